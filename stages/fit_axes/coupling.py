"""Axes fitted together, with Coriolis force, where that moves better than one by one.

    e = 1 - fit / 100,   ratio = exp(mean over legs and axes of ln(e_together / e_single))

on every other window, held out both ways, and on legs left out in turn, each flown freely
from its first window to its last. Together is chosen where the ratio is below 1.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from auvid.hydro.arrays import AXES, VELOCITIES
from auvid.hydro.axis_figures import CONSTANT, FORCE, AxisEquation
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.axes.coupled import (
    CoupledFit,
    fit_coupled,
    one_by_one,
    with_other_curves,
)
from auvid.hydro.identification.axes.drive import (
    CURVE,
    DEAD_BAND,
    HEAVE_SKEW,
    LAG,
    MIXED,
    SKEW,
    ForceDrive,
)
from auvid.hydro.identification.axes.held_out import (
    BENT_WORTH,
    FIRST_CURVE,
    FIRST_DEAD_BAND,
    HeldOut,
)
from auvid.hydro.identification.axes.judgement import coefficient_block, shape_of
from auvid.hydro.identification.axes.structure import INERTIA, LIFT, RIGHTING, SYMMETRIC
from auvid.hydro.identification.axes.windows import windows_of
from auvid.hydro.identification.constrained.statuses import FROM_PRIOR
from auvid.hydro.identification.regression.verdicts import IDENTIFIED, T_LIMIT
from auvid.hydro.partial_model import apparent_inertia
from auvid.stages.fit_axes.fitted import (
    DIVES_DIFFER,
    DRAG_AHEAD,
    CommandForces,
    FittedAxis,
    FlownAxis,
    HeldOutFit,
    Together,
)
from auvid.stages.fit_axes.flight import (
    FitOptions,
    LegData,
    doubts_of,
    held_out_fits,
    judged,
)
from auvid.stages.fit_axes.scaling import pull_of, ratio_error
from auvid.stages.steps import tell

HORIZONTAL = "uvr"
"""Velocities that have to be measured: their products are the largest Coriolis forces."""
SHARED = "uvwr"
"""Velocities whose ratio of inertia is fitted: their Coriolis forces move each other."""
FEWEST_WINDOWS = 4
"""Windows that all axes share, below which nothing is fitted together."""
WORTH = 0.98
"""Linear couplings are taken where they err less than this share of the fit without them."""
LOST = 5.0
"""Fit [%] by which a leg that was left out is flown worse than every other window, where the
legs differ: by themselves axes differ by the Coriolis force that each leg has of its own."""
LEAST_ERROR, LARGEST_ERROR = 0.01, 1.0
"""Shares of error beyond these count as these: as good as the measurement, or no better than
the mean, so that an axis which nothing flies decides nothing."""


@dataclass(frozen=True)
class CommonData:
    """What all common fits rest on: axes that were fitted, legs to fit by, all legs."""

    axes: Sequence[str]
    using: Mapping[str, LegData]
    legs: Mapping[str, LegData]
    vehicle: Vehicle
    options: FitOptions
    commands: CommandForces


def fitted_together(
    singles: Sequence[FittedAxis],
    legs: Mapping[str, LegData],
    vehicle: Vehicle,
    options: FitOptions,
    commands: CommandForces,
) -> tuple[tuple[FittedAxis, ...], Together | None]:
    """Return the axes, and which of them were tried together; None where none were.

    All whose velocity is measured, and of these only the ones that predict by themselves,
    from two on: what errs least over all of them is taken. A Coriolis force may be what an
    axis lacks to predict. They start from the fits one by one.
    """
    using = {key: leg for key, leg in legs.items() if leg.windows.use == "training"}
    measured = all(
        np.isfinite(leg.record.rate[item]).any() for leg in using.values() for item in HORIZONTAL
    )
    joining = [
        item
        for item in singles
        if item.surge is None
        and all(np.isfinite(leg.record.rate[item.equation.speed]).any() for leg in using.values())
    ]
    groups = [joining, [item for item in joining if item.predicts_training]]
    records = [leg.record for leg in using.values()]
    groups = [
        item
        for item in groups[: 1 + (groups[0] != groups[1])]
        if len(item) > 1
        and len(windows_of(records, [axis.equation.speed for axis in item])) >= FEWEST_WINDOWS
    ]
    if options.together == "never" and len(singles) > 1:
        return tuple(singles), Together(tuple(i.axis for i in singles), False, float("nan"), 0)
    if not measured or not groups:
        return tuple(singles), None
    tell("axes together", len(AXES) - 1, len(AXES))
    data = CommonData([item.axis for item in singles], using, legs, vehicle, options, commands)
    tried = [_joined_with_couplings(group, data) for group in groups]
    # Axes that a group leaves out err in it as they do one by one.
    best = min(range(len(tried)), key=lambda place: _total(tried[place][1]))
    joint, together, fit = tried[best]
    if options.fit_curve and commands.normalised:
        with_terms = any(len(item.equation.names) > 4 for item in joint.values())
        others = []
        for tried_curve in (_bent, _mixed) if together.chosen else (_mixed,):
            curved = tried_curve(groups[best], data, with_terms)
            if curved is None:
                continue
            if isinstance(curved, CoupledFit):
                others.append(curved)
                continue
            better = curved[1].error_ratio < BENT_WORTH * together.error_ratio
            if tried_curve is _mixed:
                better = flown_better(curved[0], joint)
            others.append(fit if better else curved[2])
            if better:
                joint, together, fit = curved
        if others:
            fit = with_other_curves(fit, others)
            joint = {item.axis: _one_of(fit, item, using, legs) for item in groups[best]}
            together = replace(together, inertia_shares=fitted_shares(fit))
    if not together.chosen:
        return tuple(singles), together
    return tuple(joint.get(item.axis, item) for item in singles), together


def _joined_with_couplings(
    group: Sequence[FittedAxis],
    data: CommonData,
) -> tuple[dict[str, FittedAxis], Together, CoupledFit]:
    """Return the common fit of some axes, with linear couplings where those err less.

    Before groups are compared: a coupling may be what an axis lacks to predict.
    """
    plain = _joined(group, data)
    speeds = [item.equation.speed for item in group]
    if not any(other in speeds for item in group for other in SYMMETRIC[item.axis]):
        return plain
    tell("couplings", len(AXES) - 1, len(AXES))
    coupled = _joined(group, data, couplings=True)
    return coupled if coupled[1].error_ratio < WORTH * plain[1].error_ratio else plain


def flown_better(tried: Mapping[str, FittedAxis], before: Mapping[str, FittedAxis]) -> bool:
    """Return whether some axes err less, by `BENT_WORTH`, on what was held out."""
    pairs = [(before[axis].held_out, item.held_out) for axis, item in tried.items()]
    return error_ratio(pairs)[0] < BENT_WORTH


def _total(item: Together) -> float:
    """Return the logarithm of the ratio, summed over what was held out; nan as 0."""
    return item.pairs * float(np.log(item.error_ratio)) if item.pairs else 0.0


def _bent(
    joining: Sequence[FittedAxis],
    data: CommonData,
    couplings: bool,
) -> tuple[dict[str, FittedAxis], Together, CoupledFit] | CoupledFit:
    """Return a common fit with dead band and curve; only what it moves where not clear.

    Axes that Coriolis force moves show neither by themselves. Where one does, the common
    fit has both, and the straight one is what it may be moved by.
    """
    tell("dead band", len(AXES) - 1, len(AXES))
    straight = ForceDrive(lag_s=data.options.lag_s)
    bent = common_shape(joining, data.options.lag_s) != straight
    shape = straight if bent else replace(straight, dead_band=FIRST_DEAD_BAND, curve=FIRST_CURVE)
    tried = _common_fit(joining, data, couplings=couplings, shape=shape, judge=False)
    if bent or shape_of(tried.fit).word != IDENTIFIED:
        return tried
    return _joined(joining, data, couplings=couplings, shape=shape)


def _mixed(
    joining: Sequence[FittedAxis],
    data: CommonData,
    couplings: bool,
) -> tuple[dict[str, FittedAxis], Together, CoupledFit] | None:
    """Return a common fit with dead band and curve of thrusters that axes share.

    None where fewer than two such axes join, or where the layout of the thrusters is given.
    """
    shared = [item for item in joining if item.axis in MIXED]
    if len(shared) < 2 or any(leg.record.thrusters is not None for leg in data.using.values()):
        return None
    tell("thrusters that axes share", len(AXES) - 1, len(AXES))
    shape = ForceDrive(data.options.lag_s, FIRST_DEAD_BAND, FIRST_CURVE, mixed=True)
    return _joined(joining, data, couplings=couplings, shape=shape)


def _joined(
    joining: Sequence[FittedAxis],
    data: CommonData,
    *,
    couplings: bool = False,
    shape: ForceDrive | None = None,
) -> tuple[dict[str, FittedAxis], Together, CoupledFit]:
    """Return some of the fitted axes of one common fit, and whether it is better.

    Better than one by one: both are judged on the same windows: those that the axes share.
    """
    shape = shape or common_shape(joining, data.options.lag_s)
    fit = _common_fit(joining, data, couplings=couplings, shape=shape)
    by_axis = {item.axis: _one_of(fit, item, data.using, data.legs) for item in joining}
    ratio, pairs = error_ratio(
        [
            (
                held_out_single(item, fit, list(data.using), data.options),
                by_axis[item.axis].held_out,
            )
            for item in joining
        ]
    )
    chosen = data.options.together == "always" or ratio < 1.0
    names = tuple(item.axis for item in joining)
    return by_axis, Together(names, chosen, ratio, pairs, fitted_shares(fit)), fit


def _common_fit(
    joining: Sequence[FittedAxis],
    data: CommonData,
    *,
    couplings: bool,
    shape: ForceDrive,
    judge: bool = True,
) -> CoupledFit:
    """Return the common fit, whose Coriolis force has the inertia that the file has.

    The inertia of an axis may follow from its own fit, m = k / c. Then the search starts
    where one with the ratios of the vehicle file ends.
    """
    bent = shape != ForceDrive(lag_s=data.options.lag_s)
    free = ((LAG,) if data.options.fit_lag else ()) + ((DEAD_BAND, CURVE) if bent else ())
    free += (
        (SKEW, HEAVE_SKEW)
        if shape.mixed and any(i.axis == "Z" for i in joining)
        else ((SKEW,) if shape.mixed else ())
    )
    numerators = filed_inertia(
        [item.axis for item in joining], data.axes, data.vehicle, data.options, data.commands
    )
    shares: dict[str, float] = {}
    if data.commands.normalised and len({of for _, of in numerators.values()}) < 2:
        # Ratios of the file.
        numerators, shares = {}, share_deviations(joining, data.vehicle, data.options)

    def fitted(
        first: Mapping[str, Sequence[float]],
        numerators: Mapping[str, tuple[float, str]],
        *,
        judge: bool,
    ) -> CoupledFit:
        return fit_coupled(
            [leg.record for leg in data.using.values()],
            tuple(item.equation.speed for item in joining),
            inertia=np.array([apparent_inertia(data.vehicle, axis) for axis in AXES]),
            numerators=numerators,
            relative_sd=data.options.inertia_sd,
            share_sd=shares,
            free_inertia=[
                i.equation.speed for i in joining if i.axis not in data.options.given_inertia
            ],
            drive=shape,
            free=free,
            couplings=couplings,
            restoring=any(item.righting is not None for item in joining),
            first=first,
            leave_out=judge,
            doubtful=doubts_of(data.using) if judge else (),
        )

    first = {item.equation.speed: item.equation.values[:4].tolist() for item in joining}
    if numerators:
        by_file = fitted(first, {}, judge=False)
        first = {speed: by_file.block(speed)[0].tolist() for speed in first}
    return fitted(first, numerators, judge=judge)


def share_deviations(
    joining: Sequence[FittedAxis], vehicle: Vehicle, options: FitOptions
) -> dict[str, float]:
    """Return velocity -> deviation of the factor by which its ratio of inertia is off.

    To the inertia of the first axis; none where the file's is measured. A speed that no
    axis fits counts too: a hull that drifts aside turns itself, by the inertia of sway.
    """
    if options.inertia_sd == 0.0:
        return {}
    first, joined = joining[0], {item.equation.speed for item in joining}
    fitted = joined.intersection(SHARED).union("uv") - {first.equation.speed}
    deviation = {
        velocity: ratio_error(vehicle, AXES[VELOCITIES.index(velocity)], first.axis)
        for velocity in VELOCITIES
        if velocity in fitted
    }
    return {velocity: max(options.inertia_sd, sd) for velocity, sd in deviation.items()}


def common_shape(joining: Sequence[FittedAxis], lag_s: float) -> ForceDrive:
    """Return the drive of all axes that a common fit starts from.

    Medians of dead band and curve over the axes that tell them, which the common fit then
    has free; straight where none does.
    """
    bent = [item.shape for item in joining if item.shape.word == IDENTIFIED]
    if not bent:
        return ForceDrive(lag_s=lag_s)
    return ForceDrive(
        lag_s,
        float(np.median([shape.dead_band for shape in bent])),
        float(np.median([shape.curve for shape in bent])),
    )


def filed_inertia(
    axes: Sequence[str],
    every: Sequence[str],
    vehicle: Vehicle,
    options: FitOptions,
    commands: CommandForces,
) -> dict[str, tuple[float, str]]:
    """Return velocity -> k and velocity j, where the filed inertia is k / c_j.

    A pull may be on another axis of `every` one that is fitted. Empty, for the ratios of
    the vehicle file, where that axis does not join and gives an inertia by its own c.
    """
    speed = {axis: VELOCITIES[AXES.index(axis)] for axis in axes}
    if not commands.normalised:
        fixed = options.given_inertia if options.inertia_sd == 0.0 else ()
        return {speed[axis]: (1.0, speed[axis]) for axis in axes if axis not in fixed}
    pulled = commands.pulled(every)
    if options.newtons_from == "mass" or pulled is None:
        return {}
    out = {}
    for axis in axes:
        pull = pull_of(axis, pulled, commands)
        if pull is not None:
            out[speed[axis]] = (pull, speed[axis])
        elif pulled not in axes:
            return {}
        else:
            ratio = apparent_inertia(vehicle, axis) / apparent_inertia(vehicle, pulled)
            out[speed[axis]] = (commands.full_force[pulled] * ratio, speed[pulled])
    return out


def held_out_single(
    item: FittedAxis, fit: CoupledFit, names: Sequence[str], options: FitOptions
) -> Sequence[HeldOutFit]:
    """Return how an axis by itself flies the windows of the common fit, held out."""
    shared = {(names[w.leg], w.first, w.end) for w in fit.pool.windows}
    own = {(part.leg, *ends) for part in item.motion if part.leg in names for ends in part.windows}
    if own == shared:
        return item.held_out
    # The lag is sought anew: that of the fit on all windows has seen what is held out.
    by_itself = one_by_one(fit, item.equation.speed, lag_s=options.lag_s, fit_lag=options.fit_lag)
    return held_out_fits(by_itself, item.equation.speed, names)


def error_ratio(
    pairs: Sequence[tuple[Sequence[HeldOutFit], Sequence[HeldOutFit]]],
) -> tuple[float, int]:
    """Return the geometric mean of e_together / e_single, and of how many; nan of none.

    Infinite where a free run of the common fit is lost.

    pairs: held-out fits of an axis by itself, and together with others.

    >>> single, joint = HeldOutFit("leg a", 0.0, 3, 50.0), HeldOutFit("leg a", 0.0, 3, 75.0)
    >>> error_ratio([([single], [joint])])[0]
    0.5
    >>> single, joint = HeldOutFit("leg a", -9e5, 3), HeldOutFit("leg a", -80.0, 3)
    >>> error_ratio([([single], [joint])])[0]
    1.0
    """
    logs: list[float] = []
    for single, joint in pairs:
        others = {part.what: _error(part) for part in joint if not part.validates}
        for part in single:
            values = _error(part), others.get(part.what, np.nan)
            if np.isfinite(values[0]) and part.what in others and not np.isfinite(values[1]):
                return float("inf"), len(logs) + 1  # the common fit is lost there
            if np.isfinite(values).all():
                logs.append(float(np.log(values[1] / values[0])))
    return (float(np.exp(np.mean(logs))) if logs else float("nan")), len(logs)


def _error(part: HeldOutFit) -> float:
    percent = part.percent if part.one_run is None else part.one_run
    return min(max(1.0 - percent / 100.0, LEAST_ERROR), LARGEST_ERROR)


def _one_of(
    fit: CoupledFit,
    single: FittedAxis,
    using: Mapping[str, LegData],
    legs: Mapping[str, LegData],
) -> FittedAxis:
    """Return an axis of the common fit; how legs differ is the single fit's.

    That they do is a warning where the common fit flies a leg that was left out worse; that
    drag ahead is another than back, where it errs by more than half of the single fit.
    """
    velocity, drive = single.equation.speed, fit.fit.drive
    lag_error, lag_free = 0.0, LAG in fit.pool.free
    if lag_free:
        at = fit.fit.names.index(LAG)
        lag_free = not fit.fit.at_bound[at]
        lag_error = float(np.sqrt(fit.fit.covariance[at, at])) if lag_free else 0.0
    shape = shape_of(fit.fit) if CURVE in fit.pool.free else single.shape
    clear = lag_free and 0.0 < T_LIMIT * lag_error < drive.lag_s
    lag_words = "thrust lag not determined"
    return replace(
        single,
        equation=_equation(fit, velocity),
        rate_rms=fit.speeds[velocity],
        lag_s=drive.lag_s,
        lag_error_s=lag_error if clear else 0.0,
        shape=shape,
        lag_verdict="identified" if clear else "weak" if lag_free else "assumed",
        quantities=fit.without_newtons(velocity),
        notes=tuple(words for words in single.notes if lag_words not in words),
        warnings=tuple(
            words
            for words in single.warnings
            if (DIVES_DIFFER not in words or legs_lose(fit.held_out, velocity))
            and (DRAG_AHEAD not in words or not halves_error(fit.held_out, single))
        ),
        righting=fit.beside_force(velocity, RIGHTING),
        **judged(
            FlownAxis(velocity, fit.pool, fit.fit), fit.held_out, using, legs,
            rms=fit.speeds[velocity],
        ),
    )  # fmt: skip


def legs_lose(held_out: Sequence[HeldOut], velocity: str) -> bool:
    """Return whether a leg left out is flown worse than windows left out, by `LOST`.

    >>> windows, leg = HeldOut("odd windows", {"v": 97.0}, 9), HeldOut("leg 1", {"v": 96.0}, 9)
    >>> legs_lose([windows, leg], "v"), legs_lose([windows], "v")
    (False, True)
    >>> legs_lose([windows, leg, HeldOut("leg 0", {"v": 80.0}, 9)], "v")
    True
    """
    percents: dict[bool, list[float]] = {True: [], False: []}
    for item in held_out:
        if velocity in item.percent and np.isfinite(item.percent[velocity]):
            percents[item.what.startswith("leg ")].append(item.percent[velocity])
    legs, windows = percents[True], percents[False]
    return not (legs and windows) or min(legs) < min(windows) - LOST


def halves_error(held_out: Sequence[HeldOut], single: FittedAxis) -> bool:
    """Return whether a common fit errs by less than half of one axis by itself.

    Drag that differed ahead and back would be in its error, too.
    """
    velocity = single.equation.speed
    percents = [item.percent[velocity] for item in held_out if velocity in item.percent]
    worst = min((value for value in percents if np.isfinite(value)), default=-np.inf)
    return 100.0 - worst < 0.5 * (100.0 - (single.held_out_percent or 0.0))


def fitted_shares(fit: CoupledFit) -> dict[str, tuple[float, float]]:
    """Return axis -> factor of its inertia and the error, of all that are fitted.

    At a bound the legs tell no error: it is that of the prior then. Where they tell little,
    as of yaw beside lift, it is that of both together at least.
    """
    errors = np.sqrt(np.diag(fit.fit.covariance)) * fit.width / NORMAL_95
    size = np.sqrt(np.diag(fit.fit.information))
    return {
        term.axis: (
            float(fit.fit.values[at]),
            term.sd
            if fit.fit.at_bound[at]
            else float(max(errors[at], size[at] * (fit.verdicts[name].word == FROM_PRIOR))),
        )
        for at, (name, term) in enumerate(
            zip(fit.pool.structure.names, fit.pool.structure.terms, strict=True)
        )
        if term.name == INERTIA
    }


def _equation(fit: CoupledFit, velocity: str) -> AxisEquation:
    """Return a, b, c, d of an axis; 1.96 of their errors are half of the interval."""
    axis = AXES[VELOCITIES.index(velocity)]
    others = [o for o in (*SYMMETRIC[axis], LIFT) if f"{axis} {o}" in fit.fit.names]
    names = (velocity, f"{velocity}*|{velocity}|", FORCE, CONSTANT, *others)
    keys = (velocity, f"{velocity}|{velocity}|", FORCE, CONSTANT, *others)
    values, covariance = coefficient_block(fit.fit, axis, keys)
    verdicts = {
        name: fit.verdicts[f"{axis} {key}"].word for name, key in zip(names, keys, strict=True)
    }
    return AxisEquation(axis, names, values, covariance * (fit.width / NORMAL_95) ** 2, verdicts)
