"""The path in 3D: a line per segment, the vehicle on it, and forces along it.

The vehicle has its axes and the residual force that acts on it.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pyarrow as pa
import rerun as rr

from auvid.data_schemas.records.motion import SegmentRecord
from auvid.data_schemas.tables import column, has_columns, matrix
from auvid.hydro.arrays import Array, runs_of
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned
from auvid.stages.base import part_of
from auvid.stages.columns import LINEAR_VELOCITY
from auvid.stages.number_format import visible
from auvid.stages.page.colours import GREEN, ROLES, Ink
from auvid.stages.report.recording.rerun_stream import TIMELINE, Recording

POSE = ("x_m", "y_m", "z_m", "phi_rad", "theta_rad", "psi_rad")
FORCE = ("tau_bar_X_N", "tau_bar_Y_N", "tau_bar_Z_N")
BODY_HALF_SIZE_M = (0.4, 0.15, 0.15)
ARROWS = 40
FREE_RUN = Ink(*GREEN)
FREE_RUN_WIDTH = -1.5
"""Negative radii are points of the screen, not metres."""
LONGEST = 0.2
"""Length of the strongest force (its 95th percentile), in sizes of the path."""


def send_paths(
    out: Recording,
    fused: Mapping[str, pa.Table],
    tables: Mapping[str, pa.Table],
    segments: Mapping[str, SegmentRecord],
    starts: Mapping[str, float],
    rate_hz: float,
    model: str = "",
) -> Array | None:
    """Send the path of each segment with the forces on it, and free runs of `model`.

    Returns the corners (2, 3) of the box around all in m NED, None for no path.
    """
    paths, forces = {}, {}
    for name in fused:
        table = part_of(fused, name, POSE)
        pose = matrix(table, POSE)
        good = np.isfinite(pose).all(axis=1)
        times = column(table, "t_s")
        if good.any():
            stride = (
                max(1, round((times.size - 1) / max(times[-1] - times[0], 1e-9) / rate_hz))
                if times.size > 1
                else 1
            )
            chosen = np.flatnonzero(good)[::stride]
            force = _force(tables, name, times.size)
            forces[name] = None if force is None else force[chosen]
            paths[name] = times[chosen] + starts[name], pose[chosen]
    if not paths:
        return None
    places = np.vstack([pose[:, :3] for _, pose in paths.values()])
    corners = np.array([places.min(axis=0), places.max(axis=0)])
    measured = np.concatenate(
        [np.linalg.norm(force, axis=1) for force in forces.values() if force is not None]
        or [np.zeros(0)]
    )
    strongest = (
        float(np.percentile(measured[np.isfinite(measured)], 95))
        if np.isfinite(measured).any()
        else 0.0
    )
    scale = (
        LONGEST * max(float(np.ptp(corners, axis=0).max()), 2.0) / strongest
        if strongest > 0
        else 0.0
    )
    out.static("path", rr.ViewCoordinates.FRD)
    for name, (times, pose) in paths.items():
        use = str(segments[name].use)
        label = str(visible(f"{name} ({use})"))
        part = rr.escape_entity_path_part(name)
        out.static(
            f"path/{part}",
            rr.LineStrips3D([pose[:, :3]], colors=[ROLES[use].rgb], labels=[label]),
        )
        out.body("path/vehicle", times, pose)
        flown = tables.get(f"validate/simulated_motion/{name}")
        if flown is not None:
            out.static(
                f"path/{part}/free_run",
                rr.LineStrips3D(
                    free_paths(flown, times - starts[name], pose),
                    colors=[FREE_RUN.rgb],
                    labels=[str(visible(f"free run of {model}"))],
                    radii=[FREE_RUN_WIDTH],
                ),
            )
        force = forces[name]
        if force is not None and scale > 0:
            _send_forces(
                out,
                f"path/{part}/forces",
                times,
                pose,
                scale * np.nan_to_num(force),
            )
    out.static(
        "path/vehicle/body",
        rr.Ellipsoids3D(
            half_sizes=[BODY_HALF_SIZE_M], colors=[ROLES["raw"].rgb], fill_mode="solid"
        ),
    )
    out.body_axes("path/vehicle")
    if scale > 0:
        words = f"residual force, 1 m = {1 / scale:.3g} N"
        out.static(
            "path/vehicle/force",
            rr.Arrows3D.from_fields(colors=[ROLES["measured"].rgb], labels=[words], radii=[0.02]),
        )
    return corners


def free_paths(flown: pa.Table, t_s: Array, pose: Array) -> list[Array]:
    """Return the path (k, 3) of every free run in m NED, from its measured start on.

    p(t) = p(0) + integral of R(Theta) v dt by trapezoids, with velocity and attitude of
    the run; t_s (n,), pose (n, 6): the measured ones. A run of one sample has no path.
    """
    times, velocity, attitude = (
        column(flown, "t_s"),
        matrix(flown, LINEAR_VELOCITY),
        matrix(flown, POSE[3:]),
    )
    good = np.isfinite(velocity).all(axis=1) & np.isfinite(attitude).all(axis=1)
    paths = []
    for first, last in runs_of(np.asarray(good)):
        if last - first < 2:
            continue
        run = slice(first, last)
        rates = np.einsum("nij,nj->ni", rotation_body_to_ned(attitude[run]), velocity[run])
        steps = np.diff(times[run])[:, None] * (rates[1:] + rates[:-1]) / 2.0
        start = np.array([np.interp(times[first], t_s, pose[:, axis]) for axis in range(3)])
        paths.append(start + np.vstack([np.zeros(3), np.cumsum(steps, axis=0)]))
    return paths


def _force(tables: Mapping[str, pa.Table], segment: str, samples: int) -> Array | None:
    """Return the residual force (n, 3) [N] of a segment in body axes, or None."""
    name = next((name for name in tables if name.split("/")[1:] == [segment, "residual"]), None)
    table = None if name is None else part_of(tables, name, FORCE)
    if table is None or table.num_rows != samples or not has_columns(table, FORCE):
        return None
    return matrix(table, FORCE)


def _send_forces(out: Recording, entity: str, times: Array, pose: Array, vectors: Array) -> None:
    """Send the force at the vehicle, and `ARROWS` of them along the path.

    The arrows lie at even distances; vectors (n, 3) in body axes, in m.
    """
    out.stream.send_columns(
        "path/vehicle/force",
        [rr.TimeColumn(TIMELINE, duration=times)],
        rr.Arrows3D.columns(vectors=vectors),
    )
    gone = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(pose[:, :3], axis=0), axis=1))])
    some = np.unique(
        np.searchsorted(gone, np.linspace(0.0, gone[-1], ARROWS)).clip(0, times.size - 1)
    )
    turned = np.einsum("nij,nj->ni", rotation_body_to_ned(pose[some, 3:]), vectors[some])
    out.static(
        entity,
        rr.Arrows3D(
            origins=pose[some, :3], vectors=turned, colors=[ROLES["measured"].rgb], radii=[0.006]
        ),
    )
