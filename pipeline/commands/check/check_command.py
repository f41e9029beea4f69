"""`auvid check`: the health of logs, given as files or through a campaign, before
anything is fitted to them.
"""

from __future__ import annotations

import json
import math
import os
import stat
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from auvid.data_schemas.documents import check_document
from auvid.data_schemas.errors import DataError, LogError, PipelineError, UsageError
from auvid.data_schemas.tables import column, matrix
from auvid.hydro.identification.signals.clock_offset import ClockOffset, clock_offset
from auvid.pipeline.campaigns.campaign import Campaign, LogFile, load_campaign
from auvid.pipeline.campaigns.workspace import workspace_of
from auvid.pipeline.campaigns.yaml_files import load_yaml
from auvid.pipeline.store.atomic_files import contents, readable, write_atomically
from auvid.stages import KINDS, ingest
from auvid.stages.base import Document, RawFile, RawLog
from auvid.stages.columns import GYRO
from auvid.stages.ingest.health.finding import Recorded
from auvid.stages.ingest.health.usability import legs
from auvid.stages.simulate.csv_writer import column_maps

FINE, REFUSED, LOSSES = 0, 1, 3
FASTEST_NEEDED_HZ = 5.0
LEAST_CORRELATION = 0.5
LARGEST_STD_S = 1.0  # beyond it the records have a trend in common, as two dives of one kind have, and no moment
SHARED: Mapping[str, tuple[str, ...]] = {"imu": GYRO, "depth": ("depth_m",)}
"""Signals that two logs of one dive share."""


@dataclass(frozen=True)
class Page:
    """What is said about one log: its health, or why it was refused; the legs that a
    campaign has in it.
    """

    name: str
    health: Mapping[str, Any] | None = None
    refused: str | None = None
    legs: tuple[Mapping[str, Any], ...] = ()
    outputs: ingest.Outputs | None = field(default=None, repr=False)

    @property
    def losses(self) -> bool:
        """Whether bytes were lost or an error was found."""
        return self.health is not None and (
            self.health["status"] != "complete"
            or any(item["severity"] == "error" for item in self.health["findings"])
        )

    @property
    def document(self) -> dict[str, Any]:
        """The page as JSON."""
        if self.health is None:
            return {"name": self.name, "refused": self.refused}
        return {
            "name": self.name,
            "health": self.health,
            **({"legs": list(self.legs)} if self.legs else {}),
        }


@dataclass(frozen=True)
class Alignment:
    """The clocks of two logs: add the offset to a time of `second` to get the time of
    `first`; `signal` is what was compared.
    """

    first: str
    second: str
    signal: str
    offset: ClockOffset

    @property
    def document(self) -> dict[str, Any]:
        """The alignment as JSON."""
        found = self.offset
        numbers = {
            "offset_s": found.offset_s,
            "std_s": found.std_s,
            "correlation": found.correlation,
            "overlap_s": found.overlap_s,
        }
        return {"first": self.first, "second": self.second, "signal": self.signal, **numbers}


def check(
    targets: Sequence[str],
    *,
    columns: Path | None = None,
    json_file: str | None = None,
    html_file: Path | None = None,
    align: bool = False,
) -> int:
    """Print the health page of every log and return the exit code: 0 fine, 1 a log was
    refused, 3 losses or errors.

    Raises `PipelineError` for what concerns the call itself: no such campaign, a column
    map that does not hold, nothing to align.
    """
    from auvid.pipeline.commands.check import check_page

    pages = [page for target in targets for page in pages_of(target, columns)]
    if align and len(pages) != 2:
        raise UsageError(
            "--align needs exactly two logs",
            value=len(pages),
            remedy="auvid check dive.tlog dive.BIN --align",
        )
    aligned, apart = _aligned(pages) if align else (None, None)
    if json_file is not None:
        _write_json(json_file, pages, aligned)
    if html_file is not None:
        write_atomically(html_file, check_page.html(pages, aligned).encode())
    if json_file != "-":
        check_page.show(pages)
        if aligned is not None:
            check_page.show_alignment(aligned)
    if apart is not None:
        raise apart
    if any(page.refused is not None for page in pages):
        return REFUSED
    return LOSSES if any(page.losses for page in pages) else FINE


