"""Logs on a disk: files below a folder or of a list, by content, dive by dive."""

from __future__ import annotations

import fnmatch
import json
import os
import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from auvid.data_schemas.errors import PipelineError, UsageError
from auvid.pipeline.campaigns.workspace import vehicle_file_of
from auvid.pipeline.commands.fleet.fleet_folder import FleetFolder
from auvid.pipeline.commands.fleet.surveys.csv_dives import Grouping
from auvid.pipeline.store.atomic_files import write_atomically
from auvid.pipeline.store.file_hashes import FileHashes, hash_file, hash_value
from auvid.stages.ingest.registry import HEAD_BYTES, READERS

LOG_SUFFIXES = (".bin", ".log", ".tlog", ".ulg", ".csv")
"""Files with these names are logs, damaged or not; others where their bytes say so."""
TABLE_SUFFIXES = (".csv", ".tsv")
"""Several of these in a folder may be of one dive."""
HEADER_BYTES = 4096
GROUPS = ".csv_files.json"
READING_THREADS = 4
NO_TEXT = "its path is not UTF-8, so that no campaign can name it: rename the file or folder"
FOLDER = "is a folder: name its logs in the list, or give it in place of the list"
STEM_LETTERS, HASH_DIGITS = 60, 8


@dataclass(frozen=True)
class FleetLog:
    """One log on the disk: id, files, hash of their content, size and time of each.

    `vehicle`: the file of the vehicle that the call names for it. `fault`: why its files
    cannot be read. `copy_of`: id of a log with the same content.
    """

    id: str
    files: tuple[Path, ...]
    hash: str
    stamps: tuple[tuple[int, int], ...]
    vehicle: str | None = None
    fault: str = ""
    copy_of: str = ""

    @property
    def paths(self) -> tuple[str, ...]:
        """Its files in full, in letters that can be written."""
        return tuple(readable_name(path.absolute()) for path in self.files)

    @property
    def unchanged(self) -> bool:
        """Return whether its files have the size and time of when they were hashed."""
        try:
            return tuple(map(stamp_of, self.files)) == self.stamps
        except OSError:
            return False


@dataclass(frozen=True)
class Discovery:
    """The logs of a disk, and the number of other files by the end of their name."""

    logs: tuple[FleetLog, ...]
    others: Mapping[str, int]


def readable_name(path: Path | str) -> str:
    """Return a path with a sign of doubt for each byte of it that is no UTF-8."""
    return os.fsencode(path).decode("utf-8", "replace")


def stamp_of(path: Path) -> tuple[int, int]:
    """Return size and time of the last change of a file."""
    status = path.stat()
    return status.st_size, status.st_mtime_ns


def discover(
    target: Path,
    fleet: FleetFolder,
    vehicles: Sequence[str],
    hashes: FileHashes,
    group: Grouping,
) -> Discovery:
    """Return the logs below a folder, or those that a list names, sorted by path.

    `vehicles`: `NAME` for all, or `PATTERN=NAME` for paths that match. `group` tells which
    CSV files are of one dive. Raises `PipelineError` for a target that is not there,
    `UsageError` for a vehicle.
    """
    named = [_vehicle_rule(words) for words in vehicles]
    base = target.expanduser()
    others: Counter[str] = Counter()
    if base.resolve() == fleet.root:
        raise UsageError(
            "is the folder of the logs: another one must take what is made",
            field="--out",
            value=str(fleet.root),
        )
    if base.is_dir():
        paths = sorted(_below(base, fleet.root, others))
    elif base.is_file():
        paths = [base] if _is_log(base) else _listed(base)
    else:
        raise PipelineError("there is no such folder or list of logs", file=target)
    if not paths:
        there = ", ".join(f"{count} {suffix}" for suffix, count in sorted(others.items()))
        raise PipelineError(
            "there is no log here",
            file=target,
            value=there or "no file",
            remedy="Is the disk there? The fleet stays as it was.",
        )
    dives = _dives(paths, fleet, group)
    with ThreadPoolExecutor(READING_THREADS) as pool:
        logs = list(pool.map(lambda files: _log(files, base, named, hashes), dives))
    for rule, _ in named:
        if not any(_fits(_below_folder(files[0], base), rule) for files in dives):
            raise UsageError("fits no log", field="--vehicle", value=rule)
    return Discovery(tuple(_copies_named(logs)), others)


def _vehicle_rule(words: str) -> tuple[str, str]:
    """Return the pattern and the file of a vehicle that the call names."""
    pattern, equals, name = words.rpartition("=")
    path = vehicle_file_of(name)
    if not path.is_file():
        raise UsageError("no such vehicle file", field="--vehicle", value=name)
    return (pattern if equals else "*"), str(path.resolve())


def _below(folder: Path, fleet: Path, others: Counter[str]) -> Iterator[Path]:
    for top, names, files in os.walk(folder):
        names[:] = [
            name
            for name in names
            if not name.startswith(".") and not _is_fleet(Path(top) / name, fleet)
        ]
        for name in files:
            path = Path(top) / name
            if name.startswith("."):
                continue
            if _is_log(path):
                yield path
            else:
                others[readable_name(path.suffix.lower()) or "no suffix"] += 1


def _is_fleet(folder: Path, fleet: Path) -> bool:
    """Return whether a folder is this fleet or another: its logs are links to logs."""
    other = FleetFolder(folder)
    return folder.resolve() == fleet or (other.index.is_file() and other.table("runs").is_file())


