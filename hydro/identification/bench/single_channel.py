"""Added mass and damping from a run of one channel. Equations of Alberti 2015.

(60)-(65), the other channels at rest:

    M x_dot = D_1 x + D_2 x|x| + F - R sin s + C,   s_dot = x,   M = m - X_udot

x is the channel's body velocity, s its angle (or depth), F what drives it, R the
restoring moment at 90 degrees (roll, pitch), C a constant force. Two estimates:
recursive least squares of the filtered static form (61)-(63), Theta = [D_1, D_2, 1,
C]/M, which shows how the figures settle; and output error, started from it, which is
free of the bias that noise in the regressors brings, and gives the figures to take.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array
from auvid.hydro.identification.bench.channel_records import (
    BOTH,
    DAMPING,
    ChannelEstimate,
    ChannelFit,
    ChannelRun,
    RecursiveFit,
)
from auvid.hydro.identification.bench.output_error import (
    Model,
    Nuisance,
    fit_output_error,
    simulate_run,
)
from auvid.hydro.identification.bench.persistence_of_excitation import (
    PERSISTENT,
    Excitation,
    excitation,
)
from auvid.hydro.identification.bench.recursive_least_squares import (
    RecursiveEstimate,
    StaticRegression,
    recursive_least_squares,
    static_form,
)
from auvid.hydro.identification.bench.thrust_lag import Lag, find_lag, lagged
from auvid.hydro.identification.regression.standard_errors import stationary_covariance

SIMPLER_WITHIN = 1.05
"""A damping model with fewer terms is taken when its held-out error is within 5 % of the
best: of the order of one standard error of an RMS over 200 independent samples,
1 / sqrt(2 n) (the one-standard-error rule, Hastie et al. 2009, 7.10).
"""
CLEAR_TERM = 4.0
"""Standard errors from zero beyond which a term stays whatever the held-out error: the
term that is kept would bear it, outside its interval. Four, as coloured errors are known
to a factor of 1.5 or so, which leaves 2.7: 99 %.
"""
SOUND_WITHIN = 1.5
"""A damping model whose RMS error on the whole run exceeds this times the least is not
chosen, whatever it predicts: more than half of its squared error is then of its form
(1 - 1 / 1.5^2 = 0.56).
"""
HELD_OUT = 1.0 / 3.0
"""Last part of a run, by which the damping model is chosen: it is predicted with
figures from the first.
"""


def choose_damping(held_out: Mapping[str, float], terms: ArrayLike, errors: ArrayLike) -> str:
    """Return the damping model with the least held-out error, or a simpler near equal.

    terms (2,) and errors (2,): linear and quadratic damping of the model with both, and
    their standard errors.
    """
    best = min(held_out.values())
    near = [name for name, error in held_out.items() if error <= SIMPLER_WITHIN * best]
    chosen = min(near, key=lambda name: (sum(DAMPING[name]), held_out[name]))
    dissipates = bool(np.all(np.asarray(terms) < -CLEAR_TERM * np.asarray(errors)))
    return BOTH if BOTH in near and dissipates else chosen


def estimate_channel(
    data: ChannelRun,
    *,
    filter_rate: float,
    prior_spread: float = 1e6,
    memory_s: float | None = None,
    limits: tuple[float, float] = (0.0, np.inf),
) -> ChannelEstimate:
    """Fit all damping models to a run by both methods: (60)-(65).

    filter_rate [rad/s], prior_spread, memory_s and limits are those of `static_form`
    and `recursive_least_squares`. Raises `DataError` when the channel is not excited.
    """
    reason = unexcited(data)
    if reason:
        raise DataError(
            f"the channel was never excited: {reason}",
            allowed=f"RMS above {data.noise:g}",
            remedy="Choose a leg in which this channel is driven, or correct the channel.",
        )
    end = float(data.run.grid_s[0] + (1.0 - HELD_OUT) * (data.run.grid_s[-1] - data.run.grid_s[0]))

    regressions = partial(
        recursive_fits,
        filter_rate=filter_rate,
        prior_spread=prior_spread,
        memory_s=memory_s,
        limits=limits,
    )
    recursive, excited = regressions(data)
    if all(item.status == PERSISTENT for item in excited.values()):
        data = replace(data, rate_bias=data.rate_bias or data.current)
    else:
        data = replace(data, lag=False)
    fits = {name: _output_error(data, name, recursive[name].values[-1], end) for name in DAMPING}
    lag = _lag(data, fits[BOTH])
    if lag is not None:
        late = [
            _with_lag(data, value) for value in (lag.value_s, lag.value_s + lag.standard_error_s)
        ]
        for name, fit in fits.items():
            one, other = (_output_error(item, name, fit.values, end) for item in late)
            moved = other.values - one.values
            fits[name] = replace(one, covariance=one.covariance + np.outer(moved, moved))
        data = late[0]
    bias = float(fits[BOTH].fit.bias[0])
    if lag is not None or bias != 0.0:
        taken = (
            float(np.mean(data.run.rate - data.velocity[data.run.rate_at]))
            if data.run.rate.size
            else 0.0
        )
        recursive, excited = regressions(replace(data, velocity=data.velocity + taken - bias))
    least = min(item.rmse for item in fits.values())
    sound = {
        name: item.held_out for name, item in fits.items() if item.rmse <= SOUND_WITHIN * least
    }
    chosen = choose_damping(sound, fits[BOTH].values[1:3], fits[BOTH].standard_errors[1:3])
    return ChannelEstimate(fits, recursive, excited, chosen, lag, data)


def recursive_fits(
    data: ChannelRun,
    *,
    filter_rate: float,
    prior_spread: float,
    memory_s: float | None = None,
    limits: tuple[float, float] = (0.0, np.inf),
) -> tuple[dict[str, RecursiveFit], dict[str, Excitation]]:
    """Return the recursive estimate (39), (41) and C_n (51) of every damping model.

    Arguments are those of `estimate_channel`. Theta starts at zero, so that where a run
    excites little a small prior_spread holds Theta, hence the inverse of the mass, near
    zero: the mass that comes out is far too large.
    """
    form = _static(data, filter_rate)
    fits, excited = {}, {}
    for name in DAMPING:
        columns = _columns(name, data)
        part = StaticRegression(
            form.t_s, form.z, np.ascontiguousarray(form.regressor[:, columns]), form.rate
        )
        estimate = recursive_least_squares(
            part,
            prior_spread=prior_spread,
            memory_s=memory_s,
            lowest_trace=limits[0],
            highest_trace=limits[1],
        )
        fits[name] = _recursive_fit(part, estimate, columns)
        excited[name] = excitation(part.t_s, part.regressor)
    return fits, excited


def _with_lag(data: ChannelRun, lag_s: float) -> ChannelRun:
    run = lagged(data.run, lag_s, from_rest=_from_rest(data))
    grid = data.run.grid_s
    return replace(
        data,
        run=run,
        velocity=np.interp(run.grid_s, grid, data.velocity),
        samples=np.searchsorted(run.grid_s, grid[data.samples]),
    )


def _from_rest(data: ChannelRun) -> bool:
    """Return whether the run starts at rest, where no thrust can act yet."""
    return bool(abs(data.velocity[0]) <= data.noise)


def _lag(data: ChannelRun, fit: ChannelFit) -> Lag | None:
    if not (data.lag and fit.resolved):
        return None
    model, nuisance = _model(BOTH, data), _nuisance(data)
    first = fit.fit.parameters

    def cost(lag_s: float) -> float:
        run = data.run if lag_s == 0.0 else lagged(data.run, lag_s, from_rest=_from_rest(data))
        result = fit_output_error(run, model, first, start=fit.fit.start, nuisance=nuisance)
        return float(
            np.sum(np.square(result.rate_error if run.rate.size else result.position_error))
        )

    return find_lag(cost, data.run.rate.size or data.run.position.size)


def _nuisance(data: ChannelRun) -> Nuisance:
    run = data.run
    return Nuisance(
        rate_bias=data.rate_bias and bool(run.rate.size),
        start_position=bool(run.position.size) or data.restoring != 0.0,
    )


def unexcited(data: ChannelRun) -> str:
    """Return why a run excites nothing, or an empty text.

    Nothing drove the channel, or it hardly moved.
    """
    if not (np.any(data.run.force_left != 0.0) or np.any(data.run.force_right != 0.0)):
        return "nothing drove it"
    moved = float(np.sqrt(np.mean(data.velocity[data.samples] ** 2)))
    return f"its velocity stayed at {moved:.2g} (RMS)" if moved <= data.noise else ""


def _columns(name: str, data: ChannelRun) -> list[int]:
    """Return the columns of [x, x|x|, F, 1] that a damping model has."""
    linear, quadratic = DAMPING[name]
    return [index for index, has in enumerate((linear, quadratic, True, data.constant)) if has]


def _static(data: ChannelRun, rate: float) -> StaticRegression:
    from scipy.integrate import cumulative_trapezoid

    run, x = data.run, data.velocity
    angle = (
        np.interp(run.grid_s, run.grid_s[run.position_at], run.position)
        if run.position.size
        else cumulative_trapezoid(x, run.grid_s, initial=0.0)
    )
    pull = data.restoring * np.sin(angle)
    force = np.append(run.force_left, run.force_right[-1]) - pull
    after = np.full((run.grid_s.size - 1, 4), np.nan)
    if np.array_equal(run.force_left, run.force_right) and data.restoring == 0.0:
        after[:, 2] = run.force_left
    columns = np.column_stack([x, x * np.abs(x), force, np.ones_like(x)])
    samples = data.samples[data.samples > 0]
    return static_form(run.grid_s, x, columns, rate=rate, regressor_after=after, samples=samples)


def _recursive_fit(
    form: StaticRegression, estimate: RecursiveEstimate, columns: list[int]
) -> RecursiveFit:
    """Return M, D_1, D_2, C over time from Theta = [D_1, D_2, 1, C] / M.

    Their standard errors follow by the delta method with the correlation of the end.
    """
    # `place`: where x, x|x|, F and 1 stand in this model's Theta.
    theta, place = estimate.theta, {column: index for index, column in enumerate(columns)}
    drive = place[2]
    with np.errstate(divide="ignore", invalid="ignore"):
        mass = np.where(theta[:, drive] != 0.0, 1.0 / theta[:, drive], np.nan)
    values = np.zeros((len(theta), 4))
    values[:, 0] = mass
    for target, column in ((1, 0), (2, 1), (3, 3)):
        if column in place:
            values[:, target] = theta[:, place[column]] * mass
    # Standard errors of Theta over time: white noise of the size of the errors so far,
    # times how much wider the colour of the residual makes them at the end.
    n, k = form.regressor.shape
    sigma2 = np.cumsum(estimate.error**2) / np.maximum(np.arange(1, n + 1) - k, 1)
    step = float(np.median(np.diff(form.t_s)))
    bread = np.linalg.pinv(form.regressor.T @ form.regressor, hermitian=True)
    coloured = np.diag(stationary_covariance([form.regressor], [estimate.residual], bread))
    white = np.diag(bread) * float(estimate.residual @ estimate.residual) / max(n - k, 1)
    colour = np.sqrt(np.where(white > 0, coloured / np.where(white > 0, white, 1.0), 1.0))
    size = np.sqrt(sigma2[:, None] * step * estimate.spread) * colour
    # M = 1 / theta_F and D = theta_D / theta_F: dM = -M^2 d theta_F,
    # dD = M d theta_D - D M d theta_F.
    correlation = estimate.gamma / np.sqrt(
        np.outer(np.diag(estimate.gamma), np.diag(estimate.gamma))
    )
    spread = np.zeros((n, 4))
    spread[:, 0] = size[:, drive] * mass**2
    for target, column in ((1, 0), (2, 1), (3, 3)):
        if column in place:
            one, both = size[:, place[column]] * mass, values[:, target] * mass * size[:, drive]
            cross = 2.0 * correlation[place[column], drive] * one * both
            spread[:, target] = np.sqrt(np.maximum(one**2 + both**2 - cross, 0.0))
    return RecursiveFit(estimate, values, spread)


def _model(name: str, data: ChannelRun, mass: float | None = None) -> Model:
    """Return the map from parameters to coefficients and their derivatives.

    Parameters are log M, then D_1, D_2, C where the damping model has them. mass: M is
    held at this value and is no parameter.
    """
    targets = [{0: 0, 1: 1, 3: 4}[column] for column in _columns(name, data) if column != 2]

    def of(p: Array) -> tuple[Array, Array]:
        inverse = float(np.exp(-p[0])) if mass is None else 1.0 / mass
        coefficients, by = np.zeros(5), np.zeros((5, len(p)))
        coefficients[2], coefficients[3] = inverse, -data.restoring * inverse
        for index, target in enumerate(targets, start=1 if mass is None else 0):
            coefficients[target] = p[index] * inverse
            by[target, index] = inverse
        if mass is None:
            by[:, 0] = -coefficients
        return coefficients, by

    return of


def _output_error(data: ChannelRun, name: str, first: Array, end_s: float) -> ChannelFit:
    used = [0, *({0: 1, 1: 2, 3: 3}[column] for column in _columns(name, data) if column != 2)]
    guesses = [first[used]] if np.all(np.isfinite(first)) and first[0] > 0 else []
    if not guesses or not data.run.rate.size:  # a slope of positions starts the regression badly
        guesses.append(_steady_guess(data, used))
    model = _model(name, data)
    run = data.run
    nuisance = _nuisance(data)
    start = np.array([data.velocity[0], run.position[0] if run.position.size else 0.0])
    tried = [
        fit_output_error(
            run,
            model,
            np.concatenate([[np.log(guess[0])], guess[1:]]),
            start=start,
            nuisance=nuisance,
        )
        for guess in guesses
    ]
    fitted = min(
        tried, key=lambda item: float(np.sum(item.rate_error**2) + np.sum(item.position_error**2))
    )
    held_mass = _unresolved(data, fitted.coefficients)
    if held_mass is not None:
        used, model = used[1:], _model(name, data, held_mass)
        fitted = fit_output_error(
            run, model, _steady_guess(data, [0, *used])[1:], start=start, nuisance=nuisance
        )
    early = fit_output_error(
        run.until(end_s), model, fitted.parameters, start=fitted.start, nuisance=nuisance
    )
    which = 0 if run.rate.size else 1
    at, measured = (run.rate_at, run.rate) if run.rate.size else (run.position_at, run.position)
    states = simulate_run(run, early.coefficients, early.start)[which]
    error = states[at] + (early.bias[0] if run.rate.size else 0.0) - measured
    late = run.grid_s[at] > end_s
    values, covariance = np.zeros(4), np.zeros((4, 4))
    values[used], covariance[np.ix_(used, used)] = fitted.parameters, fitted.covariance
    if held_mass is None:
        values[0] = np.exp(values[0])
        covariance[0] *= values[0]
        covariance[:, 0] *= values[0]
    else:
        values[0] = held_mass
    return ChannelFit(
        values=values,
        covariance=covariance,
        rmse=float(
            np.sqrt(np.mean((fitted.rate_error if run.rate.size else fitted.position_error) ** 2))
        ),
        held_out=float(np.sqrt(np.mean(error[late] ** 2))) if late.any() else float("nan"),
        simulated=simulate_run(run, fitted.coefficients, fitted.start)[which]
        + (fitted.bias[0] if which == 0 else 0.0),
        fit=fitted,
        resolved=held_mass is None,
    )


def _steady_guess(data: ChannelRun, used: Sequence[int]) -> Array:
    """Return M, then D_1, D_2, C as used, as if every speed were a steady one.

    Force against damping; M such that a change takes five samples.
    """
    x = data.velocity[data.samples]
    force = np.append(data.run.force_left, data.run.force_right[-1])[data.samples]
    columns = np.column_stack([np.ones_like(x), x, x * np.abs(x), np.ones_like(x)])[:, used[1:]]
    drag = np.linalg.lstsq(columns, -force, rcond=None)[0]
    values = np.zeros(4)
    values[used[1:]] = drag
    slope = abs(values[1] + 2.0 * values[2] * float(np.sqrt(np.mean(x**2)))) or 1.0
    return np.concatenate(
        [[5.0 * slope * float(np.median(np.diff(data.run.grid_s[data.samples])))], drag]
    )


def _unresolved(data: ChannelRun, coefficients: Array) -> float | None:
    """Return M with a time constant of half a sample for too fast a fit, or None.

    Faster than one sample the data do not determine M: a steady run. The time constant
    is that of small changes about the RMS speed, 1 / (c0 + 2 c1 |x|).
    """
    interval = float(np.median(np.diff(data.run.grid_s[data.samples])))
    speed = float(np.sqrt(np.mean(data.velocity[data.samples] ** 2)))
    decay = -(coefficients[0] + 2.0 * coefficients[1] * speed)
    return None if decay * interval < 1.0 else float(0.5 * decay * interval / coefficients[2])
