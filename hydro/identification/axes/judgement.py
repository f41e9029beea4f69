"""Verdicts on the coefficients of a fit, and whether legs agree.

Words of `regression.verdicts` and `constrained.statuses`: `not excited` where the
velocity or the input hardly moves; `at its bound`; `from the prior` where the prior gives
half of what is known; `inseparable` where two coefficients are known together only;
`identified` from `T_LIMIT` standard errors on; otherwise `weak`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from auvid.hydro.arrays import VELOCITIES, Array
from auvid.hydro.axis_figures import AxisEquation
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.identification.axes.drive import CURVE, DEAD_BAND, MIXED
from auvid.hydro.identification.axes.pooled_fit import Pool, PoolFit
from auvid.hydro.identification.axes.record import AxisRecord, unmeasured
from auvid.hydro.identification.axes.structure import CONSTANT, FORCE, INPUT, AxisTerm
from auvid.hydro.identification.axes.windows import depth_measures
from auvid.hydro.identification.constrained.statuses import AT_BOUND, FROM_PRIOR, PRIOR_SHARE
from auvid.hydro.identification.regression.verdicts import (
    IDENTIFIED,
    INSEPARABLE,
    NOT_EXCITED,
    T_LIMIT,
    WEAK,
)

FLOORS = {"u": 0.03, "v": 0.03, "w": 0.01, "p": 0.02, "q": 0.02, "r": 0.02}
"""RMS from which on a velocity counts as excited [m/s, rad/s]: ten times the noise of
gyro or depth rate at 1 Hz, or of a velocity log."""
INSEPARABLE_CORRELATION = 0.98
"""Correlation from which on two coefficients are not told apart: standard errors five
times as large as with the other one known."""
LIKELY, ALIKE_WITHIN = 0.05, 1.2
"""Legs differ where chance alone is less probable than this, and the largest is more than
so many times the smallest."""
DOUBTED = 2.0
"""From so many times on a doubt of mass or thrust curve is said."""
SIDES_DIFFER = 2.0
"""Ratio of drag ahead and back from which on it is warned of: a tether."""


@dataclass(frozen=True)
class AxisVerdict:
    """Verdict on one coefficient; `partners`: what it is inseparable from."""

    word: str
    partners: tuple[str, ...] = ()


@dataclass(frozen=True)
class Heterogeneity:
    """Whether legs agree in a quantity: Q = sum (x_l - mean)^2 / se_l^2 (Cochran 1954).

    `values` and `standard_errors` by leg number; `probability` of so large a Q by
    chance, chi-squared with legs - 1 degrees; `ratio`: largest over smallest modulus.
    """

    quantity: str
    values: Mapping[int, float]
    standard_errors: Mapping[int, float]
    q: float
    probability: float
    ratio: float

    @property
    def differ(self) -> bool:
        """Return whether the legs differ by more than chance, and by what matters."""
        return self.probability < LIKELY and self.ratio > ALIKE_WITHIN


def verdicts_of(pool: Pool, fit: PoolFit) -> dict[str, AxisVerdict]:
    """Return the verdict on every coefficient, by name `axis term`."""
    moving = _movement(pool)
    size = np.sqrt(np.diag(fit.information))
    out = {}
    for i, term in enumerate(pool.structure.terms):
        error = float(np.sqrt(fit.covariance[i, i]))
        share = 1.0 - fit.information[i, i] / max(fit.data_variances[i], 1e-300)
        with np.errstate(all="ignore"):
            near = np.abs(fit.information[i]) / (size[i] * size)
        partners = tuple(
            name
            for j, name in enumerate(fit.names)
            if j != i and np.isfinite(near[j]) and near[j] >= INSEPARABLE_CORRELATION
        )
        if not _excited(term, moving):
            word = AxisVerdict(NOT_EXCITED)
        elif term.sd == 0.0 or (0.0 < term.sd < np.inf and share >= PRIOR_SHARE):
            word = AxisVerdict(FROM_PRIOR)
        elif fit.at_bound[i]:
            word = AxisVerdict(AT_BOUND)
        elif error > 0.0 and abs(fit.values[i]) >= T_LIMIT * error:
            word = AxisVerdict(IDENTIFIED)
        elif partners:
            word = AxisVerdict(INSEPARABLE, partners)
        else:
            word = AxisVerdict(WEAK)
        out[fit.names[i]] = word
    return out


def rms_of(pool: Pool) -> dict[str, float]:
    """Return the RMS [m/s, rad/s] of every velocity, u to r, over the windows.

    Fitted ones count as measured, gaps as 0.
    """
    out = {}
    nu = np.vstack([pool.prepared[w.leg].nu[w.nodes] for w in pool.windows])
    start = np.vstack([pool.prepared[w.leg].start[w.nodes] for w in pool.windows])
    for j, place in enumerate(pool.structure.places):
        nu[:, place] = start[:, j]
    for j, name in enumerate(VELOCITIES):
        out[name] = float(np.sqrt(np.mean(nu[:, j] ** 2)))
    return out


def _movement(pool: Pool) -> dict[str, float]:
    out = rms_of(pool)
    for name in pool.structure.inputs:
        parts = [
            (pool.records[w.leg].force if name in pool.records[w.leg].force
             else pool.extra[w.leg])[name][w.nodes]
            for w in pool.windows
        ]  # fmt: skip
        out[name] = float(np.ptp(np.concatenate(parts)))
    return out


def _excited(term: AxisTerm, moving: Mapping[str, float]) -> bool:
    if term.kind == CONSTANT:
        return True
    if term.kind == INPUT:
        return moving[term.axis if term.name == "force" else term.name] > 0.0
    name = VELOCITIES[term.of]
    return moving[name] >= FLOORS[name]


def heterogeneity(
    quantity: str, values: Sequence[float], errors: Sequence[float], legs: Sequence[int]
) -> Heterogeneity:
    """Return Cochran's Q of one quantity over legs.

    >>> heterogeneity("drag", [1.0, 3.0], [0.5, 0.5], [0, 1]).q
    8.0
    """
    from scipy.stats import chi2

    x, se = np.asarray(values), np.asarray(errors)
    weight = se**-2.0
    mean = float(weight @ x / weight.sum())
    q = float(weight @ (x - mean) ** 2)
    size = np.abs(x)
    return Heterogeneity(
        quantity,
        dict(zip(legs, x.tolist(), strict=True)),
        dict(zip(legs, se.tolist(), strict=True)),
        q,
        float(chi2.sf(q, len(x) - 1)),
        float(size.max() / size.min()) if size.min() > 0.0 else float("inf"),
    )


def coefficient_block(fit: PoolFit, axis: str, names: Sequence[str]) -> tuple[Array, Array]:
    """Return named values of one axis with their covariance; 0 for absent ones."""
    places = [fit.names.index(f"{axis} {name}") if f"{axis} {name}" in fit.names else -1
              for name in names]  # fmt: skip
    kept = [i for i, place in enumerate(places) if place >= 0]
    index = [places[i] for i in kept]
    values, covariance = np.zeros(len(names)), np.zeros((len(names), len(names)))
    values[kept] = fit.values[index]
    covariance[np.ix_(kept, kept)] = fit.covariance[np.ix_(index, index)]
    return values, covariance


def beside_force(fit: PoolFit, axis: str, name: str, width: float) -> AxisEquation | None:
    """Return c and a term of an axis, for the term as a force; None where it has none.

    1.96 of their standard errors are half of the 95 % interval (`width` errors of the fit).
    """
    if f"{axis} {name}" not in fit.names:
        return None
    names = (FORCE, name)
    values, covariance = coefficient_block(fit, axis, names)
    return AxisEquation(axis, names, values, covariance * (width / NORMAL_95) ** 2, {})


@dataclass(frozen=True)
class InertiaPrior:
    """Apparent inertia [kg, kg m^2] with a relative deviation; 0 holds it."""

    value: float
    relative_sd: float = 0.0


def hull_words(
    velocity: str,
    records: Sequence[AxisRecord],
    inertia: Array | None,
    with_moment: Sequence[float] = (),
) -> tuple[str, ...]:
    """Return a sentence where motion of the hull may count as inertia of yaw or heave.

    inertia (6,): what the fit has its motion by; None where it has none. with_moment:
    held-out fits [%] of yaw that have the moment of the hull.
    """
    by_depth = velocity == "w" and any(depth_measures(record, "w") for record in records)
    if not (velocity == "r" or by_depth) or not unmeasured(records):
        return ()
    what = "the moment of a hull that moves ahead and aside ((m_1 - m_2) u v, Munk, and N_v v)"
    axis, when = "yaw", "turns"
    if by_depth:
        what = "the climb of a hull that is tilted while it moves ahead and aside (u sin theta)"
        axis, when = "heave", "tilts"
    if inertia is None:
        return (
            f"surge and sway are not measured: {what} counts as inertia and damping of {axis},"
            f" which may be off by tens of percent where it {when} under way",
        )
    if by_depth:
        return (
            f"surge and sway are not measured: {what}, by speeds that its forces give, is taken"
            " off the depth; errors of these speeds count as heave",
        )
    flown = ""
    if with_moment:
        percents = " and ".join(f"{percent:.0f}" for percent in with_moment)
        flown = (
            "; held-out fits are flown without it, as a simulation without both speeds is; with it"
            f" every other window is flown to {percents} %"
        )
    return (
        f"surge and sway are not measured: {what} is in the fit by speeds that its forces give,"
        f" with an error as large as itself; a model that has both speeds has it too{flown}",
    )


def with_unseen_moment(
    verdicts: Mapping[str, AxisVerdict], records: Sequence[AxisRecord]
) -> dict[str, AxisVerdict]:
    """Return verdicts of yaw where a moment (m_1 - m_2) u v may be among its damping.

    Nothing measures the speeds of a hull that is driven ahead and aside, and without newtons
    no force gives them: damping that is called identified is weak.
    """
    aside = any(np.nanmax(np.abs(record.force["Y"])) > 0.0 for record in records)
    ahead = any(np.nanmax(np.abs(record.force["X"])) > 0.0 for record in records)
    weak = {name: AxisVerdict(WEAK) for name in ("N r", "N r|r|")}
    change = unmeasured(records) and ahead and aside
    return {
        name: weak[name] if change and name in weak and verdict.word == IDENTIFIED else verdict
        for name, verdict in verdicts.items()
    }


@dataclass(frozen=True)
class LagVerdict:
    """Thrust lag [s] of a fit; `standard_error` nan where it is fixed.

    `deviation_s`: what an assumed one, or a determined one beside speeds that nothing
    measures, may be off by; 0 where it is given. `by_motion_s`: what the motion tells, with
    its error, where the value lies between that and the assumed one. `told_s`: the same
    whatever is taken, None where it tells none.
    """

    value_s: float
    standard_error: float
    determined: bool
    deviation_s: float = 0.0
    by_motion_s: tuple[float, float] | None = None
    told_s: tuple[float, float] | None = None


@dataclass(frozen=True)
class ShapeVerdict:
    """Dead band and curve of commands, with errors; 0 and 1 are a straight line.

    `word`: `identified`, `weak` (bent, but not clearly), `assumed` (straight). `mixed`: they
    are those of the four thrusters that give surge, sway and yaw, which give more one way by
    `skew`, and those of heave by `heave_skew` (`ForceDrive`).
    """

    dead_band: float = 0.0
    dead_band_error: float = 0.0
    curve: float = 1.0
    curve_error: float = 0.0
    word: str = "assumed"
    mixed: bool = False
    skew: float = 0.0
    heave_skew: float = 0.0

    def skew_of(self, axis: str) -> float:
        """Return by how much thrusters of an axis give more one way."""
        return self.skew if axis in MIXED else self.heave_skew if axis == "Z" else 0.0


STRAIGHT = ShapeVerdict()


@dataclass(frozen=True)
class InertiaVerdict:
    """What a fit says of the apparent inertia 1 / c.

    `word`: `given`, `from the prior`, `determined`, `weak` (its lag is assumed),
    `not determined`.
    `value` with its 95 % interval in kg or kg m^2; nan for commands.
    """

    word: str
    value: float
    low: float
    high: float


@dataclass(frozen=True)
class SideDrag:
    """Drag over inertia [1/s] at `speed`, ahead and back, and their ratio."""

    speed: float
    ahead: float
    back: float
    ratio: float
    low: float
    high: float

    @property
    def differ(self) -> bool:
        """Return whether they differ by more than `SIDES_DIFFER`, clearly from 1."""
        clear = self.low > 1.0 or self.high < 1.0
        return clear and max(self.ratio, 1.0 / self.ratio) > SIDES_DIFFER


def doubts(verdict: InertiaVerdict, inertia: InertiaPrior | None) -> tuple[str, ...]:
    """Return a sentence where the motion is not that of the expected inertia."""
    if inertia is None or inertia.relative_sd == 0.0 or not np.isfinite(verdict.value):
        return ()
    ratio = verdict.value / inertia.value
    if 1.0 / DOUBTED < ratio < DOUBTED:
        return ()
    words = (
        "the thrust curve gives too much, or the body has more mass (flooded parts, payload)"
        if ratio > 1.0
        else "the thrust curve gives too little, or the body has less mass"
    )
    return (
        f"it moves as if its inertia were {ratio:.2g} times that of the vehicle file: {words};"
        " these logs cannot tell which",
    )


def notes_of(
    fit: PoolFit,
    legs: Sequence[Heterogeneity],
    sides: SideDrag | None,
    inertia: InertiaVerdict,
    lag: LagVerdict,
) -> tuple[str, ...]:
    """Return what a reader of the figures has to know, a sentence each."""
    notes = []
    if fit.word != "converged":
        notes.append("the search did not settle")
    for item in legs:
        words = "differ" if item.differ else "agree"
        notes.append(
            f"{len(item.values)} legs {words} in {item.quantity}: Q {item.q:.3g}, probability "
            f"{item.probability:.2g}, largest over smallest {item.ratio:.2g}"
        )
    if sides is not None and sides.differ:
        notes.append(
            f"drag ahead is {sides.ratio:.2g} times that back ({sides.low:.2g} to "
            f"{sides.high:.2g}): a tether pulls on one side"
        )
    if inertia.word == "not determined" and np.isfinite(inertia.value):
        notes.append(
            f"inertia not determined, though the fit gives {inertia.value:.3g}; state it in the"
            " vehicle file"
        )
    if not lag.determined:
        words = f"thrust lag not determined: {lag.value_s:.2g} s is assumed"
        if lag.by_motion_s is not None:
            late_s, error_s = lag.by_motion_s
            words = (
                f"thrust lag hardly determined: {lag.value_s:.2g} s, from {late_s:.2g} +-"
                f" {error_s:.1g} s by the motion and what thrusters have"
            )
        notes.append(words + "; inertia trades with it" * (inertia.word == "weak"))
    return tuple(notes)


def shape_of(fit: PoolFit) -> ShapeVerdict:
    """Return dead band and curve of a fit that has them free."""
    at = [fit.names.index(name) for name in (DEAD_BAND, CURVE)]
    errors = np.sqrt(np.diag(fit.covariance)[at])
    band, curve = (float(fit.values[place]) for place in at)
    clear = band > T_LIMIT * errors[0] > 0.0 or abs(curve - 1.0) > T_LIMIT * errors[1] > 0.0
    return ShapeVerdict(
        band, float(errors[0]), curve, float(errors[1]), IDENTIFIED if clear else WEAK,
        fit.drive.mixed, fit.drive.skew, fit.drive.heave_skew,
    )  # fmt: skip
