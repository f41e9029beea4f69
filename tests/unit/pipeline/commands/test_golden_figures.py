"""Golden figures: what is kept of tables, estimates and free runs, what departs, and
which stage is named.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pyarrow as pa
import pytest

from auvid.data_schemas.errors import CampaignError
from auvid.pipeline.commands.regress import golden_figures as figures
from auvid.pipeline.commands.regress.golden_figures import READERS, GoldenFigure, Key


def read(schema: str, document: Any, item: str = "fossen") -> dict[tuple[str, str], GoldenFigure]:
    """What is kept of one document of a schema."""
    return dict(READERS[schema][1](iter([(item, document)])))


def row(quantity: str, value: float | None, **more: Any) -> dict[str, Any]:
    return {"quantity": quantity, "value": value, "unit": "kg", **more}


FUSED: Key = ("fuse", "fused", "u_m_s")
FORCE: Key = ("residual", "residual", "tau_x_n")
DRAG: Key = ("synthesise", "fossen", "X u")
BASE: dict[str, dict[Key, GoldenFigure]] = {
    "stages": {FUSED: GoldenFigure(0.1, 0.5, "m/s"), FORCE: GoldenFigure(-2.0, 4.0, "N")},
    "coefficients": {DRAG: GoldenFigure(-60.0, 10.0, "N s/m", "identified")},
    "free_run": {},
    "results": {},
}


def changed(file: str, key: Key, **values: Any) -> dict[str, dict[Key, GoldenFigure]]:
    """The figures above with one that differs."""
    return {**BASE, file: {**BASE[file], key: dataclasses.replace(BASE[file][key], **values)}}


def test_columns_are_kept_as_mean_and_rms_over_all_items() -> None:
    parts = [
        pa.table({"t_s": [0.0], "u_m_s": [3.0]}),
        pa.table({"t_s": [1.0, 2.0], "u_m_s": [float("nan"), -4.0]}),
    ]
    columns = dict(figures._columns("fused", iter([("a", parts[0]), ("b", parts[1])])))
    assert columns["rows"].value == 3.0
    assert columns["u_m_s"] == GoldenFigure(-0.5, 3.53553, "m/s")
    gaps = {name: figure.value for name, figure in columns.items() if "not finite" in name}
    assert gaps == {"u_m_s not finite": 1.0}


def test_rows_that_are_left_out_do_not_count() -> None:
    table = pa.table({"trajectory": ["helix", "saw_tooth"], "x_m": [1.0, 9.0]})
    columns = dict(figures._columns("tracking_errors", iter([("control", table)]), ["saw_tooth"]))
    assert columns["rows"].value == 1.0
    assert columns["x_m"].value == 1.0


def test_what_is_left_out_has_a_reason(tmp_path: Path) -> None:
    assert figures.left_out(tmp_path) == ()
    (tmp_path / figures.LEFT_OUT).write_text("saw_tooth: it amplifies rounding\n")
    assert figures.left_out(tmp_path) == ("saw_tooth",)
    (tmp_path / figures.LEFT_OUT).write_text("- saw_tooth\n")
    with pytest.raises(CampaignError, match="names with reasons"):
        figures.left_out(tmp_path)


def test_a_table_with_verdicts_gives_no_columns() -> None:
    table = pa.table({"ours": [1.0e9], "verdict": ["weak"]})
    assert list(figures._columns("comparison", iter([("campaign", table)]))) == []


@pytest.mark.parametrize(
    ("verdict", "kept"),
    [("identified", True), ("weak", False), ("not excited", False), ("at its bound", False)],
)
def test_a_coefficient_keeps_its_number_where_it_is_identified(verdict: str, kept: bool) -> None:
    term = {"term": "u", "unit": "N", "value": -3.0, "standard_error": 0.5, "verdict": verdict}
    means = read("model_card", {"axes": {"X": {"terms": [term]}}, "inertia": []})
    assert means == {
        ("fossen", "X u"): GoldenFigure(-3.0 if kept else None, 0.5 if kept else None, "N", verdict)
    }


def test_errors_of_a_fit_with_undetermined_terms_stay_out() -> None:
    rows = [
        row("mass (linear)", 5.0, verdict="identified", standard_error=0.1),
        row("rmse (linear)", 0.2),
        row("mass (both)", 5.0, verdict="weak", standard_error=9.0),
        row("rmse (both)", 1.0e9),
        row("rmse", 0.1),
    ]
    means = read("results", {"title": "surge", "rows": rows})
    values = {quantity: figure.value for (_, quantity), figure in means.items()}
    assert values == {
        "mass (linear)": 5.0,
        "rmse (linear)": 0.2,
        "mass (both)": None,
        "rmse (both)": None,
        "rmse": 0.1,
    }
    assert means["surge", "mass (both)"].verdict == "weak"


def runs(starts: int, diverged: int, error: float) -> dict[str, Any]:
    errors = {name: error for columns in figures.MOTIONS.values() for name in columns}
    run = {"model": "fossen", "as_measured": "", "horizon_s": 5.0}
    return {**run, "starts": starts, "diverged": diverged, **errors}


def test_free_runs_are_weighted_by_their_number_and_counted_where_they_diverge() -> None:
    def figure(*rows: dict[str, Any]) -> GoldenFigure:
        return read("free_run", pa.Table.from_pylist(list(rows)))["fossen", "velocity after 5 s"]

    assert figure(runs(1, 0, 1.0), runs(3, 0, 3.0)) == GoldenFigure(4.58258, None, "m/s", "bounded")
    assert figure(runs(1, 0, 1.0), runs(3, 2, 3.0)) == GoldenFigure(
        None, None, "m/s", "2 of 4 diverged"
    )
    nan = float("nan")
    most = figure(runs(3, 0, 1.0), runs(4, 1, 3.0), runs(1, 1, nan))
    assert most == GoldenFigure(3.87298, None, "m/s", "2 of 8 diverged")


def test_what_is_written_is_read_back(tmp_path: Path) -> None:
    for name in ("stages", "coefficients"):
        (tmp_path / f"{name}.csv").write_bytes(figures.to_csv(BASE[name]))
    assert figures.read_figures(tmp_path) == BASE


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("stage,of\nfuse,fused\n", "heading"),
        (",".join(figures.HEADER) + "\nfuse,fused,u,,1.0\n", "not a row"),
        (",".join(figures.HEADER) + "\nfuse,fused,u,,one,,m/s\n", "not a row"),
    ],
)
def test_a_malformed_file_is_refused(tmp_path: Path, text: str, fault: str) -> None:
    (tmp_path / "stages.csv").write_text(text)
    with pytest.raises(CampaignError, match=fault):
        figures.read_figures(tmp_path)


def shares() -> Iterator[tuple[str, Key, float, float]]:
    """File, key, scale, and the share of it that a number may move by."""
    tolerances = figures.tolerances()
    yield "stages", FUSED, 0.5, tolerances["stages"].relative
    yield "coefficients", DRAG, 10.0, tolerances["coefficients"].relative


@pytest.mark.parametrize(("file", "key", "scale", "share"), list(shares()))
@pytest.mark.parametrize(("part", "departs"), [(0.9, False), (1.1, True), (-1.1, True)])
def test_the_tolerance_is_a_share_of_the_scale(
    file: str, key: Key, scale: float, share: float, part: float, departs: bool
) -> None:
    for field in ("value", "scale"):
        new = getattr(BASE[file][key], field) + part * share * scale
        _, departures = figures.compare(BASE, changed(file, key, **{field: new}))
        assert [item.column for item in departures] == [key[2]] * departs


def test_a_verdict_that_changes_departs() -> None:
    new = changed("coefficients", DRAG, value=None, scale=None, verdict="weak")
    within, (departure,) = figures.compare(BASE, new)
    assert departure.check is not None
    assert departure.check.cells["status"] == "identified -> weak"
    assert within == 4


def column_of(*values: float) -> dict[str, dict[Key, GoldenFigure]]:
    """The figures of a fused table whose only column is a velocity."""
    table = pa.table({"u_m_s": list(values)})
    columns = figures._columns("fused", iter([("a", table)]))
    return {"stages": {("fuse", "fused", name): figure for name, figure in columns}}


NAN = float("nan")


@pytest.mark.parametrize(
    ("before", "after", "counts"),
    [
        ((3.0, 1.0, 3.0, 1.0), (3.0, 1.0, NAN, NAN), (0.0, 2.0)),
        ((3.0, 1.0, NAN, NAN), (3.0, 1.0, 3.0, 1.0), (2.0, 0.0)),
        ((3.0, 1.0, NAN, NAN), (3.0, 3.0, 1.0, NAN), (2.0, 1.0)),
    ],
)
def test_gaps_in_a_column_depart_at_the_same_mean_and_rms(
    before: tuple[float, ...], after: tuple[float, ...], counts: tuple[float, float]
) -> None:
    _, departures = figures.compare(column_of(*before), column_of(*after))
    checks = {item.column: item.check for item in departures}
    check = checks["u_m_s not finite"]
    assert check is not None
    assert (check.reference, check.value) == counts
    if 0.0 in counts:
        assert list(checks) == ["u_m_s not finite"]


def test_one_gap_in_a_long_column_departs() -> None:
    ones = [1.0] * 100_000
    within, (departure,) = figures.compare(column_of(*ones), column_of(*ones[1:], NAN))
    assert departure.column == "u_m_s not finite"
    assert within == 3


def test_a_scale_that_comes_or_goes_departs() -> None:
    gone = changed("coefficients", DRAG, scale=None)
    for old, new in ((BASE, gone), (gone, BASE)):
        _, (departure,) = figures.compare(old, new)
        assert departure.check is not None
        assert departure.check.quantity == "scale of X u"


def test_runs_that_stay_are_compared_where_the_file_holds_their_number() -> None:
    key = ("validate", "fossen", "velocity after 5 s")

    def file(value: float | None, verdict: str = "1 of 10 diverged") -> figures.Figures:
        return {"free_run": {key: GoldenFigure(value, None, "m/s", verdict)}}

    for old, new, departs in (
        (file(None), file(0.2), False),
        (file(0.2), file(0.2), False),
        (file(0.2), file(0.21), True),
        (file(0.2), file(None), True),
        (file(None), file(0.2, "2 of 10 diverged"), True),
        (file(None, "bounded"), file(0.2, "bounded"), True),
    ):
        _, departures = figures.compare(old, new)
        assert len(departures) == departs


def test_the_first_stage_of_the_chain_is_named() -> None:
    new = changed("coefficients", DRAG, value=-70.0)
    new["stages"] = {**BASE["stages"], FORCE: GoldenFigure(-2.5, 4.0, "N")}
    _, departures = figures.compare(BASE, new)
    assert figures.first_change(departures) == "stage residual (residual: tau_x_n, by -0.5 N)"
    assert [item.stage for item in departures] == ["residual", "synthesise"]
    assert figures.first_change([]) == ""


def test_what_only_one_side_has_is_named() -> None:
    fewer = {**BASE, "stages": {FORCE: BASE["stages"][FORCE]}}
    for old, new, kind in ((BASE, fewer, "missing"), (fewer, BASE, "new")):
        _, (departure,) = figures.compare(old, new)
        assert (departure.kind, departure.stage, departure.check) == (kind, "fuse", None)
