"""Health of one log: all checks, findings by rank, and their part of the report."""

from __future__ import annotations

import math
from collections.abc import Collection, Generator, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any

import numpy as np
import pyarrow as pa

from auvid.data_schemas.checks import FORCE_MODEL_NEEDS, SEVERITIES, checks
from auvid.data_schemas.records.logs import LogInfo
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.checks.response import Response
from auvid.hydro.identification.signals.pose.track import PoseTrack
from auvid.hydro.long_series.heap import give_back_heap
from auvid.hydro.long_series.long_arrays import let_go
from auvid.hydro.long_series.threads import at_once
from auvid.stages.columns import LINEAR_VELOCITY
from auvid.stages.ingest.health.actuation.fin_answers import fin_findings, propeller_findings
from auvid.stages.ingest.health.actuation.force_clocks import drift_findings, force_clock_findings
from auvid.stages.ingest.health.actuation.frame_outputs import frame_findings
from auvid.stages.ingest.health.actuation.outputs import actuation_findings, battery_findings
from auvid.stages.ingest.health.actuation.plausible_forces import force_findings, shape_findings
from auvid.stages.ingest.health.actuation.push_answers import push_responses, response_signs
from auvid.stages.ingest.health.actuation.responses import (
    late_outputs,
    response_findings,
    responses,
)
from auvid.stages.ingest.health.actuation.single_outputs import single_output_findings
from auvid.stages.ingest.health.actuation.unrelated_commands import one_tone, unrelated_commands
from auvid.stages.ingest.health.agreement.command_clock import command_clock_findings
from auvid.stages.ingest.health.agreement.exchanged_columns import exchanged_columns
from auvid.stages.ingest.health.agreement.gravity import accelerometer_findings
from auvid.stages.ingest.health.agreement.gyro import gyro_findings
from auvid.stages.ingest.health.agreement.inertial_lag import with_inertial_lag
from auvid.stages.ingest.health.agreement.motion import motion_findings
from auvid.stages.ingest.health.agreement.placeholder_values import (
    placeholder_findings,
    placeholders,
    without_placeholders,
)
from auvid.stages.ingest.health.agreement.pose import pose_findings, wrap_findings
from auvid.stages.ingest.health.agreement.sign_changes import with_one_turn, with_one_velocity
from auvid.stages.ingest.health.agreement.sources import (
    attitude_findings,
    depth_findings,
    velocity_findings,
)
from auvid.stages.ingest.health.agreement.tilt import with_direction, with_true_angles, with_upright
from auvid.stages.ingest.health.agreement.velocity.beam_velocity import (
    beam_findings,
    ground_findings,
)
from auvid.stages.ingest.health.agreement.velocity.output_clocks import clock_lag_findings
from auvid.stages.ingest.health.agreement.velocity.velocity_axes import (
    VelocityEvidence,
    velocity_evidence,
)
from auvid.stages.ingest.health.agreement.velocity.velocity_clock import (
    axis_findings,
    axis_out_of_time,
)
from auvid.stages.ingest.health.agreement.velocity.velocity_samples import (
    outlier_findings,
    step_findings,
)
from auvid.stages.ingest.health.causes import OF_MOTION, by_cause, by_mass
from auvid.stages.ingest.health.finding import ON_CHANGE, CheckedLog, Finding
from auvid.stages.ingest.health.records import (
    clock_findings,
    coarse_findings,
    file_findings,
    gap_findings,
    impossible_findings,
    rate_findings,
    rejected_findings,
    sample_findings,
)
from auvid.stages.ingest.health.unseen import unseen
from auvid.stages.ingest.health.unusable_spans import copied_findings, unusable_findings
from auvid.stages.ingest.health.usability import (
    capabilities,
    common_spans,
    excitation,
    excitation_findings,
    verdict,
)
from auvid.stages.ingest.health.vehicle import body_findings, identity_findings, missing_findings
from auvid.stages.ingest.multi_file import DecodedFile
from auvid.stages.ingest.rejection import reject_samples
from auvid.stages.ingest.streams.mapping import OtherSource, Stream, every_source
from auvid.stages.presentation import Block, remark, table

COMPARED = ("attitude", "depth", "velocity", "position")
OF_HALF = 0.4
"""Part by which a lag may differ from half of the time that samples are held."""
LEVELS: Mapping[str, Any] = {"error": "warning", "warning": "warning", "note": "note"}


