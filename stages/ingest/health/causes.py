"""Several findings that one mistake explains: mend it, check again, see what is left.

A velocity of the wrong sign answers the thrusters the wrong way round as well, and one
late clock departs from two others. Each mistake that fits is mended in memory; that which
leaves least with the fewest changed entries is named, and what it explains stands behind
it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from auvid.data_schemas.checks import checks
from auvid.data_schemas.units import NEUTRAL_US
from auvid.hydro.arrays import Array
from auvid.stages.columns import ATTITUDE, FINS, GYRO, LINEAR_VELOCITY, RATES, SPEEDS
from auvid.stages.ingest.health.actuation.output_order import (
    OTHER_PLACES,
    other_places,
    placed_otherwise,
)
from auvid.stages.ingest.health.finding import CheckedLog, Finding, finding, listed
from auvid.stages.ingest.health.vehicle import body_findings, other_masses

Mend = Callable[[CheckedLog], CheckedLog]
Check = Callable[[CheckedLog], Iterable[Finding]]

OF_LAGS = ("velocity_lag", "command_late", "commands_early", "command_delay")
"""Findings of a clock that is off by a constant."""
OF_SIGNS = (
    "velocity_sign",
    "depth_sign",
    "response_sign",
    "accelerometer_axes",
    "gyro_sign",
    "gyro_disagrees",
)
OF_GYRO = ("gyro_sign", "gyro_axes", "gyro_scale", "gyro_lag")
OF_MOTION = (
    *OF_SIGNS,
    *OF_LAGS,
    *OF_GYRO,
    "clock_drift",
    "depth_above_water",
    "velocity_axes",
    "velocity_scale",
    "velocity_turned",
    "arm_off",
    "scale_off",
    "velocity_zero",
    "output_dead",
    "tilt_offset",
    "heading_offset",
    "position_axes",
    "response_order",
    "response_unit",
    "response_scale",
    "outputs_unanswered",
    "commands_unrelated",
)
"""Findings that compare sensors and outputs with each other."""
OF_MASSES = ("body_size", "added_mass_size", "weight_in_water", "hull_volume")
OF_FORCES = ("response_unit", "response_scale", "drag_size", "weight_held")
"""Findings of a vehicle file, and of forces beside motion, that a wrong mass makes."""
OF_A_WARNING = 0.3
"""Weight of a finding that stops no run; that of one that does is 1."""
MOST_MISTAKES = 3
WORDS = {"velocity": "velocity", "actuators": "outputs", "depth": "depth"}
"""Streams whose clocks may be off, those of most findings first, in words."""
HALVES = 2.0
OF_LARGEST = 0.1
"""Part of the largest moment of a fin from which on a fin turns an axis."""
ROUNDING = 1e-6


@dataclass(frozen=True)
class Mistake:
    """A mistake by the check that names it, in words, and how it is mended.

    `entries`: how many entries of map or vehicle file are changed for it.
    """

    check: str
    words: str
    stream: str | None
    fields: tuple[str, ...]
    entries: int
    mend: Mend
    value: float = -1.0
    remedy: str = ""


@dataclass(frozen=True)
class _Tried:
    mistake: Mistake
    log: CheckedLog
    left: list[Finding]

    @property
    def rank(self) -> tuple[float, int]:
        return round(weight(self.left), 3), self.mistake.entries


def weight(findings: Sequence[Finding]) -> float:
    """Return how much is wrong, by what findings weigh."""
    return sum(1.0 if checks()[item["id"]].stops else OF_A_WARNING for item in findings)


def by_cause(
    log: CheckedLog, findings: list[Finding], check: Check
) -> tuple[list[Finding], list[dict[str, Any]]]:
    """Return the findings with one for each cause, and those that a cause explains.

    `check` returns the findings of a mended log. What is explained holds the name of its
    cause as `by`.
    """
    left = [item for item in findings if item["id"] in OF_MOTION]
    kept, explained = list(findings), []
    if len(left) == 1 and left[0]["id"] == "response_sign":
        return _with_equals(log, kept, left, check), []
    for _ in range(MOST_MISTAKES):
        if len(left) < 2 or weight(left) < 1.0:
            break
        tried = _tried(log, left, check)
        best = min(tried, key=lambda item: item.rank, default=None)
        if best is None or weight(left) - weight(best.left) < 1.0:
            break
        remaining = {_key(item) for item in best.left}
        gone = [item for item in left if _key(item) not in remaining]
        own, named = _named(best.mistake, gone)
        away = {_key(item) for item in gone}
        explained += [
            {**item, "by": named["id"]}
            for item in kept
            if _key(item) in away and (own is None or _key(item) != _key(own))
        ]
        kept = [*(item for item in kept if _key(item) not in away), named]
        log, left = best.log, best.left
    if any(item["id"] == "velocity_axes" for item in kept):  # one axis is not what it says
        kept = [item for item in kept if item["id"] != "velocity_lag" or len(item["fields"]) != 1]
    return kept, explained


def by_mass(
    log: CheckedLog, findings: list[Finding], check: Check
) -> tuple[list[Finding], list[dict[str, Any]], CheckedLog]:
    """Return the findings with one for wrong masses of a file, and the log mended.

    And those that the masses explain. Masses that leave as little are named beside.
    """
    own = [item for item in findings if item["id"] in OF_MASSES]
    of_forces = [item for item in findings if item["id"] in OF_FORCES]
    if log.vehicle is None or not own or len(own) + len(of_forces) < 2:
        return findings, [], log
    left: dict[str, tuple[CheckedLog, list[Finding]]] = {}
    for words, vehicle in other_masses(log.vehicle).items():
        mended = replace(log, vehicle=vehicle)
        if not any(item["id"] in OF_MASSES for item in body_findings(mended)):
            again = [item for item in check(mended) if item["id"] in OF_FORCES]
            left[words] = mended, again
    if not left:
        return findings, [], log
    least = min(weight(again) for _, again in left.values())
    likely = [name for name, (_, again) in left.items() if weight(again) <= least + ROUNDING]
    mended, again = left[likely[0]]
    remaining = {_key(item) for item in again}
    gone = [item for item in of_forces if _key(item) not in remaining]
    base = next((item for item in own if item["id"] == "weight_in_water"), own[0])
    others = [item for item in (*own, *gone) if item is not base]
    names = dict.fromkeys(_short(item) for item in others)
    explains = f" This explains {listed(list(names))} as well." if names else ""
    named = {
        **base,
        "text": f"{base['text']} All else fits if {', or '.join(likely)}.{explains}",
        "remedy": "Correct rigid_body.mass and rigid_body.displaced_mass, or their unit, in the"
        " vehicle file: mass in air with the water that it encloses.",
    }
    away = {id(item) for item in others}
    kept = [named if item is base else item for item in findings if id(item) not in away]
    return kept, [{**item, "by": base["id"]} for item in others], mended


def _with_equals(
    log: CheckedLog, kept: list[Finding], left: list[Finding], check: Check
) -> list[Finding]:
    """Return findings of which a single one names all mistakes that explain it."""
    equals = [item.mistake for item in _tried(log, left, check, all_of=True) if not item.left]
    words = [item.words for item in equals]
    text = f"{left[0]['text']} Explained by: {'; '.join(words)}."
    return [{**item, "text": text} if words and item is left[0] else item for item in kept]


def _tried(
    log: CheckedLog, left: list[Finding], check: Check, *, all_of: bool = False
) -> list[_Tried]:
    """Return mistakes with what they leave, none behind one that leaves nothing."""
    named = {(item["id"], item["stream"]) for item in left}

    def order(mistake: Mistake) -> tuple[int, bool]:
        return mistake.entries, (mistake.check, mistake.stream) not in named

    # What leaves as much as an earlier one, or takes away too little, is no cause.
    most = 0.0 if all_of else weight(left) - 1.0
    tried: list[_Tried] = []
    for mistake in sorted(_mistakes(log, left), key=order):
        if not all_of and tried and not tried[-1].left:
            break
        mended = mistake.mend(log)
        again: list[Finding] = []
        for item in check(mended):
            again += [item] if item["id"] in OF_MOTION else []
            if weight(again) > most + ROUNDING:
                break
        else:
            tried.append(_Tried(mistake, mended, again))
            most = min(most, weight(again))
    return tried


def _key(item: Finding) -> tuple[str, str | None, tuple[str, ...]]:
    return item["id"], item["stream"], tuple(item["fields"])


def _named(mistake: Mistake, gone: list[Finding]) -> tuple[Finding | None, Finding]:
    """Return the finding that names a mistake already, if any, and the new one."""
    own = next(
        (
            item
            for item in gone
            if (item["id"], item["stream"]) == (mistake.check, mistake.stream)
            and set(item["fields"]) <= set(mistake.fields)
        ),
        None,
    )
    words = mistake.words[0].upper() + mistake.words[1:]
    text = f"{words}." if own is None or mistake.entries > 1 else str(own["text"])
    if own is not None and mistake.fields == ("time_us",):
        text = f"{words}. {own['text']}"
    others = dict.fromkeys(_short(item) for item in gone if item is not own)
    if others:
        text += f" This explains {listed(list(others))} as well."
    base = own or finding(
        mistake.check, text, stream=mistake.stream, value=mistake.value, remedy=mistake.remedy
    )
    return own, {**base, "text": text, "fields": list(mistake.fields)}


def _short(item: Finding) -> str:
    """Return a finding's name and what it concerns."""
    names = dict(zip((*LINEAR_VELOCITY, *GYRO, *ATTITUDE), (*SPEEDS, *RATES, *RATES), strict=True))
    fields = [names[field] for field in item["fields"] if field in names]
    return f"{item['id']} of {listed(list(dict.fromkeys(fields)))}" if fields else str(item["id"])


