"""Thrusters of known place as small links on joints, and the body without them."""

from __future__ import annotations

import numpy as np

from auvid.data_schemas.records.model_file import ThrusterFigures
from auvid.export.body import Body
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.mechanics.kinematics import skew

THRUSTER_MASS, THRUSTER_INERTIA = 0.001, 1e-6
"""Of a thruster link [kg, kg m^2]; base_link has so much less."""


def placed_thrusters(body: Body) -> list[ThrusterFigures]:
    """Return the thrusters whose position and axis are known."""
    return [item for item in body.thrusters if item.position_m and item.axis]


def unplaced_note(body: Body) -> tuple[str, ...]:
    """Return the note on thrusters that a file leaves out, none where it has all."""
    if len(placed_thrusters(body)) == len(body.thrusters):
        return ()
    return ("Thrusters whose position is not known are left out: apply their force.",)


def offsets_words(body: Body, lost: Array, *, first: int = 1) -> str:
    """Return in words which thruster forces make a lost constant force (6,).

    The least forces of the thrusters, counted from `first`; nothing where they cannot make
    it, or one has no known place.
    """
    if not body.thrusters or unplaced_note(body) or not lost.any():
        return ""
    effects = np.array([item.effect for item in body.thrusters]).T
    offsets = np.linalg.pinv(effects) @ lost
    if np.abs(effects @ offsets - lost).max() > 1e-6 * np.abs(lost).max():
        return ""
    listed = ", ".join(f"{i + first}: {force:.3g}" for i, force in enumerate(offsets))
    return (
        "The constant forces that are lost turn with the vehicle, which no element of the file"
        f" does. Thrusters do: add to their forces, in N, {listed}."
    )


def without_thrusters(body: Body) -> tuple[float, Array, Array]:
    """Return mass, centre of gravity and inertia there, without the thruster links."""
    placed = placed_thrusters(body)
    mass = body.mass_kg - THRUSTER_MASS * len(placed)
    moment, inertia = body.mass_kg * body.r_G, np.array(body.inertia)
    for thruster in placed:
        arm = np.array(thruster.position_m)
        moment = moment - THRUSTER_MASS * arm
        inertia += THRUSTER_MASS * skew(arm) @ skew(arm) - THRUSTER_INERTIA * np.eye(3)
    centre = moment / mass
    return mass, centre, np.asarray(inertia + mass * skew(centre) @ skew(centre))
