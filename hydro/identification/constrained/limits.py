"""Physical limits on the unknowns of a force model, as linear inequalities.

Bounds of single coefficients, damping that takes energy out over the flown envelope,
and inertia that a body can have.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import PipelineError, nearest
from auvid.hydro.arrays import AXES, VELOCITIES, Array, Index
from auvid.hydro.dynamics.viscous.basis import BASIS_TERMS, basis_rows
from auvid.hydro.dynamics.viscous.structures import OWN_VELOCITY
from auvid.hydro.identification.constrained.active_set import Cuts, InequalityRows
from auvid.hydro.identification.constrained.equations import (
    ACCELERATIONS,
    Unknown,
    inertia_pattern,
)
from auvid.hydro.identification.regression.excitation import THRESHOLDS

NEGATIVE = 1e-11
"""An eigenvalue of a scaled matrix counts as negative below minus this."""
POWER_TOLERANCE = 1e-4
"""Power that counts as none, as a share of the sum of the terms' powers."""
CLIMBERS = 16
TINY = 1e-12


def bounds(
    unknowns: Sequence[Unknown],
    *,
    lower: Mapping[Unknown, float] | None = None,
    upper: Mapping[Unknown, float] | None = None,
) -> InequalityRows:
    """Return lower <= x <= upper for those unknowns that have a bound.

    Raises `PipelineError` for an unknown that is not fitted, and for bounds of one that
    exclude each other.
    """
    low, high = dict(lower or {}), dict(upper or {})
    for unknown in (*low, *high):
        place_of(unknowns, unknown)
    for unknown in low.keys() & high.keys():
        if low[unknown] > high[unknown]:
            raise PipelineError(
                "bounds contradict each other",
                field=str(unknown),
                value=f"{low[unknown]:g} to {high[unknown]:g}",
            )
    sides = [(u, 1.0, b) for u, b in high.items()] + [(u, -1.0, -b) for u, b in low.items()]
    rows = np.zeros((len(sides), len(unknowns)))
    for row, (unknown, sign, _) in zip(rows, sides, strict=True):
        row[unknowns.index(unknown)] = sign
    names = [f"{u} {'<=' if sign > 0 else '>='} {sign * b:g}" for u, sign, b in sides]
    return InequalityRows(rows, np.array([b for _, _, b in sides]), names.__getitem__)


def damping(unknowns: Sequence[Unknown]) -> InequalityRows:
    """Return x <= 0 for every x and x|x| on the axis of the velocity x itself."""
    own = [u for u in unknowns if u.term in _drag_terms(u.axis)]
    return bounds(unknowns, upper=dict.fromkeys(own, 0.0))


def dissipation(unknowns: Sequence[Unknown], nu: ArrayLike) -> InequalityRows:
    """Return nu' tau_nu(nu) <= 0 at the velocities nu (s, 6) [m/s, rad/s].

    Terms with eta count at eta = 1, where they vanish; a constant force is no damping.
    """
    points = np.asarray(nu, dtype=np.float64)
    viscous = [(j, u) for j, u in enumerate(unknowns) if u.term in BASIS_TERMS]
    terms = tuple(dict.fromkeys(u.term for _, u in viscous))
    values = basis_rows(points.T, np.ones(len(points)), terms)
    rows = np.zeros((len(points), len(unknowns)))
    for j, u in viscous:
        rows[:, j] = points[:, AXES.index(u.axis)] * values[terms.index(u.term)]

    def describe(i: int) -> str:
        motion = ", ".join(f"{n} {x:.2g}" for n, x in zip(VELOCITIES, points[i], strict=True) if x)
        return f"power <= 0 at {motion}"

    return InequalityRows(rows, np.zeros(len(points)), describe)


