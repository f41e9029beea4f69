"""Published vehicles of the shelf judged on a dive."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from auvid.data_schemas.errors import DataError
from auvid.data_schemas.tables import make_table
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.mechanics.rigid_body import coriolis_force
from auvid.hydro.dynamics.simulation.free_run import FreeRuns
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.model_file import viscous_model
from auvid.hydro.published_model import published_model
from auvid.pipeline.campaigns.vehicle_files import load_published, load_vehicle, shelf_files
from auvid.pipeline.campaigns.workspace import SHIPPED_VEHICLES
from auvid.stages.columns import ACCELERATION, POSE, POSE_RATE, VELOCITY, force_columns, named
from auvid.stages.score_shelf import (
    OWN,
    PublishedSet,
    Score,
    nearest_set,
    shelf_section,
    worse_than_nothing,
)

SHELF = shelf_files()
UNSTEADY = [name for name in SHELF if name.startswith("vt690_")]
"""Fitted to runs with u > 0: some of their own damping has the other sign."""
MEASURED = {"remus100_alberti_2015": "XYZ", "remus100_prestero_2001": "XYZKMN"}
AXES = "XYZKMN"


@pytest.fixture(scope="module")
def rov() -> Vehicle:
    return load_vehicle(SHIPPED_VEHICLES / "bluerov2_heavy.yaml").vehicle


def cross(r: Array) -> Array:
    x, y, z = r
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def test_the_shelf_has_six_sets_of_the_bluerov2_or_more() -> None:
    assert len([name for name in SHELF if name.startswith("bluerov2_")]) >= 6


@pytest.mark.parametrize("name", SHELF)
def test_a_published_set_names_source_and_licence_and_brakes(name: str) -> None:
    vehicle = load_published(SHELF[name])
    assert vehicle.name == name
    assert vehicle.document.licence
    assert vehicle.document.notes
    if name in UNSTEADY:
        return
    damping = {item: vehicle.published[item].value for item in vehicle.published}
    main = [item for item in damping if item[2] == "uvwpqr"["XYZKMN".index(item[0])]]
    assert {item[0] for item in main} >= set(MEASURED.get(name, "XYZN"))
    assert all(damping[item] < 0.0 for item in main)


@pytest.mark.parametrize("name", ["bluerov2_wu_2018", "lauv"])
def test_the_set_that_moved_the_vehicle_leaves_no_force(name: str, rov: Vehicle) -> None:
    """Fossen's equation in plain numpy, the centre of gravity at the origin."""
    published = load_vehicle(SHELF[name]).vehicle
    random = np.random.default_rng(4)
    nu, nu_dot = random.normal(0.0, 0.4, (5, 6)), random.normal(0.0, 0.3, (5, 6))
    eta = np.column_stack([random.normal(0.0, 3.0, (5, 3)), random.normal(0.0, 0.3, (5, 3))])
    mass, inertia = published.mass_kg, published.inertia
    total = np.zeros((6, 6))
    total[:3, :3], total[3:, 3:] = mass * np.eye(3), inertia
    total -= published.added_mass
    thrust = np.zeros((5, 6))
    for i in range(5):
        momentum = total @ nu[i]
        C_nu = np.concatenate(
            [
                cross(nu[i, 3:]) @ momentum[:3],
                cross(nu[i, :3]) @ momentum[:3] + cross(nu[i, 3:]) @ momentum[3:],
            ]
        )
        phi, theta = eta[i, 3:5]
        down = np.array([-np.sin(theta), np.cos(theta) * np.sin(phi), np.cos(theta) * np.cos(phi)])
        buoyancy = -published.displaced_mass_kg * published.gravity * down
        gravity = mass * published.gravity * down + buoyancy
        tau_G = np.concatenate([gravity, np.cross(published.r_B, buoyancy)])
        viscous = np.zeros(6)
        for item, coefficient in published.published.items():
            names = item[2:].replace("|", "")
            first = nu[i, "uvwpqr".index(names[0])]
            factor = first * abs(first) if len(names) == 2 else first
            viscous[AXES.index(item[0])] += coefficient.value * factor
        thrust[i] = total @ nu_dot[i] + C_nu - tau_G - viscous
    t_s = np.arange(5.0)
    residual = make_table(
        "residual",
        {
            "t_s": t_s,
            **named(VELOCITY, nu),
            **named(force_columns("thrusters"), thrust),
            **named(force_columns("tau_bar"), np.ones((5, 6))),
        },
    )
    fused = make_table(
        "fused",
        {
            "t_s": t_s,
            **named(POSE, eta),
            **named(VELOCITY, nu),
            **named(ACCELERATION, nu_dot),
            **named(POSE_RATE, np.zeros((5, 6))),
        },
    )
    missing = PublishedSet.of(published, rov).missing_force(residual, fused)
    np.testing.assert_allclose(missing, 0.0, atol=1e-9)
    heavier = replace(published, mass_kg=published.mass_kg + 1.0)
    assert np.abs(PublishedSet.of(heavier, rov).missing_force(residual, fused)).max() > 0.1


