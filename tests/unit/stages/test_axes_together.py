"""Axes fitted together or one by one, by what is held out, and their files."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import auvid
from auvid.data_schemas.records.models import ModelCard
from auvid.hydro.arrays import AXES
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.partial_model import apparent_inertia
from auvid.stages.fit_axes.card import model_card
from auvid.stages.fit_axes.fitted import AxisFits
from auvid.stages.fit_axes.fitting import fit_all
from auvid.stages.fit_axes.flight import FitOptions, LegData
from auvid.stages.fit_axes.presentation import fit_section
from auvid.stages.fit_axes.scaling import scaled
from tests.support.axis_legs import axis_leg
from tests.support.axis_twin import leg
from tests.support.motions import shipped_vehicle
from tests.unit.stages.test_fit_axes import file_of

TRUTH = {
    "u": (-0.25, -1.2, 2.0, 0.02),
    "v": (-0.3, -1.6, 2.0, -0.02),
    "r": (-1.0, -0.8, 3.0, 0.03),
}


def body() -> Vehicle:
    return shipped_vehicle("bluerov2_heavy")


@cache
def fits(coriolis: bool, torque: float = 3.0) -> AxisFits:
    """Return the fits of two legs that turn while they move, and of a third."""
    truth = {**TRUTH, "r": (-1.0, -0.8, torque, 0.03)}
    inertia = np.array([apparent_inertia(body(), axis) for axis in AXES])
    legs = {}
    for seed, use in ((1, "training"), (2, "training"), (3, "validation")):
        moved = axis_leg(
            seed, truth, seconds=80.0, step_s=0.1, inertia=inertia if coriolis else None,
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
    return fit_all(legs, body(), FitOptions(fit_lag=False))


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
    assert yaw.idle_legs == ("leg_2",)
    section = str(fit_section(fitted, card_of(fitted)))
    assert "Fitted together, with Coriolis force" in section
    assert "not commanded" in section
    assert all(item.whole_legs["leg_3"] > 85.0 for item in fitted.fitted)


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


def test_a_body_without_coriolis_force_is_fitted_one_by_one() -> None:
    fitted = fits(False)
    assert fitted.together is not None
    assert not fitted.together.chosen
    assert fitted.together.error_ratio > 1.2


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