def names_campaign(target: str) -> bool:
    """Whether a word of the command line means a campaign (by name, folder or manifest)
    and not a file.
    """
    path = Path(target).expanduser()
    return (
        path.name == "campaign.yaml"
        or (path / "campaign.yaml").is_file()
        or not (path.exists() or path.suffix or os.sep in target)
    )


def pages_of(target: str, columns: Path | None) -> list[Page]:
    """The page of a log file, or of every log of a campaign."""
    if names_campaign(target):
        return _campaign_pages(target)
    path = Path(target).expanduser()
    mapping = None
    if columns is not None:
        found = load_yaml(columns, what="column map")
        found.check("column_map")
        mapping = found.value
    file = LogFile(path.name, path, mapping)
    return [_page(str(path), path.stem, (file,))]


def _campaign_pages(target: str) -> list[Page]:
    workspace = workspace_of(target)
    campaign = load_campaign(
        workspace.campaign_folder(target), kinds=KINDS, vehicles=workspace.vehicle_files()
    )
    flown = workspace.runs / campaign.name / "simulate" / "logs"
    return [_log_page(campaign, log, flown) for log in campaign.logs]


def _simulated_files(campaign: Campaign, log: str, flown: Path) -> tuple[LogFile, ...]:
    """The files of a log that the stage simulate wrote to the folder `flown`."""
    assert campaign.twin is not None
    if not flown.is_dir():
        remedy = f"Fly them first: auvid run {campaign.name} --only simulate."
        raise PipelineError(
            "the logs of this twin have not been flown", file=campaign.file.path, remedy=remedy
        )
    maps = column_maps(accelerometer=campaign.twin["accelerometer"])
    entry = campaign.logs[log]
    return tuple(
        LogFile(
            item["file"],
            flown / item["file"],
            maps[Path(item["columns"]).stem] if "columns" in item else None,
        )
        for item in entry.get("files") or [entry]
    )


def _log_page(campaign: Campaign, log: str, flown: Path) -> Page:
    name = f"{campaign.name}: {log}"
    try:
        files = (
            campaign.log_files(log)
            if campaign.twin is None
            else _simulated_files(campaign, log, flown)
        )
    except PipelineError as fault:
        return Page(name, refused=str(fault))
    entries = [leg for leg in campaign.legs.values() if leg["log"] == log]
    return _page(name, log, files, campaign=campaign, entries=entries)


def _page(
    name: str,
    log: str,
    files: Sequence[LogFile],
    *,
    campaign: Campaign | None = None,
    entries: Sequence[Document] = (),
) -> Page:
    """Decode one log and check it; a log that cannot be read is a page that says why."""
    try:
        before = [_stamp(file) for file in files]
        reader = campaign.logs[log].get("reader") if campaign is not None else None
        raw = RawLog(
            log,
            tuple(
                RawFile(
                    file.name, contents(file.path, file=file.path, what="the log"), file.columns
                )
                for file in files
            ),
            reader,
        )
        seen = campaign.seen_by(log) if campaign is not None else None
        vehicle = campaign.vehicle if campaign is not None else None
        outputs = ingest.run(
            ingest.Inputs(raw, seen, vehicle), ingest.Params(max_dropped_share=1.0)
        )
        for file, stamp in zip(files, before, strict=True):
            if _stamp(file) != stamp:
                raise LogError(
                    "the file changed while it was read",
                    file=file.name,
                    remedy="Wait until the copy or download has finished.",
                )
    except PipelineError as fault:
        return Page(name, refused=str(fault))
    check_document(outputs.health, "health")
    recorded = Recorded(tables_of(outputs), outputs.log_info, outputs.dropped, vehicle)
    return Page(name, outputs.health, legs=tuple(legs(recorded, entries)), outputs=outputs)


