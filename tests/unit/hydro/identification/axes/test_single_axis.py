"""One axis: known truth, an oracle of another origin, refusals, what is said."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import replace
from typing import cast

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array
from auvid.hydro.identification.axes import single_axis
from auvid.hydro.identification.axes.drive import ForceDrive
from auvid.hydro.identification.axes.judgement import (
    AxisVerdict,
    InertiaPrior,
    hull_words,
    with_unseen_moment,
)
from auvid.hydro.identification.axes.pooled_fit import Loss, fit_pool, make_pool, wider
from auvid.hydro.identification.axes.quantities import Scale
from auvid.hydro.identification.axes.record import (
    AxisRecord,
    LeftOut,
    climb,
    hull_inputs,
    without_climb,
)
from auvid.hydro.identification.axes.single_axis import fit_axis, refusal, speed_share, surge_input
from auvid.hydro.identification.axes.structure import Structure, axis_terms
from auvid.hydro.identification.axes.windows import windows_of
from auvid.hydro.identification.regression.standard_errors import widened_by
from auvid.hydro.identification.regression.verdicts import IDENTIFIED, WEAK
from tests.support.axis_legs import axis_leg, scaled_force

YAW = {"r": (-1.0, -0.8, 3.0, 0.03)}
HEAVE = {"w": (-0.6, -2.0, 1.5, -0.05)}


def simulated_by_scipy(leg: AxisRecord, axis: str, p: Array) -> Array:
    """Return x and its integral (2, m, n), a run per column of p (6, m): DOP853, lag a state.

    p: a, b, c, d, x(0), s(0). The force is linear between nodes; each call ends where its
    slope changes, so that what it integrates is smooth.
    """
    a, b, c, d = p[:4]
    t, force = leg.t_s, leg.force[axis]
    bends = np.flatnonzero(np.abs(np.diff(force, 2)) > 0.0) + 1
    y, out = np.vstack([p[4:], np.full((1, p.shape[1]), force[0])]).ravel(), []
    for first, end in itertools.pairwise([0, *bends.tolist(), len(t) - 1]):
        slope = (force[end] - force[first]) / (t[end] - t[first])

        def rate(at: float, y: Array, first: int = first, slope: float = slope) -> Array:
            x, _, late = y.reshape(3, -1)
            command = force[first] + slope * (at - t[first])
            return np.concatenate(
                [a * x + b * x * np.abs(x) + c * late + d, x, (command - late) / 0.08]
            )

        run = solve_ivp(
            rate, (t[first], t[end]), y, method="DOP853", t_eval=t[first : end + 1],
            rtol=1e-8, atol=1e-10,
        )  # fmt: skip
        y = run.y[:, -1]
        out.append(run.y[:, : None if end == len(t) - 1 else -1])
    return np.hstack(out).reshape(3, p.shape[1], -1)[:2]


@pytest.mark.parametrize(
    ("seconds", "truth", "by_depth", "loss"),
    [
        (4.0, YAW["r"], False, "squares"), (6.0, (-1.0, 0.3, 3.0, 0.03), False, "soft_l1"),
        (6.0, HEAVE["w"], True, "soft_l1"),
        *(pytest.param(*case, marks=pytest.mark.release) for case in (
            (6.0, YAW["r"], False, "squares"), (8.0, YAW["r"], False, "squares"),
            (4.0, YAW["r"], False, "soft_l1"), (8.0, YAW["r"], False, "soft_l1"),
            (8.0, HEAVE["w"], True, "soft_l1"),
        )),
    ],
)  # fmt: skip
def test_pooled_fit_equals_scipy(
    seconds: float, truth: tuple[float, float, float, float], by_depth: bool, loss: Loss
) -> None:
    """One window, no prior: least_squares over solve_ivp, derivatives by differences.

    Damping that the truth has above 0 ends at its bound in both.
    """
    velocity, axis = ("w", "Z") if by_depth else ("r", "N")
    leg = axis_leg(1, {velocity: truth}, seconds=seconds, by_depth=by_depth)
    pool = make_pool(
        Structure((velocity,), axis_terms(axis, inputs=(axis,)), (axis,)),
        [leg], windows_of([leg], (velocity,)), constant_sd=np.zeros(1),
        drive=ForceDrive(0.08), loss=loss,
    )  # fmt: skip
    fit = fit_pool(pool, np.array([-0.5, -0.5, 2.0, 0.0]))
    assert fit.windows == 1
    channel = int(by_depth)
    sigma, measured = fit.sigma[channel], leg.depth_m if by_depth else leg.rate[velocity]
    # A rate does not see where its integral starts.
    count = 6 if by_depth else 5

    def errors(p: Array) -> Array:
        every = np.vstack([p, np.zeros((6 - count, p.shape[1]))])
        return np.asarray(simulated_by_scipy(leg, axis, every)[channel] - measured) / sigma

    def jacobian(p: Array) -> Array:
        ends = errors(p[:, None] + 1e-4 * np.hstack([np.eye(count), -np.eye(count)]))
        return np.asarray(ends[:count] - ends[count:]).T / 2e-4

    start = np.array([*truth, 0.0, 5.0])[:count]
    start[:2] -= 0.5
    oracle = least_squares(
        lambda p: errors(p[:, None])[0], start, jac=jacobian, x_scale="jac",
        bounds=(-np.inf, np.array([0.0, 0.0, *(count - 2) * [np.inf]])),
        loss="linear" if loss == "squares" else "soft_l1", xtol=1e-8, ftol=1e-8, gtol=1e-8,
    )  # fmt: skip
    # Our unknowns in the cost of the other; both stop where steps change no conclusion.
    squares = errors(np.concatenate([fit.values, fit.local[0, :2]])[:count, None])[0] ** 2
    cost = float(np.sum(0.5 * squares if loss == "squares" else np.sqrt(1.0 + squares) - 1.0))
    assert cost == pytest.approx(oracle.cost, abs=1e-3)
    free = np.flatnonzero(~fit.at_bound)
    assert oracle.x[:4] == pytest.approx(np.where(fit.at_bound, 0.0, oracle.x[:4]), abs=1e-6)
    # The least_squares Jacobian has the curvature of the loss, as our information has.
    columns = np.append(free, np.arange(4, count))
    curvature = np.linalg.inv(oracle.jac[:, columns].T @ oracle.jac[:, columns])[
        : free.size, : free.size
    ]
    covariance = fit.colour[channel] * curvature
    spread = np.sqrt(np.diag(covariance))
    assert np.all(np.abs(fit.values - oracle.x[:4])[free] < 0.02 * spread)
    assert fit.information[np.ix_(free, free)] / np.outer(spread, spread) == pytest.approx(
        covariance / np.outer(spread, spread), abs=0.01
    )


def test_truth_comes_back_from_gyro_and_from_depth() -> None:
    yaw = fit_axis([axis_leg(2, YAW), axis_leg(3, YAW)], "N")
    assert yaw.values[:3] == pytest.approx(YAW["r"][:3], rel=0.02)
    assert {item.word for item in yaw.verdicts.values()} == {"identified"}
    assert all(part.percent["r"] > 90.0 for part in yaw.held_out)
    assert [part.what for part in yaw.held_out[2:]] == ["leg 0", "leg 1"]
    heave = fit_axis([axis_leg(4, HEAVE, by_depth=True)], "Z", try_lag=False)
    assert heave.values[2] == pytest.approx(1.5, rel=0.03)
    assert all(part.percent["w"] > 85.0 for part in heave.held_out)


def test_a_longer_lag_is_determined_and_a_short_one_near_what_the_motion_tells() -> None:
    late = fit_axis([axis_leg(5, YAW, lag_s=0.4)], "N")
    assert late.lag.determined
    assert late.lag.value_s == pytest.approx(0.4, abs=4.0 * late.lag.standard_error + 0.01)
    usual = fit_axis([axis_leg(5, YAW)], "N")
    assert not usual.lag.determined
    assert usual.lag.by_motion_s is not None
    assert usual.lag.value_s == pytest.approx(0.08, abs=0.002)
    assert any("lag hardly determined: 0.08 s" in note for note in usual.notes)


def test_commands_give_no_newtons_before_a_pull_or_a_mass() -> None:
    legs = [axis_leg(6, YAW, normalised=True)]
    fit = fit_axis(legs, "N", try_lag=False)
    with pytest.raises(DataError, match="no newtons"):
        fit.physical()
    names = {item.name: item for item in fit.without_newtons()}
    assert all("N*m" not in item.unit and "kg" not in item.unit for item in names.values())
    assert names["time constant from rest"].value == pytest.approx(1.0, rel=0.05)
    steady = (-1.0 + np.sqrt(1.0 + 4 * 0.8 * 3.0)) / 1.6
    assert names["steady speed of full command"].value == pytest.approx(steady, rel=0.02)
    # A pull of 6 N m with 5 %: the inertia is 6 / 3 kg m^2, and its error mostly that of the pull.
    pulled = {item.name: item for item in fit.physical(Scale(pull_N=6.0, standard_error=0.3))}
    newtons = fit_axis([replace(scaled_force(legs[0], 6.0), normalised=False)], "N", try_lag=False)
    direct = {item.name: item for item in newtons.physical()}
    for name in ("M", "N_r", "N_r|r|", "N constant"):
        assert pulled[name].value == pytest.approx(direct[name].value, rel=0.01)
        assert pulled[name].standard_error >= 0.0499 * abs(pulled[name].value)
    weighed = {item.name: item for item in fit.physical(Scale(mass=2.0))}
    assert weighed["full command"].value == pytest.approx(6.0, rel=0.02)


def test_roll_surge_and_empty_windows_are_refused_with_the_reason() -> None:
    leg = axis_leg(7, YAW)
    moving = replace(leg, rate={**leg.rate, "p": 0.2 * np.sin(leg.t_s)})
    driven = replace(moving, force={**leg.force, "K": np.sin(3.0 * leg.t_s) + 2.0})
    assert refusal([leg], "N") == ""
    assert "not observable" in refusal([leg], "X")
    assert "free decay" in refusal([driven], "K")
    assert refusal([moving], "K") == ""
    idle = replace(leg, force={**leg.force, "N": np.zeros(len(leg.t_s))})
    assert "nothing drives it" in refusal([idle], "N")
    reason = LeftOut("N", 0.0, 120.0, "never armed")
    empty = replace(leg, windows={}, left_out=(reason,))
    with pytest.raises(DataError, match="never armed"):
        fit_axis([empty], "N")


def test_dives_that_differ_and_a_tether_are_said() -> None:
    other = {"r": (-3.0, -0.8, 3.0, 0.03)}
    fit = fit_axis([axis_leg(8, YAW), axis_leg(9, other)], "N", try_lag=False)
    drag = next(item for item in fit.legs if item.quantity.startswith("drag"))
    assert drag.differ
    assert drag.ratio > 1.5
    assert any("legs differ in drag" in note for note in fit.notes)
    # Drag back four times that ahead: two legs of one sign each make one dive.
    up = axis_leg(10, {"r": (-1.0, 0.0, 3.0, 0.8)}, seconds=60.0)
    down = axis_leg(11, {"r": (-4.0, 0.0, 3.0, -0.8)}, seconds=60.0)
    up, down = (replace(leg, force={**leg.force, "N": leg.force["N"] + sign * 0.8 / 3.0})
                for leg, sign in ((up, 1.0), (down, -1.0)))  # fmt: skip
    pulled = fit_axis([up, down], "N", try_lag=False)
    assert pulled.sides is not None
    assert pulled.sides.differ
    assert any("tether" in note for note in pulled.notes)


def test_an_absurd_inertia_is_not_determined_and_a_given_one_is_kept() -> None:
    leg = axis_leg(12, HEAVE, by_depth=True)
    kept = fit_axis([leg], "Z", inertia=InertiaPrior(1.0 / 1.5), try_lag=False)
    assert kept.inertia.word == "given"
    assert kept.values[2] == pytest.approx(1.5)
    assert kept.verdicts["Z force"].word == "from the prior"
    absurd = fit_axis([leg], "Z", inertia=InertiaPrior(10.0 / 1.5, 50.0), try_lag=False)
    assert absurd.inertia.word == "not determined"


def test_bent_commands_come_back_and_straight_ones_stay_straight() -> None:
    """Thrust goes with about the square of the pulse, beyond a dead band."""
    straight = axis_leg(7, YAW, normalised=True)
    force = straight.force["N"]
    size = (1.0 - 0.08) * np.abs(force) ** (1.0 / 1.7) + 0.08 * (force != 0.0)
    bent = replace(straight, force={**straight.force, "N": np.sign(force) * size})
    fit = fit_axis([bent], "N", try_lag=False, try_shape=True)
    assert fit.shape.word == "identified"
    assert fit.shape.dead_band == pytest.approx(0.08, abs=0.01)
    assert fit.shape.curve == pytest.approx(1.7, rel=0.02)
    a, b, c, _ = YAW["r"]
    assert fit.values[2] == pytest.approx(c, rel=0.02)
    assert fit.values[0] + fit.values[1] * fit.speed == pytest.approx(a + b * fit.speed, rel=0.02)
    for other in (fit_axis([bent], "N", try_lag=False), fit_axis([straight], "N", try_shape=True)):
        assert abs(other.shape.curve - 1.0) < 0.05
    assert min(part.percent["r"] for part in fit.held_out) > 90.0


def test_a_curve_of_commands_that_is_not_taken_is_in_the_intervals(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A straight line through bent commands has too little force, and says by how much at most."""
    monkeypatch.setattr(single_axis, "errs_less", lambda tried, blocks: False)
    straight = axis_leg(7, YAW, normalised=True)
    force = straight.force["N"]
    bent = replace(straight, force={**straight.force, "N": np.sign(force) * np.abs(force) ** 0.7})
    sure, doubting = (fit_axis([bent], "N", try_lag=False, try_shape=by) for by in (False, True))
    off = [
        abs(fit.values[2] - YAW["r"][2]) / (fit.width * fit.covariance[2, 2] ** 0.5)
        for fit in (sure, doubting)
    ]
    assert doubting.shape.word == "assumed"
    assert off[1] < 1.0 < off[0]


