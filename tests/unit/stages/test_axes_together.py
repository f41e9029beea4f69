"""Axes fitted together or one by one, by what is held out, and their files."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

import auvid
from auvid.data_schemas.records.models import ModelCard
from auvid.export.body import body_of
from auvid.export.source_code import partial_text
from auvid.hydro.arrays import AXES, Array
from auvid.hydro.dynamics.actuators.commands import frame_thrusters, full_commands
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.axes.coupled import fit_coupled
from auvid.hydro.identification.axes.drive import ForceDrive, acting
from auvid.hydro.identification.axes.record import ThrusterForces
from auvid.hydro.partial_model import apparent_inertia
from auvid.models import _force_of
from auvid.stages.fit_axes import coupling
from auvid.stages.fit_axes.card import lacking_axis, model_card, ranking
from auvid.stages.fit_axes.clocks import MOST_PASSES, clock_words
from auvid.stages.fit_axes.coupling import (
    filed_inertia,
    fitted_shares,
    fitted_together,
    held_out_single,
)
from auvid.stages.fit_axes.fitted import (
    DIVES_DIFFER,
    DRAG_AHEAD,
    AxisFits,
    CommandForces,
    HeldOutFit,
    Together,
)
from auvid.stages.fit_axes.fitting import fit_all, turned_round
from auvid.stages.fit_axes.flight import FitOptions, LegData
from auvid.stages.fit_axes.presentation import fit_section
from auvid.stages.fit_axes.scaling import scaled
from auvid.stages.report.summary.axes_summary import summarise_axes
from tests.support.axis_legs import axis_leg
from tests.support.axis_twin import leg
from tests.support.motions import shipped_vehicle
from tests.support.plain_model import flown_by_file
from tests.unit.stages.test_fit_axes import file_of

TRUTH = {
    "u": (-0.25, -1.2, 2.0, 0.02),
    "v": (-0.3, -1.6, 2.0, -0.02),
    "r": (-1.0, -0.8, 3.0, 0.03),
}


def body() -> Vehicle:
    return shipped_vehicle("bluerov2_heavy")


def file_inertia() -> Array:
    return np.array([apparent_inertia(body(), axis) for axis in AXES])


def legs_of(
    inertia: Array, *, coriolis: bool = True, torque: float = 3.0, seconds: float = 56.0
) -> dict[str, LegData]:
    """Return two legs that turn while they move, and a third."""
    truth = {**TRUTH, "r": (-1.0, -0.8, torque, 0.03)}
    legs = {}
    for seed, use in ((1, "training"), (2, "training"), (3, "validation")):
        moved = axis_leg(
            seed, truth, seconds=seconds, step_s=0.1, inertia=inertia if coriolis else None,
            normalised=True, idle=("r",) if seed == 2 else (),
        )  # fmt: skip
        still = np.zeros(len(moved.t_s))
        rate = {name: np.nan_to_num(values) if name in "wpq" else values
                for name, values in moved.rate.items()}  # fmt: skip
        measured = dict.fromkeys("XYN", "a pose")
        windows = {axis: ((0, len(still)),) for axis in "XYN" if seed != 2 or axis != "N"}
        record = replace(moved, rate=rate, windows=windows, measured_by=measured)
        document = leg(normalised=True, use=use, seed=seed, seconds=10.0).windows
        document = document.model_copy(update={"measured_by": measured})
        legs[f"leg_{seed}"] = LegData(record, document)
    return legs


def in_newtons(item: LegData, inertia: Array) -> LegData:
    """Return a leg whose full commands have the newtons of a body with this inertia."""
    full = {axis: 2.0 * m for axis, m in zip("XY", inertia[:2], strict=True)}
    full["N"] = 3.0 * inertia[5]
    force = {axis: full.get(axis, 0.0) * values for axis, values in item.record.force.items()}
    return LegData(
        replace(item.record, force=force, normalised=False),
        item.windows.model_copy(update={"normalised": False}),
    )


@cache
def fits(coriolis: bool, torque: float = 3.0) -> AxisFits:
    legs = legs_of(file_inertia(), coriolis=coriolis, torque=torque)
    return fit_all(legs, body(), FitOptions(lag_s=0.08, fit_lag=False))


ONE_BY_ONE = FitOptions(lag_s=0.08, fit_lag=False, together="never")
SWAY_BY_TURNING, TURN_BY_SWAY = -0.2, 1.5
"""v' has so much of r [m/s per rad], r' so much of v [rad/(m s)]: a hull longer behind."""
WITHOUT_LIFT = 0.3
"""What lift leaves of the moment of the added mass by u v."""


def coupled_motion(item: LegData, seed: int, noise_m_s: float = 0.005) -> LegData:
    """Return a leg whose forces move a hull that couples sway and yaw, by Euler's method."""
    record, m, parts = item.record, file_inertia(), 20
    step = float(record.t_s[1] - record.t_s[0])
    force = np.array([record.force[axis] for axis in "XYN"]).T.tolist()
    table = [TRUTH[name] for name in "uvr"]
    late, nu, rows = list(force[0]), [0.0, 0.0, 0.0], []
    for now in force:
        rows.append(list(nu))
        for _ in range(parts):
            h = step / parts
            late = [x + h / 0.08 * (y - x) for x, y in zip(late, now, strict=True)]
            own = [
                a * x + b * x * abs(x) + c * f + d
                for (a, b, c, d), x, f in zip(table, nu, late, strict=True)
            ]
            u, v, r = nu
            own[0] += m[1] / m[0] * v * r
            own[1] += -m[0] / m[1] * u * r + SWAY_BY_TURNING * r
            own[2] += WITHOUT_LIFT * (m[0] - m[1]) / m[5] * u * v + TURN_BY_SWAY * v
            nu = [x + h * change for x, change in zip(nu, own, strict=True)]
    noise = noise_m_s * np.random.default_rng(seed).standard_normal((len(rows), 3))
    rate = {**record.rate, **dict(zip("uvr", (np.array(rows) + noise).T, strict=True))}
    return LegData(replace(record, rate=rate), item.windows)


