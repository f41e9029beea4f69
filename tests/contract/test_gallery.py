"""The gallery shows what its list of cases says: a page for each, with the command and
a picture that is small and not empty.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from auvid.data_schemas.errors import CampaignError
from auvid.pipeline.commands.look.inspect import gallery
from tests.support.pictures import look

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / gallery.FOLDER
CASES = gallery.read_cases(FOLDER)


def test_index_leads_to_every_case() -> None:
    assert (FOLDER / gallery.PAGE).read_text(encoding="utf-8") == gallery.index_of(CASES)
    assert {path.parent.name for path in FOLDER.glob("*/*.md")} == set(CASES)


@pytest.mark.parametrize("name", CASES)
def test_page_is_that_of_the_list_and_its_picture_shows_something(name: str) -> None:
    case = CASES[name]
    assert (FOLDER / name / gallery.PAGE).read_text(encoding="utf-8") == gallery.page_of(case)
    assert (ROOT / "campaigns" / case["target"] / "campaign.yaml").is_file()
    picture = look(FOLDER / name / gallery.PICTURE)
    assert picture.bytes <= gallery.MAX_BYTES
    assert picture.colours > 30, "an empty viewer has a handful of greys"
    assert 1 <= len(re.findall(r"[.:;](?:\s|$)", str(case["see"]))) <= 4, "two sentences"


def test_mistakes_in_the_list_are_named(tmp_path: Path) -> None:
    (tmp_path / gallery.CASES).write_text("- {id: a, title: A, target: x, se: words}\n")
    with pytest.raises(CampaignError, match="Did you mean 'see'"):
        gallery.read_cases(tmp_path)
    (tmp_path / gallery.CASES).write_text("- {id: a, title: A, target: x}\n")
    with pytest.raises(CampaignError, match="missing key"):
        gallery.read_cases(tmp_path)
