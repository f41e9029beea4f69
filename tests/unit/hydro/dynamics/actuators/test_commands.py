"""Forces in full commands: frames of ArduSub, PX4's geometry, thrusters without a curve."""

from __future__ import annotations

import copy
from pathlib import Path

import numpy as np
import pytest

from auvid.data_schemas.errors import PipelineError
from auvid.data_schemas.yaml_text import read_yaml
from auvid.hydro.dynamics.actuators.commands import (
    ARDUSUB_FRAMES,
    commanded_force,
    frame_name,
    frame_thrusters,
    full_commands,
    px4_thrusters,
    unscaled,
)
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.hydro.dynamics.vehicle.logged_directions import turned_as_logged

ROOT = Path(__file__).parents[5]
FULL_US = 400.0


def document(name: str) -> dict:
    return read_yaml((ROOT / f"vehicles/{name}.yaml").read_text())


@pytest.mark.parametrize(
    ("frame", "vehicle"), [("vectored", "bluerov2"), ("vectored_6dof", "bluerov2_heavy")]
)
def test_a_frame_pushes_as_the_geometry_of_its_vehicle(frame, vehicle):
    """Signs of both allocations agree in every axis that the frame mixes."""
    geometry = vehicle_from_document(document(vehicle)).thrusters
    factors = frame_thrusters(frame).allocation
    mixed = factors != 0.0
    assert np.array_equal(np.sign(factors[mixed]), np.sign(geometry.allocation[mixed]))


@pytest.mark.parametrize("frame", ARDUSUB_FRAMES)
def test_each_axis_reaches_one_full_command(frame):
    thrusters = frame_thrusters(frame)
    for axis in np.flatnonzero(full_commands(thrusters)):
        pulses = 1500.0 + FULL_US * np.sign(thrusters.allocation[axis])
        assert commanded_force(thrusters, pulses)[axis] == pytest.approx(1.0)
        assert commanded_force(thrusters, 3000.0 - pulses)[axis] == pytest.approx(-1.0)


def test_an_axis_that_no_thruster_drives_has_no_force():
    force = commanded_force(frame_thrusters("simplerov_3"), np.full((4, 3), 1900.0))
    assert np.all(force[:, 1] == 0.0)


def test_frames_by_number():
    assert [frame_name({"FRAME_CONFIG": float(n)}) for n in (0, 2, 6, 7)] == [
        "bluerov1",
        "vectored_6dof",
        "simplerov_5",
        None,
    ]
    assert frame_name({}) is None


def test_motors_turn_as_the_log_says():
    directions = {f"MOT_{n}_DIRECTION": (-1.0 if n < 3 else 1.0) for n in range(1, 7)}
    turned = turned_as_logged(frame_thrusters("vectored"), directions)
    pulses = [1900.0, 1900.0, 1900.0, 1900.0, 1500.0, 1500.0]
    assert commanded_force(turned, pulses)[0] == pytest.approx(1.0)
    assert turned_as_logged(frame_thrusters("vectored"), {"MOT_1_DIRECTION": 1.0}) is None


def test_geometry_of_px4():
    """Two rotors ahead on either side, one below amidships; outputs exchanged."""
    parameters = {"CA_ROTOR_COUNT": 3.0, "PWM_MAIN_FUNC1": 102.0, "PWM_MAIN_FUNC2": 101.0}
    parameters |= {"PWM_MAIN_FUNC3": 103.0}
    for rotor, side in ((0, 0.2), (1, -0.2)):
        parameters |= {
            f"CA_ROTOR{rotor}_AX": 1.0,
            f"CA_ROTOR{rotor}_AZ": 0.0,
            f"CA_ROTOR{rotor}_PY": side,
        }
    thrusters = px4_thrusters(parameters)
    assert thrusters.outputs == (2, 1, 3)
    assert thrusters.allocation[:, 0] == pytest.approx([1.0, 0.0, 0.0, 0.0, 0.0, -0.2])
    assert thrusters.allocation[:, 2] == pytest.approx([0.0, 0.0, -1.0, 0.0, 0.0, 0.0])
    # The same by controllers on a bus, where the main outputs drive but a light.
    by_bus = {key.replace("PWM_MAIN", "UAVCAN_EC"): value for key, value in parameters.items()} | {
        "PWM_MAIN_FUNC1": 0.0,
        "PWM_MAIN_FUNC4": 407.0,
    }
    assert px4_thrusters(by_bus).outputs == (2, 1, 3)
    assert px4_thrusters({}) is None


def test_thrusters_without_a_curve_give_no_newtons():
    heavy = document("bluerov2_heavy")
    unknown = copy.deepcopy(heavy)
    del unknown["actuators"]["thrusters"]["thrust_curve"]
    unknown["actuators"]["commands"] = {
        "axes": ["surge", "yaw"],
        "full_force": {"surge": {"value": 85.0, "unit": "N", "source": "spring scale"}},
    }
    vehicle, newtons = vehicle_from_document(unknown), vehicle_from_document(heavy)
    assert vehicle.thrusters is None
    assert vehicle.commands.axes == ("X", "N")
    assert vehicle.commands.full_force == {"X": 85.0}
    assert np.array_equal(vehicle.commands.thrusters.allocation, newtons.thrusters.allocation)
    assert vehicle.commands.thrusters.curve is unscaled(newtons.thrusters).curve


def test_a_frame_that_is_none_is_refused_with_those_there_are():
    heavy = document("bluerov2_heavy")
    heavy["actuators"]["commands"] = {"frame": "vectored_8"}
    with pytest.raises(PipelineError, match="vectored_6dof"):
        vehicle_from_document(heavy)
