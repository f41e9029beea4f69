"""Draws from the posterior of the coefficients, for randomisation in training."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence

import numpy as np

from auvid.data_schemas.errors import DataError
from auvid.data_schemas.records.model_file import ModelFile
from auvid.export.exported import Exported, Request, Target
from auvid.export.losses import flown_ranges
from auvid.export.text import number
from auvid.hydro.arrays import AXES, VELOCITIES, Array
from auvid.hydro.identification.constrained.active_set import Cuts, InequalityRows
from auvid.hydro.identification.constrained.draws import (
    AxisErrors,
    draw_within,
    flown_limits,
    joint_covariance,
)
from auvid.hydro.identification.constrained.equations import (
    ACCELERATIONS,
    Unknown,
    added_mass_change,
    added_mass_unknown,
)
from auvid.hydro.identification.constrained.limits import bounds, positive_inertia
from auvid.hydro.identification.regression.assumed_figures import total_error
from auvid.hydro.identification.regression.least_squares import CONSTANT

SEED = 0
MOST_LIMITS = 5
"""Limits that are named."""
CONVENTION = (
    "A row per draw, a column per coefficient by its name (Y_v|v| multiplies v|v| in the force Y);"
    " body axes x forward, y starboard, z down; forces on the right-hand side, so that damping is"
    " negative; SI and radians. X_constant is a constant force, X_udot an added mass."
)
_USAGE = """\
Take a row per episode and put its numbers in place of those of another export of the
same model, as `auvid export ... --to python`, `mss` or `gazebo` (mind that target's
signs). The first row is the model itself.

{counts}
"""


def export(request: Request) -> Exported:
    """Return `NAME_draws.csv`: the model itself, then draws that gain no energy.

    Normal draws in the covariance of the printed intervals, by noise of each axis and
    assumed figures of all; those whose damping gives energy to some motion of the flown
    range count at the nearest passive model, in the metric of the posterior. Inertia that
    was fitted is drawn too, unless a limit holds it.
    """
    model, count = request.model, request.draws
    if not model.covariance:
        raise DataError(
            "the model has no covariance to draw from",
            field="target",
            value="draws",
            remedy="A published set has none: fit a model to a log of yours.",
        )
    unknowns, values, covariance = posterior(model)
    flown = flown_ranges(model.validity)
    # Passive whatever the limits of the fit were: a simulator may not gain energy.
    rows, cuts = flown_limits(unknowns, "dissipative", flown)
    inertia_rows, inertia_cuts = _inertia_limits(model, unknowns, values)
    rows, cuts = [*rows, *inertia_rows], [*cuts, *inertia_cuts]
    drawn = draw_within(unknowns, values, covariance, rows, cuts, count=count, seed=SEED)
    counts = (
        f"{count} draws, of which {drawn.moved} were not passive (they give energy to a motion of"
        " the flown range, or have an inertia that no body has) and stand at the nearest passive"
        " model"
    )
    often = sorted(drawn.outside.items(), key=lambda item: -item[1])[:MOST_LIMITS]
    limits_hit = "; ".join(f"{name}: {times}" for name, times in often)
    counts += f"; limits that held most: {limits_hit}." if limits_hit else "."
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(["draw", *(_column(unknown) for unknown in unknowns)])
    for place, row in enumerate([values, *drawn.values]):
        writer.writerow([place, *(number(value) for value in row)])
    return Exported(
        {f"{request.name}_draws.csv": out.getvalue()},
        (),
        CONVENTION,
        _USAGE.format(counts=counts),
        (
            counts,
            "Each assumed figure of the vehicle file (spreads) is drawn once for all axes. By noise"
            " axes are independent, and inertia is of all; the form of the model is not drawn.",
        ),
    )


def posterior(model: ModelFile) -> tuple[list[Unknown], Array, Array]:
    """Return unknowns (p), values (p,) and covariance (p, p) of a model file.

    What it has no error of has the variance 0. It is that of the printed intervals, as of
    `joint_covariance`.
    """
    entries = {Unknown(item.axis, item.term): item for item in model.coefficients}
    unknowns, values = list(entries), [item.predictor for item in model.coefficients]
    for item in model.fitted_inertia:
        unknowns.append(added_mass_unknown(item.name))
        place = AXES.index(unknowns[-1].axis), VELOCITIES.index(item.name[2])
        values.append(model.dynamics.added_mass[place[0]][place[1]])
    parts = []
    for axis, card in model.covariance.items():
        places = [unknowns.index(Unknown(axis, term)) for term in card.terms]
        errors = [entries[unknowns[place]].standard_error for place in places]
        parts.append(AxisErrors(places, card.lower, errors, card.shifts))
    covariance = joint_covariance(parts, len(unknowns))
    for item in model.fitted_inertia:
        place_of = unknowns.index(added_mass_unknown(item.name))
        total = total_error(item.standard_error or 0.0, item.assumed_shifts)
        covariance[place_of, place_of] = total**2
    return unknowns, np.array(values), covariance


def _inertia_limits(
    model: ModelFile, unknowns: Sequence[Unknown], values: Array
) -> tuple[list[InequalityRows], list[Cuts]]:
    """Return limits that keep the inertia positive, and added mass where it is so.

    Unknowns of inertia are whole added masses here, so the rest counts as the vehicle.
    """
    rest = np.array(model.dynamics.added_mass)
    added = {
        u: x for u, x in zip(unknowns, values.tolist(), strict=True) if u.term in ACCELERATIONS
    }
    rest -= added_mass_change(added)
    passive = {
        u: 0.0
        for u, x in added.items()
        if AXES.index(u.axis) == ACCELERATIONS.index(u.term) and x <= 0.0
    }
    rigid = np.array(model.dynamics.rigid_body)
    return [bounds(unknowns, upper=passive)], [positive_inertia(unknowns, rigid - rest)]


def _column(unknown: Unknown) -> str:
    return f"{unknown.axis}_{CONSTANT}" if unknown.term == CONSTANT else str(unknown)


DRAWS = Target(
    "draws",
    "passive draws of the coefficients as CSV",
    "coefficients and their covariance, not the vehicle",
    "none",
    export,
    lacking_axes=True,
    any_unit_of_mass=True,
)