def test_a_mass_that_is_off_is_said_and_does_not_spoil_the_motion() -> None:
    """The vehicle file has .4 of the true mass: held, it costs the fit; a prior does not."""
    leg = scaled_force(axis_leg(6, HEAVE, by_depth=True), 20.0)
    fixed, free = (
        fit_axis([leg], "Z", inertia=InertiaPrior(0.4 * 20.0 / 1.5, sd), try_lag=False)
        for sd in (0.0, 0.3)
    )
    least = [min(part.percent["w"] for part in fit.held_out) for fit in (fixed, free)]
    assert least[1] > least[0] + 2.0
    assert free.inertia.value == pytest.approx(20.0 / 1.5, rel=0.1)
    assert any("2.5 times that of the vehicle file" in words for words in free.notes)
    assert not any("vehicle file" in words for words in fixed.notes)


def test_a_snag_hardly_moves_the_fit() -> None:
    """Force without motion for a tenth of the dive."""
    leg = axis_leg(13, YAW, seconds=200.0)
    rate = leg.rate["r"].copy()
    rate[3600:] = 0.0
    snagged = replace(leg, rate={**leg.rate, "r": rate})
    robust = fit_axis([snagged], "N", try_lag=False).values[2]
    squares = fit_axis([snagged], "N", try_lag=False, loss="squares").values[2]
    assert abs(robust - 3.0) < 0.5 * abs(squares - 3.0)
    assert robust == pytest.approx(3.0, rel=0.05)


