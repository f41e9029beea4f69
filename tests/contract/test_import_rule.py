"""The floors of the house: data_schemas <- hydro <- stages, export <- pipeline, and purity
below pipeline. Held by reading the source; each test lists all offenders.
"""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterable
from functools import cache
from pathlib import Path

from auvid.pipeline.store.import_closure import scan
from auvid.stages.registry import STAGES
from tests.support import source_trees

ROOT = Path(__file__).resolve().parents[2]
FLOORS = ("data_schemas", "hydro", "stages", "export", "pipeline")
HYDRO_PACKAGES = {"numpy", "scipy", "filterpy", "numba"}
SHARED_IN_STAGES = {
    "base",
    "model_use",
    "presentation",
    "columns",
    "free_run",
    "sensor_motion",
    "steps",
    "truth_lookup",
    "reference_check",
    "number_format",
    "axis_tables",
    "few_axes",
    "card_errors",
    "form_evidence",
    "leg_record",
    "leg_streams",
    "page",
}
"""Modules of stages/ that are no stage: the interface, and what stages share."""
IMPURE_MODULES = {
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
IMPURE_CALLS = {"open", "print", "input", "exec", "eval"}
DOCSTRING = re.compile(r'(\s*#.*\n)*\s*[rR]?"""\s*[^\s"]')
CLOCKS = {"now", "utcnow", "today", "perf_counter", "monotonic", "time_ns"}
PERHAPS_IMPURE = re.compile(
    rf"\b({'|'.join(IMPURE_CALLS)})\(|\bPath\b|\.({'|'.join(CLOCKS)})\b|default_rng"
)
"""What stands in every text that touches one of these: only such are parsed."""


def modules(*floors: str) -> list[Path]:
    return sorted(path for floor in floors for path in (ROOT / floor).rglob("*.py"))


def tree_of(path: Path) -> ast.Module:
    return source_trees.tree_of(path.read_text(encoding="utf-8"))


def imported(nodes: Iterable[ast.AST], package: tuple[str, ...]) -> set[str]:
    """Return the absolute names, without `auvid.`, that statements of `package` import."""
    names: set[str] = set()
    for node in nodes:
        if isinstance(node, ast.Import):
            names |= {alias.name.removeprefix("auvid.") for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else ()
            base = ".".join([*above, *([node.module] if node.module else [])])
            base = base.removeprefix("auvid.")
            names |= {base, *(f"{base}.{alias.name}" for alias in node.names)}
    return names


@cache
def imports_of(path: Path) -> set[str]:
    """Return what a file imports, as the scan that hashes code sees it: test_import_closure."""
    return imported(scan(path).imports, path.relative_to(ROOT).parent.parts)


def top_names(path: Path) -> set[str]:
    return {name.partition(".")[0] for name in imports_of(path)}


def stage_of(path: Path) -> str:
    """Return the stage of a module: `stages/fuse.py`, `stages/ingest/x.py` -> fuse, ingest."""
    return path.relative_to(ROOT / "stages").parts[0].removesuffix(".py")


def other_stages(path: Path) -> set[str]:
    """Return the stages, other than its own, that a module of stages/ imports."""
    names = {name.split(".")[1] for name in imports_of(path) if name.startswith("stages.")}
    return names - {stage_of(path), *SHARED_IN_STAGES}


def impurities(tree: ast.AST) -> set[str]:
    """Return the calls and names that touch a file, the terminal, a clock or chance."""
    names: set[str] = set()
    for node in ast.walk(tree):
        match node:
            case ast.Call(func=ast.Name(id=name)) if name in IMPURE_CALLS:
                names.add(name)
            case ast.Name(id="Path"):
                names.add("Path")
            case ast.Attribute(attr=name) if name in CLOCKS:
                names.add(name)
            case ast.Call(args=[]) if ast.unparse(node.func).endswith("default_rng"):
                names.add("default_rng without a seed")
    return names


def offenders(names_by_file: dict[Path, set[str]]) -> dict[str, set[str]]:
    return {str(path.relative_to(ROOT)): names for path, names in names_by_file.items() if names}


def test_each_floor_imports_only_from_below() -> None:
    for floor, name in enumerate(FLOORS):
        above = set(FLOORS[floor + 1 :])
        assert offenders({path: top_names(path) & above for path in modules(name)}) == {}


def test_export_imports_no_stage() -> None:
    assert offenders({path: top_names(path) & {"stages"} for path in modules("export")}) == {}


def test_hydro_imports_only_mathematics() -> None:
    allowed = HYDRO_PACKAGES | {"hydro", "data_schemas"} | sys.stdlib_module_names
    assert offenders({path: top_names(path) - allowed for path in modules("hydro")}) == {}


def test_stages_do_not_import_each_other() -> None:
    paths = [path for path in modules("stages") if path != ROOT / "stages" / "registry.py"]
    assert offenders({path: other_stages(path) for path in paths}) == {}
    assert not SHARED_IN_STAGES & {stage.name for stage in STAGES}


def test_hydro_and_stages_touch_no_file_clock_process_or_terminal() -> None:
    paths = modules("hydro", "stages")
    assert offenders({path: top_names(path) & IMPURE_MODULES for path in paths}) == {}
    suspects = [path for path in paths if PERHAPS_IMPURE.search(path.read_text(encoding="utf-8"))]
    assert offenders({path: impurities(tree_of(path)) for path in suspects}) == {}


def test_every_file_has_a_docstring() -> None:
    paths = [path for path in modules(*FLOORS) if path.stat().st_size]
    assert [path for path in paths if not DOCSTRING.match(path.read_text(encoding="utf-8"))] == []


def test_benchmarks_and_tests_are_independent() -> None:
    tests, benchmarks = modules("tests"), modules("benchmarks")
    assert offenders({path: top_names(path) & {"benchmarks"} for path in tests}) == {}
    assert offenders({path: top_names(path) & {"tests"} for path in benchmarks}) == {}
    assert offenders({path: top_names(path) & {"tests"} for path in modules(*FLOORS)}) == {}


def test_the_rules_see_what_they_forbid() -> None:
    package = ("hydro", "dynamics")
    source = """
from typing import TYPE_CHECKING
import auvid.stages.fuse, os.path
from ..control import riccati
from . import arrays
from auvid.data_schemas.errors import DataError
if TYPE_CHECKING:
    from auvid.pipeline import runner
"""
    names = imported(source_trees.executed(ast.parse(source)), package)
    assert {"stages.fuse", "os.path", "hydro.control.riccati", "hydro.dynamics.arrays"} <= names
    assert "data_schemas.errors.DataError" in names
    assert not any(name.startswith("pipeline") for name in names)
    source = "open(p); Path('x'); time.monotonic(); np.random.default_rng(); default_rng(3)"
    assert impurities(ast.parse(source)) == {
        "open",
        "Path",
        "monotonic",
        "default_rng without a seed",
    }
    assert all(PERHAPS_IMPURE.search(part) for part in source.split("; "))
