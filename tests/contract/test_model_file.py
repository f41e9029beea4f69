"""docs/model_file.md is what the models of a model file say of their fields."""

from __future__ import annotations

from pathlib import Path

import pytest

from auvid.data_schemas.records.model_file import ModelFile
from tests.support.tools import load_tool

ROOT = Path(__file__).resolve().parents[2]
tool = load_tool("model_file")


def test_the_page_is_what_the_docstrings_give() -> None:
    assert (ROOT / tool.PAGE).read_text(encoding="utf-8") == tool.page(), (
        "docs/model_file.md is out of date: run make declarations"
    )


@pytest.mark.parametrize("kind", tool._parts(ModelFile, []), ids=lambda kind: kind.__name__)
def test_every_field_says_what_it_is(kind: type[ModelFile]) -> None:
    assert all(field.description for field in kind.model_fields.values())
