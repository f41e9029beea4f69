"""The training legs, one at a time: what synthesis keeps of each, and its errors."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial, reduce
from itertools import chain
from typing import NamedTuple, TypeVar

import numpy as np
import pyarrow as pa

from auvid.data_schemas.records.motion import FusionRecord, SegmentRecord
from auvid.data_schemas.tables import column, has_columns, matrix
from auvid.hydro.arrays import AXES, Array
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.dynamics.actuators.lag import first_order_lag
from auvid.hydro.dynamics.jacobians import coriolis_jacobian
from auvid.hydro.dynamics.mechanics.rigid_body import coriolis_force
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.basis import basis_rows
from auvid.hydro.dynamics.viscous.structures import OWN_VELOCITY
from auvid.hydro.identification.constrained.actuator_lag import DrivenLeg
from auvid.hydro.identification.constrained.equations import (
    ACCELERATIONS,
    ACTUATOR_RATES,
    Unknown,
    extra_rows,
)
from auvid.hydro.identification.constrained.steady_current import LegOverGround
from auvid.hydro.identification.regression.assumed_figures import (
    CURRENT,
    MeasuredLeg,
    current_errors,
    figure_errors,
)
from auvid.hydro.identification.regression.excitation import (
    VelocityExcitation,
    axis_excitation,
    error_thresholds,
)
from auvid.hydro.identification.regression.least_squares import (
    CONSTANT,
    AxisFit,
    TriangularFactor,
    solve_axis,
)
from auvid.hydro.identification.regression.normal_changes import (
    STRIDE,
    NormalChange,
    StridedLeg,
    TrueEquations,
    shifts,
)
from auvid.hydro.identification.regression.prior import coloured_over_white
from auvid.hydro.identification.regression.standard_errors import (
    LeftOutBlocks,
    updated_together,
)
from auvid.hydro.identification.regression.unsteady_force import LINEARISED, unsteady_changes
from auvid.hydro.identification.signals.lost_motion import lost_by_spline, lost_motion
from auvid.hydro.long_series.long_arrays import laid_down
from auvid.hydro.long_series.threads import at_once
from auvid.stages.columns import (
    ACCELERATION,
    ACCELEROMETER,
    ACTUATORS,
    POSE,
    VELOCITY,
    VELOCITY_SD,
    clock,
    control_of,
    force_columns,
    forces,
)

SEGMENT_SAMPLES = 32_768
"""Samples of a leg that the coloured standard errors take at once and cut into blocks (11
minutes at 50 Hz): it bounds their memory.
"""
ROWS_AT_ONCE = 8192  # the basis rows of a larger chunk leave the processor's cache
FROM_ERRORS = "errors"
EXCITATION = (FROM_ERRORS, "fixed")
"""What a velocity has to exceed to count as excited: its own errors, or a fixed RMS."""
LAG_STEP_S = 0.05
"""Clock of the samples that a lag is measured on: commands are logged no faster."""
CURRENT_STEP_S = 0.2
"""Clock of the samples that a current is measured on: it is in slow motion, too."""
KEPT_BYTES = 50_000
"""Size of an array of one leg from which all legs keep theirs outside of memory."""
THRUST = ("propeller", "thrusters")
"""Those that a thrust curve scales."""
SPLINES = {
    "kinematic": VELOCITY,
    "smoother": (*ACCELEROMETER, *VELOCITY[3:]),
    "thesis": (*ACCELEROMETER, *VELOCITY[3:]),
}
"""Splines that bound how fast each acceleration can be, by the method of fuse."""
FEWEST_LEANING, LEANING_SHARE = 2, 0.1
"""Coefficients of a model that a low-pass leans before it is called too low, and the share
of its value that counts (decision 0081): a smaller lean is in the interval in silence.
"""
RESIDUAL_COLUMNS = (
    "eta_ratio",
    *VELOCITY,
    *VELOCITY_SD,
    *(name for part in ("tau_bar", *ACTUATORS) for name in force_columns(part)),
)
"""Of the residual force, beside its clock: not its other components."""
STATE_COLUMNS = (*POSE, *ACCELERATION)
NO_TERMS: tuple[str, ...] = ()
Fits = Mapping[tuple[str, str], AxisFit]
"""Least-squares fits by model and axis."""
T = TypeVar("T")


@dataclass(frozen=True)
class LegTables:
    """Tables of one training segment; None where no stage gave one."""

    residual: pa.Table
    segment: SegmentRecord
    fused: pa.Table | None
    fusion: FusionRecord | None
    controls: pa.Table | None


@dataclass(frozen=True)
class MovingWater:
    """Currents under a leg's velocities over ground, NED [m/s].

    (0, 3) for still water. values (d, 3): established ones of each dive, 0 but for that of the
    leg; errors (3 d, 3): three of each, one deviation; scatter_m_s: of each horizontal
    component, within a dive.
    """

    values: Array
    errors: Array
    scatter_m_s: float = 0.0

    @property
    def scatter(self) -> Array:
        """Return the scatter as two currents (2, 3)."""
        return self.scatter_m_s * np.eye(3)[: 2 if self.scatter_m_s else 0]


STILL_WATER = MovingWater(np.zeros((0, 3)), np.zeros((0, 3)))


@dataclass(frozen=True)
class TrainingSegment:
    """One training segment; None where unknown.

    nu and its standard deviations (n, 6), eta_ratio (n,), force: tau_bar (n, 6) with late
    actuators; thrust (n, 6) is what thrusters and propeller have in it, actuators (n, 6)
    all of them with fins. cutoffs_hz: of the splines behind the six accelerations,
    by_accelerometer: those of v_dot are of its channels;
    low_pass_hz: of the low-pass that all channels passed; water: what moves it.
    """

    nu: Array
    sd: Array | None
    ratio: Array | None
    force: Array
    thrust: Array
    actuators: Array
    measured: MeasuredLeg | None = None
    cutoffs_hz: tuple[float | None, ...] = ()
    by_accelerometer: bool = False
    low_pass_hz: float | None = None
    water: MovingWater = STILL_WATER

    @classmethod
    def of(
        cls,
        tables: LegTables,
        *,
        with_ratio: bool,
        lag_s: float = 0.0,
        water: MovingWater = STILL_WATER,
    ) -> TrainingSegment:
        """Return the samples of a segment whose actuators are late by `lag_s`."""
        residual, nu = tables.residual, matrix(tables.residual, VELOCITY)
        measured, cutoffs = None, []
        if tables.fused is not None and tables.controls is not None:
            measured = MeasuredLeg(
                matrix(tables.fused, POSE),
                nu,
                matrix(tables.fused, ACCELERATION),
                control_of(tables.controls, slice(None))[0],
                float(np.mean(np.diff(clock(residual)))),
            )
            if tables.fusion is not None:
                splines = [
                    tables.segment.smoothing.get(name)
                    for name in SPLINES.get(tables.fusion.method, ())
                ]
                cutoffs = [None if item is None else item.cutoff_hz for item in splines]
        return cls(
            nu,
            matrix(residual, VELOCITY_SD) if has_columns(residual, VELOCITY_SD) else None,
            column(residual, "eta_ratio") if with_ratio else None,
            forces(residual, "tau_bar") - late_change(residual, lag_s),
            acting(residual, THRUST, lag_s),
            acting(residual, ACTUATORS, lag_s),
            measured,
            tuple(cutoffs),
            tables.fusion is not None and tables.fusion.method != "kinematic",
            None if tables.fusion is None else tables.fusion.cutoff_hz,
            water,
        )

    def figure_errors(
        self, every: MeasuredLeg, vehicle: Vehicle
    ) -> list[tuple[str, Array, Array | None]]:
        """Return what assumed figures change of force and velocities, strided."""
        thrust, actuators = self.thrust[::STRIDE], self.actuators[::STRIDE]
        return [
            *figure_errors(
                every, vehicle, thrust=thrust, actuators=actuators, spreads=vehicle.spreads
            ),
            *current_errors(every, vehicle, self.water.errors),
        ]

    def blocks(self, size: int, terms: Sequence[str]) -> Iterator[tuple[Array, Array]]:
        """Return basis rows (k, m) and forces (m, 6) of `size` samples at a time."""
        for start in range(0, len(self.force), size):
            rows = slice(start, start + size)
            ratio = None if self.ratio is None else self.ratio[rows]
            yield basis_rows(self.nu[rows].T, ratio, terms), self.force[rows]


@dataclass(frozen=True)
class DataErrors:
    """What known errors of the data do to the normal equations.

    velocities: of each velocity, None where a leg has no standard deviations of them;
    smoothing: of each acceleration's spline; low_pass: of that of all channels, one or
    none; figures: assumed figure of the vehicle -> its independent numbers; currents: what
    the value of each puts right, to second order; scatter: what theirs adds.
    """

    velocities: tuple[NormalChange, ...] | None
    smoothing: tuple[NormalChange, ...]
    low_pass: tuple[NormalChange, ...]
    figures: Mapping[str, tuple[NormalChange, ...]]
    currents: tuple[NormalChange, ...] = ()
    scatter: tuple[NormalChange, ...] = ()

    def equations(self, fit: AxisFit) -> TrueEquations:
        """Return the equations of a fit without the errors of its columns."""
        return TrueEquations.of(fit, (*(self.velocities or ()), *self.scatter), self.currents)

    def shifts(self, fit: AxisFit, equations: TrueEquations) -> dict[str, Array]:
        """Return assumed figure -> what each of its numbers moves (c, k)."""
        moved = {name: shifts(changes, fit) for name, changes in self.figures.items()}
        currents = [equations.shift(change) for change in (*self.currents, *self.scatter)]
        if currents:
            moved[CURRENT] = np.vstack([*moved.get(CURRENT, ()), *currents])
        return moved

    @classmethod
    def of(cls, leg: TrainingSegment, terms: Sequence[str], vehicle: Vehicle) -> DataErrors:
        """Return the errors of one leg."""
        every, smoothing = None, []
        figures: list[tuple[str, Array, Array | None]] = []
        flows: list[tuple[Array, Array]] = []
        low_pass: tuple[NormalChange, ...] = ()
        if leg.measured is not None:
            every = leg.measured.every(STRIDE)
            smoothing = at_once(
                partial(_smoothed, leg.measured, vehicle, leg.by_accelerometer),
                list(enumerate(leg.cutoffs_hz)),
            )
            figures = leg.figure_errors(every, vehicle)
            moving = np.vstack([leg.water.values, leg.water.scatter])
            flows = [(d_force, d_nu) for _, d_force, d_nu in current_errors(every, vehicle, moving)]
            if leg.low_pass_hz is not None:
                low_pass = (
                    lost_motion(
                        leg.measured, vehicle, terms, ratio=leg.ratio, cutoff_hz=leg.low_pass_hz
                    ),
                )

        def of_piece(place: slice, part: StridedLeg) -> DataErrors:
            at, slopes = strided(place), np.zeros((len(part.rows), 6, 6))
            if every is not None and leg.sd is not None:
                slopes = every.rows(at).force_slopes(vehicle)
            squares = [part.squared(d_force[at], d_nu[at]) for d_force, d_nu in flows]
            count = len(leg.water.values)
            currents = (
                part.definite(d_force[at], d_nu[at]).merge(square)
                for (d_force, d_nu), square in zip(flows[:count], squares, strict=False)
            )
            return cls(
                None if leg.sd is None else part.random(leg.sd[place], slopes),
                tuple(part.definite(d_force[at], d_nu[at]) for d_force, d_nu in smoothing),
                (),
                _by_figure(part, figures, at),
                tuple(currents),
                tuple(squares[count:]),
            )

        parts = StridedLeg.of_parts(of_piece, leg.nu, leg.force, terms, ratio=leg.ratio)
        return replace(reduce(cls.merge, parts), low_pass=low_pass)

    @staticmethod
    def of_motion(
        leg: TrainingSegment, terms: Sequence[str], vehicle: Vehicle
    ) -> dict[str, tuple[NormalChange, ...]]:
        """Return what assumed figures do where accelerations are columns, too.

        Of `terms`, `ACCELERATIONS` and the constant; accelerations themselves stay as
        they are. None where the leg has no state or commands.
        """
        if leg.measured is None:
            return {}
        every = leg.measured.every(STRIDE)
        figures = [
            *leg.figure_errors(every, vehicle),
            *current_errors(every, vehicle, leg.water.values),
        ]

        def of_piece(place: slice, part: StridedLeg) -> dict[str, tuple[NormalChange, ...]]:
            at = strided(place)
            return _by_figure(part.with_columns(ACCELERATIONS, every.nu_dot[at]), figures, at)

        parts = StridedLeg.of_parts(of_piece, leg.nu, leg.force, terms, ratio=leg.ratio)
        return reduce(merged_figures, parts)

    def merge(self, other: DataErrors) -> DataErrors:
        """Return the errors of both; what one of them does not know is not known."""
        velocities = None
        if self.velocities is not None and other.velocities is not None:
            velocities = _merged(self.velocities, other.velocities)
        return DataErrors(
            velocities,
            _merged(self.smoothing, other.smoothing),
            _merged(self.low_pass, other.low_pass),
            merged_figures(self.figures, other.figures),
            _merged(self.currents, other.currents),
            _merged(self.scatter, other.scatter),
        )


def merged_figures(
    one: Mapping[str, tuple[NormalChange, ...]], other: Mapping[str, tuple[NormalChange, ...]]
) -> dict[str, tuple[NormalChange, ...]]:
    """Return the changes by assumed figures over both; those that both know."""
    return {name: _merged(one[name], other[name]) for name in one if name in other}


def strided(place: slice) -> slice:
    """Return the place of a piece among every `STRIDE`-th sample of a leg."""
    return slice(place.start // STRIDE, place.stop // STRIDE)


def _by_figure(
    part: StridedLeg, figures: Sequence[tuple[str, Array, Array | None]], at: slice
) -> dict[str, tuple[NormalChange, ...]]:
    """Return what errors by assumed figures do on one piece of a leg."""
    changes: dict[str, tuple[NormalChange, ...]] = {}
    for figure, d_force, d_nu in figures:
        change = part.definite(d_force[at], None if d_nu is None else d_nu[at])
        changes[figure] = (*changes.get(figure, ()), change)
    return changes


def _smoothed(
    leg: MeasuredLeg, vehicle: Vehicle, by_accelerometer: bool, spline: tuple[int, float | None]
) -> tuple[Array, Array]:
    """Return force and velocities (m, 6) that the spline of a channel took, strided.

    spline: which channel, and its cutoff.
    """
    index, cutoff_hz = spline
    if cutoff_hz is None:
        none = np.zeros((len(leg.nu[::STRIDE]), 6))
        return none, none
    return lost_by_spline(
        leg,
        vehicle,
        index,
        cutoff_hz,
        accelerometer=by_accelerometer and index < 3,
        stride=STRIDE,
    )


def _merged(
    one: tuple[NormalChange, ...], other: tuple[NormalChange, ...]
) -> tuple[NormalChange, ...]:
    """Return the changes over both; those of one alone count for it alone."""
    both = tuple(a.merge(b) for a, b in zip(one, other, strict=False))
    return (*both, *one[len(both) :], *other[len(both) :])


@dataclass(frozen=True)
class TrainingData:
    """Sums that fits need of the training legs; merging keeps the memory constant."""

    factor: TriangularFactor
    errors: DataErrors
    motion: Mapping[str, VelocityExcitation]

    @classmethod
    def of(
        cls,
        leg: TrainingSegment,
        terms: Sequence[str],
        vehicle: Vehicle,
        *,
        excitation: str = FROM_ERRORS,
    ) -> TrainingData:
        """Return the data of one leg."""
        factor = leg_factor(leg, terms)
        errors = DataErrors.of(leg, terms, vehicle)
        thresholds = error_thresholds(leg.sd if excitation == FROM_ERRORS else None)
        return cls(
            factor, errors, axis_excitation(leg.nu, eta_ratio=leg.ratio, thresholds=thresholds)
        )

    def merge(self, other: TrainingData) -> TrainingData:
        """Return the data of both."""
        motion = {name: item.merge(other.motion[name]) for name, item in self.motion.items()}
        return TrainingData(
            self.factor.merge(other.factor), self.errors.merge(other.errors), motion
        )


class Coloured(NamedTuple):
    """Covariance (k, k) of a fit for autocorrelated residuals, and samples per one.

    The latter is at most what leaves each block of time as one independent sample.
    """

    covariance: Array
    samples_per_one: float


def leg_factor(leg: TrainingSegment, terms: Sequence[str]) -> TriangularFactor:
    """Return the triangular factor of one leg."""
    factor = TriangularFactor.empty(terms)
    for rows, force in leg.blocks(ROWS_AT_ONCE, terms):
        factor = factor.update(rows, force)
    return factor


def moved_by_lag(
    fits: Mapping[str, AxisFit], prompt: TriangularFactor
) -> dict[str, dict[str, float]]:
    """Return how far a lag moved the damping of each axis's own velocity.

    fits: by axis, with the lag; prompt: the factor of the legs without it. Terms that
    have no number of their own are left out.
    """
    moved: dict[str, dict[str, float]] = {}
    for axis, fit in fits.items():
        own = OWN_VELOCITY[axis]
        terms = [term for term in fit.terms if term != CONSTANT]
        before = solve_axis(prompt, axis=axis, terms=terms, trim=CONSTANT in fit.terms)
        changes = dict(zip(fit.terms, fit.coefficients - before.coefficients, strict=True))
        damping = (own, f"{own}*|{own}|")
        kept = {t: float(c) for t, c in changes.items() if t in damping and np.isfinite(c)}
        if kept:
            moved[axis] = kept
    return moved


def leaning_terms(
    fits: Fits, coloured: Mapping[tuple[str, str], Coloured], low_pass: Sequence[NormalChange]
) -> dict[str, list[str]]:
    """Return model -> terms clear of zero that a low-pass leans.

    That is by more than noise, and by a tenth of the value at least. Models with fewer than
    `FEWEST_LEANING` of them are left out.
    """
    leaning: dict[str, list[str]] = {}
    for (model, axis), fit in fits.items():
        noise = np.sqrt(np.maximum(np.diag(coloured[model, axis].covariance), 0.0))
        for shift in (change.shift(fit) for change in low_pass):
            size, lean = np.abs(fit.coefficients), np.abs(shift)
            leans = (size > NORMAL_95 * noise) & (lean > noise) & (lean > LEANING_SHARE * size)
            leaning.setdefault(model, []).extend(
                str(Unknown(axis, fit.terms[i])) for i in np.flatnonzero(leans)
            )
    return {model: names for model, names in leaning.items() if len(names) >= FEWEST_LEANING}


def others_of(parts: Mapping[str, TriangularFactor]) -> dict[str, TriangularFactor]:
    """Return for each part the factor of all others; empty for a single part."""
    if len(parts) < 2:
        return {}
    return {
        name: reduce(
            TriangularFactor.merge, (part for other, part in parts.items() if other != name)
        )
        for name in parts
    }


def acting(residual: pa.Table, components: Sequence[str], lag_s: float = 0.0) -> Array:
    """Return the sum (n, 6), late by `lag_s`, of the components in the table."""
    total = np.zeros((residual.num_rows, 6))
    for name in components:
        if has_columns(residual, force_columns(name)):
            total += forces(residual, name)
    if lag_s <= 0.0:
        return total
    return first_order_lag(total, lag_s=lag_s, step_s=float(np.mean(np.diff(clock(residual)))))


def late_change(residual: pa.Table, lag_s: float) -> Array:
    """Return what a lag of the actuators changes of their force (n, 6)."""
    return acting(residual, ACTUATORS, lag_s) - acting(residual, ACTUATORS)


def driven_leg(tables: LegTables) -> DrivenLeg | None:
    """Return a segment for `measured_lag`; None without its state."""
    if tables.fused is None:
        return None
    residual = tables.residual
    step_s = float(np.mean(np.diff(clock(residual))))
    rows = slice(None, None, max(1, round(LAG_STEP_S / step_s)))
    # Views would keep all samples of all legs.
    return DrivenLeg(
        _of_many(matrix(residual, VELOCITY)[rows]),
        _of_many(matrix(tables.fused, ACCELERATION)[rows]),
        _of_many(forces(residual, "tau_bar")[rows]),
        _of_many(acting(residual, ACTUATORS)[rows]),
        step_s * rows.step,
    )


def _of_many(values: Array) -> Array:
    """Return a copy of what is kept of each of all legs, where it takes no memory."""
    return laid_down(values.copy(), KEPT_BYTES)


def leg_over_ground(tables: LegTables, lag_s: float) -> LegOverGround | None:
    """Return a segment for `measured_currents`.

    None where its current is known, or without its state.
    """
    if tables.fused is None or tables.controls is None:
        return None
    current = None if tables.fusion is None else tables.fusion.current
    if current is not None and current.verdict == "observable":
        return None
    residual = tables.residual
    step_s = float(np.mean(np.diff(clock(residual))))
    measured = MeasuredLeg(
        matrix(tables.fused, POSE),
        matrix(residual, VELOCITY),
        matrix(tables.fused, ACCELERATION),
        control_of(tables.controls, slice(None))[0],
        step_s,
    )
    stride = max(1, round(CURRENT_STEP_S / step_s))
    return LegOverGround(
        tables.segment.log,
        measured.every(stride, _of_many),
        _of_many((forces(residual, "tau_bar") - late_change(residual, lag_s))[::stride]),
        _of_many(acting(residual, ACTUATORS, lag_s)[::stride]),
    )


def motion_factor(
    residual: pa.Table, fused: pa.Table, terms: Sequence[str], lag_s: float = 0.0
) -> TriangularFactor:
    """Return the factor of a leg with accelerations and actuator force rates."""
    t_s, force = clock(residual), forces(residual, "tau_bar") - late_change(residual, lag_s)
    actuators = acting(residual, ACTUATORS, lag_s)
    ratio = column(residual, "eta_ratio") if has_columns(residual, ("eta_ratio",)) else None
    extra = extra_rows(matrix(fused, ACCELERATION), actuators, step_s=float(np.mean(np.diff(t_s))))
    rows = basis_rows(matrix(residual, VELOCITY).T, ratio, terms)
    empty = TriangularFactor.empty((*terms, *ACCELERATIONS, *ACTUATOR_RATES))
    return empty.update(np.vstack([rows, extra]), force)


def coloured_errors(
    fits: Fits, legs: Iterable[TrainingSegment], terms: Sequence[str]
) -> dict[tuple[str, str], Coloured]:
    """Return what blocks of time left out say of the errors of every fit.

    One more pass over the legs. nan where there are no more samples than coefficients.
    """
    row_of = {term: row for row, term in enumerate(terms)}
    left_out = {
        key: LeftOutBlocks.empty(fit)
        for key, fit in fits.items()
        if fit.n_samples > len(fit.independent)
    }
    together = _by_columns(fits, left_out)
    for leg in legs:
        for rows, force in leg.blocks(SEGMENT_SAMPLES, terms):
            groups = [[left_out[key] for key in keys] for keys in together]
            updated = at_once(partial(_with_block, rows, force, row_of), groups)
            left_out = dict(zip(chain(*together), chain(*updated), strict=True))
            del rows, force  # before the next ones are made
    errors = {}
    for key, fit in fits.items():
        covariance, most = np.full((len(fit.terms), len(fit.terms)), np.nan), 1.0
        if key in left_out:
            covariance = left_out[key].covariance()
            most = fit.n_samples / max(left_out[key].count, 1)
        errors[key] = Coloured(covariance, min(coloured_over_white(fit, covariance), most))
    return errors


class ForceSolution(NamedTuple):
    """A model's force: axis -> term -> value, and dM_A (6, 6) of fitted inertia.

    added_mass: None for the inertia of the vehicle file.
    """

    values: Mapping[str, Mapping[str, float]]
    added_mass: Array | None = None

    @classmethod
    def of(cls, fits: Iterable[AxisFit]) -> ForceSolution:
        """Return that of the fits of the axes, with the inertia of the vehicle file."""
        values = {
            fit.axis: dict(zip(fit.terms, fit.solution.tolist(), strict=True)) for fit in fits
        }
        return cls(values)


def moved_by_unsteady_force(
    solutions: Mapping[str, ForceSolution],
    legs: Iterable[TrainingSegment],
    terms: Sequence[str],
    vehicle: Vehicle,
) -> dict[str, tuple[NormalChange, ...]]:
    """Return what the force error of each model does by the motion that it causes.

    terms: of all models, and products of velocities where inertia is fitted. One more pass over
    the legs; those without a state have no part in it.
    """
    changes: dict[str, tuple[NormalChange, ...]] = dict.fromkeys(solutions, ())
    for leg in legs:
        if leg.measured is None:
            continue
        of_piece = partial(_moved, solutions, leg.measured.every(STRIDE), terms, vehicle)
        for moved in StridedLeg.of_parts(of_piece, leg.nu, leg.force, terms, ratio=leg.ratio):
            changes = {model: _merged(changes[model], moved[model]) for model in changes}
    return changes


def _moved(
    solutions: Mapping[str, ForceSolution],
    every: MeasuredLeg,
    terms: Sequence[str],
    vehicle: Vehicle,
    place: slice,
    part: StridedLeg,
) -> dict[str, tuple[NormalChange, ...]]:
    """Return what the force errors of models do on one piece of a leg."""
    measured = every.rows(strided(place))
    linearised = measured.every(LINEARISED)
    slopes = linearised.force_slopes(vehicle)
    changes = {}
    for model, (values, added) in solutions.items():
        used = {term for row in values.values() for term in row} - {*ACCELERATIONS}
        own_slopes, mass, accelerations = slopes, vehicle.mass_matrix, NO_TERMS
        if added is None:
            own = part.of_terms([term for term in terms if term in used])
        else:
            by_inertia = measured.nu_dot @ added + coriolis_force(added, measured.nu)
            own = replace(part, forces=part.forces - by_inertia)
            own = own.with_columns(ACCELERATIONS, measured.nu_dot)
            # Products that Coriolis force alone has: what moves one axis leans no other.
            own = replace(own, slopes=own.slopes * np.isin(own.terms, [*used])[:, None])
            own_slopes = slopes - coriolis_jacobian(added, linearised.nu)
            mass, accelerations = mass - added, ACCELERATIONS
        rows = [
            [values.get(axis, {}).get(term, 0.0) if term in used else 0.0 for term in own.terms]
            for axis in AXES
        ]
        changes[model] = unsteady_changes(
            own,
            np.array(rows),
            own_slopes,
            mass,
            nu_dot=measured.nu_dot,
            step_s=every.step_s,
            accelerations=accelerations,
        )
    return changes


def _by_columns(fits: Fits, chosen: Iterable[tuple[str, str]]) -> list[list[tuple[str, str]]]:
    """Return the chosen fits in groups that share their columns, largest first."""
    groups: dict[object, list[tuple[str, str]]] = {}
    for key in chosen:
        fit = fits[key]
        arrays = (fit.scaled_triangle.tobytes(), fit.column_norms.tobytes())
        groups.setdefault((fit.terms, fit.independent, arrays), []).append(key)
    return sorted(groups.values(), key=lambda keys: -len(fits[keys[0]].independent))


def _with_block(
    rows: Array, force: Array, row_of: Mapping[str, int], blocks: Sequence[LeftOutBlocks]
) -> list[LeftOutBlocks]:
    """Return what blocks left out say, with those of one more stretch of a leg.

    blocks: of fits that share their columns.
    """
    own = [row_of[term] for term in blocks[0].fit.terms if term != CONSTANT]
    axes = [AXES.index(each.fit.axis) for each in blocks]
    return updated_together(blocks, rows[own], force[:, axes])
