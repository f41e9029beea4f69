"""Whether a model holds by itself: steady motion, steps of its drive, decays.

Free runs judge a model under the commands of an autopilot that held roll and pitch. A
user simulates other commands, with nothing that holds them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from auvid.data_schemas.records.models import (
    ModelCard,
    MotionCheck,
    SteadyRange,
    VelocityRange,
)
from auvid.hydro.arrays import AXES, VELOCITIES, Array, Mask
from auvid.hydro.dynamics.actuators.propeller import propeller_force
from auvid.hydro.dynamics.equations_of_motion import Control
from auvid.hydro.dynamics.jacobians import restoring_jacobian
from auvid.hydro.dynamics.simulation.free_run import MeasuredMotion, fly_freely
from auvid.hydro.dynamics.simulation.growth import Growth, growth
from auvid.hydro.dynamics.steady_motion import (
    NO_MOTION,
    TIPPED_RAD,
    Floating,
    SteadyDrive,
    SteadyMotion,
    overturning,
    rest_tilts,
    steady_motions,
)
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.structures import OWN_VELOCITY
from auvid.hydro.force_input import driven_by_force
from auvid.hydro.identification.regression.verdicts import IDENTIFIED
from auvid.stages.model_use import GROWS_1_S, ORIGIN, TILTED, TILTS, damping_of, listed, own_drives
from auvid.stages.number_format import true_minus
from auvid.stages.page.first_screen import AXIS_WORDS
from auvid.stages.validate.flight_presentation import growth_words, named_cause

DRIVEN = ("X", "Y", "Z", "N")
"""Axes with a steady motion: the righting moment ends those of roll and pitch."""
SPEEDS = 8
"""Speeds from rest to each end of the flown range."""
FLIGHT_S, STEP_S = 40.0, 0.05
TILTED_RAD = np.radians(10.0)
"""Tilt that is said, of a vehicle at rest and under way."""
UNSTABLE = "unstable"
WORST = ("", UNSTABLE, NO_MOTION, *TILTED)
"""What ends a range, the worst last."""
ENDS = {NO_MOTION: "no steady motion was found", UNSTABLE: "it is unstable"}


@dataclass(frozen=True)
class Tried:
    """A drive along an axis towards one end of the flown range."""

    axis: str
    drive: str
    direction: Array
    speeds: Array
    motions: list[SteadyMotion]
    end: str


def motion_checks(
    models: Sequence[tuple[Floating, ModelCard]], *, minimum_speed: float
) -> list[MotionCheck]:
    """Return what each model does by itself within the flown velocities of its card.

    Steady motions of all are sought together: models may differ in inertia, not in what
    else the vehicle file says.
    """
    drives = [_drives(floating.vehicle, card.conditions) for floating, card in models]
    tracks = [
        [
            (drive, SteadyDrive(axis, direction, speeds))
            for (axis, drive), direction in own.items()
            for speeds in _speeds(card.conditions[OWN_VELOCITY[axis]])
        ]
        for (_, card), own in zip(models, drives, strict=True)
    ]
    pairs = [
        (floating, track)
        for (floating, _), own in zip(models, tracks, strict=True)
        for _, track in own
    ]
    outcomes = iter(steady_motions(pairs, minimum_speed=minimum_speed))
    rests = rest_tilts([floating for floating, _ in models])
    return [
        _checked(
            *models[number],
            drives[number],
            [
                Tried(track.axis, drive, track.direction, track.speeds, *next(outcomes))
                for drive, track in own
            ],
            rests[number],
            minimum_speed=minimum_speed,
        )
        for number, own in enumerate(tracks)
    ]


def _checked(
    floating: Floating,
    card: ModelCard,
    drives: Mapping[tuple[str, str], Array],
    tried: Sequence[Tried],
    rest: Array | None,
    *,
    minimum_speed: float,
) -> MotionCheck:
    """Return what a model does, from its steady motions and its tilt (2,) at rest."""
    vehicle = floating.vehicle
    upright, lost, decays = _fly(floating, card, tried, minimum_speed=minimum_speed)
    pairs: dict[tuple[str, str], list[tuple[Tried, Mask]]] = {}
    for item, stays in zip(tried, upright, strict=True):
        pairs.setdefault((item.axis, item.drive), []).append((item, stays))
    ranges = [
        _range(floating, card, parts, minimum_speed=minimum_speed) for parts in pairs.values()
    ]
    righting = -restoring_jacobian(
        np.zeros(6),
        weight=vehicle.weight,
        buoyancy=vehicle.buoyancy,
        r_G=vehicle.r_G,
        r_B=vehicle.r_B,
    )[[3, 4], [3, 4]]
    assumed = any("centre" in name for name in vehicle.assumed)
    steps = np.concatenate([np.zeros(0, dtype=bool), *upright])
    check = MotionCheck(
        verdict="holds",
        words="",
        remedies=[],
        ranges=ranges,
        rest_rad=None if rest is None else rest.tolist(),
        righting_N_m=righting.tolist(),
        righting_is_assumed=assumed,
        steps=len(steps),
        steps_lost=int(np.sum(~steps)),
        decays=decays,
        decays_lost=len(lost),
        seconds=FLIGHT_S,
    )
    decay = growth(vehicle, floating.model, lost, 0.0 * lost[:, :2]) if len(lost) else None
    own = own_drives(check)
    ends = {item.tips_in for item in own}
    if not own:
        check = check.model_copy(update={"verdict": "not tried"})
    elif ends & {"roll", "pitch"}:
        check = check.model_copy(update={"verdict": "tips over"})
    elif UNSTABLE in ends or check.decays_lost or any(item.growth_1_s > GROWS_1_S for item in own):
        check = check.model_copy(update={"verdict": "unstable"})
    elif NO_MOTION in ends:
        check = check.model_copy(update={"verdict": "unknown"})
    return check.model_copy(
        update={"words": _words(check, decay), "remedies": _remedies(check, card, drives)}
    )


def _drives(vehicle: Vehicle, flown: Mapping[str, VelocityRange]) -> dict[tuple[str, str], Array]:
    """Return the force (6,) of a unit of each drive: its own actuators, and one alone.

    Thrusters share X, Y, Z, N by least squares of their forces, and give what K and M
    come with that; a propeller gives its torque at the largest flown speed.
    """
    drives: dict[tuple[str, str], Array] = {}
    places = [AXES.index(axis) for axis in DRIVEN]
    if vehicle.thrusters is not None:
        allocation = vehicle.thrusters.allocation
        mixed = allocation @ np.linalg.pinv(allocation[places])
        for axis, column in zip(DRIVEN, mixed.T, strict=True):
            if column[AXES.index(axis)] > 0.99:
                drives[axis, "thrusters"] = column
    elif vehicle.propeller is not None:
        screw, nu = vehicle.propeller, np.zeros(6)
        nu[0] = flown["u"].high
        spin = np.interp(nu[0], screw.level_speed_m_s, screw.level_speed_rev_s)
        force = propeller_force(screw, nu, spin, water_density=vehicle.water_density)
        if force[0] > 0.0:
            drives["X", "propeller"] = force / force[0]
    for axis, place in zip(DRIVEN, places, strict=True):
        if (axis, "thrusters") in drives or (axis == "X" and vehicle.thrusters is None):
            drives[axis, ORIGIN] = np.eye(6)[place]
    return drives


def _speeds(flown: VelocityRange) -> list[Array]:
    """Return speeds from rest (or the slowest flown) to each end of the flown range."""
    low, high = flown.low, flown.high
    first = float(np.clip(0.0, low, high))
    return [np.linspace(first, end, SPEEDS) for end in (low, high) if end != first]


def slowest_flown(flown: Mapping[str, VelocityRange]) -> Array:
    """Return the velocities (6,) nearest to rest within the flown ranges."""
    return np.array([np.clip(0.0, flown[n].low, flown[n].high) for n in VELOCITIES])


def decay_starts(flown: Mapping[str, VelocityRange]) -> list[Array]:
    """Return the velocities (6,) that decays start from, within the flown ranges.

    Of a velocity at one of its ends the others are 0, or as near as was flown: what lift
    does at rest is no matter of a vehicle that never was. And some corners of all ends.
    """
    ends = np.array([[flown[n].low, flown[n].high] for n in VELOCITIES])
    slowest = slowest_flown(flown)
    single = [np.where(np.eye(6)[i], value, slowest) for i in range(6) for value in ends[i]]
    corners = [
        np.where([(k >> i) & 1 for i in range(6)], ends[:, 1], ends[:, 0]) for k in range(0, 64, 9)
    ]
    return [*single, *corners]


def _fly(
    floating: Floating, card: ModelCard, tried: Sequence[Tried], *, minimum_speed: float
) -> tuple[list[Mask], Array, int]:
    """Return which steps stay upright, decays (k, 6) that do not, and how many flew.

    Steps start as near to rest as was flown: below it the model says nothing.
    """
    rows = int(FLIGHT_S / STEP_S) + 1
    decays = decay_starts(card.conditions)
    steps = [(item, motion) for item in tried for motion in item.motions]
    forces = [motion.force * item.direction for item, motion in steps]
    speeds = [abs(motion.speed) for _, motion in steps]
    speeds += [0.0] * len(decays)
    state = np.zeros((len(speeds) * rows, 12))
    state[: len(steps) * rows, :6] = slowest_flown(card.conditions)
    state[len(steps) * rows :: rows, :6] = decays
    acting = np.repeat(np.array([*forces, *np.zeros((len(decays), 6))]), rows, axis=0)
    motion = MeasuredMotion(
        np.arange(len(state), dtype=np.float64) * STEP_S,
        state,
        Control(thruster_force_N=acting),
        np.repeat(speeds, rows),
    )
    states, _ = fly_freely(
        driven_by_force(floating.vehicle),
        [floating.model],
        floating.constant[None],
        motion,
        first=np.arange(0, len(state), rows),
        steps=np.arange(0, rows, 10),
        minimum_speed=minimum_speed,
    )
    tilts = np.abs(states[0, :, :, 9:11])
    stays = np.all(np.isfinite(tilts) & (tilts < TIPPED_RAD), axis=(1, 2))
    counts = np.cumsum([0, *(len(item.motions) for item in tried)])
    parts = [stays[a:b] for a, b in pairwise(counts)]
    return parts, np.array(decays)[~stays[len(steps) :]], len(decays)


def _range(
    floating: Floating,
    card: ModelCard,
    parts: Sequence[tuple[Tried, Mask]],
    *,
    minimum_speed: float,
) -> SteadyRange:
    """Return how far both directions of a drive go."""
    tried = parts[0][0]
    flown = card.conditions[OWN_VELOCITY[tried.axis]]
    first = float(tried.speeds[0])
    reached, stable = [first, first], [first, first]
    ends = [("", "", 0.0)]
    steady: list[SteadyMotion] = []
    judged: list[SteadyMotion] = []
    for item, stays in parts:
        # A step overshoots: it may tip over on its way to a motion that is upright.
        good = int(np.argmin(stays)) if not stays.all() else len(stays)
        kept = item.motions[:good]
        steady += kept
        place = int(item.speeds[-1] > item.speeds[0])
        reached[place] = kept[-1].speed if kept else first
        stable[place] = _stable_end(item.motions, first)
        ends.append(_end(floating, item, good))
        # Of an unstable range the motions that no step reaches count: they grow fastest.
        judged += item.motions if ends[-1][0] == UNSTABLE else kept
    tips, cause, most = max(ends, key=lambda end: WORST.index(end[0]))
    tilts = np.array([motion.tilt for motion in steady]).reshape(-1, 2)
    fastest = max(judged, key=lambda motion: motion.growth, default=None)
    grows_by = ""
    if fastest is not None and fastest.growth > GROWS_1_S:
        grows_by = growth(
            floating.vehicle,
            floating.model,
            fastest.nu,
            fastest.tilt,
            minimum_speed=minimum_speed,
        ).cause
    return SteadyRange.model_validate(
        {
            "axis": tried.axis,
            "drive": tried.drive,
            "flown": [flown.low, flown.high],
            "upright": reached,
            "stable": stable,
            "roll_rad": float(np.max(np.abs(tilts[:, 0]), initial=0.0)),
            "pitch_rad": float(np.max(np.abs(tilts[:, 1]), initial=0.0)),
            "growth_1_s": 0.0 if fastest is None else fastest.growth,
            "grows_on": "" if fastest is None else fastest.grows_on,
            "grows_by": grows_by,
            "tips_in": tips,
            "cause": cause,
            "cause_N_m": most,
        }
    )


def _stable_end(motions: Sequence[SteadyMotion], first: float) -> float:
    """Return the speed up to which no disturbance grows, from the first one on.

    Where one does at the next speed the growth counts as linear between the two.
    """
    speed, growth = first, 0.0
    for motion in motions:
        if motion.growth > GROWS_1_S:
            share = max(GROWS_1_S - growth, 0.0) / (motion.growth - growth)
            return float(speed + share * (motion.speed - speed))
        speed, growth = motion.speed, motion.growth
    return float(speed)


def _end(floating: Floating, item: Tried, good: int) -> tuple[str, str, float]:
    """Return what ends a drive after `good` motions, its cause and moment [N m]."""
    flown = good < len(item.motions)
    if not item.motions or not (flown or item.end in TILTED):
        return item.end, "", 0.0
    last = item.motions[min(good, len(item.motions) - 1)]
    if flown and last.growth > GROWS_1_S:
        return UNSTABLE, "", 0.0
    tips = TILTED[int(np.argmax(np.abs(last.tilt)))]
    shares = overturning(floating, "KM"[TILTED.index(tips)], last, item.direction)
    cause = next(iter(shares), "")
    return tips, cause, shares.get(cause, 0.0)


def _words(check: MotionCheck, decay: Growth | None) -> str:
    """Return in words what it does under its drive, under a force alone, at rest.

    decay: what grows fastest where a decay that is lost starts.
    """
    if not check.ranges:
        return "no drive was tried: the flown velocities have no range"
    own = [item for item in check.ranges if item.drive != ORIGIN]
    words = []
    for parts, driver in ((own, "driven by its " + (own[0].drive if own else "")), (None, "")):
        items = [item for item in check.ranges if item.drive == ORIGIN] if parts is None else parts
        tips = [item for item in items if item.tips_in]
        if parts is None:
            driver = "under a force at its origin alone"
        if tips:
            colon = ":" if tips[0].tips_in == NO_MOTION else ""
            words.append(f"{driver}{colon} " + listed(_tips(tips)))
        elif parts:
            words.append(f"{driver} it stays upright over the flown speeds" + _tilt(items))
        elif not own and items:
            words.append("it stays upright over the flown speeds" + _tilt(items))
    grows = [item for item in own_drives(check) if item.growth_1_s > GROWS_1_S]
    if grows:
        worst = max(grows, key=lambda item: item.growth_1_s)
        words.append(
            f"unstable in {AXIS_WORDS[worst.grows_on]}: a disturbance grows by"
            f" {worst.growth_1_s:.2g} 1/s at flown speeds of {AXIS_WORDS[worst.axis]}"
            + (f", mostly by {named_cause(worst.grows_by)}" if worst.grows_by else "")
        )
    if check.decays_lost:
        words.append(
            f"{check.decays_lost} of {check.decays} decays from the flown velocities tip over or"
            " leave all bounds"
            + (f": {grown}" if decay is not None and (grown := growth_words(decay)) else "")
        )
    if check.rest_rad is not None and max(map(abs, check.rest_rad)) > TILTED_RAD:
        roll, pitch = np.degrees(check.rest_rad) + 0.0
        words.append(f"at rest it floats at roll {round(roll)}, pitch {round(pitch)} degrees")
    return true_minus("; ".join(words))


def _tips(items: Sequence[SteadyRange]) -> list[str]:
    """Return where a drive tips it over: in pitch above .1 m/s of surge."""
    words: list[str] = []
    for item in items:
        unit = "rad/s" if item.axis == "N" else "m/s"
        ends = item.stable if item.tips_in == UNSTABLE else item.upright
        beyond = [
            f"{side} {end:.2g}"
            for side, end, flown in zip(("below", "above"), ends, item.flown, strict=True)
            if end != flown
        ]
        follows = bool(words) and words[-1].startswith(("it tips", "in "))
        what = f"in {item.tips_in}" if follows else f"it tips over in {item.tips_in}"
        what = ENDS.get(item.tips_in, what)
        cause = f" (most of it by {_named(item)})" if item.cause else ""
        words.append(f"{what} {listed(beyond)} {unit} of {AXIS_WORDS[item.axis]}{cause}")
    return words


def _named(item: SteadyRange) -> str:
    name = {"C": "the Coriolis force of its inertia", "actuators": "its actuators"}
    return f"{name.get(item.cause, item.cause)}, {item.cause_N_m:.2g} N m"


def _tilt(items: Sequence[SteadyRange]) -> str:
    roll = max(item.roll_rad for item in items)
    pitch = max(item.pitch_rad for item in items)
    if max(roll, pitch) < TILTED_RAD:
        return ""
    return f" (to {np.degrees(roll):.0f} degrees of roll, {np.degrees(pitch):.0f} of pitch)"


def _remedies(
    check: MotionCheck, card: ModelCard, drives: Mapping[tuple[str, str], Array]
) -> list[str]:
    """Return what would cure a model that tips over, or make it sure, as sentences."""
    words = []
    tips = [item for item in check.ranges if item.tips_in]
    for item in tips:
        own = drives.get((item.axis, "thrusters"))
        if item.drive == ORIGIN and own is not None and check.verdict == "holds":
            moments = [
                f"{own[i]:.3g} N m of {AXIS_WORDS[AXES[i]]}" for i in (3, 4) if abs(own[i]) > 1e-3
            ]
            if moments:
                words.append(
                    "Simulate it with the pulses of its thrusters, not with a force at its origin;"
                    f" or add {listed(moments)} to each N of {AXIS_WORDS[item.axis]}, as they do."
                )
    askew = check.rest_rad is None or max(map(abs, check.rest_rad)) > TILTED_RAD
    if check.righting_is_assumed and (tips or askew):
        roll, pitch = check.righting_N_m
        words.append(
            f"The righting moment, {roll:.2g} (roll) and {pitch:.2g} (pitch) N m/rad, is assumed:"
            " hang a known weight at a known arm, read the angle, and set centre_of_buoyancy."
        )
    open_axes = [axis for axis in TILTS if damping_of(card, axis) != IDENTIFIED]
    if open_axes:
        named = listed([AXIS_WORDS[axis] for axis in open_axes])
        words.append(
            f"Damping of {named} is not from these data: a dive without attitude hold, or a free"
            " decay on the bench, gives it."
        )
    return words