def test_the_lag_of_a_model_delays_the_thrust(rov: Vehicle) -> None:
    published = PublishedSet.of(load_vehicle(SHELF["bluerov2_wu_2018"]).vehicle, rov)
    t_s, still = 0.1 * np.arange(40.0), np.zeros((40, 6))
    thrust = still.copy()
    thrust[10:, 0] = 5.0
    residual = make_table(
        "residual",
        {
            "t_s": t_s,
            **named(VELOCITY, still),
            **named(force_columns("thrusters"), thrust),
            **named(force_columns("tau_bar"), still),
        },
    )
    fused = make_table(
        "fused",
        {
            "t_s": t_s,
            **named(POSE, still),
            **named(VELOCITY, still),
            **named(POSE_RATE, still),
            **named(ACCELERATION, still),
        },
    )
    prompt = published.missing_force(residual, fused)[:, 0]
    late = replace(published, lag_s=0.4).missing_force(residual, fused)[:, 0]
    assert prompt[10] == pytest.approx(-5.0)
    # One time constant after the step 63 % has come.
    assert late[14] == pytest.approx(-5.0 * (1.0 - np.exp(-1.0)), abs=0.35)
    assert late[-1] == pytest.approx(-5.0, abs=0.01)


def test_a_vehicle_without_damping_or_about_another_point_is_refused(rov: Vehicle) -> None:
    with pytest.raises(DataError, match="publishes no damping"):
        PublishedSet.of(load_vehicle(SHIPPED_VEHICLES / "remus100.yaml").vehicle, rov)
    lauv = load_vehicle(SHELF["lauv"]).vehicle
    moved = replace(lauv, r_G=np.array([0.1, 0.0, 0.0]))
    with pytest.raises(DataError, match="another point"):
        PublishedSet.of(moved, rov)


def test_axes_without_damping_stand_in_the_title(rov: Vehicle) -> None:
    li = PublishedSet.of(load_vehicle(SHELF["bluerov2_li_2020"]).vehicle, rov)
    assert li.title.endswith("(no damping in roll, pitch)")


