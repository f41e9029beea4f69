"""The checked numbers in the docstrings of hydro hold."""

from __future__ import annotations

import doctest
import importlib

import pytest

from tests.support.tools import ROOT

MODULES = [
    ".".join(["auvid", *path.relative_to(ROOT).with_suffix("").parts])
    for path in sorted((ROOT / "hydro").rglob("*.py"))
    if ">>> " in path.read_text(encoding="utf-8")
]


@pytest.mark.parametrize("module", MODULES)
def test_examples_give_what_they_print(module: str) -> None:
    result = doctest.testmod(importlib.import_module(module))
    assert result.attempted > 0
    assert result.failed == 0
