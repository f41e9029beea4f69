"""Model files for proofs of export: full, symmetric and diagonal, with seeded numbers."""

import json
from collections.abc import Iterable
from functools import cache
from typing import Any

import numpy as np

from auvid.data_schemas.documents.model import parse
from auvid.data_schemas.records.model_file import ModelFile
from auvid.data_schemas.tables import make_table
from auvid.stages import model_file
from auvid.stages.base import collection
from auvid.stages.free_run import FIT
from auvid.stages.model_file.contents import RMS
from tests.support.example_run import example_run
from tests.support.targets.frames import Array, rigid_body

AXES, RATES = "XYZKMN", "uvwpqr"

GRAVITY, DENSITY, MASS = 9.81, 1025.0, 12.0


@cache
def base() -> str:
    """Return the text of a model file that the stage writes of a made-up run."""
    run = example_run({"train": 4.0, "check": 2.0})
    run_inputs = run.inputs()
    row: dict[str, Any] = {
        "segment": "check",
        "model": "linear",
        "as_measured": "",
        "horizon_s": 5.0,
    }
    row |= {
        "starts": 4,
        "diverged": 4,
        "first_divergence_s": 1.0,
        **dict.fromkeys([*RMS.values(), *FIT]),
    }
    inputs = model_file.Inputs(
        campaign=run_inputs.campaign,
        vehicle=run_inputs.vehicle,
        provenance=run_inputs.provenance,
        model_card=collection({"linear": run.cards["linear"]}),
        ranking=run.ranking("linear"),
        free_run=make_table("free_run", {key: [row[key]] for key in row}),
    )
    return str(
        dict(model_file.run(inputs, model_file.Params()).model_file)["linear"].model_dump_json()
    )


def build(
    name: str, terms: dict[str, dict[str, float]], dynamics: dict[str, Any], added: Array
) -> ModelFile:
    """Return a model file with coefficients axis -> term -> value and changed dynamics.

    dynamics changes mass_kg, centre_of_gravity_m, inertia_kg_m2 (about the centre of
    gravity here), buoyancy_N, centre_of_buoyancy_m; added is M_A (6, 6), derivatives.
    """
    document = json.loads(base())
    d = document["dynamics"]
    d |= {"gravity_m_s2": GRAVITY, "water_density_kg_m3": DENSITY, **dynamics}
    rigid = rigid_body(
        d["mass_kg"], np.array(d["centre_of_gravity_m"]), np.array(d["inertia_kg_m2"])
    )
    d["inertia_kg_m2"] = rigid[3:, 3:].tolist()
    d |= {"rigid_body": rigid.tolist(), "added_mass": added.tolist()}
    d |= {"mass": (rigid - added).tolist(), "weight_N": d["mass_kg"] * d["gravity_m_s2"]}
    sample = document["coefficients"][0]
    document["coefficients"] = [
        sample
        | {"symbol": f"{axis}_{term}", "axis": axis, "term": term, "factors": factors(term)}
        | {"value": value, "predictor": value, "verdict": "identified", "determined": True}
        for axis, row in terms.items()
        for term, value in row.items()
    ]
    document |= {"name": name, "title": name, "covariance": {}, "combinations": {}}
    document |= {"fitted_inertia": [], "limits": [], "prior": None, "fitted_lag": None}
    return parse(ModelFile, document)


def factors(term: str) -> list[str]:
    """Return the factors of a term."""
    return [] if term == "constant" else term.split("*")


def draw(seed: int) -> np.random.Generator:
    """Return the generator of a model's numbers."""
    return np.random.default_rng(seed)


def own(axis: str) -> str:
    """Return the velocity along an axis."""
    return RATES[AXES.index(axis)]


def damping(pairs: Iterable[tuple[str, str]], seed: int) -> dict[str, dict[str, float]]:
    """Return coefficients for pairs of axis and term: own terms brake, couplings are small."""
    g, rows = draw(seed), {axis: {} for axis in AXES}  # type: ignore[var-annotated]
    for axis, term in pairs:
        if term in (own(axis), f"{own(axis)}*|{own(axis)}|"):
            rows[axis][term] = -float(g.uniform(4, 60)) * (1.0 if axis in "XYZ" else 0.05)
        else:
            rows[axis][term] = float(g.normal()) * (2.0 if axis in "XYZ" else 0.2)
    return rows


def symmetric_matrix(seed: int, diagonal: list[float], share: float) -> Array:
    """Return a symmetric matrix (n, n) with a diagonal and couplings up to `share` of it."""
    size = np.sqrt(np.outer(diagonal, diagonal))
    upper = np.triu(draw(seed).uniform(-share, share, size.shape) * size, 1)
    return np.diag(diagonal) + upper + upper.T


ADDED = [6.0, 13.0, 15.0, 0.12, 0.15, 0.13]


COUPLED = {
    "mass_kg": MASS,
    "centre_of_gravity_m": [0.02, -0.01, 0.03],
    "inertia_kg_m2": symmetric_matrix(2, [0.2, 0.25, 0.3], 0.1).tolist(),
    "buoyancy_N": MASS * GRAVITY + 2.5,
    "centre_of_buoyancy_m": [0.01, 0.015, -0.02],
}
"""Rigid body with offsets on all axes."""


