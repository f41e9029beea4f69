"""`auvid new campaign`: a campaign written from logs, ready for `auvid run`."""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Container, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from auvid.data_schemas.errors import PipelineError, UsageError
from auvid.data_schemas.records.fleet import MotionTrace
from auvid.hydro.dynamics.actuators.commands import ARDUSUB_FRAMES
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.structures import lift_and_drag
from auvid.hydro.identification.checks.signal_checks import clock_statistics
from auvid.hydro.identification.selection.leg_proposal import LegProposal
from auvid.hydro.identification.signals.band import motion_band_hz
from auvid.pipeline.campaigns.campaign import ID
from auvid.pipeline.campaigns.vehicle_files import load_vehicle
from auvid.pipeline.campaigns.workspace import find_workspace, vehicle_file_of
from auvid.pipeline.commands.check.axes_route import MOTORS_OF_VEHICLE
from auvid.pipeline.commands.check.log_page import LogPage, campaign_refusal, log_pages
from auvid.pipeline.commands.check.motion_trace import agreement, motion_of
from auvid.pipeline.commands.new.campaign_text import (
    CampaignContent,
    WrittenFile,
    campaign_text,
    dropped_words,
)
from auvid.pipeline.commands.new.feedable import (
    CampaignFeed,
    checked,
    feed_of,
    is_passive,
    proposal,
)
from auvid.pipeline.commands.new.log_survey import (
    SurveyedLog,
    apart_words,
    command_lines,
    corrected_logs,
    draft_remarks,
    shared,
    survey,
    unused_words,
)
from auvid.pipeline.commands.new.refusal import (
    NoCampaignError,
    Refusal,
    refusal_of,
    unreadable,
)
from auvid.pipeline.commands.new.vehicle_choice import (
    LAYOUT,
    OWN_FILE,
    VehicleChoice,
    choose_vehicle,
    vehicle_of_text,
)
from auvid.pipeline.output import FAILED, FINE, OUTPUT, answer
from auvid.pipeline.store.atomic_files import writable, write_atomically
from auvid.pipeline.terminal import path_from_here
from auvid.stages.ingest.formats.csv.column_proposal import ahead_words
from auvid.stages.ingest.health.actuation.motions import MOTION_WORDS, motions
from auvid.stages.ingest.health.finding import CheckedLog
from auvid.stages.synthesise import Params as SynthesiseParams

SAMPLES_PER_PERIOD = 8.0
"""What the slowest of velocity, attitude and commands samples so often a low-pass keeps."""
MOST_OF_RATE = 0.4
"""Of that sensor's rate; what the vehicle's motion reaches is kept below it."""
CUTOFF_HZ = (0.2, 3.0)
LIFT = lift_and_drag().name
BANDS = 2.0
"""Drag goes with products of velocities, which reach twice the band in which they move."""
FILTER_SAMPLES = 0.2
"""Rate [rad/s] of the filter of a single channel, of the sampling rate [Hz]; at most 1."""
SAME_DIVE = 0.5
"""Logs that share so much of the UTC time of the shorter one are of one dive."""
KINDS_BY_WORTH = ("identification", "axes", "bench", "glide", "passive")
"""Where logs feed several kinds the first is written."""
MOST_DROPPED = 0.5
"""Default of stages.ingest.max_dropped_share."""


@dataclass(frozen=True)
class WrittenCampaign:
    """A written campaign: folder, what it is in lines, and why a run would stop.

    `page`: the health of its first log; `legs`: how many, and their length [s].
    """

    folder: Path
    lines: tuple[str, ...]
    kind: str
    vehicle: VehicleChoice
    page: LogPage
    legs: tuple[int, float]
    stop: str = ""


