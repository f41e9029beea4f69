"""Body velocity and its errors from a track of poses, by a Kalman smoother.

Position (3, north-east-down) and the unit quaternion (4, body to north-east-down) are
seven columns, each place y with rate and acceleration:

    y_dot = v,   v_dot = a,   a_dot = white noise of density q,   measured y + noise.

Noise and q of each column maximise the likelihood of its innovations, first Student's t
(outliers), then normal over the samples that pass. One gate holds for all columns. Five
samples in a row that do not pass are a sharp turn where they go on from the last place and
speed with another acceleration; otherwise they are another track (a jump), and the filter
starts anew.
Then, with R of the quaternion s / |s| and a marker at r [m] from the body origin,

    omega = 2 Im(conj(s) s_dot) / |s|^2,   v_body = R' p_dot - omega x r,

with standard errors from the smoother's covariance. Samples equal to the one before are
held and no measurement; a long run of them is a freeze. Nothing is filled across a
pause: each piece between cuts is smoothed alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array, Mask, cross, runs_of
from auvid.hydro.constants import NORMAL_SPREAD
from auvid.hydro.identification.signals.pose.frames import (
    continuous_signs,
    euler_of_quaternion,
    quaternion_of_euler,
    rotated,
)

SHARE_OF_CHANCE = 1e-5
"""So few good samples fail the gate."""
PATIENCE = 5
STUDENT = 4.0
FITTED_SAMPLES = 4000
FITTED_BLOCKS = 4
LARGEST_RATE = {"position": 2.0, "quaternion": 1.0}
"""Standard deviation of the rate where a track begins [m/s], [1/s]."""
HARMLESS = {"position": 1e-3, "quaternion": 5e-4}
"""Standard deviation [m], [1] that every sample is allowed beside its noise: the start of a
thrust departs so far from white noise on the derivative of the acceleration, and to leave
such samples of a precise tracker out would cost more than an outlier of its size."""
SHARPEST = {"position": 2.0, "quaternion": 2.5}
"""Deviation of the acceleration [m/s^2, 1/s^2] that a sharp turn begins with, as thrust that
is reversed gives it to small vehicles. It moves a place by half of it times a step squared:
a jump is much more. 2 to 5 and 2.5 to 10 keep all reversals at 25 to 100 Hz. Jumps of .3 and .6
rad at 15 Hz are cut in 8 of 10 tracks without it, in 6 with it, in 2 with 3 and 5."""
SHORTEST_PIECE_S = 1.0
FEWEST = 8
REPEATED = 1e-4
STOPS, DIGITS = 5, 20.0
"""A part that stops has so many steps before, of so many times its last digit."""
FREEZE_S = 0.5
FREEZE_STEPS = 6.0
"""Equal samples over more than both of these, in s and in usual steps, are a freeze."""
LEAST_NOISE = 1e-7


@dataclass(frozen=True)
class PoseFault:
    """What is wrong with a track from start_s to end_s.

    `kind`: gap, freeze, jump (`moved_m`, `turned_rad`: by how much), lost (samples that
    fit no motion).
    """

    kind: str
    start_s: float
    end_s: float
    moved_m: float = 0.0
    turned_rad: float = 0.0


@dataclass(frozen=True)
class PoseTrack:
    """Motion of the body origin at the times (n,) of the samples that are kept.

    position north-east-down, attitude roll pitch yaw, velocity u v w and rate p q r in
    body axes with standard errors, each (n, 3); `pieces`: index pairs [start, end) that
    were smoothed alone. `outliers_s`: times of samples left out one by one; `repeats`:
    how many samples equal the one before. noise_m (3,), noise_rad: standard deviations of
    a sample.
    """

    t_s: Array
    position: Array
    attitude: Array
    velocity: Array
    rate: Array
    velocity_sd: Array
    rate_sd: Array
    pieces: tuple[tuple[int, int], ...]
    faults: tuple[PoseFault, ...]
    outliers_s: Array
    repeats: int
    noise_m: Array
    noise_rad: float


def pose_track(
    t_s: ArrayLike,
    position: ArrayLike,
    attitude: ArrayLike,
    *,
    arm_m: ArrayLike = (0.0, 0.0, 0.0),
    max_gap_s: float = 1.0,
) -> PoseTrack:
    """Return the motion of the body origin from poses at increasing times t_s (n,) [s].

    position (n, 3) [m] of the markers, north-east-down; attitude (n, 3) roll pitch yaw
    [rad] or (n, 4) quaternion, w first, body forward-right-down to north-east-down.
    arm_m (3,): the markers from the body origin, body axes. Rows that are not finite are
    left out. Raises `DataError` for too few poses, times that do not increase, or no
    piece of a second.
    """
    t, p = np.asarray(t_s, dtype=np.float64), np.asarray(position, dtype=np.float64)
    angles = np.asarray(attitude, dtype=np.float64)
    q = angles if angles.shape[1] == 4 else quaternion_of_euler(angles)
    good = np.isfinite(t) & np.isfinite(p).all(axis=1) & np.isfinite(q).all(axis=1)
    good &= np.linalg.norm(q, axis=1) > 0.0
    t, p, q = t[good], p[good], q[good]
    if t.size > 1 and (np.diff(t) <= 0.0).any():
        raise DataError("times must increase strictly", row=int(np.argmin(np.diff(t))) + 1)
    fresh, freezes = held_poses(t, (p, angles[good]))
    t, y = t[fresh], np.hstack([p[fresh], continuous_signs(q[fresh])])
    if t.size < FEWEST:
        raise DataError(
            "too few poses for a velocity", value=int(t.size), allowed=f"at least {FEWEST}"
        )
    smooth = smooth_columns(
        t,
        y,
        rate=np.repeat(list(LARGEST_RATE.values()), [3, 4]),
        allowed=np.repeat(list(HARMLESS.values()), [3, 4]),
        sharp=np.repeat(list(SHARPEST.values()), [3, 4]),
        max_gap_s=max_gap_s,
    )
    x, P = smooth.x, smooth.P
    s, s_dot = x[:, 3:, 0], x[:, 3:, 1]
    length = np.linalg.norm(s, axis=1, keepdims=True)
    s, s_dot = s / length, s_dot / length
    # omega = 2 Im(conj(s) s_dot): M s_dot, linear in the rate of the quaternion.
    M = 2.0 * _conjugate_matrix(s)
    omega = np.einsum("nij,nj->ni", M, s_dot)
    rate_sd = np.sqrt(np.einsum("nij,nj->ni", M**2, P[:, 3:, 1, 1] / length**2))
    back = s * np.array([1.0, -1.0, -1.0, -1.0])
    arm = np.asarray(arm_m, dtype=np.float64)
    velocity = rotated(back, x[:, :3, 1]) - cross(omega, np.broadcast_to(arm, omega.shape))
    turn = np.stack([rotated(back, np.tile(axis, (len(t), 1))) for axis in np.eye(3)], axis=2)
    variance = np.einsum("nij,nj->ni", turn**2, P[:, :3, 1, 1])
    # (omega x r)_1 = omega_2 r_3 - omega_3 r_2 and so on.
    lever = np.array([[0.0, arm[2], arm[1]], [arm[2], 0.0, arm[0]], [arm[1], arm[0], 0.0]])
    velocity_sd = np.sqrt(variance + rate_sd**2 @ (lever**2).T)
    angle = euler_of_quaternion(s)
    place = x[:, :3, 0] - rotated(s, np.broadcast_to(arm, omega.shape))
    pieces = _pieces(t, smooth.begins, smooth.accepted)
    if not pieces:
        raise DataError(
            "no stretch of poses hangs together for a second",
            value=f"{int(smooth.accepted.sum())} of {t.size} poses fit a motion",
            remedy="Track fewer outliers, or record more poses a second.",
        )
    kept = np.zeros(t.size, dtype=np.bool_)
    for first, last in pieces:
        kept[first:last] = True
    numbers = np.cumsum(kept) - 1
    single = ~smooth.accepted & kept
    noise_rad = 2.0 * float(np.sqrt(np.sum(smooth.noise[3:] ** 2) / 3.0))
    return PoseTrack(
        t[kept],
        place[kept],
        angle[kept],
        velocity[kept],
        omega[kept],
        velocity_sd[kept],
        rate_sd[kept],
        tuple((int(numbers[first]), int(numbers[last - 1]) + 1) for first, last in pieces),
        tuple(
            sorted([*freezes, *_cuts(t, x, pieces, max_gap_s, freezes)], key=lambda f: f.start_s)
        ),
        t[single],
        int(np.count_nonzero(~fresh)),
        smooth.noise[:3],
        noise_rad,
    )


@dataclass(frozen=True)
class SmoothColumns:
    """Place, rate, acceleration x (n, k, 3) with covariance P (n, k, 3, 3).

    `accepted` (n,): samples that pass the gate; `begins` (n,): where the filter starts
    anew; noise (k,): standard deviation of a sample; density (k,): q.
    """

    x: Array
    P: Array
    accepted: Mask
    begins: Mask
    noise: Array
    density: Array


def smooth_columns(
    t: Array, y: Array, *, rate: Array, allowed: Array, sharp: Array, max_gap_s: float
) -> SmoothColumns:
    """Return columns y (n, k) at increasing times t (n,) smoothed, outliers left out.

    rate (k,): standard deviation of the rate where a track begins; allowed (k,): that of
    an outlier too small to matter; sharp (k,): of the acceleration where a sharp turn begins.
    """
    from scipy.stats import chi2

    # numba: a second to import
    from auvid.hydro.identification.signals.pose.compiled_track import filter_track, smooth_track

    n, k = y.shape
    y = np.ascontiguousarray(y)  # numba compiles once more for each other layout
    begins = np.append(True, np.diff(t) > max_gap_s)
    noise = np.array(
        [
            _fitted(t, y[:, c], np.ones(n, np.bool_), begins, rate[c], STUDENT, None)
            for c in range(k)
        ]
    )
    gate = float(chi2.isf(SHARE_OF_CHANCE, k))
    for last in (False, True):
        x, P = np.empty((n, k, 3)), np.empty((n, k, 3, 3))
        accepted, begins, turns = (np.empty(n, np.bool_) for _ in range(3))
        filter_track(
            t,
            y,
            max_gap_s,
            noise[:, 0].copy(),  # of one layout, which is compiled once
            noise[:, 1].copy(),
            rate,
            allowed,
            gate,
            PATIENCE,
            sharp,
            x,
            P,
            accepted,
            begins,
            turns,
        )
        if not last:  # the likelihood is that of motion between sharp turns
            anew = begins | turns
            noise = np.array(
                [_fitted(t, y[:, c], accepted, anew, rate[c], 0.0, noise[c]) for c in range(k)]
            )
    smooth_track(t, y, noise[:, 0].copy(), accepted, begins, x, P)
    # The difference P - P L P cancels where a track begins: no variance below rounding.
    for i in range(3):
        P[..., i, i] = np.maximum(P[..., i, i], np.finfo(np.float64).eps * rate**2)
    return SmoothColumns(x, P, accepted, begins, np.sqrt(noise[:, 0]), noise[:, 1])


def _fitted(
    t: Array,
    y: Array,
    used: Mask,
    begins: Mask,
    rate: float,
    dof: float,
    start: Array | None,
) -> Array:
    """Return variance of a sample and q of one column (n,) by largest likelihood.

    Long tracks are read in blocks spread over them.
    """
    from scipy.optimize import minimize

    from auvid.hydro.identification.signals.pose.compiled_track import misfit

    rows = np.arange(t.size)
    if t.size > FITTED_SAMPLES:
        size = FITTED_SAMPLES // FITTED_BLOCKS
        firsts = np.linspace(0, t.size - size, FITTED_BLOCKS).astype(np.int64)
        rows = (firsts[:, None] + np.arange(size)).ravel()
    at, values, taken, anew = t[rows], y[rows], used[rows], begins[rows].copy()
    anew[1:] |= np.diff(rows) != 1
    anew[0] = True
    step = float(np.median(np.diff(t)))
    starts = [] if start is None else [start]
    if not starts:
        inner = ~anew
        second = np.diff(values, 2)[inner[1:-1] & inner[2:]] if values.size > 3 else values
        # Scatter of second differences: of noise alone, or of the motion within a step.
        scatter = max(NORMAL_SPREAD * float(np.median(np.abs(second))), LEAST_NOISE) ** 2 / 6.0
        starts = [
            np.array([scatter * 10.0**small, scatter / step**5 * 10.0**slow])
            for small in (0, -2, -4)
            for slow in (-8, -6, -4, -2, 0)
        ]

    def cost(logs: Array) -> float:
        variance, q = np.exp(np.clip(logs, np.log(LEAST_NOISE**2), 60.0))
        return float(misfit(at, values, taken, anew, variance, q, rate, dof))

    tried = [np.log(np.maximum(each, LEAST_NOISE**2)) for each in starts]
    first = min(tried, key=cost)
    simplex = first + np.array([[0.0, 0.0], [-1.5, 0.0], [0.0, 4.0 if dof else 1.0]])
    options = {"xatol": 0.03, "fatol": 0.05, "maxfev": 120, "initial_simplex": simplex}
    best = minimize(cost, first, method="Nelder-Mead", options=options)
    return np.asarray(np.exp(np.clip(best.x, np.log(LEAST_NOISE**2), 60.0)))


def held_poses(t: Array, parts: Sequence[Array]) -> tuple[Mask, list[PoseFault]]:
    """Return which samples (n,) are new in a part (n, k), and the freezes among them.

    Parts are position and attitude. Less than REPEATED of a usual step is no news. A freeze
    lasts FREEZE_S and FREEZE_STEPS usual steps between new samples, of all parts or of one
    that stops at once; nothing is new in it.
    """
    new = [_changes(values) for values in parts]
    fresh = np.any(new, axis=0)
    frozen = np.zeros(t.size, dtype=np.bool_)
    for first, last in _long_holds(t, fresh):
        frozen[first + 1 : last + 1] = True
    for values, own in zip(parts, new, strict=True):
        for first, last in _long_holds(t, own):
            if _stops_at_once(values, own, first):
                frozen[first + 1 : last + 1] = True
    return fresh & ~frozen, [
        PoseFault("freeze", float(t[first - 1]), float(t[end - 1]))
        for first, end in runs_of(frozen)
    ]


def _changes(values: Array) -> Mask:
    """Return which samples (n,) of a part differ from the last; the first one does."""
    steps = np.abs(np.diff(values, axis=0)).max(axis=1)
    moved = steps[steps > 0.0]
    least = REPEATED * float(np.median(moved)) if moved.size else 0.0
    return np.concatenate([[True], steps > least])


def _long_holds(t: Array, new: Mask) -> list[tuple[int, int]]:
    """Return first and last sample of each hold that is longer than a usual pause."""
    at = np.flatnonzero(new)
    if at.size < 2:
        return []
    longest = max(FREEZE_S, FREEZE_STEPS * float(np.median(np.diff(t[at]))))
    ends = np.append(at[1:] - 1, t.size - 1)
    return [
        (int(first), int(last))
        for first, last in zip(at, ends, strict=True)
        if t[last] - t[first] > longest
    ]


def _stops_at_once(values: Array, new: Mask, first: int) -> bool:
    """Return whether steps before a hold are clear of the last digit (not a rest)."""
    sizes = np.abs(np.diff(values, axis=0))
    digit = float(np.min(sizes[sizes > 0.0]))
    rows = np.flatnonzero(new[1:])
    near = rows[rows < first][-STOPS:] if first else rows[:STOPS]
    return float(np.median(sizes[near].max(axis=1))) > DIGITS * digit


def _pieces(t: Array, begins: Mask, accepted: Mask) -> list[tuple[int, int]]:
    """Return the stretches [start, end) between beginnings that are long enough.

    Samples that fail the gate at the end of one belong to no motion.
    """
    pieces = []
    starts = np.flatnonzero(begins)
    for first, last in zip(starts, np.append(starts[1:], t.size), strict=True):
        fit = first + np.flatnonzero(accepted[first:last])
        enough = fit.size >= max(FEWEST, 0.5 * (last - first))
        if enough and t[fit[-1]] - t[fit[0]] >= SHORTEST_PIECE_S:
            pieces.append((int(fit[0]), int(fit[-1]) + 1))
    return pieces


def _cuts(
    t: Array,
    x: Array,
    pieces: Sequence[tuple[int, int]],
    max_gap_s: float,
    freezes: Sequence[PoseFault],
) -> list[PoseFault]:
    """Return what lies between neighbouring pieces: a gap, a jump, or samples lost.

    x (n, 7, 3): the smoothed columns; both ends are carried to the middle of the pause
    along their rates, and what is left between them is the jump.
    """
    cuts = []
    for (_, end), (start, _) in pairwise(pieces):
        pause = float(t[start] - t[end - 1])
        before = x[end - 1, :, 0] + 0.5 * pause * x[end - 1, :, 1]
        after = x[start, :, 0] - 0.5 * pause * x[start, :, 1]
        moved = float(np.linalg.norm(after[:3] - before[:3]))
        one, two = before[3:], after[3:]
        cosine = abs(float(one @ two)) / float(np.linalg.norm(one) * np.linalg.norm(two))
        turned = 2.0 * float(np.arccos(min(cosine, 1.0)))
        kind = "lost" if start - end >= PATIENCE else "gap" if pause > max_gap_s else "jump"
        frozen = any(item.start_s <= t[end - 1] <= item.end_s for item in freezes)
        if not (kind == "gap" and frozen):
            cuts.append(PoseFault(kind, float(t[end - 1]), float(t[start]), moved, turned))
    return cuts


def _conjugate_matrix(s: Array) -> Array:
    """Return B (n, 3, 4) with B a = Im(conj(s) a) for quaternions s (n, 4), w first."""
    w, x, y, z = s.T
    return np.stack(
        [
            np.column_stack([-x, w, z, -y]),
            np.column_stack([-y, -z, w, x]),
            np.column_stack([-z, y, -x, w]),
        ],
        axis=1,
    )
