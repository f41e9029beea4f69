"""Velocity from poses: against truth, filterpy's smoother, and named faults."""

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array
from auvid.hydro.identification.signals.pose import compiled_track
from auvid.hydro.identification.signals.pose.frames import euler_of_quaternion
from auvid.hydro.identification.signals.pose.track import (
    LARGEST_RATE,
    PoseTrack,
    pose_track,
    smooth_columns,
)
from tests.support.pose_runs import PoseRun, pose_run, tracked

ARM = (0.2, -0.1, -0.3)
MOCAP_S = np.arange(0.0, 60.0, 0.01)
VISUAL_S = np.arange(0.0, 120.0, 1.0 / 15.0)


def rmse(values: Array) -> float:
    """Return the root of the mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def errors(run: PoseRun, track: PoseTrack) -> tuple[Array, Array]:
    """Return errors of velocity and rate (m, 3)."""
    at = np.searchsorted(run.t_s, track.t_s)
    return track.velocity - run.velocity[at], track.rate - run.rate[at]


@pytest.mark.parametrize("seed", [1, 2])
def test_motion_capture_off_the_origin(seed: int) -> None:
    # 100 Hz, 1 mm, 2 mrad: half a centimetre per second, over twenty times better than
    # differences of neighbouring samples (1.4 mm / 10 ms).
    run = pose_run(MOCAP_S, seed)
    track = pose_track(
        run.t_s, *tracked(run, seed, noise_m=1e-3, noise_rad=2e-3, arm_m=ARM), arm_m=ARM
    )
    velocity, rate = errors(run, track)
    assert rmse(velocity) < 6e-3
    assert rmse(rate) < 12e-3
    assert np.mean(np.abs(velocity) < 1.96 * track.velocity_sd) > 0.93
    assert np.mean(np.abs(rate) < 1.96 * track.rate_sd) > 0.93
    np.testing.assert_allclose(track.noise_m, 1e-3, rtol=0.1)
    assert track.noise_rad == pytest.approx(2e-3, rel=0.1)
    assert track.faults == ()
    assert len(track.pieces) == 1


@pytest.mark.parametrize("seed", [1, 2])
def test_visual_tracking_with_gaps_and_outliers(seed: int) -> None:
    # 15 Hz, 1 cm, 5 % outliers: 15 cm/s by differences.
    run = pose_run(VISUAL_S, seed)
    position, attitude = tracked(run, seed, noise_m=1e-2, noise_rad=1e-2, outliers=0.05)
    gap = (run.t_s > 40.0) & (run.t_s < 42.5)
    track = pose_track(run.t_s[~gap], position[~gap], attitude[~gap])
    velocity, rate = errors(run, track)
    assert rmse(velocity) < 0.04
    assert rmse(rate) < 0.05
    assert np.mean(np.abs(velocity) < 1.96 * track.velocity_sd) > 0.93
    off = np.linalg.norm(position - run.position, axis=1) > 0.1
    inside = np.isin(run.t_s, track.t_s)
    assert np.isin(run.t_s[off & inside], track.outliers_s).all()
    assert np.count_nonzero(off) - 3 < track.outliers_s.size < np.count_nonzero(off) + 10
    (fault,) = track.faults
    assert fault.kind == "gap"
    assert fault.start_s <= 40.0
    assert fault.end_s >= 42.5
    assert fault.end_s - fault.start_s < 3.0


def test_precise_tracker_of_a_vehicle_that_is_thrown_about() -> None:
    # Torque in steps behind a lag of .15 s, attitude without noise but for its last digit.
    t = np.arange(0.0, 40.0, 0.01)
    torque = np.repeat(np.random.default_rng(5).choice([-8.0, 0.0, 8.0], 20), 200)
    rate, yaw, state = np.zeros(t.size), np.zeros(t.size), np.zeros(3)
    for i in range(t.size):
        rate[i], yaw[i] = state[1], state[2]
        for _ in range(10):
            lagged, r, _psi = state
            state = state + 1e-3 * np.array([(torque[i] - lagged) / 0.15, lagged - 2.0 * r, r])
    position = np.random.default_rng(6).normal(0.0, 1e-3, (t.size, 3))
    attitude = np.round(np.column_stack([np.zeros((t.size, 2)), yaw]), 6)
    track = pose_track(t, position, attitude)
    assert track.faults == ()
    assert track.t_s.size == t.size
    assert rmse(track.rate[50:-50, 2] - rate[50:-50]) < 0.02
    assert np.isfinite(track.rate_sd).all()
    assert np.all(track.rate_sd > 0.0)


def test_smoother_is_that_of_filterpy() -> None:
    run = pose_run(np.sort(np.random.default_rng(4).uniform(0.0, 20.0, 200)), 4)
    position, _ = tracked(run, 4, noise_m=5e-3, noise_rad=0.0)
    t, y = run.t_s, position[:, :1]
    rate = LARGEST_RATE["position"]
    mine = smooth_columns(
        t, y, rate=np.array([rate]), allowed=np.zeros(1), sharp=np.ones(1), max_gap_s=5.0
    )
    assert mine.accepted.all()
    assert mine.begins.sum() == 1
    variance, q = float(mine.noise[0]) ** 2, float(mine.density[0])
    dt = np.diff(t, prepend=t[0])
    F = [np.array([[1.0, h, h * h / 2.0], [0.0, 1.0, h], [0.0, 0.0, 1.0]]) for h in dt]
    Q = [
        q
        * np.array(
            [
                [h**5 / 20.0, h**4 / 8.0, h**3 / 6.0],
                [h**4 / 8.0, h**3 / 3.0, h**2 / 2.0],
                [h**3 / 6.0, h**2 / 2.0, h],
            ]
        )
        for h in dt
    ]
    kalman = KalmanFilter(dim_x=3, dim_z=1)
    kalman.x = np.array([[y[0, 0]], [0.0], [0.0]])
    kalman.P = np.diag([100.0 * variance, rate**2, rate**2])
    kalman.H, kalman.R = np.array([[1.0, 0.0, 0.0]]), np.array([[variance]])
    means, covariances, _, _ = kalman.batch_filter(list(y[:, :, None]), Fs=F, Qs=Q)
    means, covariances, _, _ = kalman.rts_smoother(means, covariances, Fs=F, Qs=Q)
    np.testing.assert_allclose(mine.x[:, 0], means[:, :, 0], rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(mine.P[:, 0], covariances, rtol=1e-5, atol=1e-12)


@pytest.mark.parametrize("hz", [25.0, 50.0, 100.0])
def test_a_sharp_reversal_is_kept_and_an_outlier_in_it_is_not(hz: float) -> None:
    """A yaw rate of -1.7 rad/s becomes 1.6 behind a lag of .15 s, three times in a gentle run.

    Each was cut into pieces, and samples between them were lost.
    """
    t, random = np.arange(0.0, 90.0, 1.0 / hz), np.random.default_rng(1)
    commanded = 0.15 * np.sin(0.3 * t)
    for start in (30.0, 50.0, 70.0):
        commanded[(t >= start) & (t < start + 1.2)] = -1.7
        commanded[(t >= start + 1.2) & (t < start + 2.4)] = 1.6
    rate, yaw, decay = np.zeros(t.size), np.zeros(t.size), np.exp(-1.0 / hz / 0.15)
    for i in range(t.size - 1):  # exact for a command that holds
        rate[i + 1] = commanded[i] + decay * (rate[i] - commanded[i])
        yaw[i + 1] = yaw[i] + commanded[i] / hz + 0.15 * (1.0 - decay) * (rate[i] - commanded[i])
    position = np.column_stack([0.3 * np.sin(0.2 * t), 0.3 * np.cos(0.15 * t), 0.0 * t])
    position += random.normal(0.0, 1e-3, position.shape)
    attitude = random.normal(0.0, 2e-3, position.shape) + np.outer(yaw, [0.0, 0.0, 1.0])
    at = int(np.searchsorted(t, 31.6))
    attitude[at, 2] += 0.4
    position[t >= 80.0, 0] += 0.3
    track = pose_track(t, position, attitude)
    (fault,) = track.faults
    assert (fault.kind, round(fault.start_s)) == ("jump", 80)
    assert t[at] in track.outliers_s
    assert track.outliers_s.size < 6
    assert rmse(track.rate[:, 2] - rate[np.searchsorted(t, track.t_s)]) < 0.05


def test_a_jump_is_cut_and_named() -> None:
    run = pose_run(VISUAL_S, 3)
    position, attitude = tracked(run, 3, noise_m=5e-3, noise_rad=5e-3)
    turned = euler_of_quaternion(attitude) + np.outer(run.t_s >= 70.0, [0.0, 0.0, 0.3])
    assert [item.kind for item in pose_track(run.t_s, position, turned).faults] == ["jump"]
    position[run.t_s >= 70.0] += [0.3, 0.0, 0.4]
    track = pose_track(run.t_s, position, attitude)
    (fault,) = track.faults
    assert fault.kind == "jump"
    assert fault.start_s == pytest.approx(70.0, abs=0.2)
    assert fault.moved_m == pytest.approx(0.5, abs=0.15)
    assert rmse(errors(run, track)[0]) < 0.03


def test_a_freeze_is_named_and_held_rows_are_no_samples() -> None:
    run = pose_run(np.arange(0.0, 60.0, 0.01), 5)
    position, attitude = tracked(run, 5, noise_m=2e-3, noise_rad=2e-3)
    newest = np.arange(len(run.t_s)) // 5 * 5  # rows at 100 Hz of a tracker at 20 Hz
    newest[(run.t_s > 20.0) & (run.t_s < 23.0)] = 2000
    track = pose_track(run.t_s, position[newest], attitude[newest])
    freezes = [item for item in track.faults if item.kind == "freeze"]
    assert [item.kind for item in track.faults] == ["freeze"]
    assert freezes[0].start_s == pytest.approx(20.0, abs=0.06)
    assert freezes[0].end_s == pytest.approx(23.0, abs=0.06)
    assert track.repeats > 4000
    assert not np.any((track.t_s > 20.1) & (track.t_s < 22.9))
    assert rmse(errors(run, track)[0]) < 0.02


@pytest.mark.parametrize("frozen", ["position", "attitude", "rounding"])
def test_a_freeze_of_one_part_is_a_freeze(frozen: str) -> None:
    """Three seconds of every 7.5, the other part alive, or repeats that rounding moves."""
    run = pose_run(np.arange(0.0, 60.0, 0.05), 5)
    position, attitude = tracked(run, 5, noise_m=2e-3, noise_rad=2e-3)
    indices = np.arange(len(run.t_s))
    for at in np.flatnonzero(run.t_s % 7.5 < 3.0):
        indices[at] = indices[max(at - 1, 0)]
    if frozen != "attitude":
        position = position[indices]
    if frozen != "position":
        attitude = attitude[indices]
    if frozen == "rounding":
        position = position + 1e-9 * np.random.default_rng(0).normal(size=position.shape)
    track = pose_track(run.t_s, position, attitude)
    assert [item.kind for item in track.faults] == ["freeze"] * 8
    assert all(item.end_s - item.start_s == pytest.approx(3.0, abs=0.1) for item in track.faults)
    inside = (track.t_s % 7.5 > 0.2) & (track.t_s % 7.5 < 2.8)
    assert not np.any(inside)


def test_yaw_averaged_across_its_wrap_is_left_out() -> None:
    run = pose_run(VISUAL_S, 6)
    position, _ = tracked(run, 6, noise_m=5e-3, noise_rad=0.0)
    euler = run.attitude + np.random.default_rng(6).normal(0.0, 5e-3, run.attitude.shape)
    euler[:, 2] = euler[:, 2] % (2.0 * np.pi) - np.pi
    crossing = np.flatnonzero(np.abs(np.diff(euler[:, 2])) > np.pi)
    euler[crossing, 2] = 0.5 * (euler[crossing, 2] + euler[crossing + 1, 2])
    assert crossing.size > 2
    track = pose_track(run.t_s, position, euler)
    assert set(np.round(run.t_s[crossing], 6)) <= set(np.round(track.outliers_s, 6))
    assert rmse(errors(run, track)[1]) < 0.05


def test_nothing_to_track_is_refused() -> None:
    t = np.arange(100) * 0.1
    with pytest.raises(DataError, match="too few poses"):
        pose_track(t, np.zeros((100, 3)), np.zeros((100, 3)))
    rng = np.random.default_rng(0)
    with pytest.raises(DataError, match="no stretch of poses hangs together"):
        pose_track(t[:9], rng.normal(size=(9, 3)), rng.normal(size=(9, 4)))
    with pytest.raises(DataError, match="increase strictly"):
        pose_track(t[::-1], rng.normal(size=(100, 3)), rng.normal(size=(100, 3)))


@pytest.mark.compiles("hydro/identification/signals/pose/compiled_track.py")
@pytest.mark.parametrize("columns", [1, 3])
def test_the_loops_are_compiled_once_whatever_the_number_of_columns(columns: int) -> None:
    t = np.arange(0.0, 5.0, 0.05)
    y = np.sin(np.outer(t, np.arange(1.0, 1.0 + columns))) + 1e-3 * np.cos(40.0 * t)[:, None]
    smooth_columns(
        t,
        y,
        rate=np.ones(columns),
        allowed=np.zeros(columns),
        sharp=np.ones(columns),
        max_gap_s=1.0,
    )
    assert len(compiled_track.filter_track.signatures) == 1
    assert len(compiled_track.smooth_track.signatures) == 1
