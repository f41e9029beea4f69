"""Golden error tables: what holds, what departs and how it is named, what an update
writes, and what is refused.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any

import pytest

from auvid.data_schemas.errors import PipelineError
from auvid.pipeline import cli
from auvid.pipeline.commands.regress import changelog
from auvid.pipeline.commands.regress import golden_tables as golden
from auvid.pipeline.commands.regress import regress_command as regress
from auvid.pipeline.commands.regress.regress_command import Setting
from auvid.pipeline.output import OUTPUT
from auvid.stages.reference_check import Tolerance

AXES = "XYZKMN"
ROOT = Path(__file__).resolve().parents[4]
CHANGES = (
    "# Changelog\n\nText.\n\n## 0.2.0\n\n- fuse: new.\n  More of it.\n- validate: last.\n\n##"
    " 0.1.0\n\n- fuse: old.\n"
)


def rows(**changed: Any) -> list[dict[str, Any]]:
    """An error table of two models on both uses; `changed`: use_model_axis_field ->
    value.
    """
    lines = []
    for use in golden.USES:
        for model, n_bar, j in (("linear", 36, 2.0), ("fossen", 12, 4.0)):
            for leg in ("all", "one"):
                for axis in ("all", *AXES):
                    row = {
                        "use": use,
                        "leg": leg,
                        "model": model,
                        "axis": axis,
                        "n_bar": n_bar,
                        "rank": n_bar,
                        "rms": j,
                        "j0": 8.0,
                        "ratio": j / 8.0,
                    }
                    if leg == "one":
                        row |= {"rms": 99.0, "ratio": 9.0}
                    lines.append(row)
    for name, value in changed.items():
        use, model, axis, field = name.split("__")
        place = next(
            row
            for row in lines
            if (row["use"], row["leg"], row["model"], row["axis"]) == (use, "all", model, axis)
        )
        place[field] = value
    return lines


def tables(**changed: Any) -> dict[str, Any]:
    return golden.tables_of(rows(**changed))


@pytest.fixture
def setting(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Setting:
    """A baseline as `--update` makes it from the rows above, and a changelog."""
    monkeypatch.setattr(changelog, "current_version", lambda: "0.2.0")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "CHANGELOG.md").write_text(CHANGES)
    toy = Setting("toy", tmp_path / "golden", tmp_path / "CHANGELOG.md", tables())
    regress.update(toy, "validate: first")
    return toy


def against(setting: Setting, new: Any) -> Setting:
    return Setting(setting.campaign, setting.folder, setting.changelog, new)


def contents(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def test_layout_is_that_of_the_thesis_with_axes(setting: Setting) -> None:
    for use in golden.USES:
        lines = (setting.folder / f"{use}.csv").read_text().splitlines()
        assert lines[0] == "model,n_bar,rank,J,J0,ratio,X,Y,Z,K,M,N"
        assert lines[1] == "linear,36,36,2,8,0.25,0.25,0.25,0.25,0.25,0.25,0.25"
        assert [line.partition(",")[0] for line in lines[1:]] == ["linear", "fossen"]


def test_tables_come_back_from_their_files_to_six_digits(setting: Setting) -> None:
    new = tables(
        training__linear__all__rms=1.23456789,
        validation__fossen__K__ratio=None,
        validation__fossen__M__ratio=math.nan,
    )
    regress.update(against(setting, new), "x")
    read = golden.read_tables(setting.folder)
    assert read == new
    assert read["training"]["linear"]["J"] == 1.23457
    assert read["validation"]["fossen"]["K"] is None


def test_cells_that_hold_are_counted(setting: Setting, capsys: pytest.CaptureFixture[str]) -> None:
    assert regress.check(setting)
    assert capsys.readouterr().out.splitlines()[-1] == "toy: all 44 cells hold (golden)"


@pytest.mark.parametrize(
    ("new", "holds"),
    [(2.0099, True), (1.9901, True), (2.01, True), (2.0101, False), (1.9899, False)],
)
def test_relative_tolerance_is_half_a_per_cent_of_the_old_value(
    setting: Setting, new: float, holds: bool
) -> None:
    assert regress.check(against(setting, tables(training__linear__all__rms=new))) is holds


def test_departure_is_named_with_model_axis_old_new_tolerance(
    setting: Setting, capsys: pytest.CaptureFixture[str]
) -> None:
    capsys.readouterr()
    new = tables(
        training__fossen__K__ratio=0.6,
        validation__linear__all__rms=2.5,
        validation__linear__all__rank=35,
    )
    assert not regress.check(against(setting, new))
    lines = capsys.readouterr().out.splitlines()
    heads = "use model axis quantity reference measured unit change tolerance times tolerance"
    assert lines[0].split() == heads.split()
    rank = "validation linear all rank 36 35 -1 (-2.78 %) 0"
    assert lines[1].split() == rank.split()
    moved = "validation linear all J 2 2.5 N and N m mixed +0.5 (+25 %) 0.01 50.0"
    assert lines[2].split() == moved.split()
    ratio = "training fossen K J/J0 0.5 0.6 +0.1 (+20 %) 0.005 20.0"
    assert lines[3].split() == ratio.split()
    assert lines[-2] == "toy: 3 of 44 cells left their tolerance (golden)"
    assert "--update --message" in lines[-1]


def test_largest_departure_comes_first() -> None:
    tolerances = dict.fromkeys((*golden.FIXED[1:], *AXES), Tolerance("1", "test", relative=0.01))
    shares = {"X": 0.02, "Y": 0.5, "Z": 0.1, "M": 0.3}
    new = tables(
        **{f"training__linear__{axis}__ratio": 0.25 * (1 + share) for axis, share in shares.items()}
    )
    kept, departures = golden.compare(tables(), new, tolerances)
    assert [item.axis for item in departures] == ["Y", "M", "Z", "X"]
    assert [item.size for item in departures] == pytest.approx(
        [50.0, 30.0, 10.0, 2.0], rel=1e-4
    )  # six digits in the tables
    assert kept == 40


def test_missing_and_new_models_axes_and_uses_are_named(
    setting: Setting, capsys: pytest.CaptureFixture[str]
) -> None:
    new = tables()
    new["training"]["coe"] = new["training"].pop("linear")
    for row in new["training"].values():
        del row["N"]
    assert not regress.check(against(setting, new))
    output = capsys.readouterr().out
    assert "training: model linear: in the baseline, not in the run" in output
    assert "training: model coe: in the run, not in the baseline" in output
    assert "training: model fossen: axis N: in the baseline, not in the run" in output
    assert "0 of 32 cells left their tolerance, 3 missing or new" in output
    assert not regress.check(against(setting, {"training": tables()["training"]}))
    assert "validation tables: in the baseline, not in the run" in capsys.readouterr().out
    (setting.folder / "validation.csv").unlink()
    assert not regress.check(setting)
    assert "validation tables: in the run, not in the baseline" in capsys.readouterr().out


def test_undefined_cells_hold_only_against_undefined(
    setting: Setting, capsys: pytest.CaptureFixture[str]
) -> None:
    new = against(setting, tables(training__fossen__K__ratio=None))
    assert not regress.check(new)
    assert ["training", "fossen", "K", "J/J0", "0.5", "undefined"] in [
        line.split()[:6] for line in capsys.readouterr().out.splitlines()
    ]
    regress.update(new, "no roll moment")
    assert regress.check(new)
    assert not regress.check(setting)


def test_answer_holds_the_same(setting: Setting) -> None:
    assert regress.check(setting)
    assert OUTPUT.answer == {
        "campaign": "toy",
        "baseline": str(setting.folder),
        "holds": True,
        "held": 44,
        "first_change": None,
        "departures": [],
        "figures": [],
    }
    new = tables(training__fossen__K__ratio=0.6)
    del new["validation"]["linear"]
    assert not regress.check(against(setting, new))
    answer = OUTPUT.answer
    assert (answer["holds"], answer["held"]) == (False, 32)
    model, cell = answer["departures"]
    assert "value" not in model
    assert (model["kind"], model["use"], model["model"]) == ("missing", "validation", "linear")
    assert (cell["kind"], cell["axis"], cell["quantity"], cell["reference"], cell["value"]) == (
        "changed",
        "K",
        "J/J0",
        0.5,
        0.6,
    )
    assert (cell["allowed"], cell["times_tolerance"]) == pytest.approx((0.005, 20.0))
    regress.update(against(setting, new), "fewer models")
    assert OUTPUT.answer["written"] == [
        "golden/training.csv",
        "golden/validation.csv",
        "CHANGELOG.md",
    ]


def test_update_adds_one_line_beside_the_entries_of_the_stage(setting: Setting) -> None:
    before = CHANGES.replace(
        "- validate: last.\n", "- validate: last.\n- validate: first (golden tables of toy made)\n"
    )
    assert setting.changelog.read_text() == before
    regress.update(
        against(setting, tables(training__linear__all__rms=2.5)),
        "fuse: a lag\n of the DVL",
    )
    line = "- fuse: a lag of the DVL (golden tables of toy: 1 cell changed)\n"
    assert setting.changelog.read_text() == before.replace(
        "  More of it.\n", f"  More of it.\n{line}"
    )


def test_a_line_goes_to_what_is_unreleased_where_there_is_such_a_heading(setting: Setting) -> None:
    before = setting.changelog.read_text()
    setting.changelog.write_text(before.replace("## ", "## Unreleased\n\n- fuse: new.\n\n## ", 1))
    moved = against(setting, tables(training__linear__all__rms=2.5))
    regress.update(moved, "fuse: a lag")
    line = "- fuse: new.\n- fuse: a lag (golden tables of toy: 1 cell changed)\n\n## "
    assert line in setting.changelog.read_text()


@pytest.mark.parametrize(
    ("change", "stage"),
    [
        ({"training__linear__all__rms": 2.5}, "synthesise"),
        ({"training__linear__all__j0": 8.5}, "residual"),
        ({"training__linear__all__rank": 30}, "synthesise"),
    ],
)
def test_stage_follows_from_what_moved_unless_it_is_named(
    setting: Setting, change: dict[str, float], stage: str
) -> None:
    regress.update(against(setting, tables(**change)), "note: better")
    assert (
        f"\n- {stage}: note: better (golden tables of toy: 1 cell changed)\n"
        in setting.changelog.read_text()
    )


def test_update_without_a_change_writes_nothing(
    setting: Setting, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = contents(tmp_path)
    regress.update(setting, "again")
    assert contents(tmp_path) == before
    assert "nothing is written" in capsys.readouterr().out


def test_update_keeps_tolerances_and_takes_uses_away_that_are_gone(setting: Setting) -> None:
    path = setting.folder / "tolerances.yaml"
    path.write_text(path.read_text().replace("relative: 0.005", "relative: 0.25"))
    kept = path.read_bytes()
    regress.update(
        against(setting, {"training": tables(training__linear__all__rms=2.5)["training"]}),
        "training only",
    )
    assert path.read_bytes() == kept
    assert not (setting.folder / "validation.csv").exists()
    assert regress.check(
        against(setting, {"training": tables(training__linear__all__rms=3.0)["training"]}),
    )


def test_update_replaces_a_malformed_table(setting: Setting) -> None:
    (setting.folder / "training.csv").write_text("<<<<<<< ours\n")
    regress.update(setting, "mended")
    assert regress.check(setting)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            CHANGES.replace("0.2.0", "0.3.0"),
            (
                r"no heading for version 0\.2\.0; allowed: 0\.3\.0, 0\.1\.0\. Write a line '##"
                r" 0\.2\.0'"
            ),
        ),
        ("", r"no heading for version 0\.2\.0"),
        (None, r"changelog is not there"),
    ],
)
def test_update_is_refused_without_a_heading_and_nothing_changes(
    setting: Setting, tmp_path: Path, text: str | None, message: str
) -> None:
    setting.changelog.unlink()
    if text is not None:
        setting.changelog.write_text(text)
    before = contents(tmp_path)
    with pytest.raises(PipelineError, match=message):
        regress.update(against(setting, tables(training__linear__all__rms=2.5)), "why")
    assert contents(tmp_path) == before


def test_empty_message_is_refused(setting: Setting) -> None:
    with pytest.raises(PipelineError, match="message is empty"):
        regress.update(setting, " \n")


@pytest.mark.parametrize(
    "heading", ["## 0.2.0", "## [0.2.0] - 2026-01-31", "## v0.2.0 (unreleased)"]
)
def test_headings_in_common_forms_are_found(setting: Setting, heading: str) -> None:
    setting.changelog.write_text(f"# Changelog\n\n{heading}\n\n## 0.1.0\n")
    assert (
        changelog.with_entry(setting.changelog, "fuse", "why")
        == f"# Changelog\n\n{heading}\n\n- fuse: why\n\n## 0.1.0\n".encode()
    )


def test_update_that_cannot_finish_takes_everything_back(
    setting: Setting, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The changelog, written last, turns out not to be replaceable: the tables that
    were replaced come back.
    """
    before = contents(tmp_path)
    replace = Path.replace

    def refuse(self: Path, target: Path) -> Path:
        if target.name == "CHANGELOG.md":
            raise PermissionError(13, "Permission denied", str(self), None, str(target))
        return replace(self, target)

    monkeypatch.setattr(Path, "replace", refuse)
    new = tables(training__linear__all__rms=2.5)
    del new["validation"]
    with pytest.raises(
        PipelineError,
        match=r"CHANGELOG\.md: cannot be written: Permission denied; nothing is changed",
    ):
        regress.update(against(setting, new), "why")
    assert contents(tmp_path) == before