def _mistakes(log: CheckedLog, left: Sequence[Finding]) -> Iterator[Mistake]:
    names = {item["id"] for item in left}
    if names & set(OF_SIGNS) and "response_order" not in names:  # which weighs signs itself
        yield from _signs(log, left)
    if names & {*OF_LAGS, "clock_drift"}:
        yield from _clocks(log, left)


def _signs(log: CheckedLog, left: Sequence[Finding]) -> Iterator[Mistake]:
    names = {item["id"] for item in left}
    fields = {name for item in left for name in item["fields"]}
    for axis, name in enumerate(LINEAR_VELOCITY):
        if log.has("velocity") and name in fields:
            yield Mistake(
                "velocity_sign",
                f"{SPEEDS[axis]} of the velocity has the wrong sign",
                "velocity",
                (name,),
                1,
                partial(_turned_speeds, axes=(axis,)),
            )
    if log.has("velocity") and "depth_sign" in names:
        yield Mistake(
            "velocity_sign",
            "all axes of the velocity have the wrong sign: it is that of the water past the hull",
            "velocity",
            LINEAR_VELOCITY,
            1,
            partial(_turned_speeds, axes=(0, 1, 2)),
            remedy="Set sign: -1 for the three columns of the velocity.",
        )
    if log.has("depth") and names & {"depth_sign", "depth_above_water"}:
        yield Mistake(
            "depth_sign",
            "depth has the wrong sign",
            "depth",
            ("depth_m",),
            1,
            partial(_turned, stream="depth", fields=("depth_m",)),
        )
        if log.has("velocity"):
            yield Mistake(
                "depth_sign",
                "depth and heave both have the wrong sign: both count upward",
                "depth",
                ("depth_m", LINEAR_VELOCITY[2]),
                2,
                lambda log: _turned_speeds(_turned(log, "depth", ("depth_m",)), (2,)),
                remedy=(
                    "Depth and heave count downward: set sign: -1, or frame: enu and flu, for the"
                    " columns of both."
                ),
            )
    for axis, name in enumerate(GYRO):
        if "gyro_sign" in names and name in fields:
            yield Mistake(
                "gyro_sign",
                f"gyro {'xyz'[axis]} has the wrong sign",
                "imu",
                (name,),
                1,
                partial(_turned, stream="imu", fields=(name,)),
            )
    upward = ATTITUDE[1:], GYRO[1:]
    if log.has("imu", "attitude") and len(left) > 1 and set(GYRO) & fields:
        yield Mistake(
            "response_sign",
            "attitude and gyro are both in axes forward, left, up",
            "imu",
            (*upward[0], *upward[1]),
            2,
            partial(_turned_attitude, angles=upward[0], rates=upward[1]),
            remedy="Set frame: flu for the columns of attitude and gyro.",
        )
    for stream, fields_of, words in (
        ("attitude", upward[0], "pitch and yaw of the attitude are"),
        ("imu", upward[1], "gyro y and z are"),
    ):
        if "gyro_sign" in names and log.has("imu", "attitude"):
            yield Mistake(
                "gyro_sign",
                f"{words} in axes forward, left, up (or a world whose third axis is up)",
                stream,
                fields_of,
                1,
                partial(_turned, stream=stream, fields=fields_of),
                remedy="Set frame: flu, or enu for the heading, for these columns.",
            )
    for axis in range(3):
        by_speed = axis < 2 and LINEAR_VELOCITY[1 - axis] in fields
        by_rate = GYRO[axis] in fields or names & {"accelerometer_axes", "gyro_disagrees"}
        if log.has("imu", "attitude") and (by_speed or by_rate):
            yield Mistake(
                "response_sign",
                f"{RATES[axis]} and its rate, gyro {'xyz'[axis]}, both have the wrong sign",
                "imu",
                (ATTITUDE[axis], GYRO[axis]),
                2,
                partial(
                    _turned_attitude, angles=ATTITUDE[axis : axis + 1], rates=GYRO[axis : axis + 1]
                ),
                remedy="Set sign: -1 for both columns, or frame: flu for attitude and gyro.",
            )
    if names & set(OF_GYRO):
        return  # motion by a wrong gyro is no evidence against outputs
    yield from _fins(log, left)
    if "response_sign" in names and log.thrusters():
        outputs = tuple(log.thrusters())
        yield Mistake(
            "response_sign",
            "all outputs act the other way round",
            "actuators",
            outputs,
            1,
            partial(_turned, stream="actuators", fields=outputs, about=NEUTRAL_US),
            remedy=(
                "Turn the pulses about neutral before the export, or the directions of the"
                " thrusters in the vehicle file."
            ),
        )
    if "response_sign" in names and log.vehicle is not None:
        for words in other_places(log.vehicle):
            yield Mistake(
                "response_order",
                f"the vehicle file has {words} of the thrusters",
                "actuators",
                (),
                1,
                partial(_placed, words=words),
            )