def new_campaign(
    name: str,
    logs: Sequence[Path],
    *,
    vehicle: str | None = None,
    link: bool = False,
    commands: str = "",
    ask: Callable[[VehicleChoice], str] | None = None,
) -> WrittenCampaign:
    """Write a campaign from logs and return what was written.

    commands: `surge=cmd4,heave=-cmd2`, columns of CSV files by axis. `ask` returns the
    name of a vehicle in the place of a guess, '' to keep the guess. It stands under
    campaigns/ of the workspace here, without one in the current folder. Raises
    `PipelineError`, with nothing written, for logs that feed no campaign.
    """
    folder = _place(name)
    surveyed = survey(logs, _commands(commands))
    campaign = write_campaign(folder, surveyed, vehicle=vehicle, link=link, ask=ask)
    return replace(campaign, stop=_stop(folder, campaign.vehicle))


def write_campaign(
    folder: Path,
    surveyed: Sequence[SurveyedLog],
    *,
    vehicle: str | None = None,
    link: bool = False,
    ask: Callable[[VehicleChoice], str] | None = None,
) -> WrittenCampaign:
    """Write a campaign from decoded logs into a folder.

    Whether it would run is not tried. Raises `PipelineError`, with nothing written, for
    logs that feed no campaign.
    """
    feed, kept, left_out = _sort(surveyed, _passive_body(vehicle), named=vehicle is not None)
    ids = [f"dive_{number}" for number in range(1, len(kept) + 1)] if len(kept) > 1 else ["dive"]
    by_id = dict(zip(ids, kept, strict=True))
    first = checked(kept[0].page)
    choice = choose_vehicle(first, named=vehicle, normalised=feed.normalised)
    if ask is not None and (choice.guessed or choice.lacking):
        named = ask(choice)
        choice = choose_vehicle(first, named=named, normalised=False) if named else choice
    if not choice.lacking:
        body = vehicle_of_text(choice.text)
        by_id = dict(zip(by_id, corrected_logs(list(by_id.values()), body), strict=True))
    checks = {key: checked(log.page) for key, log in by_id.items()}
    texts: dict[str, str] = {"vehicle.yaml": choice.text}
    written: dict[str, list[WrittenFile]] = {}
    sources: dict[str, Path] = {}
    for key, log in by_id.items():
        written[key] = []
        for item in log.files:
            place = _free(f"logs/{item.path.name}", sources)
            sources[place] = item.path
            columns = None
            if item.draft is not None:
                text = item.draft.text()
                columns = next((name for name, other in texts.items() if other == text), None)
                columns = columns or _free(f"columns/{Path(place).stem}.yaml", texts)
                texts[columns] = text
            written[key].append(WrittenFile(place, columns))
    legs = proposal(feed, list(checks.values()))
    content = CampaignContent(
        feed.kind,
        _title(by_id, choice),
        choice.name,
        choice.why,
        written,
        checks,
        legs,
        _stages(feed, checks, choice, legs),
        left_out and [f"Left out: {item}." for item in left_out],
        shelf=choice.name
        if choice.name.startswith("bluerov2") and feed.kind == "identification"
        else "",
    )
    texts["campaign.yaml"] = campaign_text(content)
    write_files(folder, texts, sources, link=link)
    marks = {file: text.count("# check:") for file, text in texts.items() if "# check:" in text}
    lines = [
        f"{feed.kind}: {len(legs.legs)} leg{'s' * (len(legs.legs) != 1)} from"
        f" {len(kept)} log{'s' * (len(kept) > 1)}",
        f"vehicle: {'vehicle.yaml' if choice.name == OWN_FILE else choice.name} ({choice.why})",
        *command_lines(list(by_id.values())),
        f"to check: {', '.join(f'{file} ({count})' for file, count in sorted(marks.items()))}",
        *_unused(list(by_id.values())),
        *([f"in no leg: {dropped_words(legs)}"] if legs.dropped_s else []),
        *(f"left out: {item}" for item in left_out),
    ]
    length_s = sum(leg.end_s - leg.start_s for leg in legs.legs)
    page = next(iter(by_id.values())).page
    return WrittenCampaign(
        folder, tuple(lines), feed.kind, choice, page, (len(legs.legs), length_s)
    )