def _is_log(path: Path) -> bool:
    """Return whether a file is a log: by its name, else by its first bytes."""
    suffix = path.suffix.lower()
    if suffix in LOG_SUFFIXES:
        return True
    try:
        if not path.is_file():
            return False
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
    except OSError:
        return False
    text = READERS[-1]  # tables of text: README files would pass for them
    return suffix in TABLE_SUFFIXES or any(
        reader.recognises(head) for reader in READERS if reader is not text
    )


def _listed(file: Path) -> list[Path]:
    """Return the paths of a list, one a line; relative ones count from its folder."""
    try:
        lines = file.read_text(encoding="utf-8-sig").split("\n")
    except UnicodeDecodeError:
        raise PipelineError(
            "this is no list of logs: text with one path a line",
            file=file,
            remedy="For a single log: auvid new campaign NAME --from LOG.",
        ) from None
    names = [line.strip() for line in lines if line.strip() and not line.startswith("#")]
    return sorted({file.parent / Path(name).expanduser() for name in names})


def _dives(paths: Sequence[Path], fleet: FleetFolder, group: Grouping) -> list[tuple[Path, ...]]:
    """Return the files of each dive: CSV files with different columns may be of one."""
    folders: dict[Path, list[Path]] = defaultdict(list)
    dives: list[tuple[Path, ...]] = []
    for path in paths:
        if path.suffix.lower() in TABLE_SUFFIXES and path.is_file():
            folders[path.parent].append(path)
        else:
            dives.append((path,))
    memory = fleet.root / GROUPS
    try:
        earlier = json.loads(memory.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        earlier = {}
    stamps = {
        folder: hash_value([[path.name, *stamp_of(path)] for path in files])
        for folder, files in folders.items()
    }
    groups: dict[Path, list[tuple[Path, ...]] | None] = {}
    for folder, files in folders.items():
        before = earlier.get(str(folder))
        if before and before["stamps"] == stamps[folder]:
            groups[folder] = [tuple(folder / name for name in names) for names in before["files"]]
        elif len({_header(path) for path in files}) == 1:
            groups[folder] = [(path,) for path in files]
    mixed = [folder for folder in folders if folder not in groups]
    if mixed:
        groups |= dict(zip(mixed, group([tuple(folders[name]) for name in mixed]), strict=True))
    kept = {}
    for folder, parts in groups.items():
        if parts is None:
            dives += [(path,) for path in folders[folder]]
        else:
            dives += parts
            names = [[path.name for path in files] for files in parts]
            kept[str(folder)] = {"stamps": stamps[folder], "files": names}
    if kept != earlier:
        write_atomically(memory, json.dumps({**earlier, **kept}).encode())
    return sorted(dives)


def _header(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(HEADER_BYTES).partition(b"\n")[0]
    except OSError:
        return b""


def _log(
    files: tuple[Path, ...], base: Path, named: Sequence[tuple[str, str]], hashes: FileHashes
) -> FleetLog:
    first = _below_folder(files[0], base)
    vehicle = next((file for rule, file in named if rule != "*" and _fits(first, rule)), None)
    vehicle = vehicle or next((file for rule, file in named if rule == "*"), None)
    if any(readable_name(path) != str(path) for path in files):
        name = _id(files[0], hash_value(str(files[0].absolute())))
        return FleetLog(name, files, "", (), vehicle, NO_TEXT)
    try:
        stamps = tuple(map(stamp_of, files))
        file_hashes = [hashes.of(path) for path in files]
    except OSError as fault:
        name = _id(files[0], hash_value(str(files[0].absolute())))
        return FleetLog(name, files, "", (), vehicle, _why_unreadable(files, fault))
    log_hash = file_hashes[0] if len(files) == 1 else hash_value(file_hashes)
    return FleetLog(_id(files[0], log_hash), files, log_hash, stamps, vehicle)


def _why_unreadable(files: Sequence[Path], fault: OSError) -> str:
    """Return why the files of a log cannot be read."""
    if any(path.is_dir() for path in files):
        return FOLDER
    for path in files:
        if path.is_symlink() and not path.exists():
            target = readable_name(os.readlink(path))
            return f"is a link to {target}, which is not there: is its disk there?"
    return f"cannot be read: {fault.strerror or fault}"


def _below_folder(path: Path, base: Path) -> Path:
    """Return a path as it stands below the folder, or beside the list, of a call."""
    folder = base if base.is_dir() else base.parent
    return path.relative_to(folder) if path.is_relative_to(folder) else path


def _fits(path: Path, pattern: str) -> bool:
    return fnmatch.fnmatch(str(path), pattern) or fnmatch.fnmatch(path.name, pattern)


def _id(path: Path, log_hash: str) -> str:
    """Return a name that can be that of a campaign, and of no other log."""
    stem = re.sub(r"[^A-Za-z0-9_]+", "_", path.stem).strip("_")[:STEM_LETTERS] or "log"
    return f"{stem}-{log_hash[:HASH_DIGITS]}"


def _copies_named(logs: Sequence[FleetLog]) -> Iterator[FleetLog]:
    """Yield the logs; of several with the same content, all but the first as copies."""
    first: dict[str, FleetLog] = {}
    counts: Counter[str] = Counter()
    for log in logs:
        same = first.setdefault(log.hash, log) if log.hash else log
        if same is log:
            yield log
            continue
        counts[same.id] += 1
        name = f"{log.id}-copy{counts[same.id]}"
        yield FleetLog(name, log.files, log.hash, log.stamps, log.vehicle, copy_of=same.id)


def hash_of_file(path: str | None) -> str:
    """Return the hash of a vehicle file that the call names; empty for none."""
    return "" if path is None else hash_file(Path(path))
