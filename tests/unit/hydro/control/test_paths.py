"""Paths of a vehicle: defining geometry of helix, saw-tooth and Dubins paths, frames,
arc length, tracking errors.
"""

from __future__ import annotations

import numpy as np
import pytest

from auvid.data_schemas.errors import CampaignError
from auvid.hydro.control.paths.dubins import Bounds, Pose, dubins_path
from auvid.hydro.control.paths.paths import (
    Curve,
    frame_roll,
    frenet_frame,
    helix,
    path_of_pieces,
    saw_tooth,
)
from auvid.hydro.control.paths.trajectories import fly_path, tracking_error, trajectory_through

POSES = [
    (Pose(0, 0, 0, 0, 0.1), Pose(60, 30, 12, 1.5, 0.0)),
    (Pose(0, 0, 0, 0, 0.2), Pose(10, 3, 50, 1.5, -0.2)),
    (Pose(5, -3, 10, -2.0, 0.0), Pose(100, -40, 5, 3.0, 0.1)),
]


def test_helix_has_its_radius_pitch_length_and_curvature() -> None:
    path = helix(radius_m=12.0, pitch_rad=0.1, turns=3.0)
    points = path.at(np.linspace(0.0, path.length_m, 500))
    radius = np.hypot(points.position[:, 0], points.position[:, 1] - 12.0)
    assert path.length_m == pytest.approx(3.0 * 2.0 * np.pi * 12.0 / np.cos(0.1), rel=1e-12)
    assert np.allclose(radius, 12.0, atol=1e-9)
    assert points.position[-1, 2] == pytest.approx(-path.length_m * np.sin(0.1), abs=1e-9)
    assert np.allclose(points.curvature, np.cos(0.1) ** 2 / 12.0, atol=1e-12)


@pytest.mark.parametrize(
    "path",
    [
        helix(radius_m=9.0, pitch_rad=-0.2, turns=1.0, ramp_m=4.0),
        dubins_path(*POSES[0], Bounds(12.0, 0.35, 30.0)),
    ],
)
def test_arc_length_and_tangent_agree_with_the_positions(path: Curve) -> None:
    s = np.linspace(0.0, path.length_m, 20001)
    points = path.at(s)
    chord = np.linalg.norm(np.diff(points.position, axis=0), axis=1)
    assert chord.sum() == pytest.approx(
        path.length_m, rel=1e-6
    )  # chords cut arcs of 12 m radius by 1e-7
    middle = 0.5 * (points.tangent[1:] + points.tangent[:-1])
    assert (
        np.abs(np.diff(points.position, axis=0) / chord[:, None] - middle).max() < 5e-4
    )  # a jump of curvature inside one step


@pytest.mark.parametrize("ramp_m", [0.0, 6.0])
@pytest.mark.parametrize(("first", "last"), POSES)
def test_dubins_path_joins_the_poses_within_its_bounds(
    first: Pose, last: Pose, ramp_m: float
) -> None:
    bounds = Bounds(12.0, 0.35, 30.0, ramp_m)
    path = dubins_path(first, last, bounds)
    end = path.at(path.length_m)
    assert np.allclose(end.position[0], [last.x, last.y, last.z], atol=1e-6)
    assert np.cos(end.heading[0] - last.heading) == pytest.approx(1.0, abs=1e-12)
    assert end.pitch[0] == pytest.approx(last.pitch, abs=1e-9)
    points = path.at(np.linspace(0.0, path.length_m, 20001))
    assert np.abs(points.pitch).max() <= 0.35 + 1e-9
    assert points.curvature.max() <= np.hypot(1.0 / 12.0, 1.0 / 30.0) + 1e-9
    assert [name for name, _ in path.segments].count("straight line") == 1
    assert len(path.segments) == 5


def test_continuous_curvature_has_no_jump_and_the_classic_path_has() -> None:
    def jump(ramp_m: float) -> float:
        path = dubins_path(*POSES[0], Bounds(12.0, 0.35, 30.0, ramp_m))
        return float(
            np.abs(np.diff(path.at(np.linspace(0.0, path.length_m, 40001)).heading_rate)).max()
        )

    assert jump(6.0) < 1e-4
    assert jump(0.0) > 0.07


def test_dubins_path_in_a_straight_line_is_that_line() -> None:
    path = dubins_path(
        Pose(0, 0, 0, 0.3, 0.1),
        Pose(20 * np.cos(0.3), 20 * np.sin(0.3), -20 * np.tan(0.1), 0.3, 0.1),
        Bounds(10.0, 0.4, 20.0),
    )
    assert path.length_m == pytest.approx(20.0 / np.cos(0.1), abs=1e-6)