def test_a_hull_that_couples_sway_and_yaw_has_the_coupling() -> None:
    legs = legs_of(file_inertia(), seconds=80.0)
    moved = {key: coupled_motion(item, seed) for seed, (key, item) in enumerate(legs.items())}
    fitted = fit_all(moved, body(), FitOptions(lag_s=0.08, fit_lag=False))
    assert fitted.together is not None
    assert fitted.together.chosen
    by_axis = {item.axis: item.equation for item in fitted.fitted}
    assert by_axis["Y"].value("r") == pytest.approx(SWAY_BY_TURNING, abs=0.05)
    assert by_axis["N"].value("v") == pytest.approx(TURN_BY_SWAY, rel=0.1)
    # Lift has a coefficient of its own: sway keeps its ratio, and nothing tells that of yaw.
    m = file_inertia()
    sway, yaw = (fitted.inertia_shares[axis] for axis in "YN")
    assert sway[0] == pytest.approx(1.0, abs=4.0 * sway[1])
    assert sway[1] < 0.05
    assert yaw[0] == pytest.approx(1.0, abs=0.01)
    assert yaw[1] > 0.3
    lift = (WITHOUT_LIFT - 1.0 / yaw[0]) * (m[0] - m[1] * sway[0]) / m[5]
    assert by_axis["N"].value("u*v") == pytest.approx(lift, rel=0.1)
    card = model_card(fitted, scaled(fitted, body(), by="pull"), (), body())
    assert "r" in {item.term for item in card.axes["Y"].terms}
    assert "u*v" in {item.term for item in card.axes["N"].terms}
    screen = summarise_axes(card, ranking(card, fitted), {}, {}, body(), {})
    assert "Nothing in these logs tells the ratio of yaw" in screen.explanation
    record = moved["leg_3"].record
    start = np.array([record.rate[name][0] for name in "uvwpqr"])
    text = auvid.Model(file_of(card, fitted, body())).file.model_dump_json()
    rows = slice(0, 60)
    flown = flown_by_file(
        text, record.t_s[rows], {axis: record.force[axis][rows] for axis in "XYN"}, start
    )
    for item in fitted.fitted:
        part = next(part for part in item.motion if part.leg == "leg_3")
        own = flown[:, "uvwpqr".index(item.equation.speed)]
        assert own == pytest.approx(part.simulated[rows], abs=1e-4)
    assert min(item.held_out_percent or 0.0 for item in fitted.fitted) > 85.0
    assert not any("r" in item.equation.names[4:] for item in fits(True).fitted)


def filed_motion_error(fitted: AxisFits, leg: LegData) -> float:
    """Return the largest difference of yaw rate, as judged and by the filed model.

    Over the first window, from its measured start.
    """
    model = auvid.Model(file_of(card_of(fitted), fitted, body()))
    item = fitted.fitted[-1]
    part = next(part for part in item.motion if part.leg == "leg_3")
    first, end = part.windows[0]
    t_s = leg.record.t_s[first:end] - leg.record.t_s[first]
    fine = np.arange(0.0, t_s[-1], 0.01)
    force = leg.record.force
    tau = np.column_stack([np.interp(fine, t_s, force[axis][first:end]) for axis in AXES])
    nu = [float(leg.record.rate[name][first]) for name in "uvwpqr"]
    motion = model.simulate(fine, tau, nu=nu)
    own = np.interp(fine, t_s, part.simulated[first:end])
    return float(np.max(np.abs(motion["r_rad_s"] - own)))