def _unused(logs: Sequence[SurveyedLog]) -> list[str]:
    """Return the columns of CSV files without a meaning, once for files alike."""
    words: dict[str, str] = {}
    for log in logs:
        for file in log.files:
            if file.draft is not None and file.draft.unused:
                nameless = unused_words(file.draft)
                lines = [*ahead_words(file.draft.ahead), *([nameless] if nameless else [])]
                words |= {line: words.get(line, file.path.name) for line in lines}
    return [f"columns not used: {names} ({file})" for names, file in words.items()]


def _commands(text: str) -> dict[str, str]:
    """Return column -> axis of `surge=cmd4,heave=-cmd2`, the minus before the axis."""
    axes: dict[str, str] = {}
    for pair in filter(None, (part.strip() for part in text.split(","))):
        axis, _, column = (part.strip() for part in pair.partition("="))
        minus = "-" if column.startswith("-") else ""
        column = column.removeprefix("-")
        if axis not in MOTION_WORDS.values() or not column or column in axes:
            raise UsageError(
                "no command of an axis",
                field="--commands",
                value=pair,
                allowed=f"AXIS=COLUMN of {', '.join(MOTION_WORDS.values())}, each column once",
                remedy="For example --commands surge=cmd4,heave=-cmd2 (a minus: reversed).",
            )
        axes[column] = minus + axis
    return axes


def _place(name: str) -> Path:
    """Return the folder of a new campaign."""
    folder = Path(name).expanduser()
    with suppress(PipelineError):
        workspace = find_workspace(Path.cwd())
        folder = folder if os.sep in name else workspace.campaigns / name
    if not ID.fullmatch(folder.name):
        raise UsageError(
            "not a name for a campaign",
            value=folder.name,
            allowed="at most 100 letters, digits, _ and -, not starting with -",
        )
    if (folder / "campaign.yaml").exists():
        raise PipelineError(
            "there is a campaign already, and nothing is overwritten",
            file=folder / "campaign.yaml",
            remedy="Choose another name, or remove the folder.",
        )
    return folder


def _passive_body(named: str | None) -> Vehicle | None:
    """Return the vehicle of a name if nothing on board drives it, else None."""
    if named is None:
        return None
    vehicle = load_vehicle(vehicle_file_of(named), named_in="--vehicle").vehicle
    return vehicle if is_passive(vehicle) else None


def _sort(
    surveyed: Sequence[SurveyedLog], body: Vehicle | None, *, named: bool
) -> tuple[CampaignFeed, list[SurveyedLog], list[str]]:
    """Return what the logs feed, those that do, and in words why not the others.

    body: the vehicle, where a named one has no actuators; named: whether one is.

    Raises `NoCampaignError` where none feeds anything.
    """
    feeds: list[tuple[SurveyedLog, CampaignFeed]] = []
    refused: list[Refusal] = []
    for log in surveyed:
        if log.page.health is None:
            refused.append(unreadable(log.name, log.page))
            continue
        feed = feed_of(log.page, body, named=named)
        if isinstance(feed, CampaignFeed):
            feeds.append((log, feed))
        else:
            more = draft_remarks(log)
            refused.append(refusal_of(log.name, log.page, checked(log.page, body), feed, more))
    if not feeds:
        parted = apart_words(surveyed)
        raise NoCampaignError.of(refused, parted=parted, in_full=OUTPUT.verbose)
    kinds = {feed.kind for _, feed in feeds}
    kind = next(name for name in KINDS_BY_WORTH if name in kinds)
    kept = [(log, feed) for log, feed in feeds if feed.kind == kind]
    left_out = [item.line.rstrip(".") for item in refused]
    left_out += [
        f"{log.name}: feeds only kind {feed.kind}" for log, feed in feeds if feed.kind != kind
    ]
    left_out += _same_dives(kept)
    first = kept[0][1]
    channels = tuple(dict.fromkeys(axis for _, feed in kept for axis in feed.channels))
    streams = tuple(dict.fromkeys(name for _, feed in kept for name in feed.streams))
    pause = max(feed.max_gap_s for _, feed in kept)
    axes = tuple(dict.fromkeys(axis for _, feed in kept for axis in feed.axes))
    merged = CampaignFeed(kind, streams, pause, channels, first.normalised, axes)
    return merged, [log for log, _ in kept], left_out


