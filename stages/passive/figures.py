"""Figures of bodies that nothing drives, with intervals and verdicts."""

from __future__ import annotations

from typing import Any

import numpy as np

from auvid.hydro.arrays import Array
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.coasting.decay import CoastDecay
from auvid.hydro.identification.passive.free_swing import FreeSwing
from auvid.hydro.identification.passive.tow import TowFit
from auvid.hydro.identification.regression.standard_errors import widened_by
from auvid.hydro.identification.regression.verdicts import IDENTIFIED, WEAK, clear_of_zero
from auvid.stages.passive.motions import PassiveMotions, apparent_mass
from auvid.stages.presentation import Figure, figure

LETTERS = {
    "surge": ("X", "u"),
    "sway": ("Y", "v"),
    "heave": ("Z", "w"),
    "roll": ("K", "p"),
    "pitch": ("M", "q"),
    "yaw": ("N", "r"),
}
OF_FILE = "by the apparent mass of the vehicle file"


def passive_results(motions: PassiveMotions, vehicle: Vehicle) -> dict[str, Any]:
    """Return all figures as a `results` document."""
    rows: list[Figure] = []
    for channel, fit in motions.tow_fits.items():
        rows += _of_tow(channel, fit, "weak" if channel in motions.odd else "")
    for channel, decay in motions.coast_fits.items():
        guessed = channel in motions.guessed
        rows += _of_coasts(channel, decay, vehicle, motions.tow_fits.get(channel), guessed=guessed)
    for channel, swings in motions.swings.items():
        rows += _of_swings(channel, [swing for _, swing in swings], vehicle)
    for leg, velocity, error in motions.drifts:
        for name, value, spread in zip(("north", "east"), velocity, error, strict=True):
            note = "the water carries it: a current, no drag"
            rows.append(
                _row(
                    f"drift to the {name}, {leg}",
                    value,
                    spread,
                    "m/s",
                    note,
                    headline=True,
                )
            )
    return {"title": "body without actuators", "rows": rows}


def _row(
    quantity: str,
    value: float,
    error: float,
    unit: str,
    note: str,
    *,
    verdict: str = "",
    headline: bool = False,
) -> Figure:
    half = NORMAL_95 * error
    return figure(
        quantity,
        value,
        unit,
        error,
        interval=(value - half, value + half),
        verdict=verdict or (IDENTIFIED if clear_of_zero(value, error) else WEAK),
        note=note,
        headline=headline,
    )


def _of_tow(channel: str, fit: TowFit, doubt: str) -> list[Figure]:
    force, velocity = LETTERS[channel]
    errors = np.sqrt(np.diag(fit.covariance))
    speed = _as_named(float(np.sqrt(np.mean(fit.speeds**2))))
    drag, drag_error = fit.drag(speed)
    rows = [
        _row(
            f"drag in {channel} at {speed:.2f} m/s",
            drag,
            drag_error,
            "N",
            f"by the tow force, {fit.forces_N.size} windows",
            verdict=doubt,
            headline=True,
        )
    ]
    both = fit.free[1] and fit.free[2]
    for at, term, unit in ((1, velocity, "kg/s"), (2, f"{velocity}|{velocity}|", "kg/m")):
        if fit.free[at]:
            note = "by the tow force" + ("" if both else "; holds all drag")
            rows.append(
                _row(
                    f"{force}_{term}",
                    -fit.values[at],
                    errors[at],
                    unit,
                    note,
                    verdict=doubt if both else "weak",
                )
            )
    note = "by how it gathers speed" if fit.free[0] else "too steady a tow: that of the file"
    rows.append(
        _row(
            f"apparent mass in {channel}",
            fit.values[0],
            errors[0],
            "kg",
            note,
            verdict=doubt if fit.free[0] else "from the prior",
        )
    )
    rows.append(figure(f"held-out tow force in {channel}", 100.0 * fit.held_out, "percent"))
    return rows


def _as_named(speed: float) -> float:
    """Return the speed as a figure's name has it: .005 m/s more is 1 % of a drag."""
    return round(speed, 2)


