"""Fins at a wrong time, of a wrong sign or size, on a made-up torpedo that yaws."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.tables import make_table
from auvid.hydro.dynamics.actuators.fins import fin_force
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.hydro.identification.checks.robust_gains import AxisGains
from auvid.stages.columns import FINS
from auvid.stages.ingest.health.actuation.fin_answers import (
    YAW,
    _backward,
    _gains,
    _turned,
    propeller_findings,
)
from auvid.stages.ingest.health.finding import CheckedLog
from tests.support.motions import vehicle_document
from tests.support.sound_log import Log, micro, sound

REJECTED = ("stream", "reason", "count", "bytes", "first", "last")
AHEAD_M_S, STEP_S = 1.8, 0.1


def checked(log: Log) -> CheckedLog:
    tables = {name: make_table(name, columns) for name, columns in log.streams.items()}
    dropped = make_table("dropped", {name: [] for name in REJECTED})
    return CheckedLog(tables, LogInfo.model_validate(log.info), dropped, log.vehicle)


def yawing(
    late_s: float = 0.0,
    factors: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0),
    *,
    autopilot: float = 0.0,
    damping: float = 0.8,
) -> Log:
    """A minute of yaw by steps of the fins; recorded angles are late and times factors.

    An autopilot turns them against the rate, and they come to their angle in 0.12 s.
    """
    log, rng = sound(), np.random.default_rng(2)
    log.vehicle = vehicle_from_document(vehicle_document("vt690"))
    fins = log.vehicle.fins
    assert fins is not None
    t = np.arange(0.0, 60.0, STEP_S)
    rudder = np.repeat(rng.uniform(-0.3, 0.3, t.size // 30), 30)
    one, ahead = np.array([[0.0, 0.0, 1.0, -1.0]]), np.array([[AHEAD_M_S, *np.zeros(5)]])
    moment = fin_force(fins, ahead, 0.01 * one, water_density=log.vehicle.water_density)[0, 5]
    turning = 100.0 * moment / log.vehicle.mass_matrix[5, 5]
    rate, there = np.zeros(t.size), 0.0
    for n in range(1, t.size):
        rudder[n - 1] -= autopilot * rate[n - 1] / turning
        there += (rudder[n - 1] - there) * (1.0 - np.exp(-STEP_S / 0.12) if autopilot else 1.0)
        rate[n] = rate[n - 1] + STEP_S * (turning * there - damping * rate[n - 1])
    angles = np.outer(rudder, one)
    noise = 0.002 * rng.standard_normal((t.size, 3))
    heading = np.cumsum(rate) * STEP_S
    log.streams["imu"] = {
        "time_us": micro(t),
        "gyro_x_rad_s": noise[:, 0],
        "gyro_y_rad_s": noise[:, 1],
        "gyro_z_rad_s": rate + noise[:, 2],
        "accel_x_m_s2": noise[:, 0],
        "accel_y_m_s2": noise[:, 1],
        "accel_z_m_s2": noise[:, 2] - 9.8,
    }
    log.streams["attitude"] = {
        "time_us": micro(t),
        **dict.fromkeys(("phi_rad", "theta_rad"), noise[:, 0]),
        "psi_rad": np.mod(heading, 2.0 * np.pi),
    }
    log.streams["velocity"] = {
        "time_us": micro(t),
        "u_m_s": AHEAD_M_S + noise[:, 0],
        "v_m_s": noise[:, 1],
        "w_m_s": noise[:, 2],
    }
    recorded: dict[str, Any] = dict(zip(FINS, (angles * factors).T, strict=True))
    log.streams["actuators"] = {"time_us": micro(t + late_s), **recorded}
    return log


def of_fins(log: Log) -> list[tuple[str, str]]:
    """Findings whose words name fins."""
    return [
        (item["id"], item["text"])
        for item in log.health()["findings"]
        if " fin " in item["text"] or " fins " in item["text"]
    ]


@pytest.mark.parametrize(("gear", "named"), [(1.0, False), (1.5, False), (2.0, True), (4.0, True)])
def test_turns_of_a_motor_before_its_gear_are_named(gear: float, named: bool) -> None:
    log = sound()
    log.vehicle = vehicle_from_document(vehicle_document("vt690"))
    columns = log.streams["actuators"]
    columns["propeller_rev_s"] = np.full(columns["time_us"].size, gear * 35.0)
    log.streams["velocity"]["u_m_s"] = AHEAD_M_S + 0.1 * log.streams["velocity"]["v_m_s"]
    ids = [item["id"] for item in propeller_findings(checked(log))]
    assert ids == (["propeller_speed"] if named else [])


def test_fins_of_a_right_file_have_no_finding() -> None:
    assert of_fins(yawing()) == []


@pytest.mark.parametrize(
    ("late_s", "factors", "name", "words"),
    [
        (0.8, (1.0, 1.0, 1.0, 1.0), "command_late", "s before its stamp"),
        (-1.0, (1.0, 1.0, 1.0, 1.0), "commands_early", "s after its stamp"),
        (
            0.0,
            (-1.0, -1.0, -1.0, -1.0),
            "response_sign",
            "fins of yaw, fin_b and fin_t, have the wrong sign",
        ),
        (0.0, (1.0, 1.0, 1.0, -1.0), "response_order", "The top fin acts backward"),
        (0.0, (0.2, 0.2, 0.2, 0.2), "response_scale", "times as fast"),
    ],
)
def test_a_fault_of_the_fins_is_named(
    late_s: float, factors: tuple[float, ...], name: str, words: str
) -> None:
    (item,) = of_fins(yawing(late_s, factors))
    assert item[0] == name
    assert words in item[1]


@pytest.mark.parametrize(
    ("gains", "explained", "wrong"),
    [((-0.4, -0.5, -0.2), 0.7, True), ((-0.4, 0.1, -0.2), 0.7, False), ((-0.4,), 0.5, False)],
)
def test_fins_are_backward_where_every_lag_that_they_have_says_so(
    gains: tuple[float, ...], explained: float, wrong: bool
) -> None:
    """A feedback turns the sign of a gain at some lag, and of an axis that fins do not drive."""
    one = np.ones(1)
    by_lag = [AxisGains(gain * one, 0.01 * one, explained, 800, one) for gain in gains]
    assert _backward(by_lag) == wrong


@pytest.mark.parametrize(("autopilot", "damping"), [(3.0, 6.0), (2.0, 6.0), (1.5, 3.0)])
def test_an_autopilot_that_follows_the_rate_makes_no_wrong_size(
    autopilot: float, damping: float
) -> None:
    assert of_fins(yawing(autopilot=autopilot, damping=damping)) == []


def test_a_fin_without_a_moment_in_an_axis_is_not_what_acts_backward_there() -> None:
    log = yawing()
    log.ids()
    recorded = checked(log)
    angles = recorded.values("actuators", FINS)
    (own,) = _gains(recorded, angles, YAW, np.zeros(1))
    assert own is not None
    (item,) = _turned(recorded, angles, YAW, replace(own, gain=-own.gain))
    assert item["id"] == "response_sign"