def _same_dives(kept: list[tuple[SurveyedLog, CampaignFeed]]) -> list[str]:
    """Take logs of a dive that an earlier log holds out, and return them in words.

    A dive in training and, from another recorder, in validation would judge itself. A
    computer whose clock begins anew gives two dives one time: they differ in their motion.
    """
    earlier: list[tuple[str, tuple[float, float], MotionTrace | None]] = []
    words = []
    for item in list(kept):
        log, _ = item
        info = checked(log.page).info
        if info.utc_offset_us is None:
            continue
        span = (info.start_us + info.utc_offset_us) / 1e6, (info.end_us + info.utc_offset_us) / 1e6
        motion = motion_of(log.page)
        for name, other_span, other in earlier:
            if shared(other_span, span) < SAME_DIVE:
                continue
            shorter_s = min(np.ptp(span), np.ptp(other_span))
            by_motion = motion and other and agreement(other, motion, shorter_s, by_clock=True)
            if by_motion != "":
                kept.remove(item)
                how = by_motion or "by its clock"
                words.append(f"{log.name}: the same dive as {name}: {how}")
                break
        else:
            earlier.append((log.name, span, motion))
    return words


def _free(place: str, taken: Container[str]) -> str:
    path, number = Path(place), 1
    while place in taken:
        number += 1
        place = f"{path.parent}/{path.stem}_{number}{path.suffix}"
    return place


def _title(logs: Mapping[str, SurveyedLog], choice: VehicleChoice) -> str:
    """Return the vehicle that the user named, else that of the log, and the logs."""
    names = [log.name for log in logs.values()]
    health = next(iter(logs.values())).page.health or {}
    more = f" and {len(names) - 1} more" if len(names) > 1 else ""
    of_log = health.get("vehicle") or "Vehicle not named"
    return f"{choice.title or of_log}, {names[0]}{more}"


def _stages(
    feed: CampaignFeed,
    logs: Mapping[str, CheckedLog],
    choice: VehicleChoice,
    legs: LegProposal,
) -> dict[str, str]:
    """Return the parameters that differ from the defaults, as YAML in one line."""
    stages = {}
    dropped = max(
        stream.rejected / max(stream.rows + stream.rejected, 1)
        for log in logs.values()
        for stream in log.info.streams.values()
    )
    if dropped > MOST_DROPPED:
        stages["ingest"] = f"{{max_dropped_share: {min(dropped + 0.02, 1.0):.2f}}}"
    if feed.axes:
        return stages
    rates = [
        clock.rate_hz
        for log in logs.values()
        for name in feed.streams
        if (clock := clock_statistics(log.t_s(name)))
    ]
    if feed.kind in ("glide", "passive"):
        return stages
    if feed.channels:
        rate = min(1.0, FILTER_SAMPLES * min(rates, default=5.0))
        stages["rlse"] = f"{{filter_rate_rad_s: {rate:.2g}, max_gap_s: {feed.max_gap_s:g}}}"
        return stages
    slowest = min(rates, default=24.0)
    least = max(slowest / SAMPLES_PER_PERIOD, CUTOFF_HZ[0])
    most = max(MOST_OF_RATE * slowest, CUTOFF_HZ[0])
    bands = {
        axis: motion_band_hz(t_s[inside], values[inside])
        for key, log in logs.items()
        for axis, (t_s, values, _) in motions(log).items()
        if (inside := legs.inside(list(logs).index(key), t_s)).any()
    }
    axis = max(bands, key=lambda name: bands[name], default="u")
    cutoff = min(max(BANDS * bands.get(axis, 0.0), least), most, CUTOFF_HZ[1])
    stages["fuse"] = (
        f"{{method: kinematic, cutoff_hz: {cutoff:.1f}}}  # check: {MOTION_WORDS[axis]} moves up to"
        f" {bands.get(axis, 0.0):.1f} Hz, its drag up to twice that; the slowest sensor has"
        f" {slowest:.3g} Hz"
    )
    prior = ", prior: vehicle" if "\npublished:" in choice.text else ""
    models = ""
    if "\n  fins:" in choice.text:
        # A vehicle with fins goes ahead: only this structure has their lift.
        models = f", models: [{', '.join((LIFT, *SynthesiseParams().models))}]"
    stages["synthesise"] = f"{{trim: true{prior}{models}}}"
    return stages


