"""Golden tables and tolerances as files: what is read, what is refused and how it is
named, and those of the repository.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from auvid.data_schemas.errors import CampaignError, PipelineError, SchemaError
from auvid.data_schemas.yaml_text import read_yaml
from auvid.pipeline.commands.regress import golden_figures as figures
from auvid.pipeline.commands.regress import golden_tables as golden

AXES = "XYZKMN"
COLUMNS = (*golden.FIXED[1:], *AXES)
ROOT = Path(__file__).resolve().parents[4]
HEAD = "model,n_bar,rank,J,J0,ratio,X,Y,Z,K,M,N"
GOOD = "linear,36,36,2,8,.25,1,1,1,1,1,1"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            f"{HEAD}\n{GOOD}\nfossen,12,12,two,8,.5,1,1,1,1,1,1\n",
            r"training\.csv, row 3, field 'J': not a number; found 'two'",
        ),
        (
            f"{HEAD}\n{GOOD}\nfossen,12,12,2,8,.5,1,1,1,1\n",
            r"row 3: 10 cells under 12 headings; found 'fossen'",
        ),
        (
            f"{HEAD}\n{GOOD}\n{GOOD}\n",
            r"row 3, field 'model': each row needs a model of its own; found 'linear'",
        ),
        (
            f"{HEAD}\nlinear,36.5,36,2,8,.25,1,1,1,1,1,nan\n",
            r"(?s)2 faults.*field 'n_bar': a count.*field 'N': not a finite number",
        ),
        (
            f"{HEAD}\nlinear,36,36,,8,.25,1,1,1,1,1,1\n",
            r"row 2, field 'J': this cell may not be empty",
        ),
        (
            f"{HEAD}\nlinear,36,36,-1,8,.25,1,1,1,1,1,1\n",
            r"row 2, field 'J': not a finite number of at least 0",
        ),
        (f"{HEAD}\n", r"a header and at least one model"),
        ("", r"a header and at least one model"),
        (
            f"model,n_bar,rank,J,ratio,X\n{GOOD}\n",
            r"row 1, field 'J0': not the heading that stands here; found 'ratio'",
        ),
        (
            f"{HEAD},X\n{GOOD},1\n",
            r"row 1, field 'column 13': each column needs a heading of its own; found 'X'",
        ),
        (f'{HEAD}\n"linear"x,36\n', r"row 2: not valid CSV"),
        (b"model\n\xff\n", r"row 2: not UTF-8 text"),
    ],
)
def test_malformed_table_is_refused_with_file_row_and_field(
    tmp_path: Path, text: str | bytes, message: str
) -> None:
    (tmp_path / "training.csv").write_bytes(text.encode() if isinstance(text, str) else text)
    with (
        pytest.raises(CampaignError, match=message)
        if "faults" not in message
        else pytest.raises(PipelineError, match=message)
    ):
        golden.read_tables(tmp_path)


def test_spreadsheet_leavings_are_read(tmp_path: Path) -> None:
    """A byte order mark, carriage returns and an empty last line, as spreadsheets leave
    them.
    """
    (tmp_path / "training.csv").write_bytes(
        b"\xef\xbb\xbf" + f"{HEAD}\n{GOOD}\n\n".replace("\n", "\r\n").encode()
    )
    document = golden.read_tables(tmp_path)["training"]["linear"]
    assert list(document.items())[:6] == [
        ("n_bar", 36.0),
        ("rank", 36.0),
        ("J", 2.0),
        ("J0", 8.0),
        ("ratio", 0.25),
        ("X", 1.0),
    ]


def test_misnamed_table_is_refused(tmp_path: Path) -> None:
    (tmp_path / "validaton.csv").write_text(f"{HEAD}\n{GOOD}\n")
    with pytest.raises(CampaignError, match=r"Did you mean 'validation\.csv'"):
        golden.read_tables(tmp_path)


@pytest.mark.parametrize(
    ("change", "kind", "message"),
    [
        (
            lambda document: document["columns"].pop("K"),
            CampaignError,
            r"field 'columns\.K': no tolerance for this column",
        ),
        (
            lambda document: document["columns"].update(ration=document["columns"].pop("ratio")),
            PipelineError,
            "Did you mean 'ratio'",
        ),
        (
            lambda document: document["columns"].update(Q=document["columns"]["K"]),
            CampaignError,
            r"columns\.Q': no such column",
        ),
        (
            lambda document: document["columns"]["J"].pop("relative"),
            CampaignError,
            r"columns\.J': needs relative, absolute or both",
        ),
        (
            lambda document: document["columns"]["J"].update(relative=-0.1),
            SchemaError,
            r"columns\.J\.relative': out of range; found -0\.1",
        ),
        (
            lambda document: document["columns"]["J"].update(relative=math.nan),
            SchemaError,
            r"columns\.J\.relative': not finite; found nan",
        ),
        (
            lambda document: document["columns"]["J"].update(relativ=0.1),
            SchemaError,
            "Did you mean 'relative'",
        ),
        (
            lambda document: document["columns"]["J"].pop("reason"),
            SchemaError,
            r"columns\.J\.reason': missing key",
        ),
    ],
)
def test_tolerances_are_checked(
    tmp_path: Path, change: Callable[[Any], object], kind: type[PipelineError], message: str
) -> None:
    path = tmp_path / "tolerances.yaml"
    with pytest.raises(PipelineError, match=r"tolerances\.yaml: tolerances is not there"):
        golden.read_tolerances(path, COLUMNS)
    document = read_yaml(
        (ROOT / "pipeline" / "commands" / "regress" / "default_tolerances.yaml").read_text()
    )
    document["columns"] = {name: dict(entry) for name, entry in document["columns"].items()}
    change(document)
    path.write_text(yaml.safe_dump(document))
    with pytest.raises(kind, match=message):
        golden.read_tolerances(path, COLUMNS)


GOLDEN = sorted((ROOT / "tests" / "golden").iterdir())


@pytest.mark.parametrize("folder", GOLDEN, ids=lambda path: path.name)
def test_golden_figures_of_the_repository_are_well_formed(folder: Path) -> None:
    for name, read in figures.read_figures(folder).items():
        path = folder / f"{name}.csv"
        assert (path.read_bytes() if path.is_file() else b"") == (
            figures.to_csv(read) if read else b""
        )


@pytest.mark.parametrize(
    "folder",
    [folder for folder in GOLDEN if (folder / "training.csv").is_file()],
    ids=lambda path: path.name,
)
def test_golden_tables_of_the_repository_are_well_formed(folder: Path) -> None:
    read = golden.read_tables(folder)
    tolerances = golden.read_tolerances(folder / golden.TOLERANCES, golden.columns_of(read))
    assert golden.columns_of(read) == [*golden.FIXED[1:], *AXES]
    for name in golden.COUNTS:
        assert tolerances[name].allowed(100.0) == 0.0
    for use, table in read.items():
        assert golden.to_csv(table) == (folder / f"{use}.csv").read_bytes()
        for row in table.values():
            n_bar, rank, j, j0 = (float(row[name] or 0.0) for name in golden.NEVER_EMPTY)
            assert row["ratio"] == pytest.approx(j / j0, rel=2e-5)  # three figures of six digits
            assert 0 < rank <= n_bar
