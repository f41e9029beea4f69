"""Twelve usual mistakes of an exporter, each as the model file that it would have written.

A mistake takes a right model file; the exporter then writes that text which it would have
written of the right one, had it made the mistake.
"""

from collections.abc import Callable

import numpy as np

from auvid.data_schemas.records.model_file import CoefficientEntry, ModelFile
from tests.support.targets.frames import FLIP6, Array, rigid_body, skew

AXES, RATES = "XYZKMN", "uvwpqr"

Mistake = Callable[[ModelFile], ModelFile]
SIGNS = np.diag(FLIP6)


def dynamics(model: ModelFile, **values: object) -> ModelFile:
    """Return the model file with other dynamics; M_RB and M follow from its parts."""
    part = model.dynamics.model_copy(update=values)
    centre, about_origin = np.array(part.centre_of_gravity_m), np.array(part.inertia_kg_m2)
    s = skew(centre)
    rigid = rigid_body(part.mass_kg, centre, about_origin + part.mass_kg * s @ s)
    mass = rigid - np.array(part.added_mass)
    part = part.model_copy(update={"rigid_body": rigid.tolist(), "mass": mass.tolist()})
    return model.model_copy(update={"dynamics": part})


def coefficients(
    model: ModelFile, change: Callable[[CoefficientEntry], dict[str, object]]
) -> ModelFile:
    """Return the model file with changed coefficients."""
    rows = [entry.model_copy(update=change(entry)) for entry in model.coefficients]
    rows = [
        row.model_copy(update={"term": "*".join(row.factors) or "constant", "value": row.predictor})
        for row in rows
    ]
    return model.model_copy(update={"coefficients": rows})


def times(entry: CoefficientEntry, by: float) -> dict[str, object]:
    """Return the entry's change by a factor."""
    return {"predictor": entry.predictor * by}


def own(entry: CoefficientEntry) -> bool:
    """Return whether a coefficient belongs to the velocity along its own axis."""
    rate = RATES[AXES.index(entry.axis)]
    return {name.strip("|") for name in entry.factors} == {rate}


def turned(model: ModelFile) -> ModelFile:
    """Return the model with y and z turned round: forward, port, up."""

    def sign(entry: CoefficientEntry) -> dict[str, object]:
        plain = [name for name in entry.factors if len(name) == 1 and name in RATES]
        by = SIGNS[AXES.index(entry.axis)] * np.prod([SIGNS[RATES.index(x)] for x in plain])
        return times(entry, float(by))

    d, vector = model.dynamics, SIGNS[:3]
    return dynamics(
        coefficients(model, sign),
        centre_of_gravity_m=(vector * d.centre_of_gravity_m).tolist(),
        centre_of_buoyancy_m=(vector * d.centre_of_buoyancy_m).tolist(),
        inertia_kg_m2=(np.array(d.inertia_kg_m2) * np.outer(vector, vector)).tolist(),
        added_mass=(np.array(d.added_mass) * np.outer(SIGNS, SIGNS)).tolist(),
    )


def squares(change: Callable[[list[str]], list[str]]) -> Mistake:
    """Return the mistake that reads x|x| otherwise."""

    def apply(entry: CoefficientEntry) -> dict[str, object]:
        square = len(entry.factors) == 2 and own(entry)
        return {"factors": change(list(entry.factors))} if square else {}

    return lambda model: coefficients(model, apply)


def added(change: Callable[[Array], Array]) -> Mistake:
    """Return the mistake that writes another added mass."""
    return lambda m: dynamics(m, added_mass=change(np.array(m.dynamics.added_mass)).tolist())


def degrees(entry: CoefficientEntry) -> dict[str, object]:
    """Return a coefficient per degree, where it is one of turn rates."""
    turns = sum(name.strip("|") in tuple("pqr") for name in entry.factors)
    return times(entry, float(np.radians(1.0)) ** turns)


def about_buoyancy(model: ModelFile) -> ModelFile:
    """Return the model with moments about the centre of buoyancy in place of the origin."""
    d = model.dynamics
    arm = np.subtract(d.centre_of_gravity_m, d.centre_of_buoyancy_m).tolist()
    return dynamics(model, centre_of_gravity_m=arm, centre_of_buoyancy_m=[0.0, 0.0, 0.0])


def couplings(model: ModelFile) -> ModelFile:
    """Return the model with the signs of couplings turned."""
    matrix = np.array(model.dynamics.added_mass)
    matrix = 2 * np.diag(np.diag(matrix)) - matrix
    signed = coefficients(model, lambda e: times(e, 1.0 if own(e) else -1.0))
    return dynamics(signed, added_mass=matrix.tolist())


def exchanged(model: ModelFile) -> ModelFile:
    """Return the model with roll and pitch exchanged."""
    order, names = [0, 1, 2, 4, 3, 5], str.maketrans("pqKM", "qpMK")
    rows = coefficients(
        model,
        lambda e: {
            "axis": e.axis.translate(names),
            "factors": [name.translate(names) for name in e.factors],
        },
    )
    d = model.dynamics
    return dynamics(
        rows,
        added_mass=np.array(d.added_mass)[np.ix_(order, order)].tolist(),
        inertia_kg_m2=np.array(d.inertia_kg_m2)[np.ix_([1, 0, 2], [1, 0, 2])].tolist(),
    )


MISTAKES: dict[str, Mistake] = {
    "FLU for FRD": turned,
    "x x for x|x|": squares(lambda pair: [pair[0], pair[0]]),
    "damping positive": lambda m: coefficients(m, lambda e: times(e, -1.0)),
    "added mass twice": added(lambda a: 2 * a),
    "added mass of wrong sign": added(lambda a: -a),
    "radians for degrees": lambda m: coefficients(m, degrees),
    "moments about another point": about_buoyancy,
    "couplings of wrong sign": couplings,
    "no buoyancy": lambda m: dynamics(m, buoyancy_N=1e-3 * m.dynamics.buoyancy_N),
    "x|x| as x": squares(lambda pair: pair[:1]),
    "roll for pitch": exchanged,
    "weight for mass": lambda m: dynamics(
        m, mass_kg=m.dynamics.weight_N, weight_N=m.dynamics.mass_kg
    ),
}
"""Name of a mistake -> the model file that makes it."""