def test_one_window_is_no_fit() -> None:
    """Nothing judges it, and intervals by how windows differ would have no width."""
    assert "one window only" in refusal([axis_leg(2, YAW, seconds=10.0)], "N")
    assert not refusal([axis_leg(2, YAW, seconds=20.0)], "N")


def test_pitch_that_thrust_ahead_swings_is_no_free_decay() -> None:
    leg = axis_leg(1, {"u": (-1.0, -1.0, 2.0, 0.0)}, hold_s=3.0)
    swing = 0.3 * np.sin(2.0 * leg.t_s)
    moment = np.where(leg.t_s < 5.0, 0.2, 0.0)
    swung = replace(leg, rate={**leg.rate, "q": swing}, force={**leg.force, "M": moment})
    assert "free decay" in refusal([swung], "M")
    at_rest = replace(swung, force={**swung.force, "X": np.zeros(len(swing))})
    assert refusal([at_rest], "M") == ""


def test_depth_of_two_samples_a_second_is_fitted() -> None:
    leg = axis_leg(4, HEAVE, by_depth=True, step_s=0.5, seconds=240.0, hold_s=4.0)
    fit = fit_axis([leg], "Z", try_lag=False)
    assert fit.held_out[0].percent["w"] > 70.0


HULL_INERTIA = np.array([20.0, 32.0, 30.0, 0.4, 0.4, 0.5])
NEWTONS = {"X": 40.0, "Y": 40.0, "N": 2.5}
"""Of a force of 1, so that c of each axis of `UNDER_WAY` is 1 / m."""
UNDER_WAY = {"u": (-0.6, -3.5, 2.0, 0.0), "v": (-0.5, -4.5, 1.25, 0.0), "r": (-1.5, -1.0, 5.0, 0.0)}


