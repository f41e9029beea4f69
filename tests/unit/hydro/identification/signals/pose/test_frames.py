"""Frames of poses: by rotation matrices and by the motion that comes out."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from auvid.hydro.identification.signals.pose.frames import (
    Body,
    World,
    continuous_signs,
    euler_of_quaternion,
    in_ned,
    ned_from_frd,
    quaternion_of_euler,
    rotated,
)

ANGLES = np.random.default_rng(0).uniform([-3, -1.5, -3], [3, 1.5, 3], (50, 3))


def test_quaternions_are_those_of_scipy() -> None:
    there = Rotation.from_euler("ZYX", ANGLES[:, ::-1])
    mine = quaternion_of_euler(ANGLES)
    np.testing.assert_allclose(mine, there.as_quat(canonical=False)[:, [3, 0, 1, 2]], atol=1e-12)
    np.testing.assert_allclose(euler_of_quaternion(-3.0 * mine), ANGLES, atol=1e-9)
    vectors = np.random.default_rng(1).normal(size=(50, 3))
    np.testing.assert_allclose(rotated(mine, vectors), there.apply(vectors), atol=1e-12)


@pytest.mark.parametrize(
    ("world", "body", "down", "forward"),
    [
        ("enu", "flu", [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]),
        ("nwu", "flu", [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]),
        ("ned", "frd", [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]),
        ("nue", "fur", [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]),
    ],
)
def test_a_body_that_looks_north_has_no_attitude(
    world: World, body: Body, down: list[float], forward: list[float]
) -> None:
    # Columns of the matrix: body axes in the world of the file, looking north, upright.
    right = np.cross(down, forward)
    axes = {"f": np.array(forward), "r": right, "d": np.array(down), "l": -right}
    matrix = np.column_stack([(axes | {"u": -axes["d"]})[letter] for letter in body])
    q = Rotation.from_matrix(matrix).as_quat()[[3, 0, 1, 2]]
    np.testing.assert_allclose(
        euler_of_quaternion(ned_from_frd(q[None], world, body)), np.zeros((1, 3)), atol=1e-12
    )
    np.testing.assert_allclose(in_ned([down], world), [[0.0, 0.0, 1.0]], atol=1e-12)


def test_a_pose_with_y_up_is_that_of_scipy() -> None:
    to_ned = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])  # x, z, -y
    there = Rotation.from_euler("ZYX", ANGLES[:, ::-1])
    file = Rotation.from_matrix(to_ned.T @ there.as_matrix() @ to_ned)
    q = file.as_quat(canonical=False)[:, [3, 0, 1, 2]]
    np.testing.assert_allclose(
        euler_of_quaternion(ned_from_frd(q, "nue", "fur")), ANGLES, atol=1e-9
    )
    np.testing.assert_allclose(in_ned([[1.0, 2.0, 3.0]], "nue"), [[1.0, 3.0, -2.0]], atol=1e-12)


def test_an_outlier_does_not_turn_the_signs_behind_it() -> None:
    q = np.tile([1.0, 0.0, 0.0, 0.2], (20, 1)) * np.where(np.arange(20) % 3, 1.0, -1.0)[:, None]
    q[9] = [0.01, 1.0, 0.0, -1.0]
    signs = np.sign(continuous_signs(q)[np.arange(20) != 9, 0])
    assert np.unique(signs).size == 1