def envelope(low: ArrayLike, high: ArrayLike, *, points: int = 2048) -> Array:
    """Return velocities (s, 6) that fill the box low..high (6,) [m/s, rad/s].

    Half the points lie on its faces, half inside; every second one moves along some of
    the six alone (the rest 0, or as near as the box comes): a weakly damped axis shows
    where no other moves. The same at each call.
    """
    from scipy.stats import qmc  # scipy.stats takes a second to import

    a, b = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    unit = 2.0 * qmc.Sobol(6, rng=0).random(points) - 1.0
    unit[: points // 2] /= np.abs(unit[: points // 2]).max(axis=1)[:, None]
    nu = a + 0.5 * (unit + 1.0) * (b - a)
    subset = 1 + np.arange(len(nu)) // 2 % 63
    still = (subset[:, None] >> np.arange(6) & 1 == 0) & (np.arange(len(nu)) % 2 == 0)[:, None]
    return np.asarray(np.where(still, np.clip(0.0, a, b), nu))


def dissipation_cuts(
    unknowns: Sequence[Unknown], low: ArrayLike, high: ArrayLike, *, seed: int = 0
) -> Cuts:
    """Return cuts that keep the power at or below 0 between the points of a sample.

    From the velocities of most power among many, for their size, they climb to the next
    maximum in the box low..high (6,), and return the violated ones.
    """
    a, b = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    grid = envelope(a, b, points=1024)
    rows = dissipation(unknowns, grid).rows
    return partial(_most_power, tuple(unknowns), a, b, grid, rows, seed)


def linear_dissipation(unknowns: Sequence[Unknown]) -> Cuts:
    """Return cuts for nu' K nu <= 0 at every nu, K (6, 6) the linear damping.

    -(K + K') / 2 is positive semidefinite. With terms x|x| on their own axes, none above 0,
    it is what no motion gains energy means, exactly: nu' K nu + sum d_x |x|^3 <= 0 at every
    nu if d_x <= 0, and only then, because slow motions leave the first part alone. Raises
    `PipelineError` for other terms.
    """
    parts = {}
    for u in unknowns:
        if u.term in VELOCITIES:
            i, j = AXES.index(u.axis), VELOCITIES.index(u.term)
            matrix = np.zeros((6, 6))
            matrix[i, j] -= 0.5
            matrix[j, i] -= 0.5
            parts[u] = matrix
        elif u.term in BASIS_TERMS and u.term not in _drag_terms(u.axis):
            raise PipelineError(
                "the model has terms beside linear ones and drag along each axis", value=str(u)
            )
    return semidefinite("damping matrix", np.zeros((6, 6)), parts, unknowns)


def damping_limits(
    unknowns: Sequence[Unknown], kind: str, box: tuple[ArrayLike, ArrayLike]
) -> tuple[list[InequalityRows], list[Cuts]]:
    """Return limits on damping: none (`free`), along each axis, or `dissipative`.

    box: lowest and highest velocities (6,) [m/s, rad/s] between which no motion gains
    energy; of linear terms and drag along each axis none does anywhere.
    """
    if kind == "free":
        return [], []
    viscous = [u for u in unknowns if u.term in BASIS_TERMS]
    if kind != "dissipative" or not viscous:
        return [damping(unknowns)], []
    if all(u.term in (*VELOCITIES, *_drag_terms(u.axis)) for u in viscous):
        linear = any(u.term in VELOCITIES for u in viscous)
        return [damping(unknowns)], [linear_dissipation(unknowns)] if linear else []
    rows = [damping(unknowns), dissipation(unknowns, envelope(*box))]
    return rows, [dissipation_cuts(unknowns, *box)]


def flown_box(flown: Mapping[str, tuple[float, float]]) -> tuple[Array, Array]:
    """Return the lowest and highest velocities (6,) of flown ranges [m/s, rad/s].

    flown: velocity -> lowest, highest. As far in both directions, and none narrower than
    the threshold of excitation. Of a vehicle that went ahead alone, or astern alone, the
    other direction is none of it: lift as u*v, which takes energy ahead, gives it astern.
    """
    reach = [max(abs(flown[v][0]), abs(flown[v][1]), THRESHOLDS[v]) for v in VELOCITIES]
    low, high = -np.array(reach), np.array(reach)
    if flown["u"][0] > -THRESHOLDS["u"]:
        low[0] = 0.0
    elif flown["u"][1] < THRESHOLDS["u"]:
        high[0] = 0.0
    return low, high


def positive_inertia(
    unknowns: Sequence[Unknown], mass_matrix: ArrayLike, *, share: float = 0.01
) -> Cuts:
    """Return cuts that keep M - dM_A positive definite.

    mass_matrix (6, 6): the vehicle file's M = M_RB - M_A [kg, kg m, kg m^2]. No
    direction may have less than `share` of its diagonal.
    """
    M = np.asarray(mass_matrix, dtype=np.float64)
    parts = {u: -inertia_pattern(u) for u in unknowns if u.term in ACCELERATIONS}
    return semidefinite("total inertia", M - share * np.diag(np.diag(M)), parts, unknowns)


def added_mass_bounds(
    unknowns: Sequence[Unknown],
    added_mass: ArrayLike,
    *,
    reference: ArrayLike | None = None,
    low: float = 0.2,
    high: float = 5.0,
) -> InequalityRows:
    """Return low to high times the reference for the diagonal of M_A = file's + dM_A.

    Both (6, 6), McCarter's sign; without a reference (strip theory), M_A <= 0 alone.
    """
    M_A = np.asarray(added_mass, dtype=np.float64)
    diagonal = [
        (u, AXES.index(u.axis))
        for u in unknowns
        if u.term in ACCELERATIONS and AXES.index(u.axis) == ACCELERATIONS.index(u.term)
    ]
    if reference is None:
        return bounds(unknowns, upper={u: -M_A[i, i] for u, i in diagonal})
    theory = np.asarray(reference, dtype=np.float64)
    return bounds(
        unknowns,
        lower={u: high * theory[i, i] - M_A[i, i] for u, i in diagonal},
        upper={u: low * theory[i, i] - M_A[i, i] for u, i in diagonal},
    )


def inertia_limits(
    unknowns: Sequence[Unknown], added_mass: ArrayLike, mass_matrix: ArrayLike
) -> tuple[list[InequalityRows], list[Cuts]]:
    """Return the limits on inertia; none where no added mass is among the unknowns.

    Both (6, 6), of the vehicle file: `added_mass_bounds` and `positive_inertia`.
    """
    if not any(u.term in ACCELERATIONS for u in unknowns):
        return [], []
    return [added_mass_bounds(unknowns, added_mass)], [positive_inertia(unknowns, mass_matrix)]


@dataclass(frozen=True)
class Semidefinite:
    """Cuts for S(x) = constant + sum x_k parts_k positive semidefinite, S (m, m).

    For each negative eigenvalue of S with eigenvector v: v' S(x) v >= 0. `fixed` (m m,) and
    `parts` (k, m m) are those of S with rows and columns scaled to the diagonal of the
    largest part; `places` (k,) of the unknowns among `unknowns`.
    """

    name: str
    fixed: Array
    parts: Array
    places: Index
    unknowns: int

    @property
    def title(self) -> str:
        """Return the limit in words."""
        return f"{self.name} positive definite"

    def eigen(self, x: Array) -> tuple[Array, Array, Array, Array]:
        """Return S, the scale of its diagonal, eigenvalues and -vectors after scaling.

        x (..., p); S (..., m, m), scale (..., m): one axis may be far larger than another;
        eigenvalues (..., m) ascend.
        """
        size = math.isqrt(len(self.fixed))
        S = (self.fixed + x[..., self.places] @ self.parts).reshape(*x.shape[:-1], size, size)
        scale = np.sqrt(np.maximum(np.abs(np.diagonal(S, axis1=-2, axis2=-1)), 1e-12))
        values, vectors = np.linalg.eigh(S / (scale[..., :, None] * scale[..., None, :]))
        return S, scale, values, vectors

    def __call__(self, x: Array) -> InequalityRows:
        """Return the rows that x (p,) violates."""
        _, scale, values, vectors = self.eigen(x)
        bad = vectors[:, values < -NEGATIVE] / scale[:, None]
        rows = np.zeros((bad.shape[1], self.unknowns))
        dyads = (bad[:, None] * bad).reshape(self.fixed.size, -1).T
        rows[:, self.places] = -dyads @ self.parts.T
        return InequalityRows(rows, dyads @ self.fixed, lambda _: self.title)


def semidefinite(
    name: str, constant: Array, parts: Mapping[Unknown, Array], unknowns: Sequence[Unknown]
) -> Semidefinite:
    """Return cuts for constant + sum x_k parts_k (m, m) positive semidefinite."""
    size = np.sqrt(np.max([np.abs(np.diag(m)) for m in (constant, *parts.values())], axis=0))
    size = np.where(size > 0.0, size, 1.0)
    frame = np.outer(size, size)
    places = np.array([unknowns.index(u) for u in parts], dtype=np.intp)
    stack = np.array([m / frame for m in parts.values()]).reshape(-1, constant.size)
    return Semidefinite(name, (constant / frame).reshape(-1), stack, places, len(unknowns))


def place_of(unknowns: Sequence[Unknown], unknown: Unknown) -> int:
    """Return the index of an unknown; `PipelineError` that names the nearest one."""
    if unknown not in unknowns:
        raise PipelineError(
            "the model has no such unknown",
            value=str(unknown),
            remedy=nearest(str(unknown), map(str, unknowns)),
        )
    return unknowns.index(unknown)


def _drag_terms(axis: str) -> tuple[str, ...]:
    own = OWN_VELOCITY.get(axis, "")
    return own, f"{own}*|{own}|"


def _most_power(
    unknowns: tuple[Unknown, ...],
    low: Array,
    high: Array,
    grid: Array,
    rows: Array,
    seed: int,
    x: Array,
) -> InequalityRows:
    random = np.random.default_rng(seed)
    width = np.maximum(np.abs(low), np.abs(high))
    size = np.sum((grid / width) ** 2, axis=1)
    best = grid[np.argsort(rows @ x / np.maximum(size, TINY))[-CLIMBERS:]]
    for reach in (0.3, 0.1, 0.03, 0.01, 0.003):
        # Shifts in proportion to each velocity: one that is 0 may leave it, too.
        shift = reach * random.normal(size=(24, len(best), 6))
        shift *= np.abs(best) + reach * width * (random.random(size=(24, len(best), 1)) < 0.5)
        tried = np.clip(np.concatenate([best[None], best + shift]), low, high)
        power = dissipation(unknowns, tried.reshape(-1, 6)).rows @ x
        relative = power.reshape(tried.shape[:2]) / np.maximum(
            np.sum((tried / width) ** 2, axis=2), TINY
        )
        best = tried[np.argmax(relative, axis=0), np.arange(len(best))]
    cut = dissipation(unknowns, best)
    violated = cut.rows @ x > POWER_TOLERANCE * (np.abs(cut.rows) @ np.abs(x))
    return dissipation(unknowns, best[violated])