def other_sources(
    files: Sequence[DecodedFile], streams: Mapping[str, Stream], *, set_us: int | None
) -> list[OtherSource]:
    """Return the sources of the compared streams that are not those of `streams`.

    Unusable samples are left out.
    """
    used = {(name, stream.source) for name, stream in streams.items()}
    return [other for item in files for other in _others(item, used, set_us)]


def _others(
    item: DecodedFile, used: Collection[tuple[str, str]], set_us: int | None
) -> Iterator[OtherSource]:
    for other in every_source(item.log, item.rules, COMPARED, used) if item.rules else ():
        if other.columns is None:
            yield other
            continue
        rows = np.arange(other.columns["time_us"].size)
        other_stream = Stream(other.stream, other.columns, rows, other.source)
        stream, _ = reject_samples(other_stream, set_us=set_us)
        if len(stream):
            yield replace(other, columns=stream.columns)


def check_health(
    tables: Mapping[str, pa.Table],
    info: LogInfo,
    dropped: pa.Table,
    *,
    vehicle: Vehicle | None = None,
    others: Sequence[OtherSource] = (),
    track: PoseTrack | None = None,
) -> dict[str, Any]:
    """Return the `health` document of one log.

    The vehicle file, if there is one, says which outputs are thrusters and which
    barometer is in the water.
    """
    log = CheckedLog(tables, info, dropped, vehicle, others, track)
    log = log.without_empty("velocity", LINEAR_VELOCITY)
    rows = max(table.num_rows for table in tables.values())
    if rows > LONG_ROWS:
        give_back_heap()
    excited = excitation(log)
    uses = capabilities(log, excited)
    absent = placeholders(log)
    real = without_placeholders(log, absent)
    measured = [item for check in OF_RECORDS for item in check(log)]
    measured += placeholder_findings(log, absent)
    compared = _compared(real)
    of_values = chain.from_iterable(check(real) for check in OF_VALUES)
    results = at_once(
        _listed_of_long if rows > LONG_ROWS else list[Finding],
        [*compared.parts, of_values],
        long=LONG_ROWS < rows <= MOST_ROWS_AT_ONCE,
    )
    of_motion = list(_once(chain(*results[:-1]), "clock_drift"))
    measured += results[-1]

    def again(mended: CheckedLog) -> Iterator[Finding]:
        return _once(_findings(mended), "clock_drift")

    measured, of_masses, mended = by_mass(real, [*measured, *of_motion], again)
    measured, explained = by_cause(mended, measured, again)
    quiet = any(item["id"] == "commands_one_tone" for item in measured)
    if not quiet and not any(
        checks()[item["id"]].stops or item["id"] in OF_MOTION for item in measured
    ):
        measured += shape_findings(compared.log)
    findings = ranked([*with_hold_lag(log, measured), *excitation_findings(excited)])
    return {
        "log": info.log,
        "vehicle": info.vehicle,
        "formats": list(dict.fromkeys(item.format for item in info.files)),
        "bytes": sum(item.size_bytes for item in info.files),
        "status": info.status,
        "duration_s": (info.end_us - info.start_us) / 1e6,
        "findings": findings,
        "explained": [*of_masses, *explained],
        "streams": {name: _stream(log, name) for name in tables},
        "shared_spans_s": [list(span) for span in common_spans(log) if np.isfinite(span).all()],
        "verdict": verdict(uses, findings),
        "capabilities": uses,
        "unseen": unseen(compared.log, compared.evidence, compared.answers),
        "answers": {
            axis: {"lag_s": float(answer.lag_s), "explained": float(answer.explained)}
            for axis, answer in compared.answers.items()
        },
        "excitation": excited,
        "notes": list(info.notes),
    }


def _listed_of_long(findings: Iterable[Finding]) -> list[Finding]:
    """Return the findings of checks; what was freed of a long log is given back."""
    give_back_heap()
    let_go()
    return list(findings)


def _put_away(log: CheckedLog) -> None:
    """Give back what was freed and what was read of a log, where it is long."""
    if max(table.num_rows for table in log.tables.values()) > LONG_ROWS:
        give_back_heap()
        let_go()


def with_hold_lag(log: CheckedLog, findings: list[Finding]) -> list[Finding]:
    """Say of a late velocity that its samples are held, where that explains its lag.

    It is late all the same, and stops a run until each repeat is left out.
    """
    share = next(
        (
            item["value"]
            for item in findings
            if (item["id"], item["stream"]) == ("held_samples", "velocity")
        ),
        None,
    )
    if share is None:
        return findings
    half_s = 0.5 * float(np.median(np.diff(log.t_s("velocity")))) / (1.0 - share)
    return [
        {
            **item,
            "text": f"{item['text']} Its samples are held, and so {half_s:.1f} s late on average"
            " (held_samples).",
            "remedy": checks()["held_samples"].remedy,
        }
        if (item["id"], item["stream"]) == ("velocity_lag", "velocity")
        and abs(float(item["value"]) / half_s - 1.0) < OF_HALF
        else item
        for item in findings
    ]


