"""Poses, quaternions, world velocities and times of day of CSV files."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from auvid.data_schemas.errors import PipelineError
from auvid.hydro.arrays import Array
from auvid.stages.base import RawFile
from auvid.stages.ingest.formats.csv.reader import read_csv
from tests.support.pose_runs import PoseRun, pose_run

RUN = pose_run(np.arange(0.0, 20.0, 0.1), 1)
UPWARD_Y = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0.0]])
TURNED = {
    "ned": np.eye(3),
    "enu": np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1.0]]),
    "y_up": UPWARD_Y,
}
"""Vectors of north-east-down in the world of the file."""
BACK = {"ned": np.eye(3), "enu": np.diag([1.0, -1.0, -1.0]), "y_up": UPWARD_Y.T}


def read(columns: dict[str, Array], entries: Sequence[tuple[str, ...]], **more: Any) -> Any:
    """Return a decoded CSV file; entries: column, stream, field, unit, frame."""
    rows = [",".join(columns)]
    for row in zip(*columns.values(), strict=True):
        rows.append(",".join(item if isinstance(item, str) else f"{item:.9g}" for item in row))
    data = np.frombuffer("\n".join(rows).encode(), np.uint8)
    keys = ("column", "stream", "field", "unit", "frame")
    document = {
        "time": {"column": "t", "unit": "s", **more},
        "columns": [dict(zip(keys, entry, strict=False)) for entry in entries],
    }
    return read_csv(RawFile("log.csv", data, document))[0]


def body_to_world(run: PoseRun, world: str) -> Rotation:
    """Return the rotations from the body axes of a file to its world."""
    return Rotation.from_matrix(TURNED[world] @ run.rotation @ BACK[world])


def columns_of(world: str) -> dict[str, Array]:
    """Return a file in a world frame: position, angles, quaternion, world velocity."""
    turn = body_to_world(RUN, world)
    names, order = ("yaw", "pitch", "roll"), "YZX" if world == "y_up" else "ZYX"
    velocity = np.einsum("nij,nj->ni", RUN.rotation, RUN.velocity) @ TURNED[world].T
    return {
        "t": RUN.t_s,
        **dict(zip("xyz", (RUN.position @ TURNED[world].T).T, strict=True)),
        **dict(zip(names, turn.as_euler(order).T, strict=True)),
        **dict(zip(("qx", "qy", "qz", "qw"), turn.as_quat().T, strict=True)),
        **dict(zip(("v1", "v2", "v3"), velocity.T, strict=True)),
    }


PLACE = [("x", "pose", "x_m", "m"), ("y", "pose", "y_m", "m"), ("z", "pose", "z_m", "m")]
ANGLES = [
    (name, "pose", field, "rad")
    for name, field in (("roll", "phi_rad"), ("pitch", "theta_rad"), ("yaw", "psi_rad"))
]
QUATERNION = [(f"q{part}", "pose", f"q_{part}", "1") for part in "wxyz"]


@pytest.mark.parametrize("world", TURNED)
@pytest.mark.parametrize("attitude", [ANGLES, QUATERNION])
def test_a_pose_in_its_frame(world: str, attitude: list[tuple[str, ...]]) -> None:
    entries = [(*entry, world) for entry in PLACE + attitude]
    pose = read(columns_of(world), entries).messages["pose"]
    position = np.column_stack([pose.columns[name] for name in ("x_m", "y_m", "z_m")])
    np.testing.assert_allclose(position, RUN.position, atol=1e-6)
    angles = np.column_stack([pose.columns[name] for name in ("phi_rad", "theta_rad", "psi_rad")])
    off = Rotation.from_euler("ZYX", angles[:, ::-1]).inv() * Rotation.from_matrix(RUN.rotation)
    assert off.magnitude().max() < 1e-6


@pytest.mark.parametrize("world", TURNED)
def test_a_velocity_of_the_world_and_a_quaternion(world: str) -> None:
    entries = [(f"q{part}", "attitude", f"q_{part}", "1", world) for part in "wxyz"]
    fields = ("v_north_m_s", "v_east_m_s", "v_down_m_s")
    entries += [
        (name, "velocity", field, "m/s", world)
        for name, field in zip(("v1", "v2", "v3"), fields, strict=True)
    ]
    log = read(columns_of(world), entries)
    velocity = log.messages["velocity"]
    body = np.column_stack([velocity.columns[name] for name in ("u_m_s", "v_m_s", "w_m_s")])
    np.testing.assert_allclose(body, RUN.velocity, atol=1e-5)
    assert not any("cannot be turned" in note for note in log.notes)


def test_angles_places_and_depths_with_y_up() -> None:
    columns = columns_of("y_up")
    entries = [(name, "attitude", field, unit, "y_up") for name, _, field, unit in ANGLES]
    entries += [("y", "depth", "depth_m", "m", "y_up")]
    messages = read(columns, entries).messages
    np.testing.assert_allclose(messages["depth"].columns["depth_m"], RUN.position[:, 2], atol=1e-6)
    angles = np.column_stack(
        [messages["attitude"].columns[name] for name in ("phi_rad", "theta_rad", "psi_rad")]
    )
    off = Rotation.from_euler("ZYX", angles[:, ::-1]).inv() * Rotation.from_matrix(RUN.rotation)
    assert off.magnitude().max() < 1e-6
    with pytest.raises(PipelineError, match="is a body axis"):
        read(columns, [("x", "velocity", "u_m_s", "m/s", "y_up")])


def test_a_velocity_of_the_world_without_attitude_is_said() -> None:
    fields = ("v_north_m_s", "v_east_m_s", "v_down_m_s")
    entries = [(f"v{k}", "velocity", name, "m/s") for k, name in enumerate(fields, 1)]
    log = read(columns_of("ned"), entries)
    assert np.isnan(log.messages["velocity"].columns["u_m_s"]).all()
    assert any("no attitude or pose" in note for note in log.notes)


def test_parts_and_mixed_frames_are_refused_together() -> None:
    with pytest.raises(PipelineError, match="Map a column to q_z too"):
        read(columns_of("ned"), [*PLACE, *QUATERNION[:3]])
    mixed = [(*entry, "enu") for entry in PLACE] + ANGLES
    with pytest.raises(PipelineError, match="several frames"):
        read(columns_of("enu"), mixed)


@pytest.mark.parametrize("stream", ["pose", "attitude"])
@pytest.mark.parametrize("order", ["xyzw", "wzyx"])
def test_parts_of_a_quaternion_in_another_order_are_named(stream: str, order: str) -> None:
    place = PLACE if stream == "pose" else []
    wrong = [(f"q{a}", stream, f"q_{b}", "1") for a, b in zip("wxyz", order, strict=True)]
    with pytest.raises(PipelineError, match=rf"stream {stream}.*on its back; taken for .*q_w is"):
        read(columns_of("ned"), [*place, *wrong])
    gyro = [("roll", "imu", f"gyro_{axis}_rad_s", "rad/s") for axis in "xyz"]
    assert stream in read(columns_of("ned"), [*place, *wrong, *gyro]).messages  # the check tells
    if order == "xyzw":  # with y up, x and z are tilts
        with pytest.raises(PipelineError, match="on its back; taken for x, y, z, w"):
            read(columns_of("y_up"), [(*entry, "y_up") for entry in [*place, *wrong]])
    upside_down = columns_of("ned") | {"qx": RUN.t_s**0, "qw": 0.1 * np.sin(RUN.t_s)}
    right = [(f"q{part}", stream, f"q_{part}", "1") for part in "wxyz"]
    assert stream in read(upside_down, [*place, *right]).messages


def test_times_of_day_pass_midnight_and_clocks_are_shifted() -> None:
    seconds = [86_395.0 + 0.5 * row for row in range(20)]
    text = [f"{int(s // 3600) % 24:02d}:{int(s // 60) % 60:02d}:{s % 60:04.1f}" for s in seconds]
    columns = {"t": np.array(text, dtype=object), "z": np.arange(20.0)}
    entries = [("z", "depth", "depth_m", "m")]
    log = read(columns, entries, unit="time_of_day", epoch="arbitrary", shift_s=-1.5)
    stamps = log.messages["depth"].columns["time_us"]
    np.testing.assert_allclose(np.diff(stamps), 0.5e6)
    assert stamps[0] == (86_395.0 - 1.5) * 1e6