def card_of(fitted: AxisFits) -> ModelCard:
    return model_card(fitted, scaled(fitted, body(), by="pull"), [], body())


def test_a_body_with_coriolis_force_is_fitted_together() -> None:
    fitted = fits(True)
    assert fitted.together is not None
    assert fitted.together.chosen
    assert fitted.together.axes == ("X", "Y", "N")
    assert fitted.together.error_ratio < 0.8
    for item in fitted.fitted:
        assert item.equation.value("force") == pytest.approx(
            TRUTH[item.equation.speed][2], rel=0.02
        )
    yaw = fitted.fitted[-1]
    assert yaw.unused_legs == {"leg_2": "not commanded"}
    section = str(fit_section(fitted, card_of(fitted)))
    assert "Fitted together, with Coriolis force" in section
    assert "not commanded" in section
    assert all(item.whole_legs["leg_3"] > 85.0 for item in fitted.fitted)


def test_a_validation_leg_without_a_sensor_is_named() -> None:
    """The common fit needs sway and yaw on it too; an axis by itself, its own only."""
    legs = dict(legs_of(file_inertia()))
    check = legs["leg_3"]
    rate = {**check.record.rate, "v": np.full(len(check.record.t_s), np.nan)}
    windows = {axis: own for axis, own in check.record.windows.items() if axis != "Y"}
    legs["leg_3"] = replace(check, record=replace(check.record, rate=rate, windows=windows))
    fitted = fit_all(legs, body(), FitOptions(lag_s=0.08, fit_lag=False))
    surge, sway, yaw = fitted.fitted
    assert sway.unused_legs["leg_3"] == "not measured"
    assert surge.unused_legs["leg_3"] == "sway not measured, which the common fit needs"
    assert yaw.unused_legs["leg_3"] == surge.unused_legs["leg_3"]
    section = str(fit_section(fitted, card_of(fitted)))
    assert "sway not measured, which the common fit needs" in section


def test_together_and_one_by_one_are_judged_on_the_same_windows() -> None:
    """Surge is also measured where sway is not: what it flies there decides nothing."""
    legs = dict(legs_of(file_inertia()))
    one = legs["leg_1"]
    half = len(one.record.t_s) // 2
    rate = {**one.record.rate, "v": one.record.rate["v"].copy()}
    rate["v"][:half] = np.nan
    legs["leg_1"] = replace(one, record=replace(one.record, rate=rate))
    using = {key: leg for key, leg in legs.items() if leg.windows.use == "training"}
    options = FitOptions(lag_s=0.08, fit_lag=False)
    singles = fit_all(legs, body(), replace(options, together="never")).fitted
    # Legs that differ by Coriolis force are no warning where the common fit flies each.
    differing = [replace(item, warnings=(f"{DIVES_DIFFER} in drag", "other")) for item in singles]
    differing[1] = replace(differing[1], warnings=(f"Sway: {DRAG_AHEAD} 4", "other"))
    commands = CommandForces(True, {}, {})
    options = replace(options, together="always")
    joint, _ = fitted_together(differing, legs, body(), options, commands)
    assert [item.warnings for item in joint[:2]] == [("other",)] * 2  # yaw has one leg
    fit = fit_coupled(
        [leg.record for leg in using.values()], "uvr", inertia=file_inertia(), free=()
    )
    assert len(singles[0].motion[0].windows) > len([w for w in fit.pool.windows if w.leg == 0])
    by_itself = held_out_single(singles[0], fit, list(using), options)
    counts = {item.what: item.windows for item in by_itself}
    blocks = fit.held_out[:2]
    assert [counts[item.what] for item in blocks] == [item.windows for item in blocks]


def test_commands_of_a_leg_on_another_clock_are_moved_and_named() -> None:
    legs = dict(legs_of(file_inertia(), coriolis=False))
    assert (fits(False).clocks, fits(False).common_clock) == ({}, None)
    record = legs["leg_1"].record
    late = {axis: np.interp(record.t_s - 0.4, record.t_s, f) for axis, f in record.force.items()}
    legs["leg_1"] = replace(legs["leg_1"], record=replace(record, force=late))
    options = replace(ONE_BY_ONE, axes=("X",))
    fitted = fit_all(legs, body(), options)
    clock = fitted.clocks["leg_1"]
    assert clock.late_s == pytest.approx(0.4, abs=min(0.01, 4.0 * clock.error_s))
    assert fitted.fitted[0].equation.value("force") == pytest.approx(TRUTH["u"][2], rel=0.03)
    assert clock_words(fitted.clocks)[0] in str(fit_section(fitted, card_of(fitted)))
    # The error of the clock is in that of the model.
    unsure = {"leg_1": replace(clock, error_s=0.1)}
    doubtful = fit_all(legs, body(), options, clocks=unsure, passes=MOST_PASSES).fitted[0]
    assert doubtful.equation.error("force") > 1.2 * fitted.fitted[0].equation.error("force")