def under_way(
    axes: Mapping[str, tuple[float, ...]] = UNDER_WAY,
    *,
    seeds: tuple[int, ...] = (1, 2),
    normalised: bool = False,
    lag_s: float = 0.08,
) -> list[AxisRecord]:
    """Return legs that turn while they move ahead and aside, by the gyro alone."""
    legs, nothing = [], np.full(450, np.nan)
    for seed in seeds:
        leg = axis_leg(seed, axes, seconds=45.0, step_s=0.1, inertia=HULL_INERTIA, lag_s=lag_s)
        force = {axis: NEWTONS.get(axis, 0.0) * own for axis, own in leg.force.items()}
        rate = {**leg.rate, "u": nothing, "v": nothing}
        legs.append(replace(leg, force=force, rate=rate, normalised=normalised))
    return legs


def test_a_hull_whose_speeds_nobody_measures_is_no_inertia_of_yaw() -> None:
    """Its moment (m_1 - m_2) u v counts as inertia: 7 % without the term, here 3."""
    drive = ForceDrive(lag_s=0.08)
    legs = under_way()
    plain = fit_axis(legs, "N", drive=drive, try_lag=False)
    with_hull = fit_axis(legs, "N", drive=drive, try_lag=False, hull=HULL_INERTIA)
    off = [abs(fit.inertia.value / HULL_INERTIA[5] - 1.0) for fit in (plain, with_hull)]
    assert off[1] < 0.04 < 0.06 < off[0], off
    for part in with_hull.held_out[:2]:
        assert part.with_moment["r"] > part.percent["r"] + 5.0
    first, second = (round(part.with_moment["r"]) for part in with_hull.held_out[:2])
    assert any("Munk" in n and f"to {first} and {second} %" in n for n in with_hull.notes)
    assert plain.held_out[0].with_moment == {}


