"""The righting moment and the force of surge on heave, with the error of the inertia."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from auvid.hydro.axis_figures import FORCE, AxisEquation, Inertia
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.axes.single_axis import SURGE
from auvid.hydro.identification.axes.structure import RIGHTING
from auvid.stages.fit_axes.fitted import AxisFits, FittedAxis
from auvid.stages.fit_axes.scaling import righting_and_surge, scaled
from tests.support.motions import shipped_vehicle
from tests.unit.stages.test_fit_axes import fits


def body() -> Vehicle:
    return shipped_vehicle("bluerov2_heavy")


def tilting(axis: str, c: float, e: float, errors: tuple[float, float]) -> FittedAxis:
    """Return a fitted axis with x' = ... + c F + e sin(angle)."""
    item = fits(False).fitted[0]
    equation = AxisEquation(
        axis,
        ("p" if axis == "K" else "q", FORCE),
        np.array([-1.0, c]),
        np.diag([0.01, errors[0] ** 2]),
        {},
    )
    pair = AxisEquation(axis, (FORCE, RIGHTING), np.array([c, e]), np.diag(np.square(errors)), {})
    return replace(item, equation=equation, righting=pair)


def moment(*items: FittedAxis) -> tuple[float, float]:
    """Return the moment and its standard error."""
    fitted: AxisFits = replace(fits(False), fitted=items)
    out = righting_and_surge(fitted, scaled(fitted, body(), by="pull"))["righting"]
    assert isinstance(out, dict)
    low, high = out["interval_95"]
    return out["value"], (high - low) / (2.0 * NORMAL_95)


def test_the_moment_has_the_error_of_the_inertia() -> None:
    """k = -e / c: 10 % of c and 1 % of e are 10.05 % of k."""
    value, error = moment(tilting("K", 2.0, -8.0, (0.2, 0.08)))
    assert value == pytest.approx(4.0)
    assert error == pytest.approx(4.0 * np.hypot(0.1, 0.01), rel=1e-6)


def test_errors_that_cancel_in_the_moment_do_not_count() -> None:
    """Where e and c err together, k = -e / c does not."""
    item = tilting("K", 2.0, -8.0, (0.2, 0.8))
    assert item.righting is not None
    together = np.array([[0.04, -0.16], [-0.16, 0.64]])
    item = replace(item, righting=replace(item.righting, covariance=together))
    assert moment(item)[1] == pytest.approx(0.0, abs=1e-6)


def test_roll_and_pitch_that_disagree_widen_the_moment() -> None:
    alike = moment(tilting("K", 2.0, -8.0, (0.02, 0.08)), tilting("M", 2.0, -8.0, (0.02, 0.08)))
    disagreeing = moment(
        tilting("K", 2.0, -8.0, (0.02, 0.08)), tilting("M", 2.0, -12.0, (0.02, 0.08))
    )
    assert alike[1] < 0.05
    assert disagreeing[1] > 0.5


def test_the_force_of_surge_on_heave_has_the_error_of_the_inertia() -> None:
    heave = fits(False).fitted[0]
    c, e = heave.equation.value(FORCE), 0.01
    pair = AxisEquation(
        "Z", (FORCE, SURGE), np.array([c, e]), np.diag([(0.2 * c) ** 2, (0.1 * e) ** 2]), {}
    )
    fitted: AxisFits = replace(fits(False), fitted=(replace(heave, surge=pair),))
    out = righting_and_surge(fitted, scaled(fitted, body(), by="pull"))["cross_forces"]
    assert isinstance(out, list)
    low, high = out[0]["interval_95"]
    assert out[0]["value"] == pytest.approx(e / c)
    assert high - low == pytest.approx(2.0 * NORMAL_95 * e / c * np.hypot(0.2, 0.1), rel=1e-6)


def test_a_given_inertia_gives_its_own_error() -> None:
    item = tilting("K", 2.0, -8.0, (0.2, 0.08))
    fitted: AxisFits = replace(fits(False), fitted=(item,))
    forces = replace(
        scaled(fitted, body(), by="pull"), inertias={"K": Inertia(0.5, 0, relative_sd=0.3)}
    )
    out = righting_and_surge(fitted, forces)["righting"]
    assert isinstance(out, dict)
    low, high = out["interval_95"]
    assert (high - low) / (2.0 * NORMAL_95 * 4.0) == pytest.approx(np.hypot(0.3, 0.01), rel=1e-6)