def test_commands_of_all_legs_on_another_clock_are_moved_and_named() -> None:
    """A free lag takes a delay for damping: quadratic was a seventh low."""
    legs = dict(legs_of(file_inertia(), coriolis=False))
    del legs["leg_2"]
    for key, item in legs.items():
        t_s = item.record.t_s
        force = {axis: np.interp(t_s + 0.3, t_s, own) for axis, own in item.record.force.items()}
        legs[key] = replace(item, record=replace(item.record, force=force))
    fitted = fit_all(legs, body(), replace(ONE_BY_ONE, axes=("X",), fit_lag=True))
    clock = fitted.common_clock
    assert clock is not None
    assert clock.late_s == pytest.approx(-0.3, abs=0.03)
    assert fitted.clocks == {}
    assert fitted.fitted[0].equation.value("u*|u|") == pytest.approx(TRUTH["u"][1], rel=0.05)
    assert clock_words({}, clock)[0] in str(fit_section(fitted, card_of(fitted)))


def test_a_pull_on_an_axis_that_does_not_join_gives_the_others_their_inertia() -> None:
    """By the layout, as in the file; by the ratios of the file where the layout is open."""
    options, vehicle = FitOptions(newtons_from="pull"), body()
    ties = {"X": 2.0, "Y": 2.0, "Z": 4.0, "N": 0.5}
    by_layout = CommandForces(True, {"Z": 100.0}, ties)
    assert filed_inertia("XYN", "XYZN", vehicle, options, by_layout) == {
        "u": (50.0, "u"),
        "v": (50.0, "v"),
        "r": (12.5, "r"),
    }
    without = CommandForces(True, {"Z": 100.0}, {})
    assert filed_inertia("XYN", "XYZN", vehicle, options, without) == {}
    assert filed_inertia("XYZ", "XYZ", vehicle, options, without)["u"][1] == "w"


def test_an_axis_that_predicts_nothing_by_itself_is_fitted_with_the_others() -> None:
    """Turned at up to 3 rad/s, Coriolis force moves it more than its thrusters do."""
    fitted = fits(True, 12.0)
    assert fitted.together is not None
    assert fitted.together.axes == ("X", "Y", "N")
    assert fitted.together.error_ratio < 0.3
    assert not fitted.lacking or {item.axis for item in fitted.lacking} == set("ZKM")
    for item in fitted.fitted[:2]:
        assert item.predicts
        assert item.equation.value("force") == pytest.approx(2.0, rel=0.03)


