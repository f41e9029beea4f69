"""Axis, angle and period of a recorded swing.

Common to the quadrifilar pendulum and the free decay. The recorder may be fixed in any
position: the axis of the swing is found from the gyro, and the angle is the rotation
about it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array, run_edges
from auvid.hydro.identification.regression.standard_errors import stationary_covariance

BODY_AXES = ("x", "y", "z")
RELEASED = 0.2
"""Share of the largest rate beyond which the swing runs free; before that it is held,
or being pushed.
"""
NEARLY = 0.7
"""Share of the largest rate that the first swing comes to; less is a pull to the side."""
GONE = 0.05
"""Share of the first amplitude at which a swing is over."""
FEWEST_SAMPLES_PER_PERIOD = 6.0
SIMPLE = (1.0 / 16.0, 11.0 / 6.0 / 16.0**2 - 1.0 / 3072.0)
"""(c, e) in w = w_0 (1 - c a^2 - e a^4) of a simple pendulum, a = (amplitude of the
rate) / w_0. In the amplitude A of the angle it is 1 - A^2/16 + A^4/3072; A^2 = a^2 (1 +
11/6 c a^2), because the rate is that of the slower swing (2 c a^2) and the third
harmonic c A^3 / 12 takes off at the top of the swing.
"""
SAME_RANGE, FLAT, STEEP = 0.8, 3, 3.0
"""A clipped axis: its extreme in parts of the largest of all axes, samples on end,
steps of resolution by which it came there.
"""


@dataclass(frozen=True)
class SwingAxis:
    """The axis of a swing in the recorder's frame: unit vector (3,).

    `share` of the rotation about it (0 to 1); angle to the nearest body axis.
    """

    axis: Array
    share: float
    nearest: str
    misalignment_rad: float


@dataclass(frozen=True)
class SwingFit:
    """A damped swing: period of small undamped swings, decay rate, first amplitude.

    Period with standard error [s], decay rate [1/s], amplitude of the angle [rad].
    `swings`: how many full swings it made before it fell to a twentieth or the
    recording ended; `residual`: RMS of what is not explained, as a share of the first
    amplitude of the signal; `bias`: constant of the signal; `start_s`: where the fit
    begins. `fitted` (n,): the swing at the samples `t_s` (n,) that were fitted.
    """

    period_s: float
    standard_error_s: float
    decay_rate: float
    amplitude_rad: float
    swings: float
    residual: float
    bias: float
    start_s: float
    t_s: Array
    fitted: Array


def swing_axis(gyro: ArrayLike) -> SwingAxis:
    """Return the axis of the strongest rotation in gyro rates (n, 3) [rad/s].

    Constants and noise are removed first. Raises `DataError` for no rotation.
    """
    rates = np.asarray(gyro, dtype=np.float64)
    centred = rates - np.median(rates, axis=0)
    values, vectors = np.linalg.eigh(centred.T @ centred)
    # White noise turns about all axes alike; its size shows in the second differences
    # of the stillest one.
    still = np.diff(centred @ vectors[:, 0], 2)
    noise = len(rates) * float(still @ still) / (6.0 * max(still.size, 1))
    values = np.maximum(values - noise, 0.0)
    # Noise alone leaves 2 sqrt(3/n) of itself in the largest of three eigenvalues.
    if values[-1] <= noise * 4.0 * np.sqrt(3.0 / len(rates)):
        raise DataError(
            "the gyro shows no rotation above its noise",
            field="gyro",
            remedy="Check that the recorder was on the pendulum and running.",
        )
    axis = vectors[:, -1]
    main = int(np.argmax(np.abs(axis)))
    axis = axis * np.sign(axis[main])
    angle = float(np.arccos(min(1.0, abs(axis[main]))))
    return SwingAxis(axis, float(values[-1] / values.sum()), BODY_AXES[main], angle)


def angle_about(euler: ArrayLike, axis: ArrayLike) -> Array:
    """Return the rotation (n,) [rad] about a body axis (3,) against the mean attitude.

    Euler angles (n, 3), swings below half a turn.
    """
    from scipy.spatial.transform import Rotation

    attitude = Rotation.from_euler("ZYX", np.asarray(euler, dtype=np.float64)[:, ::-1])
    return np.asarray(
        (attitude.mean().inv() * attitude).as_rotvec() @ np.asarray(axis, dtype=np.float64)
    )


def outside_range(gyro: ArrayLike) -> NDArray[np.bool_]:
    """Return the samples (n,) at which an axis of a gyro (n, 3) is clipped.

    An axis is clipped where three or more samples on end are equal to its extreme, that
    extreme is near the largest of all axes (they have one range), and the signal came
    there by more than three steps of its resolution: the top of a slow swing in whole
    counts is no clip.
    """
    rates = np.asarray(gyro, dtype=np.float64)
    clipped = np.zeros(len(rates), dtype=np.bool_)
    largest = float(np.abs(rates).max())
    for x in rates.T:
        steps = np.abs(np.diff(x))
        resolution = float(steps[steps > 0.0].min()) if np.any(steps > 0.0) else 0.0
        for extreme in (x.max(), x.min()):
            at = x == extreme
            begins, ends = run_edges(at).T
            came = np.abs(extreme - x[np.maximum(begins - 1, 0)]) > STEEP * resolution
            if abs(extreme) >= SAME_RANGE * largest and np.any((ends - begins >= FLAT) & came):
                clipped |= at
    return clipped


def angle_per_rate(
    t_s: ArrayLike, rate: ArrayLike, angle_t_s: ArrayLike, angle: ArrayLike
) -> float:
    """Return the turn of an angle (m,) [rad] per that of a rate (n,) [rad/s].

    1 where they agree, whatever their zeros and drifts. By the first three swings: over
    more of them the noise of the rate adds up. NaN where the angle has too few samples
    in them.
    """
    from scipy.interpolate import CubicSpline

    t, x, at = (np.asarray(part, dtype=np.float64) for part in (t_s, rate, angle_t_s))
    strong = np.flatnonzero(np.abs(x - np.median(x)) > 0.3 * np.abs(x - np.median(x)).max())
    turns = strong[1:][np.diff(np.sign(x[strong] - np.median(x))) != 0.0]
    end = turns[6] if turns.size > 6 else strong[-1]
    t, x = t[: end + 1], x[: end + 1]
    inside = (at >= t[0]) & (at <= t[-1])
    at = at[inside]
    if at.size < 8 or t.size < 8:
        return float("nan")
    turned = CubicSpline(t, x).antiderivative()(at)
    time = (at - at[0]) / (at[-1] - at[0])
    columns = np.column_stack([turned, np.ones_like(time), time, time**2])
    return float(
        np.linalg.lstsq(columns, np.asarray(angle, dtype=np.float64)[inside], rcond=None)[0][0]
    )


def release_index(rate: ArrayLike) -> int:
    """Return the first sample of the free swing in a rate (n,).

    From there on the rate stays beyond a fifth of its largest size until it comes near
    that. What came before, a gentle pull to the side and the time in which it was held,
    is left out.
    """
    size = np.abs(np.asarray(rate, dtype=np.float64) - np.median(np.asarray(rate)))
    top = int(np.argmax(size >= NEARLY * size.max()))
    before = np.flatnonzero(size[:top] < RELEASED * size.max())
    return int(before[-1]) + 1 if before.size else 0


def check_rate(t_s: ArrayLike, period_s: float) -> None:
    """Raise `DataError` for times (n,) [s] too far apart for a swing."""
    step = float(np.median(np.diff(np.asarray(t_s, dtype=np.float64))))
    if period_s < FEWEST_SAMPLES_PER_PERIOD * step:
        raise DataError(
            "the recording is too slow for the swing",
            value=f"period {period_s:.3g} s, a sample every {step:.3g} s",
            allowed=f"at least {FEWEST_SAMPLES_PER_PERIOD:g} samples per period",
            remedy="Log the gyro faster.",
        )


def check_one_swing(t_s: ArrayLike, rate: ArrayLike, period_s: float) -> None:
    """Raise `DataError` when a decaying rate (n,) doubles: pushed or released again.

    The rate swings from t_s[0] on.
    """
    t, x = np.asarray(t_s, dtype=np.float64), np.asarray(rate, dtype=np.float64)
    _, begins = np.unique(((t - t[0]) / period_s).astype(np.intp), return_index=True)
    largest = np.maximum.reduceat(np.abs(x - np.median(x)), begins)
    fallen = np.minimum.accumulate(largest)
    again = (
        np.flatnonzero((largest[1:] > 2.0 * fallen[:-1]) & (largest[1:] > RELEASED * largest[0]))
        + 1
    )
    if again.size:
        begin = begins[again[0]]
        grown = begin + int(
            np.argmax(np.abs(x[begin:] - np.median(x)) > 2.0 * fallen[again[0] - 1])
        )
        raise DataError(
            "the swing grows again: it was pushed, or released a second time",
            value=f"at {t[grown]:.1f} s",
            remedy="Give each swing a leg of its own, from its release to its end.",
        )


def swing_back_period(t_s: ArrayLike, rate: ArrayLike) -> float:
    """Return the period [s] of a swing that dies within a few turns.

    It is twice the time from the release to the first turning point. rate (n,) [rad/s]
    from the release on. Raises `DataError` when it never comes back with a twentieth of
    its first rate: overdamped.
    """
    t, x = np.asarray(t_s, dtype=np.float64), np.asarray(rate, dtype=np.float64)
    ahead = x * np.sign(x[np.argmax(np.abs(x) >= 0.5 * np.abs(x).max())])
    back = np.flatnonzero(ahead < -GONE * np.abs(x).max())
    back = back[back > np.argmax(ahead)]
    if not back.size:
        raise DataError(
            "the pendulum does not swing back (overdamped, or the recording ends too early)",
            value=f"rate after the first half swing below {100.0 * GONE:g} % of the largest",
            remedy=(
                "Add weight or take a longer arm, so that it swings at least twice; record until it"
                " is at rest."
            ),
        )
    turn = int(np.flatnonzero(ahead[: back[0]] > 0.0)[-1])
    crossing = t[turn] + (t[turn + 1] - t[turn]) * ahead[turn] / (ahead[turn] - ahead[turn + 1])
    return float(2.0 * (crossing - t[0]))


def spectral_period(t_s: ArrayLike, signal: ArrayLike) -> float:
    """Return the period [s] of the strongest line of a signal (n,).

    Hann window, fourfold zero padding, parabola through the peak. Raises `DataError`
    when the strongest line lies at the lower end of the spectrum: there is no
    oscillation (overdamped, or a drift).
    """
    t, x = np.asarray(t_s, dtype=np.float64), np.asarray(signal, dtype=np.float64)
    uniform = np.linspace(t[0], t[-1], t.size)
    values = np.interp(uniform, t, x)
    values = (values - np.polyval(np.polyfit(uniform, values, 1), uniform)) * np.hanning(t.size)
    power = np.abs(np.fft.rfft(values, 4 * t.size)) ** 2
    peak = int(np.argmax(power[1:-1])) + 1
    # A Hann window of one and a half periods is the least that shows an oscillation as
    # a line of its own.
    if peak < 6:
        raise DataError(
            "the recording shows no oscillation (overdamped, too short, or only a drift)",
            value=(
                f"strongest line at {4.0 * (t[-1] - t[0]) / max(peak, 1) / 4.0:.3g} s in"
                f" {t[-1] - t[0]:.3g} s"
            ),
            remedy=(
                "Add weight or take a longer arm, so that it swings at least twice; record until it"
                " is at rest."
            ),
        )
    low, mid, high = np.log(power[peak - 1 : peak + 2] + np.finfo(float).tiny)
    shift = 0.5 * (low - high) / (low - 2.0 * mid + high)
    return float(4.0 * t.size * (uniform[1] - uniform[0]) / (peak + shift))


def fit_swing(
    t_s: ArrayLike,
    rate: ArrayLike,
    *,
    slowing: tuple[float, float] = SIMPLE,
    fewest: float = 3.0,
    usable: NDArray[np.bool_] | None = None,
) -> SwingFit:
    """Fit a damped sinusoid to a rate (n,) [rad/s] from its release on.

    The rate is exp(-z t) (a cos psi + b sin psi) + constant + drift, with psi_dot = w
    (1 - c a(t)^2 - e a(t)^4): large swings are slower. a is the amplitude of the rate
    over w; slowing: c and e, unless it is a simple pendulum. The period is that of
    small swings without damping, 2 pi / sqrt(w^2 + z^2). Its standard error allows for
    coloured residuals. usable (n,): samples to fit, for instance those that are not
    clipped. Raises `DataError` for fewer than `fewest` swings, too slow a recording,
    one without oscillation, or one of several swings.
    """
    from scipy.optimize import least_squares

    t, x = np.asarray(t_s, dtype=np.float64), np.asarray(rate, dtype=np.float64)
    first = release_index(x)
    keep = np.ones(t.size, dtype=np.bool_) if usable is None else np.asarray(usable)
    if t.size - first < 16:
        raise DataError(
            "too few samples of a swing", value=t.size - first, remedy="Record longer or faster."
        )
    period = spectral_period(t[first:], x[first:])
    start = t[first]
    rows = (np.arange(t.size) >= first) & keep
    time, y = t[rows] - start, x[rows]
    check_rate(t, period)
    check_one_swing(t[first:], x[first:], period)
    size = float(np.abs(y - np.median(y)).max())

    def shrunk(decay: float, power: int) -> Array:
        """Return the integral of exp(-power z t) from the release on."""
        x = power * decay
        return time if abs(x) * time[-1] < 1e-9 else np.asarray(-np.expm1(-x * time) / x)

    def waves(w: float, z: float, square: float) -> Array:
        """Return decaying cos and sin of the phase, a constant and a drift.

        `square`: amplitude of the rate over w, squared.
        """
        loss = slowing[0] * square * shrunk(z, 2) + slowing[1] * square**2 * shrunk(z, 4)
        psi, fade = w * (time - loss), np.exp(-z * time)
        return np.column_stack([fade * np.cos(psi), fade * np.sin(psi), np.ones_like(time), time])

    def error_of(p: Array) -> Array:
        return np.asarray(waves(p[0], p[1], (p[2] ** 2 + p[3] ** 2) / p[0] ** 2) @ p[2:] - y)

    w = 2.0 * np.pi / period
    half = time.size // 2
    fading = float(np.log(np.std(y[:half]) / np.std(y[half:])) / (0.5 * time[-1]))
    linear = np.linalg.lstsq(waves(w, max(fading, 0.0), (size / w) ** 2), y, rcond=None)[0]
    scale = np.array([w / 100.0, w / 100.0, size, size, size, size / time[-1]])
    solution = least_squares(
        error_of, np.concatenate([[w, max(fading, 0.0)], linear]), x_scale=scale
    )
    p, error = solution.x, solution.fun
    bread = np.linalg.inv(solution.jac.T @ solution.jac)
    covariance = stationary_covariance([solution.jac], [error], bread)
    natural = float(np.hypot(p[0], p[1]))
    by = np.array([p[0], p[1]]) * (-2.0 * np.pi / natural**3)
    amplitude = float(np.hypot(p[2], p[3]))
    lasting = min(time[-1], -np.log(GONE) / p[1] if p[1] > 0 else time[-1])
    swings = float(lasting * p[0] / (2.0 * np.pi))
    if swings < fewest:
        raise DataError(
            f"too few swings: {swings:.1f} before the swing has died down or the recording ends",
            allowed=f"at least {fewest:g}",
            remedy="Record longer, start from a larger angle, or add weight so that it swings on.",
        )
    return SwingFit(
        period_s=2.0 * np.pi / natural,
        standard_error_s=float(np.sqrt(by @ covariance[:2, :2] @ by)),
        decay_rate=float(p[1]),
        amplitude_rad=amplitude / float(p[0]),
        swings=swings,
        residual=float(np.sqrt(np.mean(error**2))) / amplitude,
        bias=float(p[4]),
        start_s=float(start),
        t_s=t[rows],
        fitted=y + error,
    )