def _of_coasts(
    channel: str, decay: CoastDecay, vehicle: Vehicle, tow: TowFit | None, *, guessed: bool
) -> list[Figure]:
    """Return drag over mass; weak where it is negative or its start was `guessed`."""
    turns = channel == "yaw"
    unit, per = ("rad/s", "1/rad") if turns else ("m/s", "1/m")
    speed = _as_named(decay.reference_speed)
    rate, error = decay.rate(speed)
    errors = np.sqrt(np.diag(decay.covariance))
    kind = "inertia" if turns else "mass"
    label = f"drag over apparent {kind} in {channel}"
    note = "d1 x + d2 x|x|"
    start = "from peaks of speed" if guessed else "no force is needed"
    rows = [
        _row(
            name,
            value,
            spread,
            of_unit,
            about,
            verdict="weak" if guessed or value <= 0.0 else "",
            headline=not at,
        )
        for at, (name, value, spread, of_unit, about) in enumerate(
            (
                (f"{label} at {speed:.2f} {unit}", rate, error, "1/s", start),
                (f"{label}, linear", float(decay.drag[0]), float(errors[0]), "1/s", note),
                (f"{label}, quadratic", float(decay.drag[1]), float(errors[1]), per, note),
            )
        )
    ]
    size, spread = apparent_mass(vehicle, channel)
    product = rate * speed * size
    share = float(np.hypot(error / rate, spread / size)) if rate > 0.0 else float("nan")
    rows.append(
        _row(
            f"drag in {channel} at {speed:.2f} {unit}, by the file",
            product,
            abs(product) * share,
            "N m" if turns else "N",
            OF_FILE,
            verdict="from the prior",
        )
    )
    if tow is not None and tow.free[1] and tow.free[2] and rate > 0.0:
        drag, drag_error = tow.drag(speed)
        mass = drag / (rate * speed)
        spread = mass * float(np.hypot(drag_error / drag, error / rate))
        rows.append(
            _row(
                f"apparent mass in {channel}, by tow and coasts",
                mass,
                spread,
                "kg",
                "drag by the tow over drag over mass by the coasts",
            )
        )
    return rows


def pooled(swings: list[FreeSwing]) -> tuple[Array, Array]:
    """Return the mean of k, D_1, D_2 over swings (3,) and standard errors (3,).

    Of several the scatter counts, by Student's t, where it is larger than what each says of
    itself. D_1 and
    D_2 are those of `alike_damped`: linear damping of one swing is another figure than that
    of a swing whose damping is linear and quadratic.
    """
    k, k_error = _mean(swings)
    damping, damping_error = _mean(alike_damped(swings))
    return np.append(k[:1], damping[1:]), np.append(k_error[:1], damping_error[1:])


def alike_damped(swings: list[FreeSwing]) -> list[FreeSwing]:
    """Return the swings with the damping that most have; of two, the larger swings."""

    def weight(damping: str) -> tuple[int, float]:
        own = [swing.amplitude for swing in swings if swing.damping == damping]
        return len(own), max(own)

    chosen = max({swing.damping: None for swing in swings}, key=weight)
    return [swing for swing in swings if swing.damping == chosen]


def _mean(swings: list[FreeSwing]) -> tuple[Array, Array]:
    values = np.array([swing.values for swing in swings])
    own = np.array([np.sqrt(np.maximum(np.diag(swing.covariance), 0.0)) for swing in swings])
    count = len(swings)
    errors = np.sqrt(np.sum(own**2, axis=0)) / count
    if count > 1:
        scatter = values.std(axis=0, ddof=1) / np.sqrt(count)
        errors = np.maximum(errors, widened_by(count - 1) * scatter)
    return values.mean(axis=0), errors


def _of_swings(channel: str, swings: list[FreeSwing], vehicle: Vehicle) -> list[Figure]:
    values, errors = pooled(swings)
    alike = alike_damped(swings)
    k, k_error = float(values[0]), float(errors[0])
    per, what = ("1/m", "mass") if channel == "heave" else ("1/rad", "inertia")
    root = float(np.sqrt(k))
    single = len(swings) == 1
    count = "1 decay: a second tells what water adds" if single else f"{len(swings)} decays"
    doubt = "weak" if single else ""
    terms = (("linear", "1/s"), ("quadratic", per))
    rows = [
        _row(
            f"frequency in {channel}",
            root,
            k_error / (2.0 * root),
            "rad/s",
            f"undamped, small swings; {count}",
            verdict=doubt,
            headline=True,
        ),
        _row(
            f"restoring over apparent {what} in {channel}",
            k,
            k_error,
            "1/s^2",
            count,
            verdict=doubt,
        ),
    ]
    for (name, unit), value, error in zip(terms, values[1:], errors[1:], strict=True):
        if value != 0.0 or error != 0.0:
            label = f"damping over apparent {what} in {channel}, {name}"
            weak = "weak" if value <= 0.0 else doubt
            note = alike[0].damping
            if len(alike) < len(swings):
                note += f"; {len(alike)} of {count}, the others have other damping"
            rows.append(_row(label, float(value), float(error), unit, note, verdict=weak))
    size, spread = apparent_mass(vehicle, channel)
    unit = "N/m" if channel == "heave" else "N m/rad"
    share = float(np.hypot(k_error / k, spread / size))
    rows.append(
        _row(
            f"restoring in {channel}, by the file",
            k * size,
            k * size * share,
            unit,
            OF_FILE,
            verdict="from the prior",
        )
    )
    return rows