def test_a_coupling_counts_where_axes_that_do_not_predict_are_left_out_or_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Yaw by itself flies 10 % of what was held out, with the moment of sway as well as all."""
    legs = legs_of(file_inertia())
    lost = (HeldOutFit("even windows", 10.0, 9), HeldOutFit("odd windows", 10.0, 9))
    every = [
        item if item.axis != "N" else replace(item, held_out=lost) for item in fits(True).fitted
    ]
    ratios = {("XYN", False): 1.0, ("XYN", True): 0.7, ("XY", False): 0.9, ("XY", True): 0.9}

    def joined(group: Any, *_: Any, couplings: bool = False) -> tuple[Any, ...]:
        axes = "".join(item.axis for item in group)
        together = Together(tuple(axes), True, ratios[axes, couplings], 4 * len(axes))
        return {item.axis: item for item in group}, together, None

    monkeypatch.setattr(coupling, "_joined", joined)
    _, together = fitted_together(every, legs, body(), FitOptions(), CommandForces(True, {}, {}))
    assert together is not None
    assert (together.axes, together.error_ratio) == (("X", "Y", "N"), 0.7)


def test_a_body_without_coriolis_force_is_fitted_one_by_one() -> None:
    fitted = fits(False)
    assert fitted.together is not None
    assert not fitted.together.chosen
    assert fitted.together.error_ratio > 1.2


def test_coriolis_force_has_the_inertia_that_is_filed() -> None:
    """Yaw inertia is .4 times the file's: with the file's the munk moment is as wrong."""
    inertia = file_inertia()
    inertia[5] *= 0.4
    legs = {key: in_newtons(item, inertia) for key, item in legs_of(inertia).items()}
    fitted = fit_all(
        legs, body(), FitOptions(lag_s=0.08, fit_lag=False, given_inertia=("X", "Y", "Z"))
    )
    assert fitted.together is not None
    assert fitted.together.chosen
    yaw = fitted.fitted[-1].equation
    assert 1.0 / yaw.value("force") == pytest.approx(inertia[5], rel=0.02)
    a, b, _ = TRUTH["r"][:3]
    assert yaw.value("r") + 0.5 * yaw.value("r*|r|") == pytest.approx(a + 0.5 * b, rel=0.05)
    assert filed_motion_error(fitted, legs["leg_3"]) < 0.02


def test_commands_with_a_pull_have_the_inertia_that_is_filed() -> None:
    """The layout ties the pulls of all axes together, and with them the inertias."""
    inertia = file_inertia()
    inertia[5] *= 0.4
    full = {"X": 2.0 * inertia[0], "Y": 2.0 * inertia[1], "N": 3.0 * inertia[5]}
    legs = {
        key: LegData(
            item.record,
            item.windows.model_copy(update={"full_force": {"X": full["X"]}, "full_thrust": full}),
        )
        for key, item in legs_of(inertia).items()
    }
    fitted = fit_all(legs, body(), FitOptions(lag_s=0.08, fit_lag=False))
    assert fitted.together is not None
    assert fitted.together.chosen
    forces = scaled(fitted, body(), by="pull").forces
    assert forces["N"].inertia == pytest.approx(inertia[5], rel=0.02)
    assert fitted.fitted[-1].equation.value("force") == pytest.approx(3.0, rel=0.02)


@pytest.mark.parametrize("coriolis", [True, False])
def test_the_file_moves_as_it_was_fitted(coriolis: bool) -> None:
    """Ahead while it turns: a drift to the side, where Coriolis force acts."""
    fitted = fits(coriolis)
    card = card_of(fitted)
    model = auvid.Model(file_of(card, fitted, body()))
    time = np.arange(0.0, 20.0, 0.05)
    motion = model.simulate(time, commands={"X": 0.5, "N": 0.3})
    u, v, r = (motion[name].iloc[-1] for name in ("u_m_s", "v_m_s", "r_rad_s"))
    a, b, c, d = (fitted.fitted[1].equation.value(name)
                  for name in ("v", "v*|v|", "force", "constant"))  # fmt: skip
    ratio = apparent_inertia(body(), "X") / apparent_inertia(body(), "Y")
    turning = -ratio * u * r if coriolis else 0.0
    assert c > 0.0
    assert a * v + b * v * abs(v) + d + turning == pytest.approx(0.0, abs=2e-3)
    parts = model.force([u, v, 0.0, 0.0, 0.0, r], [0.0] * 6)
    assert bool(np.any(parts.coriolis[[0, 1, 5]])) is coriolis
    # An integrator that has the file alone flies as the fit does.
    record = legs_of(file_inertia(), coriolis=coriolis)["leg_3"].record
    rows = slice(0, 60)
    start = np.array([record.rate[name][0] for name in "uvwpqr"])
    force = {axis: record.force[axis][rows] for axis in "XYN"}
    flown = flown_by_file(model.file.model_dump_json(), record.t_s[rows], force, start)
    for item in fitted.fitted:
        part = next(part for part in item.motion if part.leg == "leg_3")
        assert part.windows[0][0] == 0
        own = flown[:, "uvwpqr".index(item.equation.speed)]
        assert own == pytest.approx(part.simulated[rows], abs=1e-4)


def test_the_file_has_the_ratio_of_inertia_that_was_fitted() -> None:
    """Yaw inertia .4 times the file's, give or take .02 of it."""
    plain = fits(True)
    assert plain.together is not None
    yaw = plain.fitted[-1]
    fitted = replace(plain, together=replace(plain.together, inertia_shares={"N": (0.4, 0.02)}))
    card = card_of(fitted)
    mass = np.array(file_of(card, fitted, body()).dynamics.mass)
    ratio = 0.4 * file_inertia()[5] / file_inertia()[0]
    assert mass[5, 5] / mass[0, 0] == pytest.approx(ratio, rel=1e-9)
    auvid.Model(file_of(card, fitted, body()))  # its dynamics follow from its vehicle
    assert card.partial is not None
    assert card.partial.inertia_shares["N"].interval_95 == pytest.approx([0.361, 0.439], abs=1e-3)
    term = card.axes["N"].terms[0]
    assert term.value == pytest.approx(yaw.equation.values[0] * ratio, rel=1e-9)
    assert term.standard_error is not None
    assert term.standard_error > 0.05 * abs(term.value)


