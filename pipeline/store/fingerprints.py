"""Hashes of what a result depends on: files, values, schemas and code."""

from __future__ import annotations

import ast
import errno
import hashlib
import json
import os
import stat
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, is_dataclass
from functools import cache
from importlib import import_module, metadata
from pathlib import Path
from typing import Any

from auvid.data_schemas.documents import MODELS, model_of
from auvid.data_schemas.schemas import schema_text
from auvid.pipeline.store.atomic_files import write_atomically
from auvid.stages.base import Stage, ports

FLOORS = ("auvid.data_schemas", "auvid.hydro", "auvid.stages")
DATA_SUFFIXES = (".yaml", ".json", ".css", ".js", ".html", ".j2", ".csv", ".svg")
PACKAGES = ("numpy", "scipy", "pyarrow", "auvid")
STATEMENTS = (ast.stmt, ast.excepthandler, ast.match_case)
SETTLED_S = 2.0
READERS = {"vehicle": "auvid.hydro.dynamics.vehicle.from_document"}
"""What makes the value that a port delivers, where that is not the document's model."""


def hash_bytes(content: bytes) -> str:
    """Return the SHA-256 of bytes in hexadecimal."""
    return hashlib.sha256(content).hexdigest()


def hash_value(value: object) -> str:
    """Return the hash of a value of mappings, sequences, scalars and dataclasses.

    The order of keys does not matter.
    """
    return hash_bytes(json.dumps(value, sort_keys=True, default=_plain).encode())


def _plain(value: object) -> object:
    if is_dataclass(value) and not isinstance(value, type):
        return asdict(value)
    return str(value)


def hash_file(path: Path) -> str:
    """Return the SHA-256 of a file's content."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


class FileHashes:
    """File hashes, kept by size and time of change: unchanged files are read once.

    The hash of a file younger than two seconds is not kept: the file could change again
    within one tick of the file system's clock.
    """

    def __init__(self, memory: Path | None = None) -> None:
        self._memory = memory
        self._known: dict[str, list[Any]] = {}
        self._changed = False
        if memory is not None and memory.is_file():
            try:
                loaded = json.loads(memory.read_text(encoding="utf-8"))
            except (OSError, ValueError):
                loaded = {}
            self._known = loaded if isinstance(loaded, dict) else {}

    def of(self, path: Path) -> str:
        """Return the hash of a file. Raises `OSError` where it cannot be read.

        The time of the last change of its entry (ctime) counts too: an edit whose time
        was set back is noticed.
        """
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            raise OSError(errno.EINVAL, "no regular file", str(path))
        stamp = [status.st_size, status.st_mtime_ns, status.st_ctime_ns, status.st_ino]
        earlier = self._known.get(str(path))
        if isinstance(earlier, list) and earlier[:-1] == stamp:
            return str(earlier[-1])
        digest = hash_file(path)
        if time.time() - max(status.st_mtime, status.st_ctime) > SETTLED_S:
            self._known[str(path)] = [*stamp, digest]
            self._changed = True
        return digest

    def save(self) -> None:
        """Write the hashes if any changed, without those of files that are gone."""
        if self._memory is not None and self._changed:
            kept = {name: entry for name, entry in self._known.items() if os.path.exists(name)}
            write_atomically(self._memory, json.dumps(kept, sort_keys=True).encode())
            self._changed = False


@cache
def package_versions() -> dict[str, str]:
    """Return the versions of the packages that shape the numbers."""
    return {name: metadata.version(name) for name in PACKAGES}


def stage_code(stage: Stage[Any, Any, Any]) -> str:
    """Return the hash of what a result depends on besides inputs and parameters.

    That is: the stage's module, the modules of auvid that it imports directly or
    through others (found in the source, not by running it), the data files that these
    name or that lie in the stage's own folder, and the schemas of the stage's ports.
    """
    sources = {name: hash_file(path) for name, path in import_closure(stage.run.__module__).items()}
    return hash_value({"sources": sources, "schemas": stage_schemas(stage)})


def stage_schemas(stage: Stage[Any, Any, Any]) -> dict[str, str]:
    """Return the hash of the schema of every port of a stage."""
    named = {
        spec["port"] for kind in (stage.inputs, stage.outputs) for spec in ports(kind).values()
    }
    return {name: _schema_hash(name) for name in sorted(named - {"table", "raw_log"})}


@cache
def _schema_hash(name: str) -> str:
    """Hash of a schema's text, or of the code that reads a document."""
    if name not in MODELS:
        return hash_bytes(schema_text(name).encode())
    module = READERS.get(name) or model_of(name).__module__
    return hash_value({part: hash_file(path) for part, path in import_closure(module).items()})