def write_files(
    folder: Path, texts: Mapping[str, str], sources: Mapping[str, Path], *, link: bool
) -> None:
    """Write all files of a campaign, or none."""
    clash = [name for name in (*texts, *sources) if (folder / name).exists()]
    clash = [name for name in clash if not _same(folder / name, sources.get(name))]
    if clash:
        raise PipelineError(
            "there is a file already, and nothing is overwritten", file=folder / clash[0]
        )
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder.parent, prefix=f".{folder.name}.") as temporary:
        for name, path in sources.items():
            copy = Path(temporary) / name
            with writable(folder / name):
                copy.parent.mkdir(parents=True, exist_ok=True)
                if link:
                    copy.symlink_to(path.resolve())
                else:
                    shutil.copyfile(path, copy)
        for name, text in texts.items():
            write_atomically(Path(temporary) / name, text.encode())
        for name in (*sources, *texts):
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            if not (folder / name).exists():
                os.replace(Path(temporary) / name, folder / name)


def _same(path: Path, source: Path | None) -> bool:
    return source is not None and path.resolve() == source.resolve()


def _stop(folder: Path, choice: VehicleChoice) -> str:
    """Return why a run of the written campaign would stop, empty if it goes on."""
    if choice.lacking:
        return (
            f"no log tells {choice.lacking}, and there is no default. Fill it in in"
            f" {folder / 'vehicle.yaml'}, or remove {folder} and name a vehicle with --vehicle"
            f" (auvid vehicles lists those that come with auvid).{_of_frame(choice)}"
        )
    pages = log_pages(str(folder), None)
    for page in pages:
        if page.refused is not None:
            return page.refused
    refusal = campaign_refusal(str(folder), pages)
    if refusal is None:
        return ""
    doubt = (
        f"\nThe vehicle {choice.name} is a guess by the number of outputs: if the frame is another,"
        f" remove {folder} and name a vehicle file of it with --vehicle."
    )
    return (
        f"{refusal}{doubt if choice.guessed and choice.name in MOTORS_OF_VEHICLE.values() else ''}"
    )


def _of_frame(choice: VehicleChoice) -> str:
    """Return what a vehicle whose outputs are mixed by an unknown frame can do."""
    if not choice.lacking.startswith(LAYOUT):
        return ""
    return (
        " Mixed by a frame of ArduSub, its pulses feed axes in full commands by a vehicle file with"
        f" actuators: {{commands: {{frame: NAME}}}}; NAME: {', '.join(ARDUSUB_FRAMES)}. Commands of"
        " single axes (surge, sway, heave, yaw of a CSV table, --commands) need no frame."
    )


def _ask(choice: VehicleChoice) -> str:
    """Return the vehicle that the user names, '' for an empty answer."""
    print(f"vehicle: {choice.name} ({choice.why}). Name another or its file, or press Enter:")
    return input("> ").strip()


def print_new_campaign(
    name: str,
    logs: Sequence[Path],
    *,
    vehicle: str | None = None,
    link: bool = False,
    commands: str = "",
) -> int:
    """Write a campaign, print what was written, and return the exit code."""
    terminal = sys.stdin.isatty() and sys.stdout.isatty()
    ask = _ask if terminal else None
    result = new_campaign(name, logs, vehicle=vehicle, link=link, commands=commands, ask=ask)
    answer(
        {
            "folder": result.folder,
            "campaign": result.folder / "campaign.yaml",
            "lines": result.lines,
            "stop": result.stop or None,
        }
    )
    print(f"wrote {path_from_here(result.folder)}")
    print("\n".join(f"  {line}" for line in result.lines))
    if result.stop:
        print(f"\nauvid run would stop: {result.stop}", file=sys.stderr)
        return FAILED
    print(f"\n    auvid run {name}\n")
    return FINE