def _fins(log: CheckedLog, left: Sequence[Finding]) -> Iterator[Mistake]:
    """Yield the fins that turn an axis, where it answers them the wrong way round."""
    fins = log.vehicle and log.vehicle.fins
    if not fins or not log.has("actuators"):
        return
    fields = {name for item in left if item["id"] == "response_sign" for name in item["fields"]}
    for axis in (1, 2):
        moments = np.abs(fins.linear[3 + axis])
        own = tuple(np.array(FINS)[moments > OF_LARGEST * moments.max(initial=0.0)].tolist())
        if GYRO[axis] in fields and set(own) <= set(log.tables["actuators"].column_names):
            names = listed([name.removesuffix("_rad") for name in own])
            yield Mistake(
                "response_sign",
                f"the fins of {RATES[axis]}, {names}, have the wrong sign",
                "actuators",
                own,
                1,
                partial(_turned, stream="actuators", fields=own),
                remedy="Set sign: -1 for the columns of these fins, or correct their columns of"
                " actuators.fins in the vehicle file.",
            )


def _clocks(log: CheckedLog, left: Sequence[Finding]) -> Iterator[Mistake]:
    """Yield clocks that are off, by what the findings measured: later is positive."""
    shifts: set[tuple[str, float]] = set()
    rates: set[tuple[str, float]] = set()
    for item in left:
        size = round(abs(float(item["value"] or 0.0)), 2)
        if item["id"] == "velocity_lag" and len(item["fields"]) == 1:
            yield from _late_axis(log, item["fields"][0], size)
        elif item["id"] == "velocity_lag":
            shifts |= {(name, side * size) for name in ("velocity", "depth") for side in (-1, 1)}
        elif item["id"] == "command_late":
            shifts |= {("actuators", size), ("velocity", -size)}
        elif item["id"] in OF_LAGS:
            shifts |= {("actuators", -size), ("velocity", size)}
        elif item["id"] == "clock_drift":
            times = log.t_s(str(item["stream"]))
            rate = HALVES * size / float(times[-1] - times[0])
            rates |= {(name, side * rate) for name in ("velocity", "actuators") for side in (-1, 1)}
    for name, late_s in sorted(shifts, key=lambda item: (list(WORDS).index(item[0]), item[1])):
        if late_s and log.has(name):
            yield _late(name, late_s)
    for name, rate in sorted(rates, reverse=True):
        if log.has(name):
            yield Mistake(
                "clock_drift",
                f"the clock of the {WORDS[name]} drifts by {100.0 * abs(rate):.1f} %",
                name,
                ("time_us",),
                1,
                partial(_timed, stream=name, rate=rate),
                value=rate * float(np.ptp(log.t_s(name))) / HALVES,
            )


