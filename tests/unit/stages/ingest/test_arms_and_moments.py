"""Arms of sensors and the moment of added mass: no scale, no lag and no wrong sign."""

from __future__ import annotations

import copy

import numpy as np
import pytest

from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.tables import make_table
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.stages.columns import ATTITUDE, GYRO, LINEAR_VELOCITY
from auvid.stages.ingest.health.actuation.push_answers import push_responses, pushes, response_signs
from auvid.stages.ingest.health.agreement.motion import depth_answers
from auvid.stages.ingest.health.agreement.velocity.velocity_arm import inertial_motion
from auvid.stages.ingest.health.finding import CheckedLog
from tests.support.motions import vehicle_document
from tests.support.sound_log import Array, Log, euler, rates, sound, velocity

DVL_M, DEPTH_M = [-0.25, 0.0, 0.08], [0.4, 0.0, 0.0]


def checked(log: Log) -> CheckedLog:
    tables = {name: make_table(name, columns) for name, columns in log.streams.items()}
    columns = {name: [] for name in ("stream", "reason", "count", "bytes", "first", "last")}
    info = LogInfo.model_validate(log.info)
    return CheckedLog(tables, info, make_table("dropped", columns), log.vehicle)


def torpedo() -> Log:
    """A hull that swims ahead and pitches, with its sensors at both ends."""
    log = sound()
    document = copy.deepcopy(vehicle_document("bluerov2_heavy"))
    for name, arm in (("dvl", DVL_M), ("depth", DEPTH_M)):
        document["sensors"][name] = {
            "arm": {"value": arm, "unit": "m", "source": "drawing", "assumed": False}
        }
    log.vehicle = vehicle_from_document(document)

    def speed(t: Array) -> Array:
        return np.column_stack([1.5 + 0.0 * t, 0.0 * t, 0.2 * rates(t)[:, 1]])

    fine = np.arange(0.0, 62.0, 0.01)
    down = np.einsum("nij,nj->ni", rotation_body_to_ned(euler(fine)), speed(fine))[:, 2]
    t = log.t_s("velocity")
    measured = speed(t) + np.cross(rates(t), DVL_M)
    log.streams["velocity"] |= dict(zip(LINEAR_VELOCITY, measured.T, strict=True))
    t = log.t_s("depth")
    lower = rotation_body_to_ned(euler(t))[:, 2] @ np.array(DEPTH_M)
    log.streams["depth"]["depth_m"] = np.interp(t, fine, 5.0 + 0.01 * np.cumsum(down)) + lower
    return log


def test_heave_at_the_velocity_log_makes_the_depth_of_that_place() -> None:
    log = torpedo()
    there = depth_answers(checked(log))
    assert there is not None
    assert there.gain[[0, 2]] == pytest.approx([1.0, 1.0], abs=0.06)
    log.vehicle = None  # as if both sat at one place
    elsewhere = depth_answers(checked(log))
    assert elsewhere is not None
    assert elsewhere.gain[2] < 0.0


def test_the_arm_of_a_velocity_log_is_measured_where_no_vehicle_file_states_it() -> None:
    log, t = sound(), sound().t_s("velocity")
    measured = velocity(t) + np.cross(rates(t), DVL_M)
    log.streams["velocity"] |= dict(zip(LINEAR_VELOCITY, measured.T, strict=True))
    log.ids()  # says where each stream comes from
    motion = inertial_motion(checked(log))
    assert motion is not None
    assert motion.arm() is None  # nothing is stated that could be off
    free = motion.free_arm()
    assert free is not None
    assert free.offset[[0, 2]] == pytest.approx([DVL_M[0], DVL_M[2]], abs=0.05)


def test_a_hull_that_its_added_mass_pitches_answers_its_thrusters_the_right_way() -> None:
    """The moment of u w is twice that of the thrusters, and against it."""
    log, random = sound(), np.random.default_rng(2)
    log.vehicle = vehicle_from_document(vehicle_document("bluerov2_heavy"))
    t = log.t_s("actuators")
    levels = np.repeat(random.uniform(-150.0, 150.0, (60, 2)), 10, axis=0)[: t.size]
    for number in range(1, 9):
        ahead = levels[:, 0] * (number in (5, 6)) + levels[:, 1] * (number in (7, 8))
        log.streams["actuators"][f"pwm_{number}_us"] = 1500.0 + ahead
    pushed = pushes(checked(log))
    assert pushed is not None
    push = pushed[1][:, 4]
    wander = np.convolve(random.standard_normal(t.size), np.ones(9) / 3.0, "same")
    w = -0.5 * push + 0.2 * push.std() * wander
    q, theta = np.zeros(t.size), np.zeros(t.size)
    for n in range(1, t.size):
        turning = push[n - 1] + 5.0 * 0.8 * w[n - 1] - 1.5 * q[n - 1] - 2.0 * theta[n - 1]
        q[n] = q[n - 1] + 0.1 * turning
        theta[n] = theta[n - 1] + 0.1 * q[n]
    for stream, name, values in (
        ("velocity", LINEAR_VELOCITY[0], 0.8 + 0.0 * t),
        ("velocity", LINEAR_VELOCITY[2], w),
        ("imu", GYRO[1], q),
        ("attitude", ATTITUDE[1], theta),
    ):
        log.streams[stream][name] = np.interp(log.t_s(stream), t, values)
    gains = dict(push_responses(checked(log)))["q"]
    assert gains.gain[0] == pytest.approx(1.0, abs=0.3)
    without = checked(log).without("velocity")
    plain = dict(push_responses(without))
    assert plain["q"].gain[0] < 0.0
    assert not list(response_signs(without, plain))
