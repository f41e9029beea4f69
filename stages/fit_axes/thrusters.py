"""How strong each thruster is against those like it, by the axes that were fitted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from auvid.data_schemas.records.partial import ThrusterShare
from auvid.hydro.arrays import AXES
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.axes.coupled import coupled_pool
from auvid.hydro.identification.axes.drive import ForceDrive, force_of
from auvid.hydro.identification.axes.pooled_fit import Pool, PoolFit, fit_pool
from auvid.hydro.identification.axes.record import AxisRecord, ThrusterForces
from auvid.hydro.identification.axes.starting_values import starting_values
from auvid.hydro.identification.axes.windows import windows_of
from auvid.hydro.identification.fleet.thruster_ratios import (
    ThrusterRatio,
    acting_on,
    thruster_ratios,
)
from auvid.hydro.identification.regression.verdicts import IDENTIFIED
from auvid.hydro.partial_model import apparent_inertia
from auvid.stages.fit_axes.fitted import FittedAxis
from auvid.stages.fit_axes.flight import FitOptions, LegData
from auvid.stages.number_format import significant

DRIVEN_ALIKE = 1.0
"""Thrusters that depart less from their mean, in parts of it, are driven alike."""
FEWEST = 4
"""Windows of a fit below which its thrusters are not compared."""


def ratios_of(
    tried: Sequence[FittedAxis],
    legs: Mapping[str, LegData],
    vehicle: Vehicle,
    options: FitOptions,
) -> tuple[ThrusterRatio, ...]:
    """Return how strong thrusters are, by output.

    None where legs mix them in other ways.

    By all fits of axes that were `tried`: a weak thruster may be why one does not predict.
    Axes that the same thrusters push are fitted together, with the Coriolis force by the
    vehicle file.
    """
    records = [leg.record for leg in legs.values() if leg.windows.use == "training"]
    first = records[0].thrusters if records else None
    if first is None or not all(_mixed_alike(first, record.thrusters) for record in records):
        return ()
    out: dict[int, ThrusterRatio] = {}
    for group in linked(first, tried):
        if len(group) > 1 and len(windows_of(records, [i.equation.speed for i in group])) >= FEWEST:
            pool, fit = _together(records, group, vehicle, options)
            out |= {item.output: item for item in thruster_ratios(pool, fit)}
            continue
        for item in group:
            flown = item.flown
            if flown is not None and len(flown.pool.windows) >= FEWEST:
                own = {ratio.output: ratio for ratio in thruster_ratios(flown.pool, flown.fit)}
                out |= {n: one for n, one in own.items() if n not in out or _surer(one, out[n])}
    return tuple(out[output] for output in sorted(out))


def _surer(one: ThrusterRatio, other: ThrusterRatio) -> bool:
    return not one.high - one.low >= other.high - other.low


def as_strong(
    legs: Mapping[str, LegData], ratios: Sequence[ThrusterRatio]
) -> Mapping[str, LegData]:
    """Return legs whose forces have weak thrusters as weak as they are."""
    share = {item.output: item.value for item in ratios if item.is_weak}
    out = {}
    for key, leg in legs.items():
        thrusters = leg.record.thrusters
        if thrusters is not None:
            gains = np.array([share.get(output, 1.0) for output in thrusters.outputs])
            drive = ForceDrive(gains=tuple(gains.tolist()))
            force = {axis: force_of(leg.record, axis, drive) for axis in AXES}
            weaker = thrusters._replace(effect=thrusters.effect * gains)
            leg = replace(leg, record=replace(leg.record, force=force, thrusters=weaker))
        out[key] = leg
    return out


def _mixed_alike(one: ThrusterForces, other: ThrusterForces | None) -> bool:
    alike = other is not None and one.outputs == other.outputs
    return alike and np.allclose(one.effect, other.effect)  # type: ignore[union-attr]


def linked(thrusters: ThrusterForces, fitted: Sequence[FittedAxis]) -> list[list[FittedAxis]]:
    """Return the axes in groups that share no thruster with each other."""
    groups: list[tuple[list[FittedAxis], set[int]]] = []
    for item in fitted:
        own, acting = [item], set(acting_on(thrusters, [item.axis]).tolist())
        unlinked = []
        for others, theirs in groups:
            if acting & theirs:
                own, acting = [*others, *own], acting | theirs
            else:
                unlinked.append((others, theirs))
        groups = [*unlinked, (own, acting)]
    return [sorted(own, key=lambda item: AXES.index(item.axis)) for own, _ in groups]


def _together(
    records: Sequence[AxisRecord],
    group: Sequence[FittedAxis],
    vehicle: Vehicle,
    options: FitOptions,
) -> tuple[Pool, PoolFit]:
    """Return the common pool of some axes, fitted with the mean of their lags."""
    pool = coupled_pool(
        records,
        [item.equation.speed for item in group],
        inertia=np.array([apparent_inertia(vehicle, axis) for axis in AXES]),
        relative_sd=options.inertia_sd,
        couplings=False,
        drive=ForceDrive(lag_s=float(np.mean([item.lag_s for item in group]))),
        free=(),
        restoring=any(item.righting is not None for item in group),
        free_inertia=[i.equation.speed for i in group if i.axis not in options.given_inertia],
    )
    return pool, fit_pool(pool, starting_values(pool))


def share_of(item: ThrusterRatio) -> ThrusterShare:
    """Return the ratio of a thruster for the model file."""
    finite = bool(np.isfinite(item.value))
    return ThrusterShare.model_validate(
        {
            "output": item.output,
            "value": item.value if finite else None,
            "interval_95": [item.low, item.high] if finite else None,
            "others": list(item.others),
            "verdict": item.verdict,
        }
    )


def untold_words(ratios: Sequence[ThrusterRatio]) -> list[str]:
    """Return why thrusters are not told apart, and what would do it."""
    groups: dict[tuple[int, ...], list[ThrusterRatio]] = {}
    for item in ratios:
        if np.isfinite(item.value) and item.verdict != IDENTIFIED:
            groups.setdefault(tuple(sorted((item.output, *item.others))), []).append(item)
    return [
        f"Outputs {', '.join(map(str, outputs))}: the motion tells the sum of their forces. That"
        f" of one departs from their mean by {significant(100.0 * largest, 2)} % of it at most, as"
        " they are driven alike, so that a weak one hides behind the others. Run each by itself"
        " under water for some seconds, both ways (motor test), and log that dive, too."
        for outputs, items in groups.items()
        if (largest := max(item.departure for item in items)) < DRIVEN_ALIKE
    ]


def weak_words(ratios: Sequence[ThrusterRatio]) -> list[str]:
    """Return a sentence for each thruster that gives less than those like it."""
    return [
        f"The thruster on output {item.output} gives {significant(item.value, 2)} times"
        f" ({significant(item.low, 2)} to {significant(item.high, 2)}) what those on outputs"
        f" {', '.join(map(str, item.others))} give: look at its propeller, its motor and its"
        " direction. Forces of these logs have it that weak."
        for item in ratios
        if item.is_weak
    ]
