"""Several axes at once, with Coriolis force and couplings, from all legs.

    x_i' = a_i x_i + b_i x_i|x_i| + c_i F_i(lagged) + d_i + couplings + Coriolis_i

(`structure`) by output error over windows of all legs (`pooled_fit`). Velocities that are
not fitted enter as measured. Each leg is left out in turn, and the fit to the others runs
free over its windows and over the whole of it; so is every other window.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import AXES, VELOCITIES, Array
from auvid.hydro.axis_figures import AxisEquation
from auvid.hydro.identification.axes.drive import CURVE, DEAD_BAND, LAG, ForceDrive, changed
from auvid.hydro.identification.axes.held_out import (
    HeldOut,
    doubting_curves,
    held_out_blocks,
    legs_left_out,
)
from auvid.hydro.identification.axes.judgement import (
    AxisVerdict,
    beside_force,
    coefficient_block,
    rms_of,
    verdicts_of,
)
from auvid.hydro.identification.axes.pooled_fit import (
    Loss,
    Pool,
    PoolFit,
    fit_pool,
    make_pool,
    with_doubts,
)
from auvid.hydro.identification.axes.quantities import (
    FitQuantity,
    Scale,
    normalised_quantities,
    physical_quantities,
)
from auvid.hydro.identification.axes.record import AxisRecord
from auvid.hydro.identification.axes.single_axis import CONSTANT_SD, interval_width
from auvid.hydro.identification.axes.starting_values import starting_values
from auvid.hydro.identification.axes.structure import (
    FORCE,
    INERTIA,
    INPUT,
    LIFT,
    SYMMETRIC,
    AxisTerm,
    Structure,
    axis_terms,
    lift_term,
    share_term,
)
from auvid.hydro.identification.axes.windows import windows_of


@dataclass(frozen=True)
class CoupledFit:
    """Fit of several axes with verdicts and held-out fits: windows and legs in turn.

    More in `fit`; `inertia` (6,) as given, only its ratios matter for Coriolis. `width`:
    standard errors of half a 95 % interval.
    """

    velocities: tuple[str, ...]
    normalised: bool
    inertia: Array | None
    pool: Pool
    fit: PoolFit
    verdicts: dict[str, AxisVerdict]
    held_out: tuple[HeldOut, ...]
    speeds: dict[str, float]
    width: float
    notes: tuple[str, ...]

    def block(self, velocity: str) -> tuple[Array, Array]:
        """Return a, b, c, d of an axis and their covariance (4, 4)."""
        names = (velocity, f"{velocity}|{velocity}|", FORCE, "constant")
        return coefficient_block(self.fit, AXES[VELOCITIES.index(velocity)], names)

    def beside_force(self, velocity: str, name: str) -> AxisEquation | None:
        """Return c and a term of an axis by name, None where it has none."""
        return beside_force(self.fit, AXES[VELOCITIES.index(velocity)], name, self.width)

    def without_newtons(self, velocity: str) -> tuple[FitQuantity, ...]:
        """Return time constants, steady speed and damping over inertia of an axis."""
        return normalised_quantities(
            AXES[VELOCITIES.index(velocity)],
            *self.block(velocity),
            width=self.width,
            speed=self.speeds[velocity],
        )

    def scale_of(self, velocity: str, scale: Scale, of: str) -> Scale:
        """Return what turns the commands of an axis into newtons, by that of axis `of`.

        With P the pull of `of`, its apparent inertia is P / c; others follow by the
        ratios of inertia, with the errors of P and c. Raises `DataError` without them.
        """
        if velocity == of:
            return scale
        if self.inertia is None:
            raise DataError(
                "another axis needs the ratios of inertia",
                remedy="Give the apparent inertia of the vehicle.",
            )
        ratio = self._fitted_inertia(velocity) / self._fitted_inertia(of)
        if scale.mass is not None:
            return Scale(mass=ratio * scale.mass, standard_error=ratio * scale.standard_error)
        assert scale.pull_N is not None
        values, covariance = self.block(of)
        mass = ratio * scale.pull_N / values[2]
        relative = float(
            np.hypot(scale.standard_error / scale.pull_N, np.sqrt(covariance[2, 2]) / values[2])
        )
        return Scale(mass=float(mass), standard_error=float(mass) * relative)

    def _fitted_inertia(self, velocity: str) -> float:
        """Return the inertia of an axis with the factor that was fitted, if one was."""
        assert self.inertia is not None
        place, name = VELOCITIES.index(velocity), f"{AXES[VELOCITIES.index(velocity)]} {INERTIA}"
        share = self.fit.values[self.fit.names.index(name)] if name in self.fit.names else 1.0
        return float(self.inertia[place] * share)

    def physical(
        self, velocity: str, scale: Scale | None = None, *, of: str = "u"
    ) -> tuple[FitQuantity, ...]:
        """Return inertia, damping and constant of an axis in SI.

        scale: pull or inertia of axis `of`. Raises `DataError` for commands without.
        """
        if self.normalised and scale is None:
            raise DataError(
                "commands have no newtons",
                remedy="Give one bollard pull, or one known inertia.",
            )
        own = None if scale is None else self.scale_of(velocity, scale, of)
        return physical_quantities(
            AXES[VELOCITIES.index(velocity)], *self.block(velocity), width=self.width, scale=own
        )


def fit_coupled(
    records: Sequence[AxisRecord],
    velocities: Sequence[str],
    *,
    inertia: Array | None = None,
    numerators: Mapping[str, tuple[float, str]] | None = None,
    relative_sd: float = 0.0,
    share_sd: Mapping[str, float] | None = None,
    couplings: bool = False,
    drive: ForceDrive | None = None,
    free: Sequence[str] = (LAG,),
    restoring: bool = False,
    leave_out: bool = True,
    free_inertia: Sequence[str] = (),
    first: Mapping[str, Sequence[float]] | None = None,
    doubtful: Sequence[Sequence[AxisRecord]] = (),
) -> CoupledFit:
    """Fit several axes to the windows that they share, in all legs.

    inertia (6,): apparent inertia of u v w p q r; its ratios give the Coriolis force, and
    where forces are in newtons 1 / m_i is the prior of c_i with `relative_sd`. numerators:
    velocity -> k and velocity j whose c gives its inertia in the Coriolis force, k / c_j in
    place of m_i. share_sd: velocity -> deviation of a factor of m_i there, which is fitted, also
    of a velocity that is measured alone. couplings: linear ones that port-starboard symmetry
    allows, between the velocities that are fitted (the noise of measured ones would enter), and
    the moment of lift, u v of yaw.
    free: parameters of the drive that are fitted. restoring: roll and pitch by angles of
    their own. free_inertia: velocities whose c has no prior. first: velocity -> a, b, c, d
    to start from, as the fits of single axes give them. doubtful: as `fit_axis` has it. Raises
    `DataError` without shared windows.
    """
    pool = coupled_pool(
        records, velocities, inertia=inertia, numerators=numerators, relative_sd=relative_sd,
        share_sd=share_sd, couplings=couplings, drive=drive or ForceDrive(), free=tuple(free),
        restoring=restoring, free_inertia=free_inertia,
    )  # fmt: skip
    fit = with_doubts(pool, fit_pool(pool, _start(pool, first or {})), doubtful)
    held_out: tuple[HeldOut, ...] = ()
    if leave_out:
        begin = fit.values[: len(pool.structure.terms)]
        held_out = (*held_out_blocks(pool, begin), *legs_left_out(pool, begin))
    notes = [] if fit.word == "converged" else ["the search did not settle"]
    return CoupledFit(
        tuple(velocities),
        records[0].normalised,
        inertia,
        pool,
        fit,
        verdicts_of(pool, fit),
        held_out,
        {velocity: rms_of(pool)[velocity] for velocity in velocities},
        interval_width(fit.windows),
        tuple(notes),
    )


def coupled_pool(
    records: Sequence[AxisRecord],
    velocities: Sequence[str],
    *,
    inertia: Array | None,
    relative_sd: float,
    couplings: bool,
    drive: ForceDrive,
    free: tuple[str, ...],
    restoring: bool,
    loss: Loss = "soft_l1",
    free_inertia: Sequence[str] = (),
    numerators: Mapping[str, tuple[float, str]] | None = None,
    share_sd: Mapping[str, float] | None = None,
) -> Pool:
    """Return the pool of a coupled fit; arguments as `fit_coupled`."""
    axes = tuple(AXES[VELOCITIES.index(velocity)] for velocity in velocities)
    free = tuple(name for name in free if records[0].normalised or name not in (DEAD_BAND, CURVE))
    terms: list[AxisTerm] = []
    for axis, velocity in zip(axes, velocities, strict=True):
        inverse = None
        tied = inertia is not None and velocity not in free_inertia
        if inertia is not None and tied and not records[0].normalised:
            c = 1.0 / float(inertia[VELOCITIES.index(velocity)])
            inverse = (c, relative_sd * c)
        terms += axis_terms(
            axis,
            inputs=axes,
            inverse=inverse,
            restoring=restoring and velocity in "pq",
            couplings=[other for other in SYMMETRIC[axis] if couplings and other in velocities],
            share_sd=(share_sd or {}).get(velocity, 0.0),
        )
    terms += [
        share_term(AXES[VELOCITIES.index(velocity)], sd)
        for velocity, sd in (share_sd or {}).items()
        if velocity not in velocities
    ]
    if couplings and inertia is not None and set("uvr") <= set(velocities):
        terms.append(lift_term("N"))
    sd = np.array([CONSTANT_SD[v] for v in velocities])
    ratios, by = inertia, {}
    if inertia is not None:
        ratios = inertia.copy()
        for velocity, (numerator, of) in (numerators or {}).items():
            ratios[VELOCITIES.index(velocity)] = numerator
            by[VELOCITIES.index(velocity)] = f"{AXES[VELOCITIES.index(of)]} {FORCE}"
    structure = Structure(tuple(velocities), tuple(terms), axes, ratios, by)
    windows = windows_of(records, velocities)
    return make_pool(structure, records, windows, constant_sd=sd, drive=drive, free=free, loss=loss)


def with_other_curves(fit: CoupledFit, others: Sequence[CoupledFit]) -> CoupledFit:
    """Return a fit with the errors of its curve of commands, by other curves."""
    wider = doubting_curves(fit.pool, fit.fit, [other.fit for other in others])
    return replace(fit, fit=wider, verdicts=verdicts_of(fit.pool, wider))


def one_by_one(
    fit: CoupledFit, velocity: str, *, lag_s: float, fit_lag: bool
) -> tuple[HeldOut, ...]:
    """Return how one axis by itself flies what the coupled fit was judged on.

    The same windows and legs are held out: those that all axes share, fitted without
    Coriolis force and couplings. fit_lag: whether its lag is fitted, from `lag_s`.
    """
    pool, axis = fit.pool, AXES[VELOCITIES.index(velocity)]
    place = fit.velocities.index(velocity)
    terms = tuple(
        replace(term, of=0) if term.kind == INPUT else term
        for term in pool.structure.terms
        if term.axis == axis and term.name not in {*VELOCITIES, INERTIA, LIFT} - {velocity}
    )
    own = make_pool(
        Structure((velocity,), terms, (axis,)),
        pool.records,
        pool.windows,
        constant_sd=pool.constant_sd[[place]],
        drive=changed(fit.pool.drive, {LAG: lag_s}),
        free=(LAG,) if fit_lag else (),
        loss=pool.loss,
    )
    first = np.array([fit.fit.values[fit.fit.names.index(f"{axis} {term.name}")] for term in terms])
    return (*held_out_blocks(own, first), *legs_left_out(own, first))


def _start(pool: Pool, first: Mapping[str, Sequence[float]]) -> Array:
    """Return coefficients to start from: by velocity, else of the integral."""
    values = starting_values(pool)
    values[[term.name == INERTIA for term in pool.structure.terms]] = 1.0
    for velocity, own in first.items():
        axis = AXES[VELOCITIES.index(velocity)]
        for name, value in zip((velocity, f"{velocity}|{velocity}|", FORCE, "constant"), own,
                               strict=True):  # fmt: skip
            values[pool.structure.names.index(f"{axis} {name}")] = value
    return values