def _late_axis(log: CheckedLog, name: str, size_s: float) -> Iterator[Mistake]:
    """Yield one axis of the velocity that is late, or early, by itself."""
    words = SPEEDS[LINEAR_VELOCITY.index(name)]
    for late_s in (size_s, -size_s):
        late = "late" if late_s > 0.0 else "early"
        yield Mistake(
            "velocity_lag",
            f"{words} of the velocity is {size_s:.1f} s {late} by itself",
            "velocity",
            (name,),
            1,
            partial(_read_later, name=name, late_s=late_s),
            value=size_s,
        )


def _read_later(log: CheckedLog, name: str, late_s: float) -> CheckedLog:
    t_s = log.t_s("velocity")
    return log.with_columns(
        "velocity", {name: np.interp(t_s + late_s, t_s, log.column("velocity", name))}
    )


def _late(name: str, late_s: float) -> Mistake:
    """Return a stream that is stamped so much later than measured, or earlier."""
    late = "late" if late_s > 0.0 else "early"
    check = "velocity_lag"
    if name == "actuators":
        check = "command_late" if late_s > 0.0 else "commands_early"
    several = name == "actuators"
    return Mistake(
        check,
        f"the {WORDS[name]} {'are' if several else 'is'} stamped {abs(late_s):.1f} s {late}",
        name,
        ("time_us",),
        1,
        partial(_timed, stream=name, late_s=late_s),
        value=abs(late_s),
    )


