"""The installation of all legs together: figures, verdicts, words, and what is missing."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from auvid.data_schemas.documents import check_document
from auvid.data_schemas.records.motion import InstallationRecord
from auvid.stages import check_installation, fuse
from auvid.stages.base import collection
from auvid.stages.check_installation.presentation import findings
from tests.support.motions import ODD, Motion, Sensors, rich_motion
from tests.unit.stages.test_fuse_smoother import inputs as fuse_inputs


@pytest.fixture(scope="module")
def motions() -> list[Motion]:
    return [rich_motion(40.0, seed=seed) for seed in (4, 5)]


def inputs(
    motions: list[Motion], sensors: Sensors, by_file: Sensors | None = None
) -> check_installation.Inputs:
    legs: dict[str, fuse.Inputs] = {}
    for name, motion in zip(("one", "two"), motions, strict=True):
        legs[name] = fuse_inputs(motion, sensors, by_file)

    def each(port: str) -> Any:
        return collection({name: getattr(leg, port) for name, leg in legs.items()})

    return check_installation.Inputs(
        each("resampled"),
        each("segment"),
        collection({"log": legs["one"].log_info}),
        legs["one"].vehicle,
        each("samples_imu"),
        each("samples_velocity"),
        each("samples_depth"),
    )


def run(inputs: check_installation.Inputs) -> InstallationRecord:
    result = check_installation.run(inputs, check_installation.Params())
    check_document(result.installation, "installation")
    return result.installation


def departing(record: InstallationRecord) -> dict[str, float]:
    return {item.name: item.departure for item in record.figures if item.verdict == "departs"}


def test_a_right_file_agrees(motions: list[Motion]) -> None:
    record = run(inputs(motions, ODD))
    assert departing(record) == {}
    assert findings(record) == []
    assert {item.name for item in record.figures if item.verdict == "agrees"} >= {
        "arm x", "arm y", "arm z", "angle y", "angle z",
    }  # fmt: skip
    assert record.estimate is not None
    np.testing.assert_allclose(record.estimate.arm_m, ODD.dvl_arm, atol=0.01)
    assert record.legs == ["one", "two"]


def test_a_wrong_arm_is_named_with_the_right_one(motions: list[Motion]) -> None:
    by_file = replace(ODD, dvl_arm=ODD.dvl_arm - [0.5, 0.0, 0.0])
    result = check_installation.run(inputs(motions, ODD, by_file), check_installation.Params())
    record = result.installation
    assert departing(record) == pytest.approx({"arm x": 0.5}, abs=0.02)
    arm = next(item for item in record.figures if item.name == "arm x")
    assert arm.corrected == pytest.approx(ODD.dvl_arm[0], abs=0.02)
    (words,) = findings(record)
    assert "arm forward departs by +0.5" in words
    assert "stages.fuse.installation: estimate" in words
    assert words in str(result.section)
    assert record.estimate is not None
    np.testing.assert_allclose(record.estimate.arm_m, ODD.dvl_arm, atol=0.02)


def test_a_turned_log_is_named_in_degrees(motions: list[Motion]) -> None:
    # The mounting is given in Euler angles: a further yaw is a further turn about z.
    by_file = replace(ODD, dvl_mounting=ODD.dvl_mounting - [0.0, 0.0, 0.05])
    record = run(inputs(motions, ODD, by_file))
    turned = np.array([departing(record).get(f"angle {axis}", 0.0) for axis in "xyz"])
    assert np.linalg.norm(turned) == pytest.approx(0.05, abs=0.01)
    assert "deg" in " ".join(findings(record))


def test_the_other_convention_is_named(motions: list[Motion]) -> None:
    by_file = replace(ODD, convention="inertial")
    sensors = inputs(motions, ODD, by_file)
    info = sensors.log_info["log"].model_copy(update={"accelerometer": None})
    record = run(replace(sensors, log_info=collection({"log": info})))
    assert (record.convention, record.convention_found) == ("inertial", "specific_force")
    assert record.estimate is None
    (words,) = findings(record)
    assert "Set accelerometer: specific_force" in words


def test_without_the_sensors_nothing_is_called_right(motions: list[Motion]) -> None:
    sensors = inputs(motions, ODD)
    for port, words in (
        ("samples_velocity", "no velocity log"),
        ("samples_imu", "no accelerometer"),
        ("samples_depth", "no depth sensor"),
    ):
        record = run(replace(sensors, **{port: None}))
        assert {item.verdict for item in record.figures} == {"not observable"}
        assert record.estimate is None
        assert record.left_out == {"one": words, "two": words}