@dataclass(frozen=True)
class _Compared:
    """What sensors and outputs say of each other; `log` as its evidence goes.

    The parts of the findings do not depend on each other.
    """

    log: CheckedLog
    evidence: VelocityEvidence
    answers: dict[str, Response]
    parts: tuple[Iterable[Finding], ...]


def _compared(log: CheckedLog) -> _Compared:
    """Compare the sensors of a log with each other and with its outputs."""
    measured: list[Finding] = []
    sensors = _of_sensors(log)
    while True:
        try:
            measured.append(next(sensors))
        except StopIteration as end:
            log, evidence = end.value
            break
    answers, of_commands = _of_commands(log, evidence)
    return _Compared(log, evidence, answers, (measured, *of_commands))


def _findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield the findings of `_compared` one after another, so that one may stop."""
    log, evidence = yield from _of_sensors(log)
    yield from chain(*_of_commands(log, evidence)[1])


def _of_sensors(log: CheckedLog) -> Generator[Finding, None, tuple[CheckedLog, VelocityEvidence]]:
    """Yield what sensors say of each other; return the log as its evidence goes."""
    exchanged = list(exchanged_columns(log))
    yield from exchanged
    for item in exchanged:  # they say nothing of the others
        log = log.without(item["stream"])
        log = log.without("velocity") if item["stream"] == "depth" else log.without("imu")
    measured: list[Finding] = []
    for mend in (with_upright, with_direction, with_one_turn, with_true_angles):
        log, wrong = mend(log)
        yield from wrong
        measured += wrong
    for check in OF_SENSORS:
        _put_away(log)
        wrong = list(check(log))
        yield from wrong
        measured += wrong
    turns = any(item["id"] in OF_TURNS for item in (*exchanged, *measured))
    if any(item["id"] in OF_GRAVITY and item["stream"] == "imu" for item in measured):
        log = log.without_accelerometer()  # it is no evidence against others
    elif not turns:
        _put_away(log)
        log, late = with_inertial_lag(log)
        yield from late
        turns = any(item["id"] in OF_TURNS for item in late)
    _put_away(log)
    if not turns:
        log, wrong = with_one_velocity(log)
        yield from wrong
        _put_away(log)
    beams = list(beam_findings(log.in_time())) or list(ground_findings(log.in_time()))
    yield from beams
    if beams:
        log = log.without("velocity")  # nor is it of clocks, signs and forces
    _put_away(log)
    return log, velocity_evidence(log.in_time())


def of_forces(log: CheckedLog, answers: Mapping[str, Response]) -> Iterator[Finding]:
    """Yield forces of the thrusters at a wrong time, or of a wrong size."""
    drift = list(drift_findings(log))
    yield from drift
    if not drift and log.has("actuators") and late_outputs(log, answers) is None:
        yield from force_clock_findings(log)
    yield from fin_findings(log)
    yield from propeller_findings(log)
    yield from force_findings(log)


def _of_commands(
    log: CheckedLog, evidence: VelocityEvidence
) -> tuple[dict[str, Response], tuple[Iterable[Finding], ...]]:
    """Return how motion follows the commands, and the findings of both in parts.

    Commands of another motion say nothing of this one, and those that swing at one
    frequency no more than signs, drag and weight: its other checks go without them.
    """
    tone = list(one_tone(log))
    signs = dict(push_responses(log, "uvwr")) if tone else {}
    of_tone = [*tone, *response_signs(log, signs), *(force_findings(log) if tone else ())]
    _put_away(log)
    unrelated = of_tone or list(unrelated_commands(log))
    _put_away(log)
    if unrelated:
        log = log.without("actuators")
    answers = responses(log)
    moving = motion_findings(log, answers, evidence)
    of_axis = list(axis_findings(log, answers))
    single = axis_out_of_time(answers)  # early by itself: it is wrong, or a controller answers it
    early = single is not None and single[1] < 0.0
    of_outputs = response_findings(log, answers, of_axis=bool(of_axis) or early)
    others = (check(log, answers) for check in OF_ANSWERS)
    return answers, (unrelated, moving, of_axis, of_outputs, *others)


def _once(findings: Iterable[Finding], name: str) -> Iterator[Finding]:
    """Yield findings, of one name only the first for each stream."""
    streams = []
    for item in findings:
        if item["id"] == name and item["stream"] in streams:
            continue
        streams += [item["stream"]] if item["id"] == name else []
        yield item


LONG_ROWS = 30_000
"""Samples of a stream from which the checks of a log are worth threads."""
MOST_ROWS_AT_ONCE = 400_000
"""Samples, two hours at 50 Hz, up to which there is memory for several checks at once."""
OF_RECORDS = (
    file_findings,
    rejected_findings,
    impossible_findings,
    missing_findings,
    clock_findings,
    gap_findings,
    rate_findings,
    unusable_findings,
    copied_findings,
    identity_findings,
    frame_findings,
)
"""Checks of how a log was recorded; each yields its findings."""
OF_SENSORS = (gyro_findings, accelerometer_findings, depth_findings)
"""Checks of sensors against each other, which also run on a log that is mended."""
OF_VALUES = (
    sample_findings,
    coarse_findings,
    attitude_findings,
    velocity_findings,
    outlier_findings,
    step_findings,
    pose_findings,
    command_clock_findings,
    wrap_findings,
    actuation_findings,
    single_output_findings,
    battery_findings,
    body_findings,
)
"""Checks of what a log says, without numbers that stand for none."""
OF_GRAVITY = (
    "accelerometer_unit",
    "accelerometer_convention",
    "accelerometer_direction",
    "accelerometer_axes",
)
"""Findings of an accelerometer that is no evidence against other sensors."""
OF_TURNS = ("attitude_unit", "gyro_sign", "gyro_axes", "gyro_scale", "gyro_lag")
"""Findings of attitude and gyro, which do not agree so that both could be late alike."""
OF_ANSWERS = (clock_lag_findings, of_forces)
"""Checks that also read how the motion follows the outputs, which is computed once."""


def ranked(findings: Iterable[Finding]) -> list[Finding]:
    """Sort findings by severity, within it in the order of the catalogue."""
    order = {name: place for place, name in enumerate(checks())}
    return sorted(
        findings, key=lambda item: (SEVERITIES.index(item["severity"]), order[item["id"]])
    )


def _stream(log: CheckedLog, name: str) -> dict[str, Any]:
    about = log.info.streams[name]
    clock = None if name in ON_CHANGE else log.clock(name)
    others = [item for item in about.alternatives if item.source != about.source]
    absent = ("not logged", "has no column")
    return {
        "source": about.source,
        "others": [item.source for item in others if item.status == "available"],
        "refused": [
            item.source
            for item in others
            if item.status != "available" and not item.status.startswith(absent)
        ],
        "rows": about.rows,
        "rejected": about.rejected,
        "rate_hz": None if clock is None or not math.isfinite(clock.rate_hz) else clock.rate_hz,
        "jitter_s": None if clock is None else clock.jitter_s,
        "longest_gap_s": about.longest_gap_s,
        "start_s": float(log.t_s(name)[0]),
        "end_s": float(log.t_s(name)[-1]),
    }


def health_blocks(document: Mapping[str, Any], *, force_model: bool = True) -> list[Block]:
    """Return the health of a log as blocks of the report.

    `force_model`: whether the campaign fits one; else whatever only concerns that is
    left out.
    """
    kept = [
        item for item in document["findings"] if force_model or item["id"] not in FORCE_MODEL_NEEDS
    ]
    keys = ("severity", "id", "text", "value", "threshold", "unit", "remedy")
    findings = [[item[key] for key in keys] for item in kept]
    columns = ["severity", "finding", "what was measured", "value", "threshold", "unit", "remedy"]
    uses = [
        [item["name"], "yes" if item["possible"] else "no", item["reason"]]
        for item in document["capabilities"]
    ]
    blocks = [
        remark(item["text"], LEVELS[item["severity"]])
        for item in kept
        if item["severity"] == "error"
    ]
    blocks.append(
        table(
            "Findings",
            columns,
            findings,
            note="docs/checks.md explains each finding and its threshold.",
        )
    )
    if not force_model:
        return blocks
    blocked = [[item["name"], item["reason"]] for item in document["unseen"]]
    blocks.append(table("Not observable in this log", ["what", "why"], blocked))
    return [
        remark(document["verdict"], "finding"),
        *blocks,
        table("What the log can be used for", ["stage", "possible", "why"], uses),
    ]