def test_a_hull_that_drifts_aside_turns_itself_and_that_is_no_damping() -> None:
    """N_v v with N_v = -2 N s: by speeds that forces give, 1.3 times too fast."""
    legs = []
    for seed in (1, 2):
        leg = axis_leg(seed, UNDER_WAY, seconds=30.0, step_s=0.1)
        force = {axis: NEWTONS.get(axis, 0.0) * own for axis, own in leg.force.items()}
        moment = -2.0 * leg.rate["v"]  # the hull's part of what turned it; thrusters gave the rest
        force["N"] = force["N"] - moment
        nothing = np.full(leg.t_s.size, np.nan)
        legs.append(replace(leg, force=force, rate={**leg.rate, "u": nothing, "v": nothing}))
    fits = [
        fit_axis(legs, "N", drive=ForceDrive(lag_s=0.08), try_lag=False, hull=hull)
        for hull in (None, HULL_INERTIA)
    ]
    speed, (a, b, _, _) = 0.5, UNDER_WAY["r"]
    truth = HULL_INERTIA[5] * (a + b * speed)
    off = [abs((f.values[0] + f.values[1] * speed) / f.values[2] / truth - 1.0) for f in fits]
    assert off[1] < 0.05 < 0.1 < off[0], off


def test_the_drag_of_a_hull_whose_speeds_nobody_measures_is_sought_by_its_turning() -> None:
    """By three times that drag, which is assumed, yaw drag was 38 % too large; here 5.

    Its interval holds the truth: how well the drag ahead and aside is told is in it.
    """
    slippery = {**UNDER_WAY, "u": (-0.2, -1.0, 2.0, 0.0), "v": (-0.2, -1.0, 1.25, 0.0)}
    fit = fit_axis(
        under_way(slippery, seeds=(14, 15)),
        "N",
        drive=ForceDrive(lag_s=0.08),
        try_lag=False,
        hull=HULL_INERTIA,
    )
    speed, (a, b, _, _) = 0.5, UNDER_WAY["r"]
    drag = (fit.values[0] + fit.values[1] * speed) / fit.values[2]
    assert drag == pytest.approx(HULL_INERTIA[5] * (a + b * speed), rel=0.06)
    slope = np.array([1.0, speed, -drag]) / fit.values[2]
    error = fit.width * float(np.sqrt(slope @ fit.covariance[:3, :3] @ slope))
    assert abs(drag - HULL_INERTIA[5] * (a + b * speed)) < error