def full() -> ModelFile:
    """Return a model with all 21 added masses, offsets on all axes, couplings on all axes."""
    pairs = [(axis, rate) for axis in AXES for rate in RATES]
    pairs += [(axis, f"{x}*|{y}|") for axis in AXES for x in RATES for y in RATES]
    pairs += [(axis, f"{x}*{y}") for axis in AXES for x, y in ("uv", "uw", "vr", "wq", "pr")]
    return build("full", damping(pairs, 1), COUPLED, -symmetric_matrix(3, ADDED, 0.15))


def cross_flow() -> ModelFile:
    """Return a model with terms of the cross-flow speed and constant forces."""
    pairs = [(axis, f"{x}*V") for axis in AXES for x in "vwqr"]
    pairs += [(axis, term) for axis in AXES for term in ("|r|*Vv", "|q|*Vw", "u*u", "constant")]
    pairs += [(axis, own(axis)) for axis in AXES]
    return build("cross_flow", damping(pairs, 6), COUPLED, -symmetric_matrix(3, ADDED, 0.15))


def symmetric() -> ModelFile:
    """Return a model that is alike to port and starboard: linear couplings, own squares."""
    even, odd = "uwq", "vpr"
    pairs = [(a, x) for a in AXES for x in (even if a in "XZM" else odd)]
    pairs += [(a, f"{own(a)}*|{own(a)}|") for a in AXES]
    added = np.diag(ADDED)
    for i, j, value in (
        (0, 2, 0.6),
        (0, 4, -0.3),
        (2, 4, -0.4),
        (1, 3, 0.25),
        (1, 5, 0.35),
        (3, 5, 0.01),
    ):
        added[i, j] = added[j, i] = value
    return build(
        "symmetric",
        damping(pairs, 4),
        {
            "mass_kg": MASS,
            "centre_of_gravity_m": [0.01, 0.0, 0.025],
            "inertia_kg_m2": [[0.2, 0, 0.01], [0, 0.25, 0], [0.01, 0, 0.3]],
            "buoyancy_N": MASS * GRAVITY + 1.5,
            "centre_of_buoyancy_m": [0.005, 0.0, -0.015],
        },
        -added,
    )


def balanced_thrusters() -> list[dict[str, Any]]:
    """Return the thrusters of the made-up run, moved so that their centre is the origin."""
    thrusters: list[dict[str, Any]] = json.loads(base())["dynamics"]["thrusters"]
    centre = np.mean([item["position_m"] for item in thrusters], axis=0)
    return [item | {"position_m": (item["position_m"] - centre).tolist()} for item in thrusters]


def centred() -> ModelFile:
    """Return the symmetric model with the centre of gravity in the origin."""
    terms = {axis: {} for axis in AXES}  # type: ignore[var-annotated]
    model = symmetric()
    for entry in model.coefficients:
        terms[entry.axis][entry.term] = entry.predictor
    rigid = {
        "thrusters": balanced_thrusters(),
        "mass_kg": MASS,
        "centre_of_gravity_m": [0.0, 0.0, 0.0],
        "inertia_kg_m2": [[0.2, 0, 0.01], [0, 0.25, 0], [0.01, 0, 0.3]],
        "buoyancy_N": MASS * GRAVITY + 1.5,
        "centre_of_buoyancy_m": [-0.005, 0.0, -0.04],
    }
    return build("centred", terms, rigid, np.array(model.dynamics.added_mass))


def diagonal() -> ModelFile:
    """Return a model of twelve coefficients with the centre of gravity in the origin."""
    pairs = [(a, own(a)) for a in AXES] + [(a, f"{own(a)}*|{own(a)}|") for a in AXES]
    return build(
        "diagonal",
        damping(pairs, 5),
        {
            "thrusters": balanced_thrusters(),
            "mass_kg": MASS,
            "centre_of_gravity_m": [0.0, 0.0, 0.0],
            "inertia_kg_m2": np.diag([0.2, 0.25, 0.3]).tolist(),
            "buoyancy_N": MASS * GRAVITY + 1.0,
            "centre_of_buoyancy_m": [0.0, 0.0, -0.02],
        },
        -np.diag(ADDED),
    )


MODELS = {
    "full": full,
    "cross_flow": cross_flow,
    "symmetric": symmetric,
    "centred": centred,
    "diagonal": diagonal,
}


def states(count: int, seed: int = 7) -> tuple[Array, Array]:
    """Return velocities and poses (count, 6) of a vehicle under water, seeded."""
    g = draw(seed)
    nu = g.uniform(-1, 1, (count, 6)) * [1.5, 1.0, 1.0, 1.0, 1.0, 1.0]
    eta = g.uniform(-1, 1, (count, 6)) * [50, 50, 5, 1.0, 1.0, 3.0] + [0, 0, 20, 0, 0, 0]
    return nu, eta


def changed(model: ModelFile, **dynamics: object) -> ModelFile:
    """Return a model file with some figures of its dynamics replaced, unchecked."""
    return model.model_copy(update={"dynamics": model.dynamics.model_copy(update=dynamics)})