def test_the_file_has_the_ratio_of_an_axis_that_nothing_fits() -> None:
    """Surge and yaw alone: u v turns the hull by the inertia of sway, 1.35 times the file's."""
    inertia = file_inertia()
    inertia[1] *= 1.35
    one = legs_of(inertia)["leg_1"].record
    shares = {"v": 0.3, "r": 0.3}
    fit = fit_coupled(
        [one], "ur", inertia=file_inertia(), share_sd=shares, drive=ForceDrive(0.08), free=(),
        leave_out=False,
    )  # fmt: skip
    value, error = fitted_shares(fit)["Y"]
    assert value == pytest.approx(1.35, abs=4.0 * error)
    assert error < 0.05
    at_bound = replace(fit.fit, at_bound=np.ones_like(fit.fit.at_bound))
    assert fitted_shares(replace(fit, fit=at_bound))["Y"] == (value, 0.3)
    plain = fits(True)
    assert plain.together is not None
    assert set(plain.inertia_shares) == {"Y", "N"}
    together = replace(plain.together, axes=("X", "N"), inertia_shares=fitted_shares(fit))
    fitted = replace(plain, fitted=plain.fitted[::2], together=together)
    card = card_of(fitted)
    mass = np.array(file_of(card, fitted, body()).dynamics.mass)
    in_file = file_inertia()[1] / file_inertia()[0]
    assert mass[1, 1] / mass[0, 0] == pytest.approx(value * in_file, rel=1e-9)
    words = f"sway, which is not fitted itself, {value:.2f} ("
    assert words in str(fit_section(fitted, card))
    screen = summarise_axes(card, ranking(card, fitted), {}, {}, body(), {})
    assert words in screen.explanation
    assert "lift takes part of" in screen.explanation


DEAD_BAND = 0.1


def in_the_band(item: LegData) -> LegData:
    """Return a leg whose commands give its forces beyond a dead band."""
    force = {
        axis: np.sign(own) * (np.abs(own) * (1.0 - DEAD_BAND) + DEAD_BAND)
        for axis, own in item.record.force.items()
    }
    return replace(item, record=replace(item.record, force=force))


@pytest.mark.release  # 10 s of CPU
def test_a_dead_band_is_no_drag_of_axes_together() -> None:
    """Medians of single fits, which lack Coriolis force, made drag 15 % too large."""
    legs = {key: in_the_band(item) for key, item in legs_of(file_inertia()).items()}
    fitted = fit_all(legs, body(), FitOptions(lag_s=0.08, fit_curve=True))
    assert fitted.together is not None
    assert fitted.together.chosen
    for item in fitted.fitted:
        velocity = item.equation.speed
        assert item.shape.dead_band == pytest.approx(DEAD_BAND, abs=0.01)
        assert item.shape.curve == pytest.approx(1.0, abs=0.03)
        quadratic = item.equation.value(f"{velocity}*|{velocity}|")
        assert quadratic == pytest.approx(TRUTH[velocity][1], rel=0.1)
    straight = fit_all(legs, body(), FitOptions(lag_s=0.08, fit_lag=False, together="never"))
    options = FitOptions(lag_s=0.08, fit_lag=False, fit_curve=True)
    commands = CommandForces(True, {}, {})
    joint, _ = fitted_together(straight.fitted, legs, body(), options, commands)
    for item in joint:  # no single fit shows it
        assert item.shape.dead_band == pytest.approx(DEAD_BAND, abs=0.01)


def by_thrusters(item: LegData, strength: Array) -> LegData:
    """Return a leg whose force vectored thrusters give that are as strong as stated.

    What they say they give is that force where all are sound.
    """
    frame = frame_thrusters("vectored")
    full = full_commands(frame)
    effect = frame.allocation / np.where(full > 0.0, full, 1.0)[:, None]
    level = [AXES.index(axis) for axis in "XYN"]
    total = np.array([item.record.force[axis] for axis in AXES])[level].T
    force = np.zeros((len(total), 6))
    force[:, :4] = total @ np.linalg.pinv(effect[level, :4]).T / strength
    stated = dict(zip(AXES, (force @ effect.T).T, strict=True))
    thrusters = ThrusterForces(frame.outputs, force, effect)
    return replace(item, record=replace(item.record, force=stated, thrusters=thrusters))


