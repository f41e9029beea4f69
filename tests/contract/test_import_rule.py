"""The floors of the house: data_schemas <- hydro <- stages <- pipeline, and purity
below pipeline. Held by reading the source.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FLOORS = ("data_schemas", "hydro", "stages", "pipeline")
MODULES = sorted(path for floor in FLOORS for path in (ROOT / floor).rglob("*.py"))
HYDRO_PACKAGES = {"numpy", "scipy", "filterpy", "numba"}
SHARED_IN_STAGES = {"base", "presentation", "columns", "truth_lookup", "page"}
"""Modules of stages/ that are no stage: the interface, and what stages share."""
TOUCHES_THE_WORLD = {
    "subprocess",
    "multiprocessing",
    "socket",
    "shutil",
    "tempfile",
    "urllib",
    "requests",
    "http",
    "logging",
    "threading",
}


def name_of(path: Path) -> str:
    return str(path.relative_to(ROOT))


def executed(tree: ast.AST) -> Iterator[ast.AST]:
    """Nodes except those behind `if TYPE_CHECKING`."""
    for node in ast.iter_child_nodes(tree):
        if not (
            isinstance(node, ast.If)
            and isinstance(node.test, ast.Name)
            and node.test.id == "TYPE_CHECKING"
        ):
            yield node
            yield from executed(node)


def imports(path: Path) -> set[str]:
    """Absolute names of the modules that a file imports."""
    package = list(path.relative_to(ROOT).parent.parts)
    found: set[str] = set()
    for node in executed(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name.removeprefix("auvid.") for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = (
                ".".join(
                    [
                        *package[: len(package) - node.level + 1],
                        *([node.module] if node.module else []),
                    ]
                )
                if node.level
                else str(node.module).removeprefix("auvid.")
            )
            found |= {str(base), *(f"{base}.{alias.name}" for alias in node.names)}
    return found


def of_floor(floor: str) -> list[Path]:
    return [path for path in MODULES if path.relative_to(ROOT).parts[0] == floor]


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_each_floor_imports_only_from_below(path: Path) -> None:
    floor = FLOORS.index(path.relative_to(ROOT).parts[0])
    forbidden = {name for name in imports(path) if name.partition(".")[0] in FLOORS[floor + 1 :]}
    assert forbidden == set()


@pytest.mark.parametrize("path", of_floor("hydro"), ids=name_of)
def test_hydro_imports_only_mathematics(path: Path) -> None:
    outside = (
        {name.partition(".")[0] for name in imports(path)}
        - HYDRO_PACKAGES
        - {"hydro", "data_schemas"}
    )
    assert outside <= sys.stdlib_module_names


def stage_of(path: Path) -> str:
    """The stage that a module of stages/ belongs to: `stages/fuse.py` and
    `stages/ingest/merge.py` -> fuse, ingest.
    """
    return path.relative_to(ROOT / "stages").parts[0].removesuffix(".py")


@pytest.mark.parametrize(
    "path",
    [
        path
        for path in of_floor("stages")
        if path.name != "__init__.py" or path.parent.name != "stages"
    ],
    ids=name_of,
)
def test_stages_do_not_import_each_other(path: Path) -> None:
    own = stage_of(path)
    others = {
        name.split(".")[1]
        for name in imports(path)
        if name.startswith("stages.") and name.split(".")[1] not in (own, *SHARED_IN_STAGES)
    }
    assert others == set()


def test_what_stages_share_is_no_stage() -> None:
    from auvid.stages import STAGES

    assert not SHARED_IN_STAGES & {stage.name for stage in STAGES}


@pytest.mark.parametrize(
    "path",
    [path for path in MODULES if path.relative_to(ROOT).parts[0] in ("hydro", "stages")],
    ids=name_of,
)
def test_hydro_and_stages_touch_no_file_clock_process_or_terminal(path: Path) -> None:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    assert not {name.partition(".")[0] for name in imports(path)} & TOUCHES_THE_WORLD
    calls = {
        node.func.id
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
    }
    assert not calls & {"open", "print", "input", "exec", "eval"}
    names = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
    assert "Path" not in names
    clocks = {"now", "utcnow", "today", "perf_counter", "monotonic", "time_ns"}
    assert not clocks & {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    unseeded = [
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.Call)
        and ast.unparse(node.func).endswith("default_rng")
        and not node.args
    ]
    assert unseeded == []


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_files_say_what_they_are(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert not text or ast.get_docstring(ast.parse(text))
