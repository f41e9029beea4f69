"""Text that is no YAML is refused with the line that is wrong, the cause and the remedy."""

from __future__ import annotations

from pathlib import Path

import pytest

from auvid.data_schemas.errors import CampaignError
from auvid.pipeline.campaigns.yaml_files import load_yaml

FAULTS = {
    "tab": ("kind: x\nlogs:\n\t- {id: a}\n", 3, "a tab indents the line"),
    "list by one space less": (
        "logs:\n  - {id: a}\n - {id: b}\n",
        3,
        "indented by 1 spaces; lines above it by 0, 2",
    ),
    "mapping by one space less": (
        "legs:\n  - id: a\n    log: b\n   use: training\n",
        4,
        "indented by 3 spaces; lines above it by 0, 2, 4",
    ),
    "deeper than its fellows": ("kind: x\n vehicle: rov\n", 2, "that has its value already"),
    "second colon": ("title: a dive: the first\n", 1, "a second colon"),
    "no space": ("kind:identification\nvehicle: rov\n", 1, "no space behind the colon"),
    "brace": ("logs:\n  - {id: a, file: b\nlegs: []\n", 2, "'{' of this line is not closed"),
    "quote": ("title: 'abc\nkind: x\n", 1, "is not closed"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_the_line_the_cause_and_the_remedy(name: str, tmp_path: Path) -> None:
    text, row, words = FAULTS[name]
    (tmp_path / "a.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(CampaignError) as caught:
        load_yaml(tmp_path / "a.yaml")
    assert caught.value.row == row
    assert words in str(caught.value)
    assert caught.value.value == text.splitlines()[row - 1].strip()
    assert caught.value.remedy


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "latin-1"])
def test_text_of_another_encoding_is_refused_with_the_remedy(encoding: str, tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text("kind: x\ntitle: Föhr\n", encoding=encoding)
    with pytest.raises(CampaignError, match=r"a\.yaml.*UTF-\d.* Save the file as UTF-8"):
        load_yaml(path)


def test_a_file_of_zeros_is_no_text_of_another_encoding(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_bytes(bytes(300))
    with pytest.raises(CampaignError, match=r"zero bytes.*Write it again"):
        load_yaml(path)