def _stamp(file: LogFile) -> tuple[int, int]:
    with readable(file.path, file=file.path, what="the log"):
        status = file.path.stat()
    if not stat.S_ISREG(status.st_mode) and not stat.S_ISDIR(status.st_mode):
        raise LogError(
            "the log is no regular file",
            file=file.path,
            remedy="Copy what it delivers into a file first.",
        )
    return status.st_size, status.st_mtime_ns


def tables_of(outputs: ingest.Outputs) -> dict[str, Any]:
    """The streams of a log by name."""
    return {name: getattr(outputs, name) for name in outputs.health["streams"]}


def _aligned(pages: Sequence[Page]) -> tuple[Alignment | None, DataError | None]:
    """The alignment of two logs, or why there is none; neither where a log was refused,
    which its page says.
    """
    if any(page.outputs is None for page in pages):
        return None, None
    try:
        return alignment(*pages), None
    except DataError as fault:
        return None, fault


def alignment(first: Page, second: Page) -> Alignment:
    """The offset between the clocks of two logs of one dive, from the shared signal
    that gives it most precisely.

    Raises `DataError` if they share no signal, or none that agrees.
    """
    found: list[Alignment] = []
    failed = "no signal in common"
    for stream, names in SHARED.items():
        one, two = (_signal(page, stream, names) for page in (first, second))
        if one is None or two is None:
            continue
        shorter = min(times[-1] - times[0] for times, _ in (one, two))
        try:
            offset = clock_offset(*one, *two, min_overlap_s=max(20.0, 0.2 * shorter))
        except DataError:
            continue
        # Whether stamps are cut or rounded to their resolution is not known, so it is
        # part of the uncertainty.
        rounded = math.hypot(_resolution_s(one[0]), _resolution_s(two[0])) / math.sqrt(12.0)
        offset = replace(offset, std_s=math.hypot(offset.std_s, rounded))
        if offset.correlation < LEAST_CORRELATION or not offset.std_s <= LARGEST_STD_S:
            failed = (
                f"{stream}: correlation {offset.correlation:.2f}, standard deviation"
                f" {offset.std_s:.2g} s"
            )
        else:
            found.append(
                Alignment(
                    first.name, second.name, "angular rate" if stream == "imu" else "depth", offset
                )
            )
    if not found:
        raise DataError(
            "the clocks of the two logs cannot be aligned: no signal that both hold agrees at any"
            " offset",
            file=f"{first.name} and {second.name}",
            value=failed,
            allowed=(
                f"a correlation of at least {LEAST_CORRELATION:g} and a standard deviation of at"
                f" most {LARGEST_STD_S:g} s"
            ),
            remedy="They must overlap by 20 s or more in which the vehicle turns or changes depth.",
        )
    return min(found, key=lambda item: item.offset.std_s)


def _signal(
    page: Page, stream: str, names: tuple[str, ...]
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]] | None:
    assert page.outputs is not None
    table = getattr(page.outputs, stream)
    about = page.health["streams"].get(stream) if page.health is not None else None
    if table is None or about is None or not about["rate_hz"]:
        return None
    if stream == "imu" and about["rate_hz"] < FASTEST_NEEDED_HZ:
        return None
    return column(table, "time_us") / 1e6, matrix(table, names)


def _resolution_s(times_s: npt.NDArray[np.float64]) -> float:
    """The step of which all time stamps are multiples: a microsecond, or coarser where
    the log rounds.
    """
    return float(np.gcd.reduce(np.diff(np.rint(times_s * 1e6).astype(np.int64)))) / 1e6


def _write_json(target: str, pages: Sequence[Page], aligned: Alignment | None) -> None:
    document = {
        "logs": [page.document for page in pages],
        **({"alignment": aligned.document} if aligned is not None else {}),
    }
    text = json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    if target == "-":
        sys.stdout.write(text)
    else:
        write_atomically(Path(target), text.encode())