def test_missing_baseline_says_how_to_make_it(setting: Setting, tmp_path: Path) -> None:
    with pytest.raises(
        PipelineError,
        match=r"there are no golden tables\. Make them: auvid regress toy --update --message",
    ):
        regress.check(Setting("toy", tmp_path / "nowhere", setting.changelog, tables()))


def test_default_folder_is_that_of_the_workspace_then_of_the_campaign(tmp_path: Path) -> None:
    campaign, shared = tmp_path / "campaigns" / "toy", tmp_path / "tests" / "golden" / "toy"
    assert regress.default_folder(tmp_path, campaign) == campaign / "golden"
    shared.parent.mkdir(parents=True)
    assert regress.default_folder(tmp_path, campaign) == shared
    (campaign / "golden").mkdir(parents=True)
    assert regress.default_folder(tmp_path, campaign) == campaign / "golden"
    shared.mkdir()
    assert regress.default_folder(tmp_path, campaign) == shared


def test_departure_names_its_axis_and_figure() -> None:
    new = tables(
        training__linear__all__ratio=0.9,
        training__linear__all__j0=9.0,
        training__linear__K__ratio=1,
    )
    _, departures = golden.compare(
        tables(), new, dict.fromkeys((*golden.FIXED[1:], *AXES), Tolerance())
    )
    names = {item.column: (item.axis, item.check and item.check.quantity) for item in departures}
    assert names == {"ratio": ("all", "J/J0"), "J0": ("all", "J0"), "K": ("K", "J/J0")}


