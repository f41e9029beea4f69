"""What a module is made of: the modules of auvid that it imports, and its data files.

Found in the source, not by running it. One regular expression reads a file for its
import statements and texts: parsing all of auvid takes ten times as long.
"""

from __future__ import annotations

import ast
import os
import re
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

FLOORS = ("auvid.data_schemas", "auvid.hydro", "auvid.stages")
DATA_SUFFIXES = (".yaml", ".json", ".css", ".js", ".html", ".j2", ".csv", ".svg")
TOKEN = re.compile(
    rb"""
    \#[^\n]*
    |\"\"\"[^"\\]*(?:(?:\\.|"(?!""))[^"\\]*)*\"{3}
    |\'\'\'[^'\\]*(?:(?:\\.|'(?!''))[^'\\]*)*'{3}
    |\"(?P<double>[^"\\\n]*(?:\\.[^"\\\n]*)*)"
    |\'(?P<single>[^'\\\n]*(?:\\.[^'\\\n]*)*)'
    |\n(?P<indent>[ \t]*)if[ ]TYPE_CHECKING:[^\n]*(?:\n(?P=indent)[ \t]+[^\n]*|\n[ \t]*(?=\n))*
    |\n[ \t]*(?P<statement>(?:from|import)[ \t](?:[^\n(;\#\\]|\\\n)*(?:\((?:[^)\#]|\#[^\n]*)*\))?)
    """,
    re.VERBOSE | re.DOTALL,
)
"""A comment, a text, what only type checkers see, or an import statement.

The first three are matched so that no statement is seen in them. Each begins with one
of four characters: the search for such is several times faster. A line begins with
the end of that before.
"""


@cache
def import_closure(module: str) -> dict[str, Path]:
    """Return source and data files that a module depends on, itself included, by name.

    A package's `__init__` counts only where something is imported from it.
    """
    closure: dict[str, Path] = {}
    waiting = [module]
    while waiting:
        name = waiting.pop()
        if name in closure:
            continue
        path = _source(name)
        if path is None:
            continue
        closure[name] = path
        waiting += sorted(_imports(path, name))
    data = {
        _data_name(path, name): path
        for name, source in closure.items()
        for path in _data_files(source, name)
    }
    return dict(sorted((closure | data).items()))


def _floor(module: str) -> str:
    """Return the floor of a module: `auvid.stages` of `auvid.stages.fuse.motion`.

    Outside of auvid it is the first name.
    """
    parts = module.split(".")
    return ".".join(parts[: 2 if parts[0] == "auvid" else 1])


@cache
def _floor_folder(floor: str) -> Path:
    """Return the folder of a floor, wherever it is installed."""
    spec = find_spec(floor)
    assert spec is not None
    assert spec.submodule_search_locations is not None
    return Path(next(iter(spec.submodule_search_locations))).resolve()


def _data_name(path: Path, module: str) -> str:
    folder = _floor_folder(_floor(module))
    return (Path(folder.name) / path.relative_to(folder)).as_posix()


def _source(module: str) -> Path | None:
    floor = _floor(module)
    base = "/".join(module.removeprefix(floor).split(".")[1:])
    files = _files(_floor_folder(floor))
    return files.get(f"{base}.py") or files.get(f"{base}/__init__.py".lstrip("/"))


@cache
def _files(folder: Path) -> dict[str, Path]:
    """Return sources and data files under a folder by their paths in it, in order."""
    names = [
        f"{top}/{name}"
        for top, inner, names in os.walk(folder)
        for name in names
        if name.endswith((".py", *DATA_SUFFIXES))
    ]
    return {name[len(str(folder)) + 1 :]: Path(name) for name in sorted(names)}


@dataclass(frozen=True)
class SourceScan:
    """What a source file imports (statements that run) and which data it names."""

    imports: tuple[ast.Import | ast.ImportFrom, ...]
    data_names: frozenset[str]


@cache
def scan(path: Path) -> SourceScan:
    """Return what a source file imports, wherever the statement stands, and names."""
    return scan_source(path.read_bytes())


def scan_source(source: bytes) -> SourceScan:
    """Return what `scan` does of a source."""
    statements: list[bytes] = []
    names: set[str] = set()
    for match in TOKEN.finditer(b"\n" + source):
        if match["statement"]:
            statements.append(match["statement"])
        elif text := match["double"] or match["single"]:
            name = text.decode("utf-8").rpartition("/")[2]
            if name.endswith(DATA_SUFFIXES):
                names.add(name)
    imports: list[Any] = ast.parse(b"\n".join(statements)).body
    return SourceScan(tuple(imports), frozenset(names))


@cache
def _imports(path: Path, module: str) -> frozenset[str]:
    floors = (*FLOORS, _floor(module))
    imported: set[str] = set()
    for node in scan(path).imports:
        if isinstance(node, ast.Import):
            imported |= {alias.name for alias in node.names}
            continue
        base = _absolute(node, module, path)
        if _floor(base) not in floors:
            continue
        parts = [f"{base}.{alias.name}" for alias in node.names]
        modules = [part for part in parts if _source(part) is not None]
        imported |= set(modules)
        if len(modules) < len(parts):
            imported.add(base)
    return frozenset(name for name in imported if _floor(name) in floors)


def _absolute(node: ast.ImportFrom, module: str, path: Path) -> str:
    if not node.level:
        return node.module or ""
    package = module.split(".") if path.name == "__init__.py" else module.split(".")[:-1]
    package = package[: len(package) - node.level + 1]
    return ".".join([*package, *([node.module] if node.module else [])])


def _data_files(source: Path, module: str) -> list[Path]:
    """Return data files named in a source, or in the folder of a stage."""
    top = _floor_folder(_floor(module))
    named = scan(source).data_names
    is_stage = source.parent != top and module.startswith("auvid.stages.")
    return [
        path
        for path in _folder_data(top)
        if path.name in named or (is_stage and path.is_relative_to(source.parent))
    ]


@cache
def _folder_data(top: Path) -> tuple[Path, ...]:
    return tuple(path for name, path in _files(top).items() if not name.endswith(".py"))
