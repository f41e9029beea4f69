"""Hashes of values and files; those of unchanged files are kept.

Nothing heavy is imported here: a run with nothing to do needs no more.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
import stat
import time
from dataclasses import asdict, is_dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from auvid.pipeline.store.atomic_files import write_atomically

SETTLED_S = 2.0
HASHES = ".hashes.json"
"""File of a run folder in which hashes are kept."""


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


def hash_settled_file(path: Path) -> str:
    """Return the SHA-256 of a file; one that has not changed is read once.

    The last few of this process are kept, as `FileHashes` keeps them.
    """
    status = path.stat()
    if is_young(status):
        return hash_file(path)
    stamp = (status.st_size, status.st_mtime_ns, status.st_ctime_ns, status.st_ino)
    return _hash_at(path, stamp)


@lru_cache(maxsize=256)
def _hash_at(path: Path, _: tuple[int, ...]) -> str:
    return hash_file(path)


def is_young(status: os.stat_result) -> bool:
    """Return whether a file could change again within a tick of the system's clock."""
    return time.time() - max(status.st_mtime, status.st_ctime) <= SETTLED_S


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
        if not is_young(status):
            self._known[str(path)] = [*stamp, digest]
            self._changed = True
        return digest

    def save(self) -> None:
        """Write the hashes if any changed, without those of files that are gone."""
        if self._memory is not None and self._changed:
            kept = {name: entry for name, entry in self._known.items() if os.path.exists(name)}
            write_atomically(self._memory, json.dumps(kept, sort_keys=True).encode())
            self._changed = False
