"""Forces of the thrusters against what any body needs under water, and their curve."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from auvid.data_schemas.units import NEUTRAL_US
from auvid.hydro.arrays import Array
from auvid.hydro.identification.checks.motion_checks import down_at
from auvid.hydro.identification.checks.response import LONGEST_RESPONSE_S, limited
from auvid.stages.columns import ATTITUDE
from auvid.stages.ingest.health.actuation.push_answers import push_lags, pushes
from auvid.stages.ingest.health.finding import CheckedLog, Finding, finding, limit
from auvid.stages.number_format import significant

SLOWEST_M_S, LEAST_CORRELATION = 0.1, 0.5
"""Speed that 5 % of the samples exceed, and correlation of force and speed, from which on
the work of the thrusters is that against drag.
"""
LINEAR_M_S = 0.2
"""Speed at which linear drag is as large as the largest quadratic one."""
SHORTEST_S, SLICE_S = 50.0, 3.0
LEVEL_RAD, CLEAR = 0.25, 3.0
SQUARE = "act by their square"
ROOT = "act by their root"
MIRRORED = "act by the thrust curve mirrored about neutral, ahead for astern"
LARGEST_SHARE = 1.0 - 1e-6
SHAPE_LAGS_S = tuple(np.round(np.arange(9) * 0.1, 1).tolist())
SPAN_US, OWN = 400.0, "as logged"
"""Pulse of a full command beyond neutral."""
SHAPES: Mapping[str, Callable[[Array, Array], Array]] = {
    MIRRORED: lambda _, commands: -commands,
    **{
        f"pass a limiter of {rate:g} full commands a second": partial(limited, rate=rate)
        for rate in (1.0, 0.5, 0.25)
    },
    SQUARE: lambda _, commands: commands * np.abs(commands),
    ROOT: lambda _, commands: np.sign(commands) * np.sqrt(np.abs(commands)),
}
"""Other shapes (n, k) of commands (n, k) at times (n,); those that are likeliest first."""
LEAST_PART, MIRRORED_PART = 0.25, 0.4
"""Least likelihood of a shape over that logged, as a part of that of the force over none
(logarithms): .12 at most in 80 sound logs, .02 in 66 parts that set no limit, .10 in 32 twins
since; of a mirrored curve .15, .27 and 0.
"""


def force_findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield drag that no body has, and a weight that the thrusters do not hold."""
    thrust = pushes(log)
    if thrust is None or not log.has("velocity") or log.vehicle is None:
        return
    t_s, pushed = thrust
    at, velocity = log.t_s("velocity"), log.body_velocity()
    inside = (t_s >= at[0]) & (t_s <= at[-1])
    if np.count_nonzero(inside) < 2 or not np.isfinite(velocity).all():
        return
    along = np.diag(log.vehicle.mass_matrix)[:2]
    force = (pushed[:, :2] * along)[inside]
    moved = np.column_stack([np.interp(t_s[inside], at, part) for part in velocity.T[:2]])
    yield from _drag(log, force, moved)
    del force, moved
    yield from _weight(log)


def _drag(log: CheckedLog, force: Array, moved: Array) -> Iterator[Finding]:
    """Yield a drag coefficient of surge and sway (n, 2) beyond that of bodies.

    C = 2 cov(F, u) / (rho V^(2/3) <|u|^3>), V the displaced volume: what the thrusters
    work is what drag takes.
    """
    assert log.vehicle is not None
    density = log.vehicle.water_density
    area = np.cbrt(log.vehicle.displaced_mass_kg / density) ** 2
    work = spent = 0.0
    top = 0.0
    for own, speed in zip(force.T, moved.T, strict=True):
        fast = float(np.percentile(np.abs(speed), 95.0))
        if fast < SLOWEST_M_S or not np.ptp(own) or not np.ptp(speed):
            continue
        if float(np.corrcoef(own, speed)[0, 1]) < LEAST_CORRELATION:
            continue
        work += float(np.mean((own - own.mean()) * (speed - speed.mean())))
        spent += 0.5 * density * float(area) * float(np.mean(np.abs(speed) ** 3))
        top = max(top, fast)
    if not spent:
        return
    coefficient, most = work / spent, limit("drag_size") * (1.0 + LINEAR_M_S / top)
    if coefficient < most:
        return
    yield finding(
        "drag_size",
        f"By the thrust curve the thrusters work against a drag coefficient of"
        f" {significant(coefficient)} (on the displaced volume to the power 2/3, at speeds to"
        f" {significant(top)} m/s); bodies have at most {significant(most)}: the"
        " forces are too large.",
        stream="actuators",
        value=coefficient,
    )


@dataclass(frozen=True)
class BorneWeight:
    """Weight in water [N], downward, that the thrusters hold, with its deviation."""

    newtons: float
    sd: float