def test_one_lag_moves_yaw_and_the_speeds_that_turn_its_hull() -> None:
    """With speeds of the assumed lag it came out as .12 of .15 s, and inertia 13 % too large."""
    fit = fit_axis(under_way(lag_s=0.15), "N", hull=HULL_INERTIA, drive=ForceDrive(lag_s=0.05))
    assert fit.lag.value_s == pytest.approx(0.15, abs=0.02)
    assert fit.inertia.value == pytest.approx(HULL_INERTIA[5], rel=0.05)
    assert fit.inertia.low < HULL_INERTIA[5] < fit.inertia.high


def test_a_pause_of_the_outputs_does_not_end_the_speeds_that_forces_give() -> None:
    t_s = np.arange(0.0, 10.0, 0.1)
    force = np.where((t_s > 2.0) & (t_s < 3.0), np.nan, 20.0)
    record = AxisRecord(
        t_s, {"r": np.full(t_s.size, 0.3)}, None, np.zeros((t_s.size, 3)),
        {"X": force, "Y": 0.0 * t_s}, False, {}, (), {},
    )  # fmt: skip
    hull = hull_inputs(record, "r", np.array([20.0, 30.0, 40.0, 1.0, 1.0, 1.0]))
    assert all(np.isfinite(column).all() for column in hull.values())
    assert np.isfinite(surge_input(record)).all()


def test_commands_without_a_velocity_say_what_counts_as_inertia() -> None:
    assert "tens of percent" in hull_words("r", under_way(normalised=True), None)[0]
    assert not hull_words("r", [axis_leg(1, YAW, seconds=10.0)], None)
    drag = {"N r": AxisVerdict(IDENTIFIED), "N F": AxisVerdict(IDENTIFIED)}
    weak = with_unseen_moment(drag, under_way(normalised=True))
    assert [item.word for item in weak.values()] == [WEAK, IDENTIFIED]
    turns_on_the_spot = [axis_leg(1, YAW, seconds=10.0, normalised=True)]
    assert with_unseen_moment(drag, turns_on_the_spot) == drag


