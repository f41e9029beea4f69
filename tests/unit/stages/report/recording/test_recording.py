"""The recording: on one timeline, named and coloured as in the report, verified and
compared by Rerun's own tool.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pytest
import rerun as rr
import rerun.blueprint as rrb

from auvid.data_schemas.errors import DataError
from auvid.data_schemas.records.axes import AxisWindowsRecord
from auvid.data_schemas.tables import column, make_table
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned
from auvid.pipeline.store.pipes import saved_pieces
from auvid.stages.base import Collection
from auvid.stages.columns import VELOCITY, force_columns
from auvid.stages.page.colours import roles_of
from auvid.stages.page.first_screen import Figure, Use
from auvid.stages.report import Params, collect, render_recording, run, without_curves
from auvid.stages.report.clock import Clock, make_clock
from auvid.stages.report.recording.blueprint import (
    NO_RANGE,
    LoggedSeries,
    VisibleTabs,
    _plots,
    outer,
    with_room,
)
from auvid.stages.report.recording.readable import readable_group
from auvid.stages.report.recording.recording import (
    CLOCKS,
    MOST_COLUMNS,
    Extent,
    _edges,
    _measured,
    _pieces,
    _places,
    _rows,
    _send_groups,
    _values,
    find_table,
    parted,
)
from auvid.stages.report.recording.rerun_stream import Recording, quaternions
from auvid.stages.report.recording.text import markdown, stage_texts
from auvid.stages.report.summary.model_summary import summarise
from tests.support.example_run import ExampleRun, example_run

RERUN = Path(sys.executable).with_name("rerun")


@pytest.fixture(scope="module")
def example() -> ExampleRun:
    return example_run({"train": 6.0, "check": 3.0})


@pytest.fixture(scope="module")
def recordings(example: ExampleRun, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    files = [tmp_path_factory.mktemp("recordings") / f"{name}.rrd" for name in ("one", "two")]
    for file in files:
        run(example.inputs(), Params()).recording(str(file))
    return files


def rerun_rrd(*words: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(RERUN), "rrd", *map(str, words)],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


def test_rerun_accepts_the_recording(recordings: list[Path]) -> None:
    result = rerun_rrd("verify", recordings[0])
    assert result.returncode == 0, result.stderr


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="counts threads in /proc")
def test_a_recording_that_fails_is_ended(example: ExampleRun) -> None:
    """Left open, it would write into a pipe that is gone, and fail the next flush."""

    def damaged() -> pa.Table:
        raise DataError("the artefact is damaged")

    def threads() -> int:
        return len(list(Path("/proc/self/task").iterdir()))

    inputs, content = example.inputs(), collect(example.inputs())
    *others, last = inputs.tables
    good = {name: partial(inputs.tables.__getitem__, name) for name in others}
    tables = Collection({**good, last: damaged})
    save = partial(render_recording, replace(inputs, tables=tables), Params(), content)
    failures = []
    counts = []
    for _ in range(3):
        with pytest.raises(DataError, match="damaged") as failure:
            list(saved_pieces(save))
        failures.append(failure.traceback)  # it holds the frames, and so the stream
        counts.append(threads())
    # An open stream keeps two threads. Pools of other libraries may start one of their own.
    assert counts[-1] - counts[0] < 2 * (len(counts) - 1)


def test_two_recordings_of_one_run_compare_equal(recordings: list[Path]) -> None:
    result = rerun_rrd("compare", *recordings)
    assert result.returncode == 0, result.stderr[:2000]


def test_recording_holds_every_group_once_per_segment_and_no_wall_clock(
    recordings: list[Path],
) -> None:
    printed = rerun_rrd("print", recordings[0]).stdout
    chunks = [line for line in printed.splitlines() if line.startswith("Chunk")]
    assert sum("/state/velocity/fused - " in line and "Scalars" in line for line in chunks) == 2
    assert sum("/residual/X/models - " in line and "Scalars" in line for line in chunks) == 2, (
        "models share the clock and so the entity"
    )
    assert sum("/path/vehicle - " in line for line in chunks) == 2
    assert any("with 121 rows" in line and "/residual/X/models" in line for line in chunks), (
        "120 samples and the end of the line"
    )
    assert any("/log/events" in line for line in chunks)
    assert "log_time" not in printed
    assert "log_tick" not in printed


def test_segments_stand_at_their_place_and_logs_one_after_the_other(example: ExampleRun) -> None:
    logs = {
        "dive": example.logs["dive"],
        "next": example.logs["dive"].model_copy(
            update={"start_us": 5_000_000, "end_us": 8_000_000}
        ),
    }
    segments = {
        **example.segments,
        "later": example.segments["train"].model_copy(update={"log": "next", "leg_start_s": 1.0}),
    }
    clock = make_clock(segments, logs)
    assert clock.segments == {"train": 0.0, "check": 6.0, "later": pytest.approx(9.0 + 10.0 + 1.0)}
    events = example.tables["ingest/dive/events"]
    times = clock.seconds("ingest/next/events", events)
    assert times is not None
    assert times[0] == pytest.approx(61.0 - 5.0 + 19.0)
    assert clock.seconds("ingest/unknown/events", events) is None


def test_legs_of_single_axes_stand_at_their_place_in_their_log(example: ExampleRun) -> None:
    logs = {
        "dive": example.logs["dive"],
        "next": example.logs["dive"].model_copy(
            update={"start_us": 5_000_000, "end_us": 8_000_000}
        ),
    }
    windows = AxisWindowsRecord.model_construct(leg="pier", log="next", start_s=0.5)
    clock = make_clock({}, logs, {"pier": windows})
    table = pa.table({"t_us": np.array([5_500_000, 5_550_000])})
    times = clock.seconds("fit_axes/axis_motion/pier", table)
    np.testing.assert_allclose(times, [9.0 + 10.0 + 0.5, 9.0 + 10.0 + 0.55])
    assert clock.seconds("fit_axes/axis_motion/other", table) is None


@pytest.mark.parametrize(
    ("owner", "table", "path"),
    [
        ("fuse/train", "fused", "fuse/train/fused"),
        ("fuse/check", "resampled", "resample/check/resampled"),
        ("validate", "predictions/train", "validate/predictions/train"),
        ("validate", "fuse/train/fused", "fuse/train/fused"),
        ("validate", "resampled", None),
        ("fuse/train", "absent", None),
    ],
)
def test_view_finds_its_table(
    example: ExampleRun, owner: str, table: str, path: str | None
) -> None:
    assert find_table(example.tables, owner, table) == path


def test_quaternions_turn_as_the_euler_angles_do() -> None:
    euler = np.array([[0.1, -0.4, 2.0], [0.0, 0.0, np.pi / 2], [-3.0, 1.2, -0.7]])
    for angles, (x, y, z, w) in zip(euler, quaternions(euler), strict=True):
        expected = rotation_body_to_ned(angles)
        turned = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
            ]
        )
        np.testing.assert_allclose(turned, expected, atol=1e-12)  # rounding of products of sines


def test_text_beside_the_plots_names_the_model_and_what_fails(example: ExampleRun) -> None:
    summary = summarise(
        example.cards,
        example.ranking(),
        example.segments,
        example.logs,
        example.sections,
        example.vehicle,
        {},
    )
    words = markdown(
        "A dive \x1b[31m",
        summary,
        example.segments,
        make_clock(example.segments, example.logs).segments,
    )
    assert summary.headline in words
    last = summary.models[-1]
    chosen = replace(summary, recommended=last.name)
    rows = [row for row in markdown("", chosen, {}, {}).splitlines() if row.startswith("| ")]
    first = next(at for at, row in enumerate(rows) if row.startswith("| J/J0")) + 2
    assert rows[first].startswith(f"| {last.title} (recommended) |")
    assert "| 0.62 |" in next(row for row in words.splitlines() if row.startswith("| Linear"))
    assert "**1." in words
    assert "\x1b" not in words
    assert "- check: validation, 6.0 to 9.0 s (log dive)" in words


def test_tables_beside_the_plots_do_not_run_into_the_list_before_them(
    example: ExampleRun,
) -> None:
    summary = replace(
        summarise(
            example.cards,
            example.ranking(),
            example.segments,
            example.logs,
            example.sections,
            example.vehicle,
            {},
        ),
        uses=(Use("Simulation", "surge", "all hold"),),
        identified=(),
        figures=(Figure("glider", "C_D", "0.2", "0.1 to 0.3", "identified", ""),),
    )
    words = markdown("Glides", summary, {}, {})
    assert "- Simulation: surge\n\n| figure | value |" in words


def test_angles_are_in_degrees_depths_downwards_and_models_have_titles() -> None:
    t_s = np.array([0.0, 1.0, 2.0])
    tables = {"x/leg/flown": pa.table({"t_s": t_s, "z_m": t_s, "r_rad_s": t_s})}

    def group(entity: str, column: str, unit: str, role: str) -> dict[str, object]:
        common = {"table": "flown", "tab": "State", "names": [f"r {role}"], "roles": [role]}
        return {"entity": entity, "columns": [column], "unit": unit, **common}

    groups = [
        ("x/leg", group("state/depth", "z_m", "m", "fused")),
        ("x/leg", group("state/turn", "r_rad_s", "rad/s", "symmetric_quadratic")),
    ]
    out = SentSeries()
    titles = {"symmetric_quadratic": "Symmetric, quadratic"}
    clock = Clock({"leg": 0.0}, {}, {})
    ranges = _send_groups(cast("Recording", out), groups, tables, clock, (), titles)
    np.testing.assert_array_equal(out.values["state/depth"][:, 0], -t_s)
    np.testing.assert_allclose(out.values["state/turn"][:, 0], np.degrees(t_s))
    assert ranges["state/depth"].values == (-2.0, 0.0)
    plots = _plots(groups, groups, VisibleTabs(ranges))
    assert [str(plot.name) for plot in plots.values()] == ["depth [m, downwards]", "turn [deg/s]"]
    assert out.names == ["r fused", "r Symmetric, quadratic"]
    moments = [{"unit": unit, "columns": ["K"], "names": ["K"]} for unit in ("N*m", "N m")]
    assert {readable_group(item) for item in moments} == {(1.0, "N m")}, "one plot has both"


class SentSeries:
    """What would go into a recording."""

    def __init__(self) -> None:
        self.values: dict[str, npt.NDArray[np.float64]] = {}
        self.names: list[str] = []
        self.stream = self

    def flush(self) -> None:
        """Do nothing."""

    def static(self, _: str, lines: rr.SeriesLines) -> None:
        """Keep the names of the lines."""
        self.names += [str(name) for name in lines.names.as_arrow_array().to_pylist()]

    def columns(self, entity: str, _: object, lines: Iterable[npt.NDArray[np.float64]]) -> None:
        """Keep the values."""
        self.values[entity] = np.column_stack(list(lines))


def test_no_line_crosses_a_gap() -> None:
    times = np.array([0.0, 1.0, 2.0, 3.0, 90.0, 91.0])
    values = np.arange(12.0).reshape(6, 2)
    t_s, lines = parted(times, values.T)
    drawn = np.column_stack(list(lines))
    assert t_s.tolist() == [0.0, 1.0, 2.0, 3.0, 46.5, 90.0, 91.0]
    assert np.isnan(drawn[4]).all()
    assert np.array_equal(np.delete(drawn, 4, axis=0), values)
    assert parted(times[:1], values[:1].T)[0].tolist() == [0.0]
    glides = np.array([0.0, 20.0, 40.0, 60.0, 170.0, 190.0])
    assert parted(glides, values.T)[0].tolist() == [0.0, 20.0, 40.0, 60.0, 115.0, 170.0, 190.0]
    slow = np.array([0.0, 0.1, 0.2, 1.0, 1.1, 1.2])
    assert parted(slow, values.T)[0].size == 6, "a pause of a few steps is no gap"


def test_recording_leaves_no_global_stream_behind(example: ExampleRun) -> None:
    run(example.inputs(), Params())
    assert rr.get_global_data_recording() is None


def test_names_that_are_no_plain_words_are_recorded(tmp_path: Path) -> None:
    example = example_run({"train.1": 4.0, "ä b\x1b[31m": 2.0})
    example.campaign["title"] = "<b>|\n\x07"
    file = tmp_path / "odd.rrd"
    run(example.inputs(), Params()).recording(str(file))
    assert rerun_rrd("verify", file).returncode == 0
    printed = rerun_rrd("print", file).stdout
    assert "/path/train.1 - " in printed
    assert printed.count("/path/vehicle - ") == 2
    assert "\x1b[31m" not in printed


def test_plots_leave_room_around_what_they_show() -> None:
    assert with_room((13.0, 14.0)) == pytest.approx((12.94, 14.06))
    assert with_room((2.0, 2.0)) == pytest.approx((1.8, 2.2))
    assert with_room((0.0, 0.0)) == pytest.approx((-1e-3, 1e-3))
    assert with_room(NO_RANGE) == (-1.0, 1.0)


def test_ranges_grow_with_what_is_sent_and_leave_out_gaps() -> None:
    series = (
        LoggedSeries()
        .add(np.array([0.0, 1.0]), np.array([[np.nan], [2.0]]))
        .add(np.array([5.0, 6.0]), np.full((2, 1), np.nan))
    )
    assert series == LoggedSeries((2.0, 2.0), (0.0, 6.0))
    assert outer([]) == NO_RANGE


@pytest.fixture(scope="module")
def rich(tmp_path_factory: pytest.TempPathFactory) -> str:
    """What Rerun prints of a recording with a band, a difference and a force, and with
    tables as text.
    """
    example = example_run({"train": 6.0})
    fused = example.tables["fuse/train/fused"]
    for name in ("u", "v", "w"):
        fused = fused.append_column(f"{name}_sd_m_s", pa.array(np.full(fused.num_rows, 0.1)))
    example.tables["fuse/train/fused"] = example.fused["train"] = fused
    columns = {"t_s": column(fused, "t_s")} | dict.fromkeys(VELOCITY, np.ones(fused.num_rows))
    forces = force_columns("tau_bar")
    example.tables["residual/train/residual"] = make_table(
        "residual", columns | {name: np.full(fused.num_rows, 2.0) for name in forces}
    )
    example.views["fuse/train"]["groups"].append(
        {
            "entity": "state/velocity/band",
            "table": "fused",
            "columns": ["u_m_s"],
            "spread": ["u_sd_m_s"],
            "names": ["u"],
        }
        | {"roles": ["band"], "tab": "State", "unit": "m/s"}
    )
    example.views["validate"]["groups"].append(
        {
            "entity": "error/X/linear",
            "table": "predictions/train",
            "columns": ["tau_X_N"],
            "names": ["X linear"],
            "roles": ["linear"],
        }
        | {"tab": "Error", "unit": "N", "filter": {"model": "linear"}}
        | {"less": {"table": "residual/train/residual", "columns": ["tau_bar_X_N"]}}
    )
    file = tmp_path_factory.mktemp("rich") / "rich.rrd"
    run(example.inputs(), Params()).recording(str(file))
    return rerun_rrd("print", "-vvv", file).stdout


def test_bands_differences_forces_spans_and_tables_are_recorded(rich: str) -> None:
    for entity in (
        "state/velocity/band",
        "error/X/models",
        "path/train/forces",
        "path/vehicle/force",
        "spans/training",
        "tables/synthesise",
    ):
        assert f"/{entity} - " in rich, entity
    assert "u − 2 sd" in rich
    assert "Coefficients of Linear" in rich


def _part_of(tables: Mapping[str, pa.Table]) -> Callable[[str, Sequence[str]], pa.Table]:
    return lambda name, columns: tables[name].select(columns)


def test_band_is_two_standard_deviations_and_a_difference_is_prediction_less_measurement(
    example: ExampleRun,
) -> None:
    table = pa.table({"a": [1.0, 2.0], "sd": [0.1, 0.2]})
    band = {"columns": ["a"], "spread": ["sd"], "roles": ["band"]}
    fitted = {**band, "roles": ["fitted"]}
    edges, lines = (
        list(_values(table, group, (), _part_of(example.tables), "x")) for group in (band, fitted)
    )
    np.testing.assert_allclose(edges, [[0.8, 1.6], [1.2, 2.4]], rtol=1e-12)  # rounding
    np.testing.assert_allclose(lines, [[1.0, 2.0], [0.8, 1.6], [1.2, 2.4]], rtol=1e-12)
    extents: list[Extent] = []
    assert list(_measured(lines, _edges([fitted]), extents)) == lines
    ends = [[1.0, 2.0], [1.6, 1.6], [2.4, 2.4]]
    np.testing.assert_allclose([item.finite for item in extents], ends, rtol=1e-12)
    names = {"other/train/b": pa.table({"b": [3.0, 5.0]})}
    less = {"columns": ["a"], "less": {"table": "other/train/b", "columns": ["b"]}}
    np.testing.assert_allclose(
        list(_values(table, less, names, _part_of(names), "x")), [[-2.0, -3.0]], rtol=1e-12
    )


def test_a_recording_needs_no_points_of_the_plots(example: ExampleRun) -> None:
    sections = without_curves(example.sections)
    assert stage_texts(sections) == stage_texts(example.sections)
    assert roles_of(sections) == roles_of(example.sections)
    blocks = [block for document in sections.values() for block in document["blocks"]]
    lines = [
        line for item in blocks for panel in item.get("panels", ()) for line in panel["series"]
    ]
    assert lines
    assert not any(line["x"] or line["y"] for line in lines)


def test_columns_that_are_not_drawn_stay_on_disk(example: ExampleRun) -> None:
    def part_of(key: str, columns: Sequence[str]) -> pa.Table:
        table = example.tables[key]
        return table.select([column for column in table.column_names if column in columns])

    loaders = {key: partial(example.tables.__getitem__, key) for key in example.tables}
    loaders["validate/predictions/train"] = partial(pytest.fail, "loaded whole")
    loads: list[tuple[str, set[str]]] = []

    def counted_part(key: str, columns: Sequence[str]) -> pa.Table:
        loads.append((key, {*columns} - {*CLOCKS}))
        return part_of(key, columns)

    inputs = replace(example.inputs(), tables=Collection(loaders, counted_part))
    save = partial(render_recording, inputs, Params(), collect(example.inputs()))
    assert b"".join(saved_pieces(save))
    texts = [(key, columns) for key, columns in loads if "model" in columns]
    assert all(columns == {"model"} for _, columns in texts)  # numbers come when they are gone
    assert len(texts) == len(dict.fromkeys(key for key, _ in texts)) > 0


def test_series_of_a_log_are_read_one_by_one() -> None:
    columns = {name: np.arange(4.0) + place for place, name in enumerate("abcd")}
    table = pa.table({"time_us": np.arange(4) * 1_000_000, **columns})
    written: list[Any] = []

    def part_of(key: str, names: Sequence[str]) -> pa.Table:
        assert key == "ingest/log/imu"
        assert len({*names} & {*columns}) <= 1
        return table.select([name for name in table.column_names if name in {"time_us", *names}])

    out = SimpleNamespace(
        static=lambda *_: None,
        stream=SimpleNamespace(flush=lambda: None),
        columns=lambda entity, times, lines: written.append((entity, times, np.array(list(lines)))),
    )
    group = {"entity": "raw", "table": "imu", "columns": [*"abcd"], "names": [*"abcd"]}
    group |= {"roles": ["raw"] * 4, "tab": "Raw", "unit": "m/s"}
    tables = Collection({"ingest/log/imu": partial(pytest.fail, "loaded whole")}, part_of)
    clock = Clock(segments={}, logs={"log": 2.0}, boot_s={"log": 0.0})
    _send_groups(cast(Any, out), [("ingest/log", group)], tables, clock, ())
    ((entity, times, lines),) = written
    assert entity == "raw"
    np.testing.assert_allclose(times, np.arange(4.0) + 2.0)
    np.testing.assert_array_equal(lines, list(columns.values()))


def test_a_long_table_is_loaded_a_few_columns_at_a_time() -> None:
    """Forces of all models stand one below the other; each is loaded once for both plots."""
    columns = force_columns("tau")
    bundles = [
        (table, f"{plot}/{name}", "validate/train", [{"columns": [name], **filters}])
        for table, filters in (("a/long", {"filter": {"model": "coe"}}), ("b/short", {}))
        for plot in ("residual", "error")
        for name in columns
    ]
    pieces = _pieces(bundles)
    assert sorted(item for item, _ in pieces) == sorted(bundles)
    loads = dict.fromkeys((item[0], loaded) for item, loaded in pieces)
    forces = [(table, {*loaded} & {*columns}) for table, loaded in loads]
    assert [table for table, _ in forces] == ["a/long", "a/long", "b/short"]
    assert max(len(part) for table, part in forces if table == "a/long") == MOST_COLUMNS
    assert forces[0][1].isdisjoint(forces[1][1])
    assert all("model" not in loaded for _, loaded in loads)
    assert forces[2][1] == set(columns)


def test_rows_of_a_filter_are_those_of_the_table() -> None:
    table = pa.table({"model": ["a", "a", "b", "a"], "v": [1.0, 2.0, 3.0, 4.0]})
    groups = [{}, *({"filter": {"model": model}} for model in "abc")]
    places, rows = _places({"t": table}, "t", groups), {}
    drawn = table.select(["v"])
    for group, values in zip(
        groups, ([1.0, 2.0, 3.0, 4.0], [1.0, 2.0, 4.0], [3.0], []), strict=True
    ):
        part = _rows(drawn, group, places, rows)
        assert part["v"].to_pylist() == values
        assert _rows(drawn, group, places, rows) is part


def test_long_series_show_their_extremes_and_the_recording_says_so(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    out, words = Recording("long", bins=1000), []
    monkeypatch.setattr(out, "messages", lambda entity, rows: words.extend([entity, *rows]))
    values = np.sin(np.arange(50_000.0))[:, None]
    out.series("x", np.arange(50_000) * 0.02, values)
    out.series("y", np.arange(2000) * 0.02, values[:2000])
    out.finish(rr.blueprint.Blueprint())
    entity, (_, level, text) = words
    assert (entity, level, text[:27]) == ("log/thinned", "note", "1 group of series with more")


def test_preview_is_smaller(example: ExampleRun, tmp_path: Path) -> None:
    long = example_run({"train": 900.0})
    content = collect(long.inputs())
    preview, full = tmp_path / "preview.rrd", tmp_path / "whole.rrd"
    render_recording(long.inputs(), Params(), content, str(preview), preview=True)
    render_recording(long.inputs(), Params(), content, str(full))
    assert preview.stat().st_size < 0.8 * full.stat().st_size


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="threads as Linux counts them")
@pytest.mark.parametrize("is_saved", [True, False])
def test_a_recording_leaves_no_thread_behind(is_saved: bool, tmp_path: Path) -> None:
    """Rerun keeps two threads and megabytes for each stream that is not dropped."""

    def threads_after(recordings: int) -> int:
        for number in range(recordings):
            path = str(tmp_path / f"{number}.rrd") if is_saved else None
            out = Recording("a dive", content=number, path=path)
            out.series("depth", np.arange(100.0), np.ones((100, 3)))
            content = out.finish(rrb.Blueprint(rrb.TimeSeriesView(origin="depth")))
            assert is_saved or content.startswith(b"RRF")
        return len(list(Path("/proc/self/task").iterdir()))

    before = threads_after(1)
    assert threads_after(6) <= before