def test_impossible_dubins_pairs_say_what_is_missing() -> None:
    with pytest.raises(CampaignError, match="steeper than the path may be"):
        dubins_path(Pose(0, 0, 0, 0, 0.5), Pose(50, 0, 0, 0, 0), Bounds(10.0, 0.35, 20.0))
    with pytest.raises(
        CampaignError, match=r"no Dubins path of five segments.*turns of 10 m radius"
    ):
        dubins_path(Pose(0, 0, 0, 0, 0), Pose(50, 0, 5000, 0, 0), Bounds(10.0, 0.35, 20.0))
    with pytest.raises(CampaignError, match="must be positive"):
        dubins_path(Pose(0, 0, 0, 0, 0), Pose(50, 0, 0, 0, 0), Bounds(0.0, 0.35, 20.0))


def test_saw_tooth_returns_to_its_depth_with_rounded_tips() -> None:
    path = saw_tooth(leg_m=15.0, pitch_rad=0.4, tip_radius_m=5.0, legs=4, ramp_m=1.0)
    end = path.at(path.length_m)
    assert end.position[0, 2] == pytest.approx(0.0, abs=1e-9)
    points = path.at(np.linspace(0.0, path.length_m, 20001))
    assert points.curvature.max() <= 1.0 / 5.0 + 1e-9
    assert (points.pitch.min(), points.pitch.max()) == pytest.approx((-0.4, 0.4), abs=1e-9)


def test_a_piece_shorter_than_its_ramp_is_refused() -> None:
    with pytest.raises(CampaignError, match="shorter than the ramp"):
        path_of_pieces((0, 0, 0), 0.0, 0.0, [("turn", 1.0, 0.1, 0.0)], ramp_m=2.0)


def test_frenet_frames_are_rotations_and_keep_the_vehicle_upright_on_turns_and_lines() -> None:
    pieces = [
        ("line", 10.0, 0.0, 0.0),
        ("port", 10.0, -0.1, 0.0),
        ("line", 10.0, 0.0, 0.0),
        ("starboard", 10.0, 0.1, 0.02),
    ]
    points = path_of_pieces((0, 0, 0), 0.0, 0.1, pieces).at(np.linspace(0.0, 40.0, 401))
    frame = frenet_frame(points)
    assert np.allclose(frame @ frame.swapaxes(-1, -2), np.eye(3), atol=1e-12)
    assert np.allclose(np.linalg.det(frame), 1.0)
    roll = frame_roll(frame)
    assert np.abs(roll[points.s_m < 30.0]).max() < 1e-9
    assert np.abs(roll).max() < np.pi / 2
    assert np.abs(roll[points.s_m > 31.0]).max() > 0.1


def test_a_recorded_helix_gives_the_trajectory_that_flew_it() -> None:
    flown = fly_path(helix(radius_m=12.0, pitch_rad=0.1, turns=2.0), speed_m_s=1.5, step_s=0.05)
    trajectory = trajectory_through(flown.t_s, flown.position)
    for name in ("velocity", "attitude", "attitude_rate", "s_m"):
        assert np.abs(getattr(trajectory, name) - getattr(flown, name)).max() < 1e-8


def test_tracking_error_tells_late_from_beside() -> None:
    path = fly_path(helix(radius_m=12.0, pitch_rad=0.1, turns=2.0), speed_m_s=1.5, step_s=0.05)
    late = np.roll(path.position, 10, axis=0)[10:]
    error = tracking_error(path, np.vstack([path.position[:10], late]))
    assert error.position_m[-1] == pytest.approx(1.5 * 0.05 * 10, rel=0.01)
    assert error.cross_track_m.max() < 1e-3  # chord of a step against the arc
    abeam = tracking_error(path, path.position + np.array([0.0, 0.0, 1.0]))
    assert np.allclose(
        abeam.cross_track_m, 1.0, atol=0.02
    )  # the helix rises by 0.1, so the nearest point lies a little ahead
    early = path.position + 0.2 * path.velocity / 1.5
    error = tracking_error(path, early)
    assert error.position_m[-1] == pytest.approx(0.2, rel=0.01)
    assert error.cross_track_m[-1] < 0.01, "past the end of the path, and not beside it"


@pytest.mark.parametrize(
    ("speed", "frame", "words"),
    [(0.0, "level", "positive speed"), (1.0, "banked", "unknown frame")],
)
def test_wrong_figures_of_a_trajectory_are_named(speed: float, frame: str, words: str) -> None:
    with pytest.raises(CampaignError, match=words):
        fly_path(
            helix(radius_m=12.0, pitch_rad=0.1, turns=2.0),
            speed_m_s=speed,
            step_s=0.05,
            frame=frame,
        )


def test_a_recording_that_stands_still_has_no_path() -> None:
    with pytest.raises(CampaignError, match="stands still"):
        trajectory_through(np.arange(20.0), np.zeros((20, 3)))
