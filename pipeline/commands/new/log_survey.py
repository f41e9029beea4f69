"""Logs that a campaign shall be written from: decoded, checked, CSV files joined."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations, zip_longest
from pathlib import Path
from typing import Any

from auvid.data_schemas.errors import PipelineError, UsageError, nearest
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.pipeline.campaigns.campaign import LogFile
from auvid.pipeline.commands.check.log_page import LogPage, page_of_log
from auvid.pipeline.commands.new.feedable import checked
from auvid.pipeline.commands.new.refusal import NO_MEANING
from auvid.pipeline.store.atomic_files import contents
from auvid.stages.base import RawFile
from auvid.stages.ingest.formats.csv.column_map import dialect_map
from auvid.stages.ingest.formats.csv.column_proposal import ahead_words
from auvid.stages.ingest.formats.csv.draft.column_draft import ColumnDraft
from auvid.stages.ingest.formats.csv.draft.draft_corrections import (
    OF_GRAVITY,
    SIGNS,
    corrected,
    in_upward_body,
    in_upward_poses,
    reversals,
)
from auvid.stages.ingest.formats.csv.draft.drafting import draft_columns
from auvid.stages.ingest.formats.csv.draft.units import UNITS_APART
from auvid.stages.ingest.formats.csv.reader import CSV, header
from auvid.stages.ingest.health.agreement.command_clock import answers_upward
from auvid.stages.ingest.registry import reader_of

SHARED = 0.5
"""Files of one dive share so much of the time of the shorter one."""
HOUR_S, ZONE_S, MOST_HOURS = 3600.0, 120.0, 14
"""Times that are off by whole hours, within so many seconds, are of two time zones."""
LISTED = 6
ROUNDS = 5
"""Corrections of a drafted column map, each after a new check of the log."""


@dataclass(frozen=True)
class SurveyedFile:
    """A file of a log, its columns, and the column map that was drafted for it."""

    path: Path
    draft: ColumnDraft | None = None
    columns: tuple[str, ...] = ()


@dataclass(frozen=True)
class SurveyedLog:
    """A log: its files and its health page."""

    name: str
    files: tuple[SurveyedFile, ...]
    page: LogPage


def survey(paths: Sequence[Path], commands: Mapping[str, str] | None = None) -> list[SurveyedLog]:
    """Return the logs in files, in order; CSV files of one dive are one log.

    CSV files with the same columns are runs: a log each, with one column map. commands:
    axis (surge, -heave ...) of columns that are commands. Raises `PipelineError` for a
    file that is not there or is named twice, and `UsageError` for a column of a command
    that no file has.
    """
    named: set[Path] = set()
    for path in paths:
        if path.is_dir():
            raise PipelineError(
                "this is a folder, not a log",
                file=path,
                remedy=f"Name the logs in it, or run all of them: auvid fleet run {path}",
            )
        if not path.is_file():
            raise PipelineError("there is no such log", file=path)
        if path.resolve() in named:
            raise PipelineError("the log is named twice", file=path)
        named.add(path.resolve())
    logs, refused = _dives(paths, commands or {})
    return corrected_logs([_surveyed(files, refused) for files in logs])


def files_of_dives(paths: Sequence[Path]) -> list[list[Path]]:
    """Return the files of each dive, in order: CSV files of one dive are together."""
    return [[file.path for file in files] for files in _dives(paths, {})[0]]


def _dives(
    paths: Sequence[Path], commands: Mapping[str, str]
) -> tuple[list[list[SurveyedFile]], dict[Path, str]]:
    """Return the files of each dive, and why files cannot be read."""
    refused: dict[Path, str] = {}
    columns: dict[Path, tuple[str, ...]] = {}
    drafts: dict[Path, ColumnDraft] = {}
    for path in paths:
        try:
            columns[path] = _columns(path)
            if columns[path]:
                drafts[path] = draft_columns(_raw(path))
        except PipelineError as fault:
            refused[path] = str(fault)
    _check_commands(commands, columns.values())
    alike: dict[object, list[Path]] = {}
    for path, draft in drafts.items():
        form = draft.delimiter, draft.decimal, *draft.time.items()
        alike.setdefault((columns[path], form), []).append(path)
    for runs in (part for own in alike.values() for part in _one_convention(own, drafts)):
        of_map = {key: axis for key, axis in commands.items() if key in columns[runs[0]]}
        if len(runs) > 1 or of_map:
            one_map = draft_columns(*map(_raw, runs), commands=of_map)
            for path in runs:
                drafts[path] = replace(one_map, file=path.name, span_s=drafts[path].span_s)
    logs: list[list[SurveyedFile]] = []
    for path in paths:
        _join(logs, SurveyedFile(path, drafts.get(path), columns.get(path, ())))
    return logs, refused


def _one_convention(runs: Sequence[Path], drafts: Mapping[Path, ColumnDraft]) -> list[list[Path]]:
    """Return runs of the same columns in groups of one unit and one frame.

    Of commands by their size, of positions by their noise: beside runs in mm one in m has a
    thousandth. A run whose commands show no frame goes with the most of its unit.
    """
    groups: dict[tuple[str, tuple[bool, ...]], dict[str, list[Path]]] = {}
    noises = [drafts[path].position_noise for path in runs]
    loudest = [max(own) for own in zip_longest(*noises, fillvalue=0.0)]
    for path, noise in zip(runs, noises, strict=True):
        quiet = tuple(0.0 < x < most / UNITS_APART for x, most in zip(noise, loudest, strict=False))
        own = groups.setdefault((drafts[path].command_unit, quiet), {})
        own.setdefault(drafts[path].commands_show, []).append(path)
    parts = []
    for by_frame in groups.values():
        silent = by_frame.pop("", [])
        largest = max(by_frame.values(), key=len, default=[])
        parts += [[*own, *silent] if own is largest else own for own in by_frame.values()]
        parts += [silent] if silent and not by_frame else []
    return [[path for path in runs if path in part] for part in parts]


def _raw(path: Path) -> RawFile:
    return RawFile(path.name, contents(path, file=path.name, what="log"), None)


def _columns(path: Path) -> tuple[str, ...]:
    """Return the columns of a CSV file that needs a map; () for any other log."""
    file = _raw(path)
    if reader_of(file) is not CSV:
        return ()
    names = header(file, None).names
    return () if dialect_map(names) is not None else names


def _check_commands(commands: Mapping[str, str], columns: Iterable[tuple[str, ...]]) -> None:
    """Raise `UsageError` for a column of a command that no file has."""
    there = list(dict.fromkeys(name for names in columns for name in names))
    for name in commands:
        if name not in there:
            raise UsageError(
                "no file has such a column",
                field="--commands",
                value=name,
                allowed=", ".join(there) or "none: --commands is for CSV files",
                remedy=nearest(name, there),
            )


def _join(logs: list[list[SurveyedFile]], file: SurveyedFile) -> None:
    """Add a file to the log whose time it shares and whose streams it completes."""
    draft = file.draft
    for files in logs if draft is not None else ():
        drafts = [item.draft for item in files if item.draft is not None]
        if draft is None or not drafts or drafts[0].time["epoch"] != draft.time["epoch"]:
            continue
        there = {name for item in drafts for name in item.streams}
        new = set(draft.streams) - there
        if new and there and shared(drafts[0].span_s, draft.span_s) >= SHARED:
            files.append(replace(file, draft=draft.without(*there)))
            return
    if draft is not None and _joined_across_clocks(logs, file, draft):
        return
    logs.append([file])


def _joined_across_clocks(
    logs: list[list[SurveyedFile]], file: SurveyedFile, draft: ColumnDraft
) -> bool:
    """Add a file to the one log that it completes on a clock of another kind.

    Of the two one holds the commands alone and the other the motion: neither is a dive by
    itself. Both count as begun together until a check of the log knows better.
    """
    candidates: list[tuple[int, ColumnDraft]] = []
    for number, files in enumerate(logs):
        drafts = [item.draft for item in files if item.draft is not None]
        there = {name for item in drafts for name in item.streams}
        kinds = {frozenset(there) == {"actuators"}, frozenset(draft.streams) == {"actuators"}}
        if len(drafts) != len(files) or kinds != {True, False} or there & set(draft.streams):
            continue
        if not there or not draft.streams or drafts[0].time["epoch"] == draft.time["epoch"]:
            continue
        lengths = sorted(end - start for start, end in (drafts[0].span_s, draft.span_s))
        if lengths[0] > SHARED * lengths[1]:
            candidates.append((number, drafts[0]))
    if len(candidates) != 1:
        return False
    ((number, other),) = candidates
    files = logs[number]
    if draft.streams == ("actuators",):
        files.append(replace(file, draft=draft.on_clock_of(other)))
    else:
        files[:] = [
            replace(item, draft=item.draft and item.draft.on_clock_of(draft)) for item in files
        ]
        files.insert(0, file)
    return True


def shared(first: tuple[float, float], other: tuple[float, float]) -> float:
    """Return the share of the shorter span that both have."""
    common = min(first[1], other[1]) - max(first[0], other[0])
    return common / max(min(first[1] - first[0], other[1] - other[0]), 1e-9)


def apart_words(logs: Sequence[SurveyedLog]) -> list[str]:
    """Return which CSV files complete each other but for their times, in words.

    Those of one dive whose clocks are of two time zones, for one.
    """
    words = []
    for first, other in combinations(logs, 2):
        one, two = (next(iter(log.files)).draft for log in (first, other))
        if one is None or two is None or one.time["epoch"] != two.time["epoch"]:
            continue
        streams = [
            {name for file in log.files if file.draft for name in file.draft.streams}
            for log in (first, other)
        ]
        lengths = sorted(end - start for start, end in (one.span_s, two.span_s))
        alike = lengths[0] > SHARED * lengths[1]
        if alike and streams[0] and streams[1] and not streams[0] & streams[1]:
            later = two.span_s[0] - one.span_s[0]
            names = (other.name, first.name) if later > 0.0 else (first.name, other.name)
            hours = abs(later) / HOUR_S
            zone = abs(hours - round(hours)) * HOUR_S < ZONE_S and 0 < round(hours) <= MOST_HOURS
            words.append(
                f"{names[0]} begins {abs(later):.0f} s after {names[1]}, and so counts as another"
                " dive: if both are of one, mend the times of one"
                f"{f' ({hours:.0f} h: another time zone?)' if zone else ''}."
            )
    return words


def _surveyed(files: Sequence[SurveyedFile], refused: Mapping[Path, str]) -> SurveyedLog:
    """Return a log with its health page, its drafted maps corrected by its findings."""
    name = files[0].path.name + (f" and {len(files) - 1} more" if len(files) > 1 else "")
    faults = [refused[file.path] for file in files if file.path in refused]
    empty = [file for file in files if file.draft is not None and not file.draft.columns]
    if empty:
        (draft,) = [file.draft for file in empty][:1]
        faults.append(_nothing(draft))
    if faults:
        return SurveyedLog(name, tuple(files), LogPage(name, refused="; ".join(faults)))
    return SurveyedLog(name, tuple(files), _page(files))


def corrected_logs(
    logs: Sequence[SurveyedLog], vehicle: Vehicle | None = None
) -> list[SurveyedLog]:
    """Return logs with their drafted column maps corrected by their checks.

    Runs with the same columns keep one map: it is corrected by what most of them find.
    With a vehicle the checks know how the thrusters push.
    """
    groups: dict[object, list[int]] = {}
    for number, log in enumerate(logs):
        maps = tuple(file.draft.text() if file.draft else "" for file in log.files)
        groups.setdefault(maps if all(maps) else number, []).append(number)
    result = list(logs)
    for numbers in groups.values():
        for number, log in zip(
            numbers, _corrected([logs[at] for at in numbers], vehicle), strict=True
        ):
            result[number] = log
    return result


def _corrected(runs: Sequence[SurveyedLog], vehicle: Vehicle | None) -> list[SurveyedLog]:
    """Return runs of the same columns with their one map corrected."""
    logs = list(runs)
    if all(file.draft is None for file in logs[0].files):
        return logs
    if vehicle is not None:
        logs = [
            log if log.page.health is None else replace(log, page=_page(log.files, vehicle))
            for log in logs
        ]
    logs = _in_answered_frame(_in_one_frame(logs, vehicle), vehicle)
    for _ in range(ROUNDS):
        findings = _common_findings(logs)
        mended = _redrafted(logs, partial(corrected, findings=findings), vehicle)
        if mended is None:
            break
        logs = mended
    return logs


def _in_one_frame(logs: list[SurveyedLog], vehicle: Vehicle | None) -> list[SurveyedLog]:
    """Return logs in forward-left-up axes where nothing is reversed in these any more.

    That is one cause of what single signs would mend one by one, in mirrored axes.
    """
    if len(reversals(_common_findings(logs))) < 2:
        return logs
    for heading in (True, False):
        tried = _redrafted(logs, partial(in_upward_body, heading=heading), vehicle)
        if tried is not None and not any(
            item["id"] in (*SIGNS, OF_GRAVITY) for item in _common_findings(tried)
        ):
            return tried
    return logs


def _in_answered_frame(logs: list[SurveyedLog], vehicle: Vehicle | None) -> list[SurveyedLog]:
    """Return logs with z up for poses that answer commands of another file so."""
    joined = [log for log in logs if len(log.files) > 1 and log.page.health is not None]
    if not joined or not all(answers_upward(checked(log.page, vehicle)) for log in joined):
        return logs
    return _redrafted(logs, in_upward_poses, vehicle) or logs


def _redrafted(
    logs: Sequence[SurveyedLog],
    change: Callable[[ColumnDraft], ColumnDraft],
    vehicle: Vehicle | None,
) -> list[SurveyedLog] | None:
    """Return logs checked with their drafts changed; None where nothing changes."""
    files = [
        tuple(replace(file, draft=file.draft and change(file.draft)) for file in log.files)
        for log in logs
    ]
    if all(new == log.files for new, log in zip(files, logs, strict=True)):
        return None
    return [
        log if log.page.health is None else replace(log, files=new, page=_page(new, vehicle))
        for new, log in zip(files, logs, strict=True)
    ]


def _common_findings(logs: Sequence[SurveyedLog]) -> list[Mapping[str, Any]]:
    """Return the findings that more than half of the checked logs have, each once."""
    pages = [log.page.health["findings"] for log in logs if log.page.health is not None]
    alike: dict[object, list[Mapping[str, Any]]] = {}
    for page in pages:
        for item in page:
            alike.setdefault((item["id"], tuple(item["fields"])), []).append(item)
    return [items[0] for items in alike.values() if 2 * len(items) > len(pages)]


def command_lines(logs: Sequence[SurveyedLog]) -> list[str]:
    """Return which columns were matched to which axis, and how to name others."""
    drafts = [file.draft for log in logs for file in log.files if file.draft is not None]
    matched = {axis: column for draft in drafts for axis, column in draft.matched.items()}
    if not matched:
        return []
    pairs = ",".join(f"{axis}={column}" for axis, column in matched.items())
    return [
        "commands, each matched to the axis that answers it (if others, the same call with yours):"
        f" --commands {pairs}"
    ]


def _nothing(draft: ColumnDraft | None) -> str:
    """Return in words that no column of a file fills a stream."""
    assert draft is not None
    remarks = " ".join(draft.remarks)
    return (
        f"{draft.file}: no columns fill a stream (columns: {', '.join(draft.unused[:LISTED])})."
        f" {remarks} Rename them so that they tell (depth_m, roll_deg, u_mps, pwm_1 ...)."
    )


def draft_remarks(log: SurveyedLog) -> list[str]:
    """Return what drafted column maps leave out, as sentences."""
    lines = []
    for file in log.files:
        if file.draft is not None:
            lines += [f"{file.path.name}: {remark}" for remark in file.draft.remarks]
            lines += [f"{file.path.name}: {words}" for words in ahead_words(file.draft.ahead)]
            nameless = unused_words(file.draft)
            if nameless:
                lines.append(f"{file.path.name}: {NO_MEANING} {nameless}")
    return lines


def unused_words(draft: ColumnDraft) -> str:
    """Return the columns without a meaning, a long list cut short; '' for none."""
    unused = [name for name in draft.unused if name not in draft.ahead]
    more = len(unused) - LISTED
    names = ", ".join(unused[:LISTED])
    return f"{names} and {more} more" if more > 0 else names


def _page(files: Sequence[SurveyedFile], vehicle: Vehicle | None = None) -> LogPage:
    logs = [
        LogFile(file.path.name, file.path, file.draft.document() if file.draft else None)
        for file in files
    ]
    return page_of_log(files[0].path.name, files[0].path.stem, logs, vehicle=vehicle)