def auvid(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *words: str
) -> tuple[int, str, str]:
    monkeypatch.setattr(sys, "argv", ["auvid", *words])
    monkeypatch.setattr("signal.signal", lambda *_: None)
    with pytest.raises(SystemExit) as end:
        cli.main()
    output = capsys.readouterr()
    return int(end.value.code or 0), output.out, output.err


def test_exit_codes(
    setting: Setting, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    calls: list[tuple[str, Path | None]] = []

    def opened(campaign: str, baseline: Path | None) -> Setting:
        calls.append((campaign, baseline))
        return setting

    monkeypatch.setattr(regress, "open_setting", opened)
    capsys.readouterr()
    assert auvid(monkeypatch, capsys, "regress", "toy", "--baseline", "golden")[:2] == (
        0,
        "toy: all 44 cells hold (golden)\n",
    )
    assert calls == [("toy", Path("golden"))]
    assert auvid(monkeypatch, capsys, "regress", "toy", "--update")[0] == 2
    assert auvid(monkeypatch, capsys, "regress", "toy", "--message", "why")[0] == 2
    (setting.folder / "training.csv").write_text(
        "model,n_bar,rank,J,J0,ratio\nlinear,36,36,2,8,.25\n"
    )
    assert auvid(monkeypatch, capsys, "regress", "toy", "--json")[0] == 1
    assert auvid(monkeypatch, capsys, "regress", "toy", "--update", "--message", "back")[0] == 0
    assert auvid(monkeypatch, capsys, "regress", "toy")[0] == 0
    (setting.folder / "training.csv").write_text("model\n")
    code, _, err = auvid(monkeypatch, capsys, "regress", "toy")
    assert (code, err.count("\n")) == (1, 1)
    assert err.startswith("error: ")
