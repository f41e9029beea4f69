"""Vehicle documents: the two that are shipped, and what is refused."""

import copy
import pickle
from pathlib import Path

import numpy as np
import pytest

from auvid.data_schemas.errors import CampaignError, PipelineError
from auvid.data_schemas.yaml_text import read_yaml
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from tests.support.motions import vehicle_document

ROOT = Path(__file__).parents[5]
DOCUMENTS = {
    name: read_yaml((ROOT / f"vehicles/{name}.yaml").read_text())
    for name in ("vt690", "bluerov2_heavy")
}


@pytest.mark.parametrize("name", DOCUMENTS)
def test_shipped_vehicles_agree_with_the_schema(name):
    vehicle = vehicle_from_document(DOCUMENTS[name])
    assert vehicle.name == name
    np.testing.assert_array_equal(vehicle.mass_matrix, vehicle.mass_matrix.T)
    assert np.linalg.eigvalsh(vehicle.mass_matrix)[0] > 0.0
    np.testing.assert_allclose(
        vehicle.mass_matrix @ vehicle.mass_matrix_inverse, np.eye(6), atol=1e-12
    )
    assert (np.diag(vehicle.added_mass) <= 0.0).all()


def test_vt690_holds_the_tables_of_appendix_b():
    vehicle = vehicle_from_document(DOCUMENTS["vt690"])
    np.testing.assert_array_equal(
        np.diag(vehicle.added_mass), [-0.6673, -40.1654, -40.1654, 0.0, -8.0212, -8.0212]
    )
    assert vehicle.inertia[0, 2] == 0.1407  # printed as the matrix of (2.18), so I_xz = -0.1407
    assert (vehicle.mass_kg, vehicle.displaced_mass_kg) == (41.458, 41.702)
    assert vehicle.propeller is not None
    assert vehicle.accelerometer == "inertial"
    assert vehicle.thrusters is None


def test_bluerov2_sensors_and_thrusters():
    vehicle = vehicle_from_document(DOCUMENTS["bluerov2_heavy"])
    np.testing.assert_array_equal(vehicle.dvl.arm_m, [0.12, 0.0, 0.0])
    np.testing.assert_array_equal(vehicle.imu.rotation, np.eye(3))
    assert (vehicle.dvl.lag_s, vehicle.barometer_instance) == (0.15, 1)
    assert vehicle.thrusters.outputs == tuple(range(1, 9))
    assert vehicle.propeller is None
    assert vehicle.weight == vehicle.buoyancy


def test_assumed_numbers_are_listed_with_value_unit_and_source():
    assumed = vehicle_from_document(DOCUMENTS["bluerov2_heavy"]).assumed
    assert any(line.startswith("rigid_body.mass = 13.5 kg (von Benzon") for line in assumed)
    assert any(line.startswith("sensors.dvl.lag = 0.15 s") for line in assumed)
    listed = [line.split(" = ")[0] for line in vehicle_from_document(DOCUMENTS["vt690"]).assumed]
    assert "actuators.propeller.level_speed.speed" in listed
    assert "rigid_body.mass" not in listed


def test_units_are_converted():
    document = copy.deepcopy(DOCUMENTS["vt690"])
    document["rigid_body"]["mass"].update(value=41458.0, unit="g")
    document["rigid_body"]["centre_of_gravity"].update(value=[-2.9, -0.2, 8.4], unit="mm")
    document["sensors"]["dvl"]["mounting"] = {
        "value": [0.0, 0.0, 45.0],
        "unit": "deg",
        "source": "test",
    }
    vehicle, plain = vehicle_from_document(document), vehicle_from_document(DOCUMENTS["vt690"])
    assert plain.actuator_lag_s is None
    document["actuators"]["lag"] = {"value": 120.0, "unit": "ms", "source": "test"}
    assert vehicle_from_document(document).actuator_lag_s == pytest.approx(0.12, rel=1e-15)
    assert vehicle.mass_kg == pytest.approx(plain.mass_kg, rel=1e-15)
    np.testing.assert_allclose(vehicle.r_G, plain.r_G, rtol=1e-12)
    np.testing.assert_allclose(
        vehicle.dvl.rotation @ [1.0, 0.0, 0.0], [np.sqrt(0.5), np.sqrt(0.5), 0.0], rtol=1e-12
    )


