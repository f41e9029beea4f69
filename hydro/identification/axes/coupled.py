"""Several axes at once, with Coriolis force and couplings, from all legs.

    x_i' = a_i x_i + b_i x_i|x_i| + c_i F_i(lagged) + d_i + couplings + Coriolis_i

(`structure`) by output error over windows of all legs (`pooled_fit`). Velocities that are
not fitted enter as measured. Each leg is left out in turn, and the fit to the others runs
free over the whole of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import AXES, VELOCITIES, Array
from auvid.hydro.identification.axes.drive import CURVE, DEAD_BAND, LAG, ForceDrive
from auvid.hydro.identification.axes.held_out import (
    HeldOut,
    free_run,
    held_out_blocks,
    percent_of,
    signals,
)
from auvid.hydro.identification.axes.judgement import (
    AxisVerdict,
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
    SYMMETRIC,
    AxisTerm,
    Structure,
    axis_terms,
)
from auvid.hydro.identification.axes.windows import (
    WINDOW_S,
    MotionWindow,
    measured_rate,
    stretches,
    windows_of,
)

NOT_COMMANDED = "not commanded"
COMMANDED = 1e-3
"""A leg commands an axis where its force moves by more than this share of the largest."""


@dataclass(frozen=True)
class LegFreeRun:
    """Free run over a whole leg that the fit did not use.

    `percent`: fit [%] by velocity; `not_commanded`: velocities that the leg does not
    command. `t_s` (n,), `measured` and `simulated` by velocity, (n,).
    """

    leg: int
    percent: dict[str, float]
    not_commanded: tuple[str, ...]
    t_s: Array
    measured: dict[str, Array]
    simulated: dict[str, Array]


@dataclass(frozen=True)
class CoupledFit:
    """Fit of several axes with verdicts, and free runs over each leg left out.

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
    left_out: tuple[LegFreeRun, ...]
    speeds: dict[str, float]
    width: float
    notes: tuple[str, ...]

    def block(self, velocity: str) -> tuple[Array, Array]:
        """Return a, b, c, d of an axis and their covariance (4, 4)."""
        names = (velocity, f"{velocity}|{velocity}|", FORCE, "constant")
        return coefficient_block(self.fit, AXES[VELOCITIES.index(velocity)], names)

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
        ratio = float(self.inertia[VELOCITIES.index(velocity)] / self.inertia[VELOCITIES.index(of)])
        if scale.mass is not None:
            return Scale(mass=ratio * scale.mass, standard_error=ratio * scale.standard_error)
        assert scale.pull_N is not None
        values, covariance = self.block(of)
        mass = ratio * scale.pull_N / values[2]
        relative = float(
            np.hypot(scale.standard_error / scale.pull_N, np.sqrt(covariance[2, 2]) / values[2])
        )
        return Scale(mass=float(mass), standard_error=float(mass) * relative)

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
    relative_sd: float = 0.0,
    couplings: bool = False,
    drive: ForceDrive | None = None,
    free: Sequence[str] = (LAG,),
    constant_sd: float | None = None,
    restoring: bool = False,
    leave_out: bool = True,
    loss: Loss = "soft_l1",
    window_s: float = WINDOW_S,
) -> CoupledFit:
    """Fit several axes to the windows that they share, in all legs.

    inertia (6,): apparent inertia of u v w p q r; its ratios give the Coriolis force, and
    where forces are in newtons 1 / m_i is the prior of c_i with `relative_sd`. couplings:
    linear ones that port-starboard symmetry allows, between the velocities that are
    fitted (the noise of measured ones would enter). free: parameters of the drive that
    are fitted. restoring: roll and pitch by angles of their own. Raises `DataError`
    without shared windows.
    """
    pool = coupled_pool(
        records, velocities, inertia=inertia, relative_sd=relative_sd, couplings=couplings,
        drive=drive or ForceDrive(), free=tuple(free),
        constant_sd=constant_sd, restoring=restoring, loss=loss, window_s=window_s,
    )  # fmt: skip
    fit = fit_pool(pool, starting_values(pool))
    legs = sorted({window.leg for window in pool.windows})
    left_out = []
    if leave_out and len(legs) > 1:
        for leg in legs:
            rest = replace(pool, windows=tuple(w for w in pool.windows if w.leg != leg))
            other = fit_pool(rest, fit.values[: len(pool.structure.terms)])
            left_out.append(run_leg(pool, other, leg))
    blocks = (
        held_out_blocks(pool, fit.values[: len(pool.structure.terms)])
        if (leave_out and len(legs) == 1)
        else ()
    )
    notes = [] if fit.word == "converged" else ["the search did not settle"]
    return CoupledFit(
        tuple(velocities),
        records[0].normalised,
        inertia,
        pool,
        fit,
        verdicts_of(pool, fit),
        blocks,
        tuple(left_out),
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
    constant_sd: float | None,
    restoring: bool,
    loss: Loss,
    window_s: float,
) -> Pool:
    """Return the pool of a coupled fit; arguments as `fit_coupled`."""
    axes = tuple(AXES[VELOCITIES.index(velocity)] for velocity in velocities)
    free = tuple(name for name in free if records[0].normalised or name not in (DEAD_BAND, CURVE))
    terms: list[AxisTerm] = []
    for axis, velocity in zip(axes, velocities, strict=True):
        inverse = None
        if inertia is not None and not records[0].normalised:
            c = 1.0 / float(inertia[VELOCITIES.index(velocity)])
            inverse = (c, relative_sd * c)
        terms += axis_terms(
            axis,
            inputs=axes,
            inverse=inverse,
            restoring=restoring and velocity in "pq",
            couplings=[other for other in SYMMETRIC[axis] if couplings and other in velocities],
        )
    sd = np.array([CONSTANT_SD[v] if constant_sd is None else constant_sd for v in velocities])
    structure = Structure(tuple(velocities), tuple(terms), axes, inertia)
    windows = windows_of(records, velocities, window_s=window_s)
    return make_pool(structure, records, windows, constant_sd=sd, drive=drive, free=free, loss=loss)


def run_leg(pool: Pool, fit: PoolFit, leg: int) -> LegFreeRun:
    """Return the free run of a fit over the whole of a leg, and its fit [%]."""
    record = pool.records[leg]
    velocities = pool.structure.velocities
    measured = [measured_rate(record, velocity) for velocity in velocities]
    first, end = max(
        stretches(np.all(np.isfinite(np.array(measured)), axis=0)),
        key=lambda item: item[1] - item[0],
    )
    window = MotionWindow(leg, first, end)
    states = free_run(pool, fit, window)
    idle = tuple(v for v in velocities if not commanded(pool.records, leg, v))
    percent, truth, model = {}, {}, {}
    for i, (velocity, pair) in enumerate(
        zip(velocities, signals(pool, window, states), strict=True)
    ):
        if velocity not in idle:
            percent[velocity] = percent_of(*pair)
        truth[velocity], model[velocity] = measured[i][first:end], states[:, i]
    return LegFreeRun(leg, percent, idle, record.t_s[first:end], truth, model)


def commanded(records: Sequence[AxisRecord], leg: int, velocity: str) -> bool:
    """Return whether a leg commands an axis, against the largest of all legs."""
    axis = AXES[VELOCITIES.index(velocity)]
    largest = max(float(np.nanmax(np.abs(record.force[axis]))) for record in records)
    return float(np.ptp(records[leg].force[axis])) > COMMANDED * largest