def test_the_remus_of_prestero_has_his_forces() -> None:
    """His sums of hydrodynamic terms, with the added mass in them, term by term.

    He prints M_rp = -N_pq = 4.86 where his added mass gives 4.81.
    """
    vehicle = load_published(SHELF["remus100_prestero_2001"])
    u, v, w, p, q, r = nu = np.random.default_rng(2).uniform(-1.0, 1.0, (6, 50))
    added = -35.5 * np.array([w * q - v * r, -w * p, v * p, 0 * u, 0 * u, 0 * u])
    added += 1.93 * np.array([-q * q - r * r, p * q, r * p, 0 * u, -v * p, -w * p])
    added[4:] += 4.8096 * np.array([r * p, -p * q])
    printed = np.array(
        [
            -1.62 * u * abs(u),
            -131.0 * v * abs(v) + 0.632 * r * abs(r) - 28.6 * u * v + 5.22 * u * r,
            -131.0 * w * abs(w) - 0.632 * q * abs(q) - 28.6 * u * w - 5.22 * u * q,
            -0.13 * p * abs(p),
            3.18 * w * abs(w) - 188.0 * q * abs(q) + 24.0 * u * w - 2.0 * u * q,
            -3.18 * v * abs(v) - 94.0 * r * abs(r) - 24.0 * u * v - 2.0 * u * r,
        ]
    )
    file = published_model(vehicle, vehicle_hash="0", version="0")
    viscous = viscous_model(file)[0].force(nu.T)
    ours = viscous - coriolis_force(-vehicle.added_mass, nu.T)
    np.testing.assert_allclose(ours, (printed + added).T, atol=1e-9)


def test_terms_with_the_propulsion_ratio_need_a_propeller(rov: Vehicle) -> None:
    with pytest.raises(DataError, match="'bluerov2_heavy' has no propeller"):
        PublishedSet.of(load_published(SHELF["vt690_gertler_hagen"]), rov)
    torpedo = load_vehicle(SHIPPED_VEHICLES / "vt690.yaml").vehicle
    assert PublishedSet.of(load_published(SHELF["vt690_gertler_hagen"]), torpedo).model.terms


def row(name: str, use: str, surge: float, sway: float) -> dict[str, object]:
    ratios = {"X": surge, "Y": sway, **dict.fromkeys("ZKMN", 0.5)}
    return {
        "set": name,
        "title": name.title(),
        "use": use,
        **{f"ratio_{axis}": value for axis, value in ratios.items()},
        "ratio": surge,
        "starts": 0,
        "diverged": 0,
    }


def test_nearest_is_judged_on_validation_and_the_own_model_does_not_count() -> None:
    rows = [
        row(OWN, "validation", 0.1, 0.1),
        row("a", "training", 0.2, 0.2),
        row("a", "validation", 0.9, 1.2),
        row("b", "training", 0.8, 0.2),
        row("b", "validation", 0.6, 1.1),
    ]
    best = nearest_set(rows)
    assert best is not None
    assert best["set"] == "b"
    assert worse_than_nothing(rows) == ["Y"]
    page = str(shelf_section(rows, 10.0))
    assert "Nearest is B: J/J0 0.6 on validation, 0.1 for the model of this dive." in page
    assert "In sway every published set errs more than no model at all." in page


def test_without_validation_training_decides() -> None:
    best = nearest_set([row("a", "training", 0.3, 0.2), row("b", "training", 0.2, 0.2)])
    assert best is not None
    assert best["set"] == "b"


def test_a_set_of_which_one_run_is_lost_has_no_rms() -> None:
    """What is left of it is a number that rounding moved by a tenth."""

    def score(lost_s: float) -> dict[str, Any]:
        errors = np.full((1, 2, 1, 12), 0.3)
        errors[0, 1] = np.nan if np.isfinite(lost_s) else 0.4
        runs = FreeRuns(
            horizons_s=np.array([10.0]),
            errors=errors,
            diverged_s=np.array([[np.nan, lost_s]]),
            reached=np.ones((2, 1), dtype=bool),
            persistence=np.zeros((2, 1, 12)),
            starts=np.zeros((2, 12)),
            lost_motion={},
        )
        return Score({}, (runs,)).row()

    bounded, diverging = score(np.nan), score(4.0)
    assert bounded["u_rms_m_s"] == pytest.approx(np.sqrt((0.3**2 + 0.4**2) / 2.0))
    assert (diverging["starts"], diverging["diverged"]) == (2, 1)
    assert np.isnan(diverging["u_rms_m_s"])
