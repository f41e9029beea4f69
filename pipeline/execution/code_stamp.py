"""Whether auvid's own files are those of the last look: found without reading them.

Nothing heavy is imported here: `auvid code` runs at each call of DVC.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Iterator
from pathlib import Path

from auvid.pipeline.store.atomic_files import regular_text

FILE = ".stamp"
FOLDERS = ("data_schemas", "hydro", "stages")
PRINTING = (*FOLDERS, "pipeline")
"""What the printed results depend on as well."""
ROOT = Path(__file__).resolve().parents[2]


def source_stamp(floors: Iterable[str] = FOLDERS) -> str:
    """Return the hash of names, sizes and times of the files that stages depend on."""
    lines = []
    for path in _source_paths(floors):
        status = os.stat(path)
        times = (status.st_size, status.st_mtime_ns, status.st_ctime_ns)
        lines.append(f"{path} {times}")
    return hashlib.sha256("\n".join(sorted(lines)).encode()).hexdigest()


def source_hash() -> str:
    """Return the hash of the names and contents of all of auvid's own files.

    It is the same wherever they are installed.
    """
    files = sorted((path.relative_to(ROOT).as_posix(), path) for path in source_files(PRINTING))
    digest = hashlib.sha256()
    for name, path in files:
        digest.update(name.encode() + b"\0" + hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


def source_files(floors: Iterable[str]) -> Iterator[Path]:
    """Yield the files of floors, caches left out."""
    return map(Path, _source_paths(floors))


def _source_paths(floors: Iterable[str]) -> Iterator[str]:
    for floor in floors:
        for folder, inner, names in os.walk(f"{ROOT}/{floor}"):
            inner[:] = [name for name in inner if name != "__pycache__"]
            yield from (f"{folder}/{name}" for name in names)


def hashes_of(folder: Path, names: Iterable[str]) -> dict[str, str]:
    """Return the hash of each file of these names that a folder has."""
    paths = {name: folder / name for name in names}
    return {
        name: hashlib.sha256(path.read_bytes()).hexdigest()
        for name, path in paths.items()
        if path.is_file()
    }


def unchanged(folder: Path, names: Iterable[str] | None = None) -> bool:
    """Return whether the files of code hashes in a folder are those of these sources.

    `names`: those that must be among them.
    """
    try:
        document = json.loads(regular_text(folder / FILE))
        files = document["files"]
        return bool(
            document["stamp"] == source_stamp()
            and files == hashes_of(folder, files)
            and set(names or ()) <= set(files)
        )
    except (OSError, ValueError, TypeError, KeyError):
        return False


def stamp_file(folder: Path, stamp: str, names: Iterable[str]) -> bytes:
    """Return the content of `FILE`: stamp of the sources, hashes of the files."""
    return json.dumps({"stamp": stamp, "files": hashes_of(folder, names)}).encode()