def test_a_thruster_at_half_strength_is_named_and_its_axes_are_flown_with_it() -> None:
    legs = legs_of(file_inertia())
    legs = {
        key: by_thrusters(legs[key], np.array([1.0, 1.0, 0.5, 1.0])) for key in ("leg_1", "leg_3")
    }
    options = FitOptions(lag_s=0.08, fit_lag=False, together="never")
    fitted = fit_all(legs, body(), options)
    on_paper = fit_all(legs, body(), options, strengths=())
    ratio = {item.output: item for item in fitted.thrusters}
    assert set(ratio) == {1, 2, 3, 4}
    for output, truth in ((1, 1.0), (2, 1.0), (3, 0.5), (4, 1.0)):
        assert ratio[output].low < truth < ratio[output].high
        assert ratio[output].value == pytest.approx(truth, abs=0.06)
    assert [output for output, item in ratio.items() if item.is_weak] == [3]
    assert ratio[3].others == (1, 2, 4)
    held_out = [{item.axis: item.held_out_percent for item in own.fitted}
                for own in (fitted, on_paper)]  # fmt: skip
    assert 100.0 - held_out[0]["N"] < 0.7 * (100.0 - held_out[1]["N"])
    card = model_card(fitted, scaled(fitted, body(), by="pull"), (), body())
    printed = str(fit_section(fitted, card))
    assert "The thruster on output 3 gives 0." in printed
    assert card.partial is not None
    assert [item.output for item in card.partial.thrusters] == [1, 2, 3, 4]


def test_thrusters_that_the_motion_does_not_tell_apart_are_as_strong_as_each_other() -> None:
    """Surge alone moves all four alike: their ratios are those of the prior."""
    one = legs_of(file_inertia())["leg_1"]
    surge = one.record.force["X"]
    still = {axis: surge if axis == "X" else np.zeros_like(surge) for axis in AXES}
    ahead = axis_leg(1, {"u": TRUTH["u"]}, seconds=56.0, step_s=0.1, normalised=True)
    record = replace(
        one.record, rate=dict.fromkeys("vwpqr", np.zeros_like(surge)) | {"u": ahead.rate["u"]},
        force=still | {"X": ahead.force["X"]}, windows={"X": one.record.windows["X"]},
    )  # fmt: skip
    measured = one.windows.model_copy(update={"measured_by": dict.fromkeys("XYZN", "a pose")})
    leg_1 = by_thrusters(replace(one, record=record, windows=measured), np.ones(4))
    fitted = fit_all({"leg_1": leg_1}, body(), FitOptions(lag_s=0.08, fit_lag=False))
    assert {item.verdict for item in fitted.thrusters} == {"from the prior"}
    for item in fitted.thrusters:
        assert item.value == pytest.approx(1.0, abs=0.02)
        assert item.low < 0.6
        assert not item.is_weak
        assert item.departure == pytest.approx(0.0, abs=1e-6)
    card = model_card(fitted, scaled(fitted, body(), by="pull"), (), body())
    assert "Outputs 1, 2, 3, 4: the motion tells the sum" in str(fit_section(fitted, card))
    assert card.partial is not None
    assert card.partial.lacking["Z"].remedy == "Command the axis both ways in a dive."


def test_a_leg_in_another_unit_is_refused_by_its_motion() -> None:
    """Commands of one leg a hundred times smaller: it does not drive the axis, and had no fit."""
    legs = legs_of(file_inertia())
    small = legs["leg_2"].record
    force = {axis: 0.01 * values for axis, values in small.force.items()}
    using = {
        "leg_1": legs["leg_1"],
        "leg_2": replace(legs["leg_2"], record=replace(small, force=force)),
    }
    for key, item in using.items():
        using[key] = replace(
            item, record=replace(item.record, windows={"X": item.record.windows["X"]})
        )
    options = FitOptions(axes=("X",), lag_s=0.08, fit_lag=False, together="never")
    assert turned_round("X", using, body(), options) < 0.0


def test_a_leg_whose_command_has_another_sign_is_named() -> None:
    """Surge of one leg the other way round: the axis is refused, and the leg named."""
    legs = legs_of(file_inertia(), coriolis=False, seconds=20.0)
    for key, sign in (("leg_1", 1.0), ("leg_2", -1.0)):
        record = legs[key].record
        force = {**record.force, "X": sign * record.force["X"]}
        legs[key] = replace(legs[key], record=replace(record, force=force))
    options = FitOptions(axes=("X",), lag_s=0.08, fit_lag=False, together="never")
    (item,) = [item for item in fit_all(legs, body(), options).lacking if item.axis == "X"]
    assert item.verdict == "wrong sign"
    assert "in leg leg_2 it moves against its force" in item.words, item.words