def test_off_diagonal_added_mass_is_symmetric():
    document = copy.deepcopy(DOCUMENTS["vt690"])
    document["added_mass"]["Y_rdot"] = {"value": 1.5, "unit": "kg*m", "source": "test"}
    added = vehicle_from_document(document).added_mass
    assert added[1, 5] == added[5, 1] == 1.5


def test_a_vehicle_pickles_and_cannot_be_written_to():
    vehicle = vehicle_from_document(DOCUMENTS["bluerov2_heavy"])
    again = pickle.loads(pickle.dumps(vehicle))
    np.testing.assert_array_equal(again.mass_matrix, vehicle.mass_matrix)
    with pytest.raises(ValueError, match="read-only"):
        vehicle.mass_matrix[0, 0] = 1.0


def drop(*path):
    def change(document):
        for key in path[:-1]:
            document = document[key]
        del document[path[-1]]

    return change


def put(value, *path):
    def change(document):
        for key in path[:-1]:
            document = document[key]
        document[path[-1]] = value

    return change


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("vt690", drop("rigid_body", "mass"), "rigid_body.mass"),
        ("vt690", drop("added_mass", "N_rdot"), "added_mass.N_rdot"),
        ("vt690", put(0.6673, "added_mass", "X_udot", "value"), "added mass is positive"),
        (
            "vt690",
            put([[-0.2, 0, 0], [0, 1, 0], [0, 0, 1]], "rigid_body", "inertia", "value"),
            "not positive definite",
        ),
        ("vt690", put(-1.0, "rigid_body", "mass", "value"), "must be positive"),
        ("vt690", put("m", "rigid_body", "mass", "unit"), "rigid_body.mass.unit"),
        ("vt690", put([0.1, 0.2], "rigid_body", "centre_of_gravity", "value"), "wrong shape"),
        ("vt690", put(["a", 0, 0], "rigid_body", "centre_of_gravity", "value"), "not numbers"),
        ("vt690", put(float("nan"), "rigid_body", "mass", "value"), "not finite"),
        ("vt690", put(41.458, "rigid_body", "mass"), "not a quantity"),
        ("vt690", put(3, "rigid_body"), "not a mapping"),
        (
            "vt690",
            put([[1, 2, 0], [0, 1, 0], [0, 0, 1]], "rigid_body", "inertia", "value"),
            "not symmetric",
        ),
        (
            "vt690",
            put(
                [0, 30, 20, 40, 50, 60],
                "actuators",
                "propeller",
                "level_speed",
                "propeller_speed",
                "value",
            ),
            "ascending",
        ),
        ("vt690", put("up", "sensors", "imu", "accelerometer"), "accelerometer"),
        (
            "bluerov2_heavy",
            put([1, -1, 0, 1, 1, 1, 1, 1], "actuators", "thrusters", "direction", "value"),
            "neither 1 nor -1",
        ),
        (
            "bluerov2_heavy",
            put([[1, 1, 0]] * 8, "actuators", "thrusters", "axis", "value"),
            "unit length",
        ),
        ("bluerov2_heavy", put([1, 2, 3], "actuators", "thrusters", "outputs"), "output channel"),
    ],
)
def test_what_cannot_be_a_vehicle_is_refused(name, change, message):
    document = copy.deepcopy(DOCUMENTS[name])
    change(document)
    with pytest.raises(PipelineError, match=message):
        vehicle_from_document(document)


def test_a_vehicle_may_have_no_actuator():
    """A glider or a towed body: its logs can be checked and its motion fused."""
    document = vehicle_document("vt690")
    for actuators in ({"actuators": {}}, {}):
        bare = {key: value for key, value in document.items() if key != "actuators"} | actuators
        vehicle = vehicle_from_document(bare)
        assert vehicle.propeller is vehicle.fins is vehicle.thrusters is None


def test_the_fault_names_the_field():
    document = copy.deepcopy(DOCUMENTS["bluerov2_heavy"])
    document["actuators"]["thrusters"]["thrust_curve"]["force"]["value"] = [1.0, 2.0]
    with pytest.raises(CampaignError) as fault:
        vehicle_from_document(document)
    assert fault.value.field == "actuators.thrusters.thrust_curve.pulse_width"
