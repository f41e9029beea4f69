"""What a target cannot hold of a model, as force over the flown range."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from auvid.data_schemas.records.models import UsableFor, VelocityRange
from auvid.export.body import Body, Force
from auvid.hydro.arrays import AXES, VELOCITIES, Array
from auvid.hydro.dynamics.mechanics.rigid_body import coriolis_force

LARGEST_SHARE = 0.01
"""A target that loses more than this share of the RMS viscous force, on an axis that the
model is usable for, takes the model with `lossy` alone.
"""
SAMPLES = 4096
SEED = 0
ASSUMED_REACH = 1.0
"""Of each velocity [m/s, rad/s] where a model has no range, as a published set."""
PROPULSION_RANGE = (-1.0, 1.0)
"""Range of eta - 1: from a standing propeller to twice the speed of level running."""


@dataclass(frozen=True)
class Lost:
    """One part of the model that a target does not hold.

    force: exact force less the target's, nu (n, 6), eta - 1 (n,) -> (n, 6) [N, N m].
    inertia: mass matrix (6, 6) less the target's, None where it has all.
    """

    what: str
    why: str
    force: Force | None = None
    inertia: Array | None = None


@dataclass(frozen=True)
class LossRow:
    """A lost part and its RMS force per axis over the envelope, X to N [N, N m]."""

    what: str
    why: str
    rms: tuple[float, ...]


@dataclass(frozen=True)
class ExportLosses:
    """All that a target does not hold of a model.

    viscous_rms: RMS viscous force of the model per axis; total_rms: that of the error of
    all rows together; judged: axes that the model is usable for, all where nothing
    judges it.
    """

    target: str
    rows: tuple[LossRow, ...]
    total_rms: tuple[float, ...]
    viscous_rms: tuple[float, ...]
    judged: tuple[str, ...]
    within: str
    notes: tuple[str, ...] = ()

    @property
    def shares(self) -> dict[str, float]:
        """Return axis -> total error over the viscous force, inf where that is 0."""
        return {
            axis: 0.0 if error == 0.0 else error / force if force else float("inf")
            for axis, error, force in zip(AXES, self.total_rms, self.viscous_rms, strict=True)
        }

    @property
    def too_large(self) -> tuple[str, ...]:
        """Return the judged axes that lose more than `LARGEST_SHARE`."""
        return tuple(axis for axis in self.judged if self.shares[axis] > LARGEST_SHARE)


def sample_envelope(validity: Mapping[str, VelocityRange]) -> tuple[Array, Array]:
    """Return velocities (n, 6) [m/s, rad/s] within the flown ranges, and eta - 1.

    Evenly spread, and the same at each call; to `ASSUMED_REACH` where there is no range.
    """
    random = np.random.default_rng(SEED)
    ranges = flown_ranges(validity).values()
    low, high = (np.array(ends) for ends in zip(*ranges, strict=True))
    nu = random.uniform(low, high, size=(SAMPLES, 6))
    return nu, random.uniform(*PROPULSION_RANGE, size=SAMPLES)


def flown_ranges(validity: Mapping[str, VelocityRange]) -> dict[str, tuple[float, float]]:
    """Return the ends of each range, `ASSUMED_REACH` where there is none."""
    assumed = (-ASSUMED_REACH, ASSUMED_REACH)
    return {
        name: (validity[name].low, validity[name].high) if name in validity else assumed
        for name in VELOCITIES
    }


def range_words(validity: Mapping[str, VelocityRange]) -> str:
    """Return within which velocities losses are figured, in words."""
    if validity:
        return "within the flown range"
    return f"up to {ASSUMED_REACH:g} m/s and rad/s, for want of a flown range"


def judged_axes(use: UsableFor | None) -> tuple[str, ...]:
    """Return the axes that a model is usable for, all where none is judged."""
    if use is None:
        return AXES
    named = {*use.forces, *use.simulation, *use.control}
    return tuple(axis for axis in AXES if axis in named) or AXES


def measure(
    target: str,
    body: Body,
    lost: Iterable[Lost],
    *,
    validity: Mapping[str, VelocityRange],
    use: UsableFor | None,
    notes: Sequence[str] = (),
) -> ExportLosses:
    """Return the losses as RMS forces over the envelope.

    A lost inertia dM counts as the force dM a at the accelerations a that the viscous
    force alone gives, a = M^-1 tau_viscous.
    """
    nu, excess = sample_envelope(validity)
    viscous = body.viscous(nu, excess)
    acceleration = viscous @ body.mass_inverse.T
    rows, total = [], np.zeros(viscous.shape)
    for part in lost:
        error = np.zeros(viscous.shape)
        if part.force is not None:
            error += part.force(nu, excess)
        if part.inertia is not None:
            error -= acceleration @ part.inertia.T
        rows.append(LossRow(part.what, part.why, _rms(error)))
        total += error
    return ExportLosses(
        target,
        tuple(rows),
        _rms(total),
        _rms(viscous),
        judged_axes(use),
        range_words(validity),
        tuple(notes),
    )


def lost_added_mass(*, inertia: Array, what: str, why: str) -> Lost:
    """Return the loss of an added inertia (6, 6) with its Coriolis force."""
    return Lost(what, why, lambda nu, _: -coriolis_force(inertia, nu), inertia)


def _rms(values: Array) -> tuple[float, ...]:
    return tuple(np.sqrt(np.mean(values**2, axis=0)).tolist())
