"""Added mass and damping from free decay in water. Equations of Alberti 2015.

Chapter VI, (66)-(71), corrected:

    I theta_ddot = -G sin theta + D_1 theta_dot + D_2 theta_dot |theta_dot|

I [kg m^2] and G [N m] are the inertia and the restoring moment of all that hangs on the
pivot. The motion tells the three ratios k = G/I, D_1/I and D_2/I, and nothing more: I
itself comes from a G that was weighed. Point-mass form (66): everything at the arm L,
so that I = (m - X_udot) L^2 and G = (m g - B) L. Physical pendulum: every part at its
own arm, its buoyancy at its own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array
from auvid.hydro.identification.bench.channel_records import BOTH, DAMPING
from auvid.hydro.identification.bench.output_error import (
    Model,
    Nuisance,
    OutputErrorFit,
    SingleRun,
    fit_output_error,
    simulate_run,
)
from auvid.hydro.identification.bench.persistence_of_excitation import Excitation, excitation
from auvid.hydro.identification.bench.recursive_least_squares import (
    RecursiveEstimate,
    StaticRegression,
    batch_least_squares,
    recursive_least_squares,
    static_form,
)
from auvid.hydro.identification.bench.single_channel import choose_damping
from auvid.hydro.identification.bench.swing import GONE

FILTER_SHARE = 0.5
"""Rate of the regression filter as a share of the swing's angular frequency."""
PRIOR_SPREAD = 1e6
PLAUSIBLE = 0.7, 1.6
"""k of a regression over the square of the swing's frequency: damping and large swings
lower the frequency, up to this.
"""
HELD_OUT = 0.4
"""Last share of the swings, by which the damping model is chosen."""


@dataclass(frozen=True)
class HungPart:
    """A body that hangs on the pivot: mass and displaced mass [kg] at their arms [m].

    `inertia` [kg m^2] is about its own centre.
    """

    mass: float
    arm: float
    displaced_mass: float = 0.0
    displaced_arm: float = 0.0
    inertia: float = 0.0


@dataclass(frozen=True)
class PendulumMoments:
    """The pendulum without added mass: inertia and restoring moment about the pivot.

    `inertia` [kg m^2]; `stiffness` [N m] is the moment at 90 degrees.
    """

    inertia: float
    stiffness: float


@dataclass(frozen=True)
class Decay:
    """A recorded decay, its start and its small-swing frequency [rad/s].

    `run`: x = theta_dot, s = theta from equilibrium. `known`: D_1/G and D_2/G of the
    pendulum without the vehicle, which the damping models leave in place: they are
    those of the vehicle.
    """

    run: SingleRun
    start: Array
    frequency: float
    pole: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class Ratios:
    """k = G/I [1/s^2], D_1/I [1/s] and D_2/I of one method and damping model.

    `covariance` (3, 3); 0 for a term that is left out. `rmse_rad`: simulated minus
    measured angle over the recording; `held_out_rad`: over the last swings, with ratios
    from the first.
    """

    values: Array
    covariance: Array
    rmse_rad: float
    held_out_rad: float = float("nan")


@dataclass(frozen=True)
class DecayEstimate:
    """The ratios of a decay by damping model and method, with the simulated swing.

    Output error is the estimate; recursive and batch least squares are for comparison.
    `simulated` and `measured` hold theta (n,) on the grid of the run, the measured one
    without the sensor's fitted constant; `chosen` is the damping model with the
    smallest error on the held-out swings.
    """

    output_error: Mapping[str, Ratios]
    recursive: Mapping[str, Ratios]
    batch: Mapping[str, Ratios]
    history: Mapping[str, RecursiveEstimate]
    simulated: Mapping[str, Array]
    measured: Array
    excitation: Excitation
    chosen: str


