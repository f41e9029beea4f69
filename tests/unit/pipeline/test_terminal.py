"""Tables on the terminal and in pipes."""

from pathlib import Path

import pytest

from auvid.pipeline.terminal import path_from_here, table

ROWS = [("linear", 3, "+1.5 %", None), ("quadratic\x1b[31m", 12, "-0.25 %", "[red]text[/red]")]


def test_columns_are_aligned_and_texts_harmless(capsys: pytest.CaptureFixture[str]) -> None:
    table(("model", "rank", "change", "note"), ROWS, title="errors")
    assert capsys.readouterr().out.splitlines() == [
        "errors",
        "model      rank   change  note",
        "linear        3   +1.5 %  -",
        "quadratic    12  -0.25 %  [red]text[/red]",
    ]


def test_nothing_is_printed_without_rows(capsys: pytest.CaptureFixture[str]) -> None:
    table(("model",), [], title="errors")
    assert capsys.readouterr().out == ""


def test_a_pipe_gets_long_cells_on_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    texts = ("word " * 200).strip(), "x" * 1500
    table(("first", "second"), [texts])
    assert capsys.readouterr().out.splitlines()[1] == "  ".join(texts)


def test_path_is_relative_only_below_the_current_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert path_from_here(tmp_path / "a" / "b") == "a/b"
    assert path_from_here(Path("/elsewhere")) == "/elsewhere"