def _timed(log: CheckedLog, stream: str, *, late_s: float = 0.0, rate: float = 0.0) -> CheckedLog:
    times = {name: log.t_s(name) for name in log.tables}
    own = times[stream]
    times[stream] = own - late_s - rate * (own - own[0])
    return replace(log, _times=times)


def _turned(log: CheckedLog, stream: str, fields: Sequence[str], about: float = 0.0) -> CheckedLog:
    return log.with_columns(
        stream, {name: 2.0 * about - log.column(stream, name) for name in fields}
    )


def _turned_attitude(log: CheckedLog, angles: Sequence[str], rates: Sequence[str]) -> CheckedLog:
    return _turned(_turned(log, "attitude", angles), "imu", rates)


def _turned_speeds(log: CheckedLog, axes: Sequence[int]) -> CheckedLog:
    """Return the log with the signs of some axes of the body's velocity turned."""
    rotation = np.eye(3) if log.vehicle is None else log.vehicle.dvl.rotation
    signs = np.where(np.isin(np.arange(3), axes), -1.0, 1.0)
    turn: Array = rotation.T @ np.diag(signs) @ rotation
    values = log.values("velocity", LINEAR_VELOCITY)
    # An axis that is not measured spoils no other where nothing is mounted askew.
    level = np.array_equal(rotation, np.eye(3))
    turned = values * signs if level else values @ turn.T
    return log.with_columns("velocity", dict(zip(LINEAR_VELOCITY, turned.T, strict=True)))


def _placed(log: CheckedLog, words: str) -> CheckedLog:
    assert log.vehicle is not None
    return replace(log, vehicle=placed_otherwise(log.vehicle, *OTHER_PLACES[words]))