def tilted(seed: int) -> AxisRecord:
    """Return a leg that pitches and heaves under way, with its depth and no speed.

    Its drag ahead is twice the one that its unmeasured speed is taken from.
    """
    rng, n, step, parts = np.random.default_rng(seed), 600, 0.1, 5
    t_s = step * np.arange(n)
    m_1, m_3 = HULL_INERTIA[[0, 2]].tolist()
    force = {axis: np.zeros(n) for axis in "XYZKMN"}
    force["X"] = np.repeat(rng.uniform(-60.0, 60.0, n // 30), 30)
    force["Z"] = np.repeat(rng.uniform(-30.0, 30.0, n // 20), 20)
    theta, q = 0.2 * np.sin(0.7 * t_s), 0.14 * np.cos(0.7 * t_s)
    u = w = z = ahead = down = 0.0
    speed, depth = [], []
    for k, (x_N, z_N) in enumerate(zip(force["X"].tolist(), force["Z"].tolist(), strict=True)):
        speed.append(u)
        depth.append(z)
        sine, rate, h = float(np.sin(theta[k])), float(q[k]), step / parts
        for _ in range(parts):
            ahead += h / 0.08 * (x_N - ahead)
            down += h / 0.08 * (z_N - down)
            z += h * (w * (1.0 - sine**2) ** 0.5 - u * sine)
            w += h * (down / m_3 - 0.6 * w - 3.0 * w * abs(w) + m_1 / m_3 * u * rate)
            u += h * (ahead / m_1 - 1.0 * u - 6.0 * u * abs(u))
    nothing, still = np.full(n, np.nan), np.zeros(n)
    rate = {"u": nothing, "v": nothing, "w": nothing, "p": still, "q": q, "r": still}
    attitude = np.column_stack([still, theta, still])
    noisy = np.array(depth) + 0.004 * rng.standard_normal(n)
    every_row = {"Z": ((0, n),)}
    return AxisRecord(t_s, rate, noisy, attitude, force, False, every_row, (), {"Z": "depth"})


def test_the_climb_of_a_tilted_hull_is_no_heave() -> None:
    """As heave it made the inertia 1.6 times too large; speeds are .7 of what forces give."""
    legs = [tilted(1), tilted(2)]
    prior, drive = InertiaPrior(HULL_INERTIA[2], 0.3), ForceDrive(lag_s=0.08)
    plain = fit_axis(legs, "Z", inertia=prior, drive=drive, try_lag=False)
    share = speed_share(legs, HULL_INERTIA, lag_s=0.08)
    assert 0.6 < share < 0.8
    level = [without_climb(leg, climb(leg, HULL_INERTIA), share) for leg in legs]
    fit = fit_axis(
        level, "Z", inertia=prior, hull=HULL_INERTIA, speed_share=share, drive=drive, try_lag=False
    )
    values = [plain.inertia.value, fit.inertia.value]
    assert fit.inertia.value == pytest.approx(HULL_INERTIA[2], rel=0.06), values
    assert plain.inertia.value > 1.2 * HULL_INERTIA[2], values
    assert fit.held_out[0].percent["w"] > plain.held_out[0].percent["w"] + 5.0
    assert any("climb" in note for note in fit.notes)


def test_a_coefficient_that_one_window_tells_has_the_errors_of_few() -> None:
    """Windows alike have W - 1 degrees of freedom; of one and its shadows little is known."""
    alike = [np.eye(2)] * 6
    assert wider(np.sum(alike, axis=0), alike) == pytest.approx([1.0, 1.0])
    # The second coefficient is told by the first window, all but a hundredth of each other.
    uneven = [np.diag([1.0, 1.0 if number == 0 else 0.01]) for number in range(6)]
    even, one = wider(np.sum(uneven, axis=0) + np.diag([0.0, 1.0]), uneven)
    assert even == pytest.approx(1.0)
    assert one == pytest.approx(widened_by(1) / widened_by(5), rel=0.02)
    # What no window tells, its prior alone, has no shares: all count alike.
    assert wider(np.eye(2), [np.diag([0.1, 0.0])] * 6) == pytest.approx([1.0, 1.0])


def test_what_records_rest_on_is_in_the_errors() -> None:
    """One deviation of a clock moves the estimate as a fit to such records does."""
    legs = [axis_leg(2, YAW), axis_leg(3, YAW)]
    late = np.interp(legs[0].t_s + 0.01, legs[0].t_s, legs[0].force["N"])
    other = [replace(legs[0], force={**legs[0].force, "N": late}), legs[1]]
    drive, loss = ForceDrive(lag_s=0.08), cast("Loss", "squares")
    sure, moved = (
        fit_axis(own, "N", drive=drive, try_lag=False, loss=loss) for own in (legs, other)
    )
    unsure = fit_axis(legs, "N", drive=drive, try_lag=False, loss=loss, doubtful=[other])
    assert unsure.values == pytest.approx(sure.values)
    added = np.sqrt(np.diag(unsure.covariance - sure.covariance))
    assert added == pytest.approx(np.abs(moved.values - sure.values), rel=0.1, abs=1e-4)


def test_three_windows_are_flown_in_turn_by_the_other_two() -> None:
    """One by itself fitted a window at rest, and flew the others at -1e6 %."""
    leg = axis_leg(5, YAW, seconds=30.0)
    rate, force = leg.rate["r"].copy(), leg.force["N"].copy()
    rate[200:400] = 0.005 * np.random.default_rng(1).standard_normal(200)
    force[200:400] = 0.0
    still = replace(leg, rate={**leg.rate, "r": rate}, force={**leg.force, "N": force})
    (turns,) = fit_axis([still], "N", try_lag=False).held_out
    assert (turns.what, turns.windows) == ("windows in turn", 3)
    assert turns.percent["r"] > 80.0


def test_a_lag_beside_speeds_that_nothing_measures_has_a_tenth_of_itself_for_its_error() -> None:
    """The inertia trades with it: its interval has what the lag may be off by."""
    plain = axis_leg(5, YAW, lag_s=0.4)
    pushed = replace(plain, force={**plain.force, "X": plain.force["N"]})
    measured, unmeasured = fit_axis([plain], "N"), fit_axis([pushed], "N")
    assert measured.lag.determined
    assert measured.lag.deviation_s == 0.0
    assert unmeasured.values == pytest.approx(measured.values)
    tenth = 0.1 * unmeasured.lag.value_s
    assert unmeasured.lag.deviation_s == pytest.approx(tenth)
    assert unmeasured.lag.standard_error == pytest.approx(
        np.hypot(measured.lag.standard_error, tenth)
    )
    later = fit_axis(
        [plain], "N", drive=ForceDrive(lag_s=unmeasured.lag.value_s + tenth), try_lag=False
    )
    change = later.values[2] - unmeasured.values[2]
    assert abs(change) > 3.0 * np.sqrt(measured.covariance[2, 2])
    assert unmeasured.covariance[2, 2] == pytest.approx(
        measured.covariance[2, 2] + change**2, rel=0.05
    )
    assert unmeasured.inertia.word == "determined"


def test_an_inertia_is_weak_beside_a_lag_that_is_assumed() -> None:
    leg = axis_leg(5, YAW)
    assumed, by_hand = fit_axis([leg], "N"), fit_axis([leg], "N", try_lag=False)
    assert not assumed.lag.determined
    assert (assumed.inertia.word, by_hand.inertia.word) == ("weak", "determined")
    assert any("inertia trades with it" in note for note in assumed.notes)


def test_an_assumed_lag_counts_by_its_deviation() -> None:
    leg = axis_leg(3, YAW, seconds=40.0, noise=0.3)
    fit = fit_axis([leg], "N", drive=ForceDrive(lag_s=0.05), lag_sd_s=0.07)
    assert fit.lag.by_motion_s is not None
    assert fit.lag.told_s == fit.lag.by_motion_s
    by_motion, error = fit.lag.by_motion_s
    lag_s = (by_motion / error**2 + 0.05 / 0.07**2) / (error**-2 + 0.07**-2)
    assert fit.lag.value_s == pytest.approx(lag_s)
    sure = fit_axis([leg], "N", drive=ForceDrive(lag_s=0.05), lag_sd_s=0.01)
    assert sure.lag.value_s == pytest.approx(0.05, abs=0.003)
    assert sure.lag.deviation_s < 0.02


def test_a_lag_that_is_hardly_told_lies_between_and_widens_the_inertia() -> None:
    """By their weights between the assumed one and the motion's; its deviation counts."""
    leg = axis_leg(3, YAW, seconds=40.0, noise=0.3)
    assumed = fit_axis([leg], "N", drive=ForceDrive(lag_s=0.05))
    assert assumed.lag.by_motion_s is not None
    by_motion, error = assumed.lag.by_motion_s
    lag_s = (by_motion / error**2 + 0.05 / 0.1**2) / (error**-2 + 0.1**-2)
    assert assumed.lag.value_s == pytest.approx(lag_s)
    assert abs(by_motion - 0.08) < 2.0 * error
    lag_sd_s = assumed.lag.deviation_s
    assert lag_sd_s == pytest.approx(np.hypot((error**-2 + 0.1**-2) ** -0.5, 0.1 * lag_s))
    fixed, later = (
        fit_axis([leg], "N", drive=ForceDrive(lag_s=lag), try_lag=False)
        for lag in (lag_s, lag_s + 0.05)
    )
    assert not assumed.lag.determined
    assert assumed.values == pytest.approx(fixed.values, rel=0.01)
    change = lag_sd_s / 0.05 * (later.values - fixed.values)
    wider = fixed.covariance + np.outer(change, change)  # nearly a straight line in the lag
    assert assumed.covariance == pytest.approx(wider, rel=0.1, abs=1e-2)
    assert wider[2, 2] > 1.2 * fixed.covariance[2, 2]