def borne_weight(log: CheckedLog) -> BorneWeight | None:
    """Return the weight that the thrusters hold; None where nothing shows it.

    Z = -W + a w + b w |w| + c (u^2 + v^2) + d over samples within 14 degrees of level, W
    the weight in water and c lift; samples within three seconds count as one.
    """
    thrust = pushes(log)
    if thrust is None or log.vehicle is None or not log.has("velocity", "attitude"):
        return None
    at, velocity = log.t_s("velocity"), log.body_velocity()
    if not np.isfinite(velocity).all():
        return None
    t_s, pushed = thrust
    down = pushed[:, 2] * log.vehicle.mass_matrix[2, 2]
    upright = down_at(t_s, log.t_s("attitude"), log.values("attitude", ATTITUDE))[:, 2].copy()
    rows = (t_s >= at[0]) & (t_s <= at[-1]) & (upright > np.cos(LEVEL_RAD))
    step = float(np.median(np.diff(t_s)))
    if np.count_nonzero(rows) * step < SHORTEST_S or not np.ptp(down[rows]):
        return None
    u, v, w = (np.interp(t_s[rows], at, part) for part in velocity.T)
    design = np.column_stack([np.ones(u.size), w, w * np.abs(w), u**2 + v**2])
    size = np.linalg.norm(design, axis=0)
    design = design[:, size > 0.0]
    gain = np.linalg.lstsq(design, down[rows], rcond=None)[0]
    rest = down[rows] - design @ gain
    inverse = np.linalg.pinv(design.T @ design)
    sd = float(np.sqrt(inverse[0, 0] * rest.var() * max(SLICE_S / step, 1.0)))
    return BorneWeight(-float(gain[0]), sd)


def _weight(log: CheckedLog) -> Iterator[Finding]:
    """Yield a weight in water that is not what the thrusters hold."""
    vehicle, borne = log.vehicle, borne_weight(log)
    if vehicle is None or borne is None:
        return
    weight = vehicle.mass_kg * vehicle.gravity
    net = weight - vehicle.displaced_mass_kg * vehicle.gravity
    if abs(borne.newtons - net) - CLEAR * borne.sd < limit("weight_held") * weight:
        return
    yield finding(
        "weight_held",
        f"The thrusters hold {borne.newtons:+.1f} +- {2.0 * borne.sd:.1f} N downward weight"
        f" on average; the vehicle file gives {net:+.1f} N (mass less displaced mass, times"
        f" gravity).",
        stream="actuators",
        value=borne.newtons - net,
    )


def shape_odds(log: CheckedLog) -> dict[str, float]:
    """Return by how much other shapes of the outputs are likelier than those logged.

    Logarithms over surge, sway, heave and yaw together, each at its best lag, and that of
    the force as logged over none as `OWN`; empty where the thrusters' force is not known.
    Of a long log its middle ten minutes.
    """
    return dict(_shape_odds(log))


def tells_shape(log: CheckedLog, clear: float) -> bool:
    """Return whether other shapes are less likely than the one logged, by so much."""
    odds = _shape_odds(log)
    own = next(odds, (OWN, 0.0))[1]  # another shape explains nothing at worst
    return own >= clear and all(value <= -clear for _, value in odds)


def _shape_odds(log: CheckedLog) -> Iterator[tuple[str, float]]:
    """Yield what `shape_odds` returns; each is worked out once."""
    if pushes(log) is None or not log.has("velocity"):
        return
    of = log.tables, log.t_s("actuators"), log.t_s("velocity"), log.vehicle
    middle = log.once("middle of outputs", of, partial(_middle, log))
    own = log.once(("shape", OWN), of, partial(_answered, middle, 1.0))
    if not own:
        return
    yield OWN, own
    for words in SHAPES:
        yield words, log.once(("shape", words), of, partial(_shaped_answer, middle, words)) - own


def _middle(log: CheckedLog) -> CheckedLog:
    """Return the ten minutes in the middle of the outputs of a longer log."""
    start, end = log.t_s("actuators")[[0, -1]].tolist()
    if end - start <= LONGEST_RESPONSE_S:
        return log
    middle, half = 0.5 * (start + end), 0.5 * LONGEST_RESPONSE_S
    return log.between(middle - half, middle + half)


def _shaped_answer(log: CheckedLog, words: str) -> float:
    """Return the logarithm of the likelihood of outputs in a shape over none."""
    names = log.thrusters()
    commands = np.nan_to_num((log.values("actuators", names) - NEUTRAL_US) / SPAN_US)
    shaped = SHAPES[words](log.t_s("actuators"), commands)
    pulses = dict(zip(names, (NEUTRAL_US + SPAN_US * shaped).T, strict=True))
    sign = -1.0 if words == MIRRORED else 1.0
    return _answered(log.with_columns("actuators", pulses), sign)


def _answered(log: CheckedLog, sign: float) -> float:
    """Return the logarithm of the likelihood of forces of a sign over none."""
    return sum(
        max(
            -0.5 * gains.count * float(np.log1p(-min(max(gains.explained, 0.0), LARGEST_SHARE)))
            if gains is not None and sign * gains.gain[0] > 0.0
            else 0.0
            for gains in by_lag
        )
        for _, by_lag in push_lags(log, "uvwr", lags_s=SHAPE_LAGS_S)
    )


def shape_findings(log: CheckedLog) -> Iterator[Finding]:
    """Yield outputs that act by another curve than that of the vehicle file."""
    odds = shape_odds(log)
    if not odds:
        return
    parts = dict.fromkeys(odds, LEAST_PART) | {MIRRORED: MIRRORED_PART}
    clear = [
        words
        for words, value in odds.items()
        if words != OWN and value >= max(limit("response_shape"), parts[words] * odds[OWN])
    ]
    if not clear:
        return
    best = max(clear, key=lambda words: odds[words])
    yield finding(
        "response_shape",
        f"The motion follows the outputs better, by e^{odds[best]:.0f}, if they {best}.",
        stream="actuators",
        value=odds[best],
    )
