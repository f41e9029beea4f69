"""Free runs against an independent integration, and what they say of models that leave
the run.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from auvid.data_schemas.errors import DataError
from auvid.data_schemas.yaml_text import read_yaml
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.equations_of_motion import Control, state_derivative
from auvid.hydro.dynamics.simulation.free_run import (
    FreeRuns,
    MeasuredMotion,
    WanderingForce,
    fly_freely,
    free_runs,
)
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.models import IdentifiedModel
from tests.support.motions import shipped_vehicle

VEHICLES = Path(__file__).parents[5] / "vehicles"
STABLE = {
    "X": {"u": -40.0},
    "Y": {"v": -60.0},
    "Z": {"w": -80.0},
    "K": {"p": -2.0},
    "M": {"q": -2.0},
    "N": {"r": -3.0, "r*|r|": -4.0},
}
TRIM = np.array([0.5, 0.0, -1.0, 0.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def vehicle() -> Vehicle:
    return vehicle_from_document(read_yaml((VEHICLES / "bluerov2_heavy.yaml").read_text()))


@pytest.fixture(scope="module")
def run(vehicle: Vehicle) -> tuple[Array, Array, Array]:
    """Clock, thruster forces and the true state of a driven run, by an integrator of
    another kind and eighth order: from sample to sample, between which the forces are
    straight lines, so that no step crosses a kink.
    """
    t = np.arange(0.0, 18.0, 0.02)
    thrust = 4.0 * np.sin(np.outer(t, [0.5, 0.7, 0.3, 0.9, 0.2, 0.4, 0.6, 0.8]))
    model = IdentifiedModel("truth", STABLE)

    def rate(s: float, x: Array, left: float, force: Array, slope: Array) -> Array:
        now = Control(thruster_force_N=force + (s - left) * slope)
        return state_derivative(vehicle, x, now, lambda nu: model.force(nu) + TRIM)

    state = np.empty((len(t), 12))
    state[0] = [0.2, 0.0, 0.0, 0.0, 0.0, 0.05, 0.0, 0.0, 5.0, 0.02, -0.01, 0.3]
    for k, (left, right) in enumerate(pairwise(t)):
        step = right - left
        state[k + 1] = solve_ivp(
            *(rate, (left, right), state[k], "DOP853"),
            args=(left, thrust[k], (thrust[k + 1] - thrust[k]) / step),
            rtol=1e-12,
            atol=1e-13,
            first_step=step,
        ).y[:, -1]
    return t, thrust, state


def runs(
    vehicle: Vehicle,
    run: tuple[Array, Array, Array],
    coefficients: dict[str, dict[str, float]],
    trim: Array = TRIM,
) -> FreeRuns:
    t, thrust, state = run
    return free_runs(
        vehicle,
        [IdentifiedModel("model", coefficients)],
        trim[None],
        MeasuredMotion(t, state, Control(thruster_force_N=thrust)),
        starts_s=[0.0, 5.0, 12.0],
        horizons_s=[5.0, 10.0],
    )


@pytest.mark.compiles("hydro/dynamics/simulation/compiled_free_run.py")
def test_the_true_model_follows_the_motion(
    vehicle: Vehicle, run: tuple[Array, Array, Array]
) -> None:
    simulated = runs(vehicle, run, STABLE)
    # RK4 at 50 Hz errs by 4.7e-8.
    assert np.nanmax(np.abs(simulated.errors)) < 1e-7
    assert np.isnan(simulated.errors[0, 2, 1]).all(), "12 s + 10 s lies beyond the data"
    assert np.isnan(simulated.diverged_s).all()
    assert simulated.rms().shape == (1, 2, 12)


def test_a_wrong_coefficient_shows_in_its_velocity(
    vehicle: Vehicle, run: tuple[Array, Array, Array]
) -> None:
    wrong = runs(vehicle, run, {**STABLE, "X": {"u": -20.0}}).rms()[0]
    assert wrong[0, 0] > 0.01
    assert wrong[0, 0] > 10 * wrong[0, 3]


def test_an_unstable_model_is_named_with_its_time(
    vehicle: Vehicle, run: tuple[Array, Array, Array]
) -> None:
    simulated = runs(vehicle, run, {**STABLE, "N": {"r": +30.0}})
    assert np.all(simulated.diverged_s[0, :2] > 0)
    assert np.isnan(simulated.errors[0, 0, 1]).all()
    assert np.isnan(simulated.rms()[0, 1]).all()


def test_no_angle_errs_by_more_than_half_a_turn(
    vehicle: Vehicle, run: tuple[Array, Array, Array]
) -> None:
    """A moment that turns the model over and over in roll: the error is that of the attitude."""
    moment = TRIM + np.array([0.0, 0.0, 0.0, 10.0, 0.0, 0.0])
    simulated = runs(vehicle, run, STABLE, moment)
    roll = simulated.errors[0, :, :, 9]
    assert np.nanmax(np.abs(simulated.errors[0, :, :, 3])) > 2.0, "it turns fast"
    assert np.nanmax(np.abs(roll)) <= np.pi


def test_a_segment_shorter_than_the_horizon_is_refused(
    vehicle: Vehicle, run: tuple[Array, Array, Array]
) -> None:
    t, thrust, state = (part[:100] for part in run)
    with pytest.raises(DataError, match="shorter"):
        free_runs(
            vehicle,
            [IdentifiedModel("model", STABLE)],
            TRIM[None],
            MeasuredMotion(t, state, Control(thruster_force_N=thrust)),
            starts_s=[0.0],
            horizons_s=[5.0],
        )


def test_terms_with_the_propulsion_ratio_need_a_propeller_speed(
    vehicle: Vehicle, run: tuple[Array, Array, Array]
) -> None:
    with pytest.raises(DataError, match="propeller speed"):
        runs(vehicle, run, {"X": {"(u*u)*(eta-1)": -1.0}})


def test_inertia_of_a_model_is_that_of_a_vehicle_that_has_it() -> None:
    """Two models, one with more inertia in yaw and a coupling of sway and yaw, fly as two
    vehicles do that have each inertia.
    """
    vehicle = shipped_vehicle("bluerov2_heavy")
    model = IdentifiedModel(
        "linear", {axis: {x: -4.0} for axis, x in zip("XYZKMN", "uvwpqr", strict=True)}
    )
    t_s = np.arange(0.0, 3.0, 0.02)
    forces = 5.0 * np.sin(t_s[:, None] * np.arange(1, 9))
    state = np.zeros((len(t_s), 12))
    state[:, :6] = [0.3, -0.1, 0.05, 0.02, -0.03, 0.4]
    change = np.zeros((2, 6, 6))
    change[1, 5, 5], change[1, 1, 5], change[1, 5, 1] = -2.5, 0.4, 0.4

    def fly(own: Vehicle, added: Array) -> Array:
        return free_runs(
            own,
            [model] * len(added),
            np.zeros((len(added), 6)),
            MeasuredMotion(t_s, state, Control(thruster_force_N=forces)),
            starts_s=[0.0],
            horizons_s=[1.0, 2.0],
            added_mass=added,
        ).errors

    both = fly(vehicle, change)
    for i in range(2):
        other = replace(vehicle, added_mass=vehicle.added_mass + change[i])
        np.testing.assert_allclose(both[i], fly(other, np.zeros((1, 6, 6)))[0], atol=1e-12)
    assert np.abs(both[1] - both[0]).max() > 1e-2


def test_states_put_in_as_measured_carry_the_others(
    vehicle: Vehicle, run: tuple[Array, Array, Array]
) -> None:
    """Where the damping of roll pushes, the run is lost; with roll as measured it is not."""
    t, thrust, state = run
    motion = MeasuredMotion(t, state, Control(thruster_force_N=thrust))
    roll = np.zeros(12, dtype=bool)
    roll[[3, 9]] = True
    wild = IdentifiedModel("wild", {**STABLE, "K": {"p": 30.0}})
    free, bound = (
        free_runs(
            vehicle,
            [wild],
            TRIM[None],
            motion,
            starts_s=[0.0, 5.0],
            horizons_s=[5.0, 10.0],
            imposed=imposed,
        )
        for imposed in (None, roll)
    )
    assert np.isfinite(free.diverged_s).all()
    assert np.isnan(bound.diverged_s).all()
    assert np.abs(bound.errors[..., [3, 9]]).max() == 0.0
    # The other axes follow the true motion, because their model is the true one.
    assert np.nanmax(np.abs(bound.errors)) < 1e-5, "measured roll is linear between samples"


def test_a_wandering_force_spreads_models_as_it_should(
    vehicle: Vehicle, run: tuple[Array, Array, Array]
) -> None:
    """Two hundred equal models under a force that wanders in surge: the spread of u is
    that of a damped mass, sd^2 T / (X (m + X T)) of its variance once it has settled.
    """
    still = MeasuredMotion(
        0.02 * np.arange(1501), np.zeros((1501, 12)), Control(thruster_force_N=np.zeros((1501, 8)))
    )
    lone = replace(vehicle, added_mass=np.diag(np.diag(vehicle.added_mass)))
    model = IdentifiedModel("model", {**STABLE, "X": {"u": -40.0}})
    sd, time_s = np.zeros((400, 6)), np.full(6, 0.5)
    sd[:, 0] = 2.0

    def spread(seed: int) -> Array:
        states, lost = fly_freely(
            lone,
            [model] * 400,
            np.zeros((400, 6)),
            still,
            first=np.array([0]),
            steps=np.array([0, 1500]),
            disturbance=WanderingForce(sd, time_s, seed),
        )
        assert np.isnan(lost).all()
        return states[:, 0, 1]

    mass, X = lone.mass_matrix[0, 0], 40.0
    expected = np.sqrt(2.0**2 * time_s[0] / (X * (mass + X * time_s[0])))
    assert spread(0)[:, 0].std() == pytest.approx(expected, rel=0.1)
    np.testing.assert_array_equal(spread(0), spread(0))
    assert np.abs(spread(1) - spread(0)).max() > 0.0


def test_a_model_with_a_lag_flies_with_late_actuators(
    vehicle: Vehicle, run: tuple[Array, Array, Array]
) -> None:
    t, thrust, state = run
    lag_s = 0.4
    late = np.empty_like(thrust)  # T y' = u - y between the samples, by an integrator
    late[0] = thrust[0]
    for k, (left, right) in enumerate(pairwise(t)):
        slope = (thrust[k + 1] - thrust[k]) / (right - left)
        late[k + 1] = solve_ivp(
            lambda s, y, k=k, left=left, slope=slope: (thrust[k] + (s - left) * slope - y) / lag_s,
            (left, right),
            late[k],
            rtol=1e-10,
            atol=1e-12,
        ).y[:, -1]
    model = IdentifiedModel("model", STABLE)
    options = {"first": np.array([0, 100]), "steps": np.array([0, 400])}
    both = fly_freely(
        vehicle,
        [model, model],
        np.stack([TRIM, TRIM]),
        MeasuredMotion(t, state, Control(thruster_force_N=thrust)),
        lags_s=np.array([0.0, lag_s]),
        **options,
    )[0]
    for number, force in enumerate((thrust, late)):
        motion = MeasuredMotion(t, state, Control(thruster_force_N=force))
        one = fly_freely(vehicle, [model], TRIM[None], motion, **options)[0]
        np.testing.assert_allclose(both[number], one[0], atol=1e-7)
    assert np.abs(both[0] - both[1])[:, 1].max() > 1e-3