def test_thrusters_that_run_one_by_one_are_told_apart() -> None:
    """Three of four push ahead in turn, and the third gives half."""
    one = legs_of(file_inertia())["leg_1"]
    ahead = axis_leg(1, {"u": TRUTH["u"]}, seconds=56.0, step_s=0.1, normalised=True)
    delivered, still = ahead.force["X"], np.zeros(len(ahead.t_s))
    turn = np.arange(len(delivered)) // 100 % 4
    stated = np.where(turn[:, None] == np.arange(4), delivered[:, None], 0.0) / [1.0, 1.0, 0.5, 1.0]
    effect = np.zeros((6, 4))
    effect[0] = 1.0
    record = replace(
        one.record, rate=dict.fromkeys("vwpqr", still) | {"u": ahead.rate["u"]},
        force=dict.fromkeys(AXES, still) | {"X": stated.sum(axis=1)},
        windows={"X": one.record.windows["X"]},
        thrusters=ThrusterForces((1, 2, 3, 4), stated, effect),
    )  # fmt: skip
    options = FitOptions(lag_s=0.08, fit_lag=False)
    fitted = fit_all({"leg_1": replace(one, record=record)}, body(), options)
    ratio = {item.output: item for item in fitted.thrusters}
    assert ratio[3].value == pytest.approx(0.5, abs=0.05)
    assert ratio[3].is_weak
    assert min(item.departure for item in fitted.thrusters) > 1.0
    remedies = {item.axis: lacking_axis(item).remedy for item in fitted.lacking}
    assert remedies["Y"].startswith("Take its damping"), "no thruster pushes aside"


BAND, BEND, ONE_WAY = 0.06, 1.6, 0.12
CORNERS = np.array([(-1, 1, 1), (-1, -1, -1), (1, 1, -1), (1, -1, 1)])
"""What four thrusters at the corners push along X, Y and N, as ArduSub's vectored frames."""


def by_bent_thrusters(commands: Array) -> Array:
    """Return what commands of X, Y and N (n, 3) give by four bent thrusters."""
    each = np.clip(commands @ CORNERS.T, -1.0, 1.0)
    beyond = np.maximum(np.abs(each) - BAND, 0.0) / (1.0 - BAND)
    stronger = np.where(each > 0.0, 1.0 + ONE_WAY, 1.0 - ONE_WAY)
    return np.asarray((stronger * np.sign(each) * beyond**BEND) @ CORNERS / len(CORNERS))


def test_commands_that_thrusters_share_have_the_curve_of_each() -> None:
    """Axis by axis they look straight, and linear drag comes out up to twice the true one."""
    moved = {}
    for number, (key, item) in enumerate(legs_of(file_inertia(), seconds=24.0).items()):
        strong = {axis: 1.6 * values for axis, values in item.record.force.items()}
        record = replace(item.record, force=strong)
        thrust = by_bent_thrusters(np.column_stack([record.force[axis] for axis in "XYN"]))
        pushed = {**record.force, **dict(zip("XYN", thrust.T, strict=True))}
        flown = coupled_motion(replace(item, record=replace(record, force=pushed)), number)
        moved[key] = replace(flown, record=replace(flown.record, force=strong))
    fitted = fit_all(moved, body(), FitOptions(lag_s=0.08, fit_lag=False, fit_curve=True))
    for item in fitted.fitted:
        linear, quadratic = item.equation.values[:2]
        truth = TRUTH[item.equation.speed]
        assert item.shape.mixed
        error = item.equation.error(item.equation.speed)
        assert linear == pytest.approx(truth[0], abs=min(0.1, 3.0 * error))
        assert quadratic == pytest.approx(truth[1], rel=0.1)
    shape = fitted.fitted[0].shape
    assert shape.dead_band == pytest.approx(BAND, abs=0.01)
    assert shape.curve == pytest.approx(BEND, abs=0.1)
    assert shape.skew == pytest.approx(ONE_WAY, abs=0.02)
    file = auvid.Model(file_of(card_of(fitted), fitted, body())).file
    commands = np.random.default_rng(0).uniform(-0.6, 0.6, (9, 3))
    assert file.partial is not None
    gains = {gain.axis: gain.value for gain in file.partial.gains}
    names: dict[str, Any] = {"math": math}
    exec(partial_text(body_of(file)), names)
    for row in commands:
        by_axis = dict(zip("XYN", row.tolist(), strict=True))
        force = _force_of(file, by_axis, 1)[0]
        drive = ForceDrive(0.08, shape.dead_band, shape.curve, (), 0.0, True, shape.skew)
        record = replace(
            moved["leg_1"].record, force={k: np.array([v]) for k, v in by_axis.items()}
        )
        expected = [gains[axis] * acting(record, axis, drive)[0] for axis in "XYN"]
        assert force[[0, 1, 5]] == pytest.approx(expected, rel=1e-6)
        assert names["command_force"](by_axis) == pytest.approx(force.tolist(), rel=1e-6)
