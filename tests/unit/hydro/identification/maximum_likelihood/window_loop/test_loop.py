"""The compiled window: sensitivities against differences, sensors against their models."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from auvid.data_schemas.yaml_text import read_yaml
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned
from auvid.hydro.dynamics.simulation.sensor_models import specific_force
from auvid.hydro.dynamics.simulation.simulation import (
    Actuation,
    Flight,
    SimulatedVehicle,
    integrate_open_loop,
    motion_at,
)
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.hydro.dynamics.vehicle.vehicle import MountedSensor
from auvid.hydro.dynamics.viscous.models import IdentifiedModel
from auvid.hydro.identification.maximum_likelihood.likelihood import Likelihood, NoiseModel
from auvid.hydro.identification.maximum_likelihood.noise import NoiseUnknowns
from auvid.hydro.identification.maximum_likelihood.parameters import UnknownParameters
from auvid.hydro.identification.maximum_likelihood.records import (
    ActuatorRecord,
    LegRecord,
    SensorGeometry,
    SensorRecord,
)
from auvid.hydro.identification.maximum_likelihood.windows import cut_windows

ROOT = Path(__file__).parents[6]
VT690 = vehicle_from_document(read_yaml((ROOT / "vehicles/vt690.yaml").read_text(encoding="utf-8")))
TRUTH = {
    "X": {"u": -9.0, "v*v": 3.0},
    "Y": {"v": -110.0, "r": 40.0, "v*V": -30.0, "(u*v)*(eta-1)": -8.0},
    "Z": {"w": -110.0, "q": -44.0},
    "K": {"p": -0.8, "v": -0.4},
    "M": {"w": -42.0, "q": -57.0},
    "N": {"v": 40.0, "r": -53.0, "constant": 0.2},
}
PLACES = SensorGeometry(
    MountedSensor(np.array([0.1, -0.05, 0.2]), rotation_body_to_ned([0.1, -0.2, 0.3]), 0.0),
    MountedSensor(np.array([-0.3, 0.1, 0.15]), rotation_body_to_ned([0.0, 0.05, -0.7]), 0.0),
    MountedSensor(np.array([0.4, 0.0, -0.1]), np.eye(3), 0.0),
    9.81,
)
NAMES = tuple(f"{axis} {term}" for axis, terms in TRUTH.items() for term in terms)


def flown() -> tuple[Flight, SimulatedVehicle]:
    """Four seconds with moving fins, open loop, at 200 steps a second."""
    k = 801
    t = np.arange(k) * 0.005
    fins = 0.2 * np.sin(np.outer(t, [1.0, 1.3, 0.8, 1.7]) + np.arange(4.0))
    actuation = Actuation(np.full(k, 35.0), fins, np.zeros((k, 6)))
    viscous = {
        axis: {term: value for term, value in terms.items() if term != "constant"}
        for axis, terms in TRUTH.items()
    }
    force = actuation.force.copy()
    force[:, 5] = TRUTH["N"]["constant"]
    actuation = replace(actuation, force=force)
    simulated = SimulatedVehicle(VT690, IdentifiedModel("truth", viscous))
    start = np.array([1.6, 0.1, -0.05, 0.0, 0.1, -0.1, 0.0, 0.0, 5.0, 0.05, -0.1, 0.4])
    states = integrate_open_loop(simulated, start, actuation, step_s=0.005)
    return Flight(t, states, actuation, 0.005), simulated


def exact_leg() -> LegRecord:
    """A leg whose sensors measure a flight without noise, each at its own times."""
    flight, simulated = flown()
    times = {
        "attitude": np.arange(0.0, 4.0, 0.02),
        "gyro": np.arange(0.003, 4.0, 0.02),
        "accel": np.arange(0.003, 4.0, 0.02),
        "velocity": np.arange(0.107, 4.0, 0.25),
        "depth": np.arange(0.041, 4.0, 0.1),
    }
    sensors = {}
    for name, t in times.items():
        motion = motion_at(simulated, flight, t)
        v, omega = motion.nu[:, :3], motion.nu[:, 3:]
        down = rotation_body_to_ned(motion.eta[:, 3:])[:, 2, :]
        values = {
            "attitude": motion.eta[:, 3:],
            "gyro": omega @ PLACES.imu.rotation,
            "accel": specific_force(motion, PLACES.imu.arm_m, gravity=PLACES.gravity)
            @ PLACES.imu.rotation,
            "velocity": (v + np.cross(omega, PLACES.velocity.arm_m)) @ PLACES.velocity.rotation,
            "depth": (motion.eta[:, 2] + down @ PLACES.depth.arm_m)[:, None],
        }[name]
        sensors[name] = SensorRecord(t, values)
    act = flight.actuation
    record = ActuatorRecord(flight.t_s, act.propeller_rev_s, act.fins_rad, np.zeros((801, 6)))
    return LegRecord("flight", sensors, record, PLACES)


def likelihood_of(leg: LegRecord, *, filtering: bool) -> tuple[Likelihood, np.ndarray, np.ndarray]:
    parameters = UnknownParameters(
        VT690,
        {axis: tuple(terms) for axis, terms in TRUTH.items()},
        inertia=((1, 1), (1, 5), (5, 5)),
        lag=True,
    )
    windows, _ = cut_windows([leg], length_s=None)
    theta = parameters.vector(
        {f"{axis} {term}": value for axis, terms in TRUTH.items() for term, value in terms.items()},
        lag_s=0.0,
    )
    flight, simulated = flown()
    start = motion_at(simulated, flight, windows[0].t_s[:1])
    first = np.concatenate([start.eta[:, 3:], start.eta[:, 2:3], start.nu], axis=-1)
    return (
        Likelihood([leg], windows, parameters, filtering, np.full(10, 0.1)),
        np.concatenate([theta, np.zeros(6)]),
        first,
    )


SD = NoiseModel(np.repeat([1e-3, 2e-3, 0.03, 0.01, 0.005], [3, 3, 3, 3, 1]))


def test_the_true_model_predicts_every_sensor() -> None:
    likelihood, common, start = likelihood_of(exact_leg(), filtering=False)
    run = likelihood.run(common, start, SD, sensitive=False)[0]
    # RK4 over 20 ms against 5 ms, and corners of the fins between samples.
    np.testing.assert_allclose(run.errors / np.sqrt(run.variances), 0.0, atol=2e-2)


def test_sensitivities_are_derivatives_of_the_predictions() -> None:
    likelihood, common, start = likelihood_of(exact_leg(), filtering=False)
    k = len(likelihood.parameters.names)
    common[k - 1] = 0.05  # a lag, so that its own derivative exists
    common[k:] = 0.01
    run = likelihood.run(common, start, SD, sensitive=True)[0]

    def predictions(common: np.ndarray, start: np.ndarray) -> np.ndarray:
        return -likelihood.run(common, start, SD, sensitive=False)[0].errors

    names = [*likelihood.parameters.names, *["bias"] * 6, *["start"] * 10]
    for column, name in enumerate(names):
        moved = np.zeros(k + 16)
        size = common[column] if column < k else 1.0
        moved[column] = 1e-4 * max(abs(size), 0.1)
        high = predictions(common + moved[: k + 6], start + moved[k + 6 :])
        low = predictions(common - moved[: k + 6], start - moved[k + 6 :])
        expected = (high - low) / (2.0 * moved[column])
        scale = np.abs(expected).max()
        np.testing.assert_allclose(
            run.jacobian[:, column], expected, atol=2e-3 * scale, err_msg=name
        )


@pytest.mark.parametrize("w", [-4e-7, 4e-7])
def test_a_jump_of_the_force_beside_the_state_is_in_no_derivative(w: float) -> None:
    """|q| V sign(w) (C.11) jumps where w changes its sign, here half a difference away."""
    terms = {axis: tuple(own) for axis, own in TRUTH.items()}
    terms["Z"] = (*terms["Z"], "|q|*Vw")
    parameters = UnknownParameters(VT690, terms)
    values = {f"{axis} {term}": value for axis, own in TRUTH.items() for term, value in own.items()}
    theta = parameters.vector(values | {"Z |q|*Vw": -60.0})
    windows, _ = cut_windows([exact_leg()], length_s=None)
    likelihood = Likelihood([exact_leg()], windows, parameters, False, np.full(10, 0.1))
    first = likelihood_of(exact_leg(), filtering=False)[2]
    jacobians = []
    for start in (w, 1e-4 * np.sign(w)):
        first[0, 6] = start
        common = np.concatenate([theta, np.zeros(6)])
        jacobians.append(likelihood.run(common, first, SD, sensitive=True)[0].jacobian)
    scale = np.abs(jacobians[1]).max(axis=0)
    np.testing.assert_allclose(jacobians[0] / scale, jacobians[1] / scale, atol=1e-2)


def test_a_filter_that_trusts_its_motion_predicts_as_a_free_run() -> None:
    leg = exact_leg()
    free, common, start = likelihood_of(leg, filtering=False)
    filtered, _, _ = likelihood_of(leg, filtering=True)
    filtered = replace(filtered, start_sd=np.full(10, 1e-9))
    noise = replace(SD, force_sd=np.full((1, 6), 1e-9), time_s=np.ones(6))
    common[0] *= 1.1
    plain = free.run(common, start, SD, sensitive=True)[0]
    followed = filtered.run(common, start, noise, sensitive=True)[0]
    np.testing.assert_allclose(followed.errors, plain.errors, atol=1e-7)
    np.testing.assert_allclose(
        followed.jacobian, plain.jacobian[:, : followed.jacobian.shape[1]], atol=1e-6
    )


def test_the_filter_knows_how_it_depends_on_parameters_and_noise() -> None:
    # Innovations far above their deviations, so that every change of a gain shows. The
    # tangents leave out what the motion changes of A: a few parts in a hundred.
    leg = exact_leg()
    random = np.random.default_rng(0)
    noisy = {
        name: replace(item, values=item.values + 0.01 * random.standard_normal(item.values.shape))
        for name, item in leg.sensors.items()
    }
    likelihood, common, start = likelihood_of(replace(leg, sensors=noisy), filtering=True)
    noise = replace(SD, force_sd=np.full((1, 6), 2.0), time_s=np.full(6, 0.4))
    unknown = NoiseUnknowns(np.arange(13), 1)
    k, g = len(likelihood.parameters.names), len(common)
    run = likelihood.run(common, start, noise, sensitive=True, channels=unknown.channels)[0]

    def moved(place: int, width: float) -> tuple[np.ndarray, np.ndarray]:
        point = np.concatenate([common, unknown.logarithms(noise)])
        point[place] += width
        there = unknown.noise_at(point[g:], noise.sensor_sd)
        other = likelihood.run(point[:g], start, there, sensitive=False)[0]
        return -other.errors, other.variances

    names = ("K p", "N r", "M w", "M[1,5]", "M[5,5]")
    places = [likelihood.parameters.names.index(name) for name in names]
    for place in [*places, *(g + np.array([0, 5, 7, 10, 12, 13, 16, 18, 20, 22, 24]))]:
        width = 1e-4 * (max(abs(common[place]), 0.1) if place < k else 1.0)
        high, low = moved(place, width), moved(place, -width)
        error, variance = ((a - b) / (2.0 * width) for a, b in zip(high, low, strict=True))
        off = np.linalg.norm(run.jacobian[:, place] - error) / np.linalg.norm(error)
        assert off < 0.06, place
        column = run.variance_slopes[:, place if place < k else place - 6]
        scaled = np.linalg.norm((column - variance) / run.variances)
        assert scaled / np.linalg.norm(variance / run.variances) < 0.02, place


def test_a_run_that_diverges_has_no_likelihood() -> None:
    likelihood, common, start = likelihood_of(exact_leg(), filtering=False)
    common[NAMES.index("X u")] = 1e5
    evaluation, _ = likelihood.evaluate(common, start, SD, sensitive=True)
    assert evaluation.objective == np.inf
    assert evaluation.equations is None


@pytest.mark.parametrize("lag", [0.0, 0.08])
def test_the_lag_of_the_actuators_is_found(lag: float) -> None:
    likelihood, _, _ = likelihood_of(exact_leg(), filtering=False)
    inputs, _ = likelihood._inputs(0, lag)
    window = likelihood.windows[0]
    t = window.stations
    record = likelihood.legs[0].actuators
    # y' = (u - y) / T by fine Euler steps from the first sample on.
    fine = np.arange(0.0, 4.0, 1e-4)
    u = np.interp(fine, record.t_s, record.fins_rad[:, 2])  # type: ignore[index]
    y = np.empty(len(fine))
    y[0] = u[0]
    for i in range(len(fine) - 1):
        y[i + 1] = y[i] + 1e-4 * (u[i] - y[i]) / lag if lag else u[i + 1]
    np.testing.assert_allclose(inputs[:, 4], np.interp(t, fine, y), atol=1e-4)
