"""Position fixes as the source of motion: lat-lon, too coarse, outliers, a jump, too few."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from auvid.data_schemas.errors import DataError
from auvid.hydro.arrays import Array
from auvid.hydro.identification.signals.pose.fixes import FixTrack, fix_track, metres_from_degrees
from auvid.stages import ingest
from auvid.stages.base import RawFile, RawLog
from auvid.stages.columns import GYRO, LINEAR_VELOCITY, named
from auvid.stages.ingest.fix_motion import fix_motion
from auvid.stages.ingest.streams.mapping import Stream
from tests.support.motions import shipped_vehicle

STEP_S, LAG_S = 0.05, 2.0


def path(seed: int, duration_s: float = 300.0) -> tuple[Array, Array, Array]:
    """Return times (n,), positions and velocities (n, 2) of steps of thrust every 20 s."""
    rng = np.random.default_rng(seed)
    n = int(duration_s / STEP_S)
    thrust = np.repeat(rng.uniform(-0.7, 0.7, (n // 400 + 1, 2)), 400, axis=0)
    velocity = np.zeros((n, 2))
    for k in range(1, n):
        velocity[k] = velocity[k - 1] + STEP_S / LAG_S * (thrust[k - 1] - velocity[k - 1])
    return np.arange(n) * STEP_S, np.cumsum(velocity, axis=0) * STEP_S, velocity


def fixes(
    seed: int, *, noise_m: float, every_s: float, outliers: float = 0.05
) -> tuple[Array, Array, Array]:
    """Return times (m,), noisy fixes (m, 2) and the true velocity there (m, 2)."""
    t, place, velocity = path(seed)
    at = np.arange(0, t.size, int(every_s / STEP_S))
    rng = np.random.default_rng(seed + 100)
    measured = place[at] + noise_m * rng.standard_normal((at.size, 2))
    off = rng.random(at.size) < outliers
    measured[off] += rng.uniform(-20.0, 20.0, (int(off.sum()), 2))
    return t[at], measured, velocity[at]


def error_of(track: FixTrack, t_s: Array, velocity: Array) -> Array:
    """Return velocity minus truth (n, 2) at the fixes that were kept."""
    truth = [np.interp(track.t_s, t_s, column) for column in velocity.T]
    return track.velocity - np.column_stack(truth)


@pytest.mark.parametrize(
    ("noise_m", "every_s", "rms", "too_coarse"),
    [(0.1, 0.25, 0.04, False), (0.5, 1.0, 0.1, False), (5.0, 2.0, 0.3, True)],
)
def test_velocity_of_fixes_has_an_honest_deviation(
    noise_m: float, every_s: float, rms: float, too_coarse: bool
) -> None:
    inside, errors = [], []
    for seed in range(4):
        t_s, measured, velocity = fixes(seed, noise_m=noise_m, every_s=every_s)
        track = fix_track(t_s, measured)
        error = error_of(track, t_s, velocity)
        inside.append(np.mean(np.abs(error) < 1.96 * track.velocity_sd))
        errors.append(np.sqrt(np.mean(error**2)))
        assert track.too_coarse == too_coarse
        assert track.noise_m == pytest.approx(noise_m, rel=0.4)
    # Steps of thrust are no white noise: the deviation is on the safe side.
    assert np.mean(inside) >= 0.93
    assert np.mean(errors) < rms


@pytest.mark.parametrize(("noise_m", "every_s"), [(0.1, 0.25), (0.05, 0.5), (0.5, 1.0)])
def test_the_velocity_is_that_of_the_vehicle_smoothed_over_so_long(
    noise_m: float, every_s: float
) -> None:
    errors = np.zeros(3)
    for seed in range(3):
        t, _, velocity = path(seed)
        t_s, measured, _ = fixes(seed, noise_m=noise_m, every_s=every_s, outliers=0.0)
        track = fix_track(t_s, measured)
        for place, factor in enumerate((0.0, 1.0, 3.0)):
            width = factor * track.smoothed_s / STEP_S
            smooth = gaussian_filter1d(velocity, width, axis=0) if width else velocity
            errors[place] += np.sum(error_of(track, t, smooth) ** 2)
    assert errors[1] < 0.85 * errors[0]
    assert errors[1] < 0.85 * errors[2]


@pytest.mark.compiles("hydro/identification/signals/pose/compiled_fixes.py")
def test_outliers_are_left_out_and_a_jump_begins_a_new_track() -> None:
    t_s, measured, velocity = fixes(7, noise_m=0.5, every_s=1.0, outliers=0.1)
    track = fix_track(t_s, measured)
    assert 0.05 * t_s.size < track.outliers < 0.14 * t_s.size
    moved = measured + np.where(t_s > 150.0, 60.0, 0.0)[:, None]
    parted = fix_track(t_s, moved)
    error = error_of(parted, t_s, velocity)
    assert np.sqrt(np.mean(error[np.abs(parted.t_s - 150.0) > 10.0] ** 2)) < 0.12


def test_latitude_and_longitude_become_metres() -> None:
    _, measured, _ = fixes(3, noise_m=0.0, every_s=1.0, outliers=0.0)
    latitude = np.radians(63.4) + measured[:, 0] / 6371008.8
    longitude = np.radians(10.4) + measured[:, 1] / 6371008.8 / np.cos(np.radians(63.4))
    metres = metres_from_degrees(latitude, longitude)
    assert metres == pytest.approx(measured - measured[0], abs=0.01)


def test_too_few_and_frozen_fixes_are_refused() -> None:
    t_s = np.arange(0.0, 60.0)
    with pytest.raises(DataError, match="too few fixes"):
        fix_track(t_s[:8], np.zeros((8, 2)) + t_s[:8, None])
    with pytest.raises(DataError, match="too few fixes"):
        fix_track(t_s, np.full((60, 2), 3.0))


def streams_of(t_s: Array, measured: Array, heading_rad: float) -> dict[str, Stream]:
    """Return fixes with a level attitude of one heading and a depth."""
    time_us = np.rint(t_s * 1e6).astype(np.int64)
    rows = np.arange(t_s.size)
    level = np.zeros(t_s.size)
    columns = {
        "fixes": {"north_m": measured[:, 0], "east_m": measured[:, 1]},
        "attitude": {"phi_rad": level, "theta_rad": level, "psi_rad": level + heading_rad},
        "depth": {"depth_m": 2.0 + 0.1 * t_s},
    }
    return {
        name: Stream(name, {"time_us": time_us, **item}, rows, "USBL")
        for name, item in columns.items()
    }


def ingested(t_s: Array, measured: Array) -> ingest.Outputs:
    """Return what ingest makes of latitudes, longitudes, a level attitude and a depth."""
    degrees = np.degrees(
        [
            np.radians(63.4) + measured[:, 0] / 6371008.8,
            np.radians(10.4) + measured[:, 1] / 6371008.8 / np.cos(np.radians(63.4)),
        ]
    )
    rows = [
        f"{t:.2f},{lat:.9f},{lon:.9f},0,0,{0.1 * np.sin(t):.5f},3.0"
        for t, lat, lon in zip(t_s, *degrees, strict=True)
    ]
    text = "\n".join(["t,lat,lon,roll,pitch,yaw,depth", *rows]) + "\n"
    fields = {"lat": "latitude_rad", "lon": "longitude_rad"}
    columns = [
        {"column": name, "stream": "fixes", "field": field, "unit": "deg"}
        for name, field in fields.items()
    ]
    for name, field in (("roll", "phi_rad"), ("pitch", "theta_rad"), ("yaw", "psi_rad")):
        columns.append({"column": name, "stream": "attitude", "field": field, "unit": "rad"})
    columns.append({"column": "depth", "stream": "depth", "field": "depth_m", "unit": "m"})
    mapping = {"time": {"column": "t", "unit": "s", "epoch": "arbitrary"}, "columns": columns}
    file = RawFile("usbl.csv", np.frombuffer(text.encode(), dtype=np.uint8), mapping)
    return ingest.run(ingest.Inputs(RawLog("usbl", (file,)), None, None), ingest.Params())


def test_body_axes_come_from_the_attitude_and_heave_from_the_depth() -> None:
    t_s, measured, velocity = fixes(5, noise_m=0.2, every_s=0.5)
    motion = fix_motion(streams_of(t_s, measured, np.pi / 2), None)
    body = motion.streams["velocity"].columns
    at = body["time_us"] / 1e6
    east = np.interp(at, t_s, velocity[:, 1])
    assert np.sqrt(np.mean((body["u_m_s"] - east) ** 2)) < 0.1
    assert body["w_m_s"][5:-5] == pytest.approx(0.1, abs=1e-6)
    assert motion.streams["position"].columns["z_m"] == pytest.approx(2.0 + 0.1 * at)
    assert "no sensor measures u, v, w" in motion.notes[0]


def test_arm_and_mounting_of_a_velocity_log_do_not_turn_the_velocity_of_fixes() -> None:
    """What takes them off the velocity afterwards finds that of the body."""
    t_s, measured, _ = fixes(5, noise_m=0.2, every_s=0.5)
    streams = streams_of(t_s, measured, 0.3)
    rate = named(GYRO, np.column_stack([0.0 * t_s, 0.1 + 0.0 * t_s, 0.4 * np.sin(t_s)]))
    time_us = streams["attitude"].columns["time_us"]
    streams["imu"] = Stream("imu", {"time_us": time_us, **rate}, np.arange(t_s.size), "gyro")
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    vehicle = shipped_vehicle("bluerov2_heavy")
    log = replace(vehicle.dvl, rotation=quarter, arm_m=np.array([0.3, 0.1, 0.2]), lag_s=0.15)
    bare = fix_motion(streams, None).streams["velocity"].columns
    logged = fix_motion(streams, replace(vehicle, dvl=log)).streams["velocity"].columns
    assert np.all(logged["time_us"] - bare["time_us"] == 150_000)
    omega = np.column_stack([np.interp(bare["time_us"], time_us, rate[name]) for name in GYRO])
    body, back = (np.column_stack([item[n] for n in LINEAR_VELOCITY]) for item in (bare, logged))
    back = back @ quarter.T - np.cross(omega, log.arm_m)
    np.testing.assert_allclose(back, body, atol=1e-6)


def test_coarse_fixes_leave_heading_and_depth() -> None:
    t_s, measured, _ = fixes(5, noise_m=5.0, every_s=2.0)
    motion = fix_motion(streams_of(t_s, measured, 0.0), None)
    assert "velocity" not in motion.streams
    assert "too coarse for a velocity" in motion.notes[0]
    assert "heave by depth and yaw by gyro" in motion.notes[0]
    findings = ingested(t_s, measured).health["findings"]
    (item,) = (item for item in findings if item["id"] == "no_velocity")
    assert re.search(r"\d\d% of what is there", item["text"])
    assert item["text"].endswith("too coarse for a velocity.")
    assert "Keep each speed for longer" in item["remedy"]


def test_a_csv_with_latitude_and_longitude_gives_a_velocity() -> None:
    t_s, measured, _ = fixes(9, noise_m=0.3, every_s=0.5)
    outputs = ingested(t_s, measured)
    assert outputs.fixes is not None
    assert outputs.velocity is not None
    assert outputs.log_info.streams["velocity"].source == "fixes of usbl.csv"
    (note,) = (note for note in outputs.log_info.notes if "noise" in note)
    noise = re.search(r"noise ([\d.]+) m", note)
    assert noise is not None
    assert float(noise[1]) == pytest.approx(0.3, rel=0.1)