@dataclass(frozen=True)
class Derivatives:
    """Added mass [kg], linear [kg/s] and quadratic [kg/m] damping at the arm L.

    All are <= 0 in physics; `covariance` (3, 3).
    """

    values: Array
    covariance: Array

    @property
    def standard_errors(self) -> Array:
        """Return the standard errors (3,)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))


def pendulum_moments(
    parts: Sequence[HungPart], gravity: float, *, arm: float | None = None
) -> PendulumMoments:
    """Return inertia and restoring moment of parts about the pivot.

    I = sum m L^2 + I_c, G = g sum (m L - m_displaced L_displaced). arm: everything at
    this arm, the point-mass form (66). Raises `DataError` where buoyancy exceeds
    weight.
    """
    if arm is not None:
        parts = [HungPart(part.mass, arm, part.displaced_mass, arm) for part in parts]
    inertia = sum(part.mass * part.arm**2 + part.inertia for part in parts)
    stiffness = gravity * sum(
        part.mass * part.arm - part.displaced_mass * part.displaced_arm for part in parts
    )
    if stiffness <= 0.0:
        raise DataError(
            "the pendulum does not hang: the moment of buoyancy is above that of weight",
            value=f"{stiffness:.4g} N m",
            remedy="Check masses, displaced masses and arms in the apparatus; add weight.",
        )
    return PendulumMoments(float(inertia), float(stiffness))


def estimate_decay(decay: Decay) -> DecayEstimate:
    """Fit all damping models to a decay by all three methods.

    Raises `DataError` as `fit_output_error` does.
    """
    run = decay.run
    theta, theta_dot, times = _signals(decay)
    rough = _static(decay, theta, theta_dot, times)
    output: dict[str, Ratios] = {}
    recursive: dict[str, Ratios] = {}
    batch: dict[str, Ratios] = {}
    history: dict[str, RecursiveEstimate] = {}
    simulated: dict[str, Array] = {}
    measured: dict[str, Array] = {}
    over = times[np.flatnonzero(np.abs(theta_dot) > GONE * np.abs(theta_dot).max())[-1]]
    end = times[0] + (1.0 - HELD_OUT) * (over - times[0])
    late = (run.grid_s > end) & (run.grid_s <= over)
    fits: dict[str, OutputErrorFit] = {}
    guesses: dict[str, Array] = {}
    for name, terms in DAMPING.items():
        used = _used(terms)
        guesses[name] = recursive_least_squares(
            _columns(rough, used), prior_spread=PRIOR_SPREAD
        ).theta[-1, :-1]
        fits[name] = _fit(decay, run, guesses[name], used)
    # The regressions shown are those without the constants and drifts of the sensors:
    # an integrated gyro drifts far.
    form = _static(decay, *_signals(decay, fits[BOTH]))
    for name, terms in DAMPING.items():
        used, fitted = _used(terms), fits[name]
        part = _columns(form, used)
        recursion = recursive_least_squares(part, prior_spread=PRIOR_SPREAD)
        first = _fit(decay, run.until(float(end)), guesses[name], used)
        history[name] = recursion
        simulated[name] = simulate_run(run, fitted.coefficients, fitted.start)[1]
        measured[name] = measured_angle(run, fitted)
        predicted = simulate_run(run, first.coefficients, first.start)[1] - measured[name]
        values, covariance = _totals(
            fitted.parameters, fitted.covariance, used, decay.pole, logarithm=True
        )
        output[name] = Ratios(
            values, covariance, _rms(simulated[name] - measured[name]), _rms(predicted[late])
        )
        batched, gamma = batch_least_squares(part, prior_spread=PRIOR_SPREAD)
        for results, theta_hat, spread in (
            (recursive, recursion.theta[-1], recursion.gamma),
            (batch, batched, gamma),
        ):
            results[name] = _by_regression(
                decay, fitted.start, measured[name], part, theta_hat, spread, used
            )
    chosen = choose_damping(
        {name: item.held_out_rad for name, item in output.items()},
        *clear_of_zero(output[BOTH], decay.pole),
    )
    return DecayEstimate(
        output,
        recursive,
        batch,
        history,
        simulated,
        measured[chosen],
        excitation(form.t_s, form.regressor[:, :3]),
        chosen,
    )


def clear_of_zero(both: Ratios, pole: tuple[float, float]) -> tuple[Array, Array]:
    """Return D_1/I and D_2/I (2,) beyond the known part, and standard errors (2,).

    D_1/I and D_2/I of the damping model with both terms.
    """
    return both.values[1:] - both.values[0] * np.asarray(pole), np.sqrt(
        np.maximum(np.diag(both.covariance)[1:], 0.0)
    )


def derivatives(
    ratios: Ratios, hung: PendulumMoments, *, arm: float, empty: Derivatives | None = None
) -> Derivatives:
    """Return added mass and damping at the arm from ratios and weighed moments, (70).

    X_udot = -(G/k - I) / L^2, X_u = D_1 / L^2, X_u|u| = D_2 / L^3. empty: those of the
    pendulum without the vehicle, which are taken off, with their covariance (where
    `Decay.pole` was theirs).
    """
    k, one, two = ratios.values
    inertia = hung.stiffness / k
    values = np.array(
        [-(inertia - hung.inertia) / arm**2, one * inertia / arm**2, two * inertia / arm**3]
    )
    by = np.array(
        [
            [inertia / k / arm**2, 0.0, 0.0],
            [-one * inertia / k / arm**2, inertia / arm**2, 0.0],
            [-two * inertia / k / arm**3, 0.0, inertia / arm**3],
        ]
    )
    covariance = by @ ratios.covariance @ by.T
    if empty is None:
        return Derivatives(values, covariance)
    return Derivatives(values - empty.values, covariance + empty.covariance)


def prediction_error(decay: Decay, ratios: Ratios) -> float:
    """Return the RMS error [rad] of another decay simulated with given ratios.

    Only its start and the constants of its sensors are fitted.
    """
    k, one, two = ratios.values
    coefficients = np.array([one, two, 0.0, -k, 0.0])
    run = decay.run
    gyro, attitude = bool(run.rate.size), bool(run.position.size)
    nuisance = Nuisance(
        rate_bias=gyro, rate_drift=gyro, position_bias=attitude, start_position=True
    )
    fitted = fit_output_error(
        run,
        lambda _: (coefficients, np.zeros((5, 0))),
        np.zeros(0),
        start=decay.start,
        nuisance=nuisance,
    )
    return _rms(simulate_run(run, coefficients, fitted.start)[1] - measured_angle(run, fitted))


def measured_angle(
    run: SingleRun, fitted: OutputErrorFit | None = None, *, start: float = 0.0
) -> Array:
    """Return the angle (n,) [rad] on the grid, by positions or the integrated rate.

    With a fit, the constants and the drift of the sensors that it found are taken off,
    and the rate is integrated from its s(0); else from `start`.
    """
    bias = np.zeros(3) if fitted is None else fitted.bias
    if run.position.size:
        return np.asarray(
            np.interp(run.grid_s, run.grid_s[run.position_at], run.position - bias[2])
        )
    time = run.grid_s[run.rate_at]
    rate = run.rate - bias[0] - bias[1] * (time - run.grid_s[0])
    steps = 0.5 * (rate[1:] + rate[:-1]) * np.diff(time)
    first = start if fitted is None else float(fitted.start[1])
    return np.asarray(
        np.interp(run.grid_s, time, first + np.concatenate([[0.0], np.cumsum(steps)]))
    )


def _used(terms: tuple[bool, bool]) -> list[int]:
    """Return the columns of a damping model in the full regression, but the last."""
    return [0, *(index + 1 for index, has in enumerate(terms) if has)]


def _static(decay: Decay, theta: Array, theta_dot: Array, times: Array) -> StaticRegression:
    """Return the static form of a decay with all columns.

    They are the restoring moment with the known damping, linear and quadratic damping,
    and the constant of the angle's zero.
    """
    one, two = theta_dot, theta_dot * np.abs(theta_dot)
    columns = np.column_stack(
        [decay.pole[0] * one + decay.pole[1] * two - np.sin(theta), one, two, np.ones_like(theta)]
    )
    return static_form(times, theta_dot, columns, rate=FILTER_SHARE * decay.frequency)


def _columns(form: StaticRegression, used: Sequence[int]) -> StaticRegression:
    return StaticRegression(
        form.t_s, form.z, np.ascontiguousarray(form.regressor[:, [*used, 3]]), form.rate
    )


def _signals(decay: Decay, fitted: OutputErrorFit | None = None) -> tuple[Array, Array, Array]:
    """Return theta, theta_dot and their times.

    They are given at the samples of the rate, or at those of the angle, whose rate is
    then that of its smoothing spline. fitted: constants and drifts of the sensors are
    those that it found; else a constant of the gyro is guessed.
    """
    from auvid.hydro.identification.signals.splines import smoothing_spline

    run = decay.run
    if run.rate.size:
        time = run.grid_s[run.rate_at]
        if fitted is not None:
            rate = run.rate - fitted.bias[0] - fitted.bias[1] * (time - run.grid_s[0])
            return np.interp(time, run.grid_s, measured_angle(run, fitted)), rate, time
        plain = replace(run, rate=run.rate - _constant_rate(run))
        return (
            np.interp(time, run.grid_s, measured_angle(plain, start=float(decay.start[1]))),
            plain.rate,
            time,
        )
    time = run.grid_s[run.position_at]
    spline = smoothing_spline(time, run.position)
    return spline.evaluate(time), spline.evaluate(time, 1), time


def _model(used: Sequence[int], pole: tuple[float, float]) -> Model:
    """Return the map from parameters to coefficients and their derivatives.

    Parameters are log k, then what the damping model adds to the known ratios.
    """

    def of(p: Array) -> tuple[Array, Array]:
        coefficients, by = np.zeros(5), np.zeros((5, len(p)))
        k = np.exp(p[0])
        by[[0, 1, 3], 0] = k * pole[0], k * pole[1], -k
        coefficients[:] = by[:, 0]
        for index, term in enumerate(used[1:], start=1):
            coefficients[term - 1] += p[index]
            by[term - 1, index] = 1.0
        return coefficients, by

    return of


def _fit(decay: Decay, run: SingleRun, theta: Array, used: Sequence[int]) -> OutputErrorFit:
    """Fit by output error from the result of a regression.

    Where its k is far from the swing's frequency, the fit also starts from period and
    decay of the amplitude.
    """
    plausible = PLAUSIBLE[0] < theta[0] / decay.frequency**2 < PLAUSIBLE[1]
    guesses = (
        [theta] if plausible else [_from_fading(decay, used), *([theta] if theta[0] > 0.0 else [])]
    )
    gyro, attitude = bool(run.rate.size), bool(run.position.size)
    nuisance = Nuisance(
        rate_bias=gyro, rate_drift=gyro, position_bias=attitude, start_position=True
    )
    tried = []
    for guess in guesses:
        first = np.concatenate([[np.log(guess[0])], np.minimum(guess[1:], 0.0)])
        tried.append(
            fit_output_error(
                run, _model(used, decay.pole), first, start=decay.start, nuisance=nuisance
            )
        )
    return min(tried, key=lambda item: _rms(item.rate_error) if gyro else _rms(item.position_error))


def _from_fading(decay: Decay, used: Sequence[int]) -> Array:
    """Return k, D_1/I, D_2/I as used, from the period and the decay of the amplitude.

    The decay is that from the first to the second half of the recording.
    """
    _, rate, times = _signals(decay)
    half, span = rate.size // 2, times[-1] - times[0]
    size = [max(float(np.std(part)), np.finfo(float).tiny) for part in (rate[:half], rate[half:])]
    fading = max(2.0 * np.log(size[0] / size[1]) / span, 0.0)
    # A swing of amplitude a loses as much by D_2 as by D_1 = 8 a / (3 pi) D_2.
    guess = np.array(
        [
            decay.frequency**2,
            -2.0 * fading,
            -2.0 * fading * 3.0 * np.pi / (8.0 * np.sqrt(2.0) * size[0]),
        ]
    )
    if len(used) == 3:
        guess[2] = 0.0
    return guess[list(used)]


def _totals(
    parameters: Array,
    covariance: Array,
    used: Sequence[int],
    pole: tuple[float, float],
    *,
    logarithm: bool,
) -> tuple[Array, Array]:
    """Return k, D_1/I, D_2/I (3,) and their covariance from fitted parameters.

    The first parameter is k or its logarithm, the others add to the known ratios.
    """
    values, by = np.zeros(3), np.zeros((3, len(used)))
    k = float(np.exp(parameters[0])) if logarithm else float(parameters[0])
    values[:] = k, k * pole[0], k * pole[1]
    by[:, 0] = values if logarithm else values / k
    for index, term in enumerate(used[1:], start=1):
        values[term] += parameters[index]
        by[term, index] = 1.0
    return values, by @ covariance @ by.T


def _constant_rate(run: SingleRun) -> float:
    """Return the constant of the gyro [rad/s].

    It is its mean less the turn from the first to the last angle; without angles the
    mean over the last half.
    """
    if not run.position.size:
        return float(np.mean(run.rate[run.rate.size // 2 :]))
    time = run.grid_s[run.rate_at]
    turned = np.diff(np.interp(time[[0, -1]], run.grid_s[run.position_at], run.position))[0]
    return float(
        (np.sum(0.5 * (run.rate[1:] + run.rate[:-1]) * np.diff(time)) - turned)
        / (time[-1] - time[0])
    )


def _by_regression(
    decay: Decay,
    start: Array,
    measured: Array,
    form: StaticRegression,
    theta: Array,
    gamma: Array,
    used: Sequence[int],
) -> Ratios:
    """Return the ratios of a regression with white standard errors.

    `rmse_rad` is that of their simulation from the fitted start. The last column of the
    regression, the constant of the angle's zero, is no ratio.
    """
    residual = form.z - form.regressor @ theta
    step = float(np.median(np.diff(form.t_s)))
    spread = (
        gamma[:-1, :-1] * step * float(residual @ residual) / max(residual.size - len(theta), 1)
    )
    values, covariance = _totals(theta[:-1], spread, used, decay.pole, logarithm=False)
    angle = simulate_run(decay.run, np.array([values[1], values[2], 0.0, -values[0], 0.0]), start)[
        1
    ]
    return Ratios(values, covariance, _rms(angle - measured))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")
