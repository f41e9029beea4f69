"""The rooms of the product: few entries a folder, no circle of files, no climb."""

from __future__ import annotations

import subprocess
from typing import Any

import pytest

from tests.support.tools import ROOT, load_tool

MOST_ENTRIES = 12
ROOMS = load_tool("rooms")


@pytest.fixture(scope="module")
def folders() -> list[Any]:
    """The product folders, read in the worker that looks at them."""
    return list(ROOMS.folders(ROOT))


def test_a_folder_has_at_most_twelve_entries(folders: list[Any]) -> None:
    """Exception: `stages` itself, which has one entry a stage."""
    entries = {folder.path: len(folder.rooms) for folder in folders if folder.path != "stages"}
    assert {path: count for path, count in entries.items() if count > MOST_ENTRIES} == {}


def test_no_files_import_each_other_in_a_circle() -> None:
    assert ROOMS.circles(ROOMS.import_graph(ROOT)) == []


def test_no_room_climbs(folders: list[Any]) -> None:
    assert {folder.path: folder.climbs for folder in folders if folder.climbs} == {}


def test_circles_are_recognised() -> None:
    graph = {"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}}
    assert ROOMS.circles(graph) == [["a", "b", "c"]]


def test_unit_tests_lie_where_the_product_does() -> None:
    unit = ROOT / "tests" / "unit"
    tested = {path.parent.relative_to(unit) for path in unit.rglob("test_*.py")}
    assert [str(folder) for folder in sorted(tested) if not (ROOT / folder).is_dir()] == []


def test_the_top_of_the_repository_holds_what_belongs_there() -> None:
    """A campaign's files and a test's leftovers do not."""
    if not (ROOT / ".git").exists():
        pytest.skip("not a clone: nothing says which files belong to the repository")
    listed = subprocess.run(
        ["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True, timeout=60
    ).stdout.splitlines()
    files = {name for name in listed if "/" not in name and not name.startswith(".")}
    locks = {name for name in files if name.startswith("requirements") and name.endswith(".lock")}
    assert files - locks == {
        "CHANGELOG.md",
        "LICENSE",
        "Makefile",
        "README.md",
        "dvc.yaml",
        "params.yaml",
        "pyproject.toml",
        "setup.py",
    }
