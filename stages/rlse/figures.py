"""Results of a single-channel run: masses and damping, with intervals and verdicts.

Names: `m - X_udot`, `X_udot`, `X_u`, `X_u|u|` are those of the chosen damping model by
output error; in brackets behind them stands another damping model, and `recursive` for
the recursive estimate: `X_udot (quadratic)`, `X_udot (quadratic, recursive)`, with a
second initial covariance `X_udot (quadratic, recursive, gamma_0 5)`. Where
only commands are known: `X_u/(m - X_udot)`, `X_u|u|/(m - X_udot)`, `1/(m - X_udot)`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from auvid.data_schemas.documents.campaign import LegEntry
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.bench.channel_records import (
    CHANNELS,
    DAMPING,
    WRONG_SIGN,
    ChannelEstimate,
    ChannelFit,
    RecursiveFit,
    Symbols,
    symbols,
)
from auvid.hydro.identification.bench.persistence_of_excitation import NOT_EXCITED, PERSISTENT
from auvid.stages.presentation import Figure, figure
from auvid.stages.rlse.run_of_leg import LegRun

TOO_FAST = "the run answers its force faster than it was sampled: only steady speeds are seen"
CLEAR = 2.0
"""A figure is identified from this many standard errors on."""
IDENTIFIED, WEAK, CONSTANT = "identified", "weak", "constant force"


def no_results(leg: str, leg_run: LegRun, reason: str) -> dict[str, Any]:
    """Return the results of a channel never excited: every figure without a number."""
    names = symbols(leg_run.channel)
    mass, one, two, _ = names.units
    quantities = (
        (f"{names.mass} - {names.added}", mass),
        (names.added, mass),
        (names.linear, one),
        (names.quadratic, two),
    )
    rows = [
        figure(quantity, None, unit, verdict=NOT_EXCITED, note=reason, headline=True)
        for quantity, unit in quantities
    ]
    return {"title": f"{leg_run.channel} of leg {leg}", "rows": rows}


def channel_results(
    leg: str, leg_run: LegRun, estimate: ChannelEstimate, dry: float
) -> dict[str, Any]:
    """Return all figures of a leg, the chosen damping model first.

    Then every damping model by both methods, errors and excitation.
    """
    rows: list[Figure] = []
    for name in (None, *DAMPING):
        fit = estimate.fits[name or estimate.chosen]
        suffix, note = (
            ("", f"{estimate.chosen} damping, output error")
            if name is None
            else (f" ({name})", None)
        )
        rows += _figures(
            leg_run,
            fit,
            _status(estimate, name or estimate.chosen),
            dry,
            suffix,
            note,
            headline=name is None,
        )
    for name in DAMPING:
        suffix = f" ({name}, recursive)"
        rows += _recursive_figures(leg_run, estimate.recursive[name], name, dry, suffix)
    signal = "m/s" if CHANNELS.index(leg_run.channel) < 3 else "rad/s"
    if not leg_run.data.run.rate.size:
        signal = "m" if leg_run.channel == "heave" else "rad"
    for name, fit in estimate.fits.items():
        rows.append(figure(f"rmse ({name})", fit.rmse, signal))
        rows.append(figure(f"rmse held out ({name})", fit.held_out, signal))
    if estimate.lag is not None:
        rows.append(
            figure(
                "thrust lag",
                estimate.lag.value_s,
                "s",
                estimate.lag.standard_error_s,
                note="first-order, found with the figures",
            )
        )
    for name, excited in estimate.excitation.items():
        rows.append(
            figure(
                f"smallest eigenvalue of C_n ({name})",
                float(excited.smallest[-1]),
                "1",
                verdict=excited.status,
            )
        )
    return {"title": f"{leg_run.channel} of leg {leg}", "rows": rows}


def dry_mass(channel: str, vehicle: Vehicle, leg: LegEntry) -> float:
    """Return the mass [kg] or inertia [kg m^2] to subtract for the added mass.

    That of the leg, else of the vehicle file.
    """
    index = CHANNELS.index(channel)
    own = leg.mass_kg if index < 3 else leg.inertia_kg_m2
    if own is not None:
        return own
    return vehicle.mass_kg if index < 3 else float(vehicle.inertia[index - 3, index - 3])


def _status(estimate: ChannelEstimate, name: str) -> str:
    return str(estimate.excitation[name].status)


def _verdict(status: str, value: float, error: float, *, signed: bool = False) -> str:
    """Return the verdict; `signed`: an added mass or damping, which is negative."""
    if status != PERSISTENT:
        return status
    if abs(value) < CLEAR * error:
        return WEAK
    return WRONG_SIGN if signed and value > 0.0 else IDENTIFIED


def _figures(
    leg_run: LegRun,
    fit: ChannelFit,
    status: str,
    dry: float,
    suffix: str,
    note: str | None,
    *,
    headline: bool,
) -> list[Figure]:
    names = symbols(leg_run.channel)
    mass_unit = names.units[0]
    values, errors = fit.values, fit.standard_errors
    total = f"{names.mass} - {names.added}"
    rows = []
    if leg_run.normalised:
        rows += _in_commands(leg_run, fit, status, suffix, note, headline=headline)
        theta, covariance = fit.normalised()
        if not fit.resolved:
            return rows
        spread = np.sqrt(np.diag(covariance))
        for index, (quantity, unit) in enumerate(
            (
                (names.linear, "1/s"),
                (names.quadratic, per_length(leg_run.channel)),
                ("1", per_command(leg_run)),
            )
        ):
            if theta[index] != 0.0:
                verdict = _verdict(status, theta[index], spread[index], signed=index < 2)
                quantity = f"{quantity}/({total}){suffix}"
                rows.append(
                    figure(
                        quantity,
                        theta[index],
                        unit,
                        spread[index],
                        verdict=verdict,
                        note=note,
                        headline=headline,
                    )
                )
        return rows
    low, high = fit.mass_interval
    more: dict[str, Any] = {"note": note, "headline": headline}
    if not fit.resolved:
        rows += [
            figure(
                name + suffix,
                None,
                mass_unit,
                verdict=NOT_EXCITED,
                note=TOO_FAST,
                headline=headline,
            )
            for name in (total, names.added)
        ]
        return rows + _damping_figures(names, fit, status, suffix, more)
    verdict = _verdict(status, values[0], errors[0])
    rows.append(
        figure(
            total + suffix,
            values[0],
            mass_unit,
            errors[0],
            interval=(low, high),
            verdict=verdict,
            **more,
        )
    )
    added = figure(
        names.added + suffix,
        dry - values[0],
        mass_unit,
        errors[0],
        interval=(dry - high, dry - low),
        **more,
    )
    rows.append(added | {"verdict": _verdict(status, dry - values[0], errors[0], signed=True)})
    return rows + _damping_figures(names, fit, status, suffix, more)


def _damping_figures(
    names: Symbols, fit: ChannelFit, status: str, suffix: str, more: Mapping[str, Any]
) -> list[Figure]:
    """Return damping and constant force, as far as the damping model has them."""
    heads = zip(
        (names.linear, names.quadratic, CONSTANT),
        names.units[1:],
        fit.values[1:],
        fit.standard_errors[1:],
        strict=True,
    )
    return [
        figure(
            quantity + suffix,
            value,
            unit,
            error,
            verdict=_verdict(status, value, error, signed=quantity != CONSTANT),
            **more,
        )
        for quantity, unit, value, error in heads
        if error > 0.0
    ]


def _in_commands(
    leg_run: LegRun, fit: ChannelFit, status: str, suffix: str, note: str | None, *, headline: bool
) -> list[Figure]:
    """Return damping and constant force in units of full command.

    Steady speeds determine them even where masses are not known.
    """
    names, angle = symbols(leg_run.channel), "m" if CHANNELS.index(leg_run.channel) < 3 else "rad"
    units = ("1", f"s/{angle}", f"s^2/{angle}^2", "1")
    inside = Symbols(
        names.mass,
        names.added,
        f"{names.linear} in commands",
        f"{names.quadratic} in commands",
        units,
    )
    rows = _damping_figures(inside, fit, status, suffix, {"note": note, "headline": headline})
    for item in rows:
        item["quantity"] = str(item["quantity"]).replace(CONSTANT, f"{CONSTANT} in commands")
    return rows


def second_results(
    leg_run: LegRun, fits: Mapping[str, RecursiveFit], dry: float, spread: float
) -> list[Figure]:
    """Return the figures of recursive estimates with another initial covariance."""
    return [
        row
        for name, fit in fits.items()
        for row in _recursive_figures(
            leg_run, fit, name, dry, f" ({name}, recursive, gamma_0 {spread:g})"
        )
    ]


def _recursive_figures(
    leg_run: LegRun, fit: RecursiveFit, name: str, dry: float, suffix: str
) -> list[Figure]:
    names = symbols(leg_run.channel)
    values, errors = fit.values[-1], fit.spread[-1]
    total = f"{names.mass} - {names.added}"
    if leg_run.normalised:
        theta, spread = fit.estimate.theta[-1], errors[0] / values[0] ** 2
        return (
            [figure(f"1/({total}){suffix}", 1.0 / values[0], per_command(leg_run), spread)]
            if theta.size
            else []
        )
    rows = [
        figure(total + suffix, values[0], names.units[0], errors[0]),
        figure(names.added + suffix, dry - values[0], names.units[0], errors[0]),
    ]
    has: Array = np.array(DAMPING[name])
    for quantity, unit, index in (
        (names.linear, names.units[1], 1),
        (names.quadratic, names.units[2], 2),
    ):
        if has[index - 1]:
            rows.append(figure(quantity + suffix, values[index], unit, errors[index]))
    return rows


def per_length(channel: str) -> str:
    """Return the unit of a quadratic damping over a mass."""
    return "1/m" if CHANNELS.index(channel) < 3 else "1/rad"


def per_command(leg_run: LegRun) -> str:
    """Return the unit of the acceleration at full command."""
    return "m/s^2" if CHANNELS.index(leg_run.channel) < 3 else "rad/s^2"