@cache
def import_closure(module: str) -> dict[str, Path]:
    """Return source and data files that a module depends on, itself included, by name.

    A package's `__init__` counts only where something is imported from it:
    `stages/__init__.py` names all stages, and no stage depends on the others.
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
    return Path(next(iter(import_module(floor).__path__))).resolve()


def _data_name(path: Path, module: str) -> str:
    folder = _floor_folder(_floor(module))
    return (Path(folder.name) / path.relative_to(folder)).as_posix()


@cache
def _source(module: str) -> Path | None:
    floor = _floor(module)
    base = _floor_folder(floor).joinpath(*module.removeprefix(floor).split(".")[1:])
    for path in (base.with_suffix(".py"), base / "__init__.py"):
        if path.is_file():
            return path
    return None


@dataclass(frozen=True)
class _Scan:
    """What a source file imports (statements that run) and which data it names."""

    imports: tuple[ast.Import | ast.ImportFrom, ...]
    data_names: frozenset[str]


@cache
def _scan(path: Path) -> _Scan:
    imports: list[ast.Import | ast.ImportFrom] = []
    names: set[str] = set()
    source = path.read_bytes()
    # Expressions hold no imports: they are walked only where a name of data can stand.
    kinds = ast.AST if any(suffix.encode() in source for suffix in DATA_SUFFIXES) else STATEMENTS
    waiting: list[ast.AST] = [ast.parse(source, filename=str(path))]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.Import | ast.ImportFrom):
            imports.append(node)
        elif isinstance(node, ast.Constant):
            if isinstance(node.value, str) and node.value.endswith(DATA_SUFFIXES):
                names.add(node.value.rpartition("/")[2])
        elif not (
            isinstance(node, ast.If)
            and isinstance(node.test, ast.Name)
            and node.test.id == "TYPE_CHECKING"
        ):
            waiting += [child for child in ast.iter_child_nodes(node) if isinstance(child, kinds)]
    return _Scan(tuple(imports), frozenset(names))


@cache
def _imports(path: Path, module: str) -> frozenset[str]:
    floors = (*FLOORS, _floor(module))
    imported: set[str] = set()
    for node in _scan(path).imports:
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
    named = _scan(source).data_names
    is_stage = source.parent != top and module.startswith("auvid.stages.")
    return [
        path
        for path in _folder_data(top)
        if path.name in named or (is_stage and path.is_relative_to(source.parent))
    ]


@cache
def _folder_data(top: Path) -> tuple[Path, ...]:
    return tuple(
        sorted(path for path in top.rglob("*") if path.suffix in DATA_SUFFIXES and path.is_file())
    )


def fingerprint_line(stage: Stage[Any, Any, Any]) -> str:
    """Return the content of the file on which DVC depends in place of the code."""
    return f"{stage.name} {stage_code(stage)}\n"


def as_document(params: object) -> Mapping[str, Any]:
    """Return parameters as a mapping of plain values, tuples as lists."""
    document: dict[str, Any] = json.loads(json.dumps(asdict(params), default=str))  # type: ignore[call-overload]
    return document
