"""`auvid coefficients`: strip theory of a vehicle, and published coefficients."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from auvid.data_schemas.errors import PipelineError, UsageError, nearest
from auvid.hydro.dynamics.hybrid_vehicle import PARAMETER_SETS, parameter_coefficients
from auvid.hydro.dynamics.vehicle.strip_theory import strip_theory_of
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.basis import BASIS_TERMS
from auvid.hydro.dynamics.viscous.coefficients import Coefficient, viscous_terms
from auvid.pipeline.campaigns.vehicle_files import load_vehicle, read_coefficients
from auvid.pipeline.campaigns.vehicle_files import published_coefficients as coefficient_files
from auvid.pipeline.campaigns.workspace import vehicle_file_of
from auvid.pipeline.output import answer
from auvid.pipeline.terminal import table
from auvid.stages.number_format import significant

KINDS = {
    "added_mass": "Added mass, tau_A = M_A nu_dot (M_A <= 0)",
    "drag": "Drag",
    "body_lift": "Lift of the hull",
    "surface_lift": "Lift of fins and wings",
    "control": (
        "Control, times u^2 delta: both fins of a pair together, for K the right one by delta and"
        " the left by -delta"
    ),
}


def coefficients_of(
    vehicle: str, *, parameter_set: str = "corrected", model: str | None = None
) -> dict[str, Any]:
    """Return strip theory and published coefficients of a vehicle, as a document.

    `published` of a row is what the vehicle file prints. `model` names one of the
    models whose published coefficients lie beside the vehicle file; its terms that
    strip theory has too stand under `model`. Raises `PipelineError` for unknown names,
    a vehicle without geometry, and geometry that cannot be.
    """
    if parameter_set not in PARAMETER_SETS:
        raise UsageError(
            "unknown parameter set",
            field="--set",
            value=parameter_set,
            allowed=PARAMETER_SETS,
            remedy=nearest(parameter_set, PARAMETER_SETS),
        )
    path = vehicle_file_of(vehicle)
    loaded = load_vehicle(path)
    of_file = loaded.vehicle
    try:
        used = _used(of_file, parameter_set)
    except PipelineError as fault:
        raise loaded.file.located(fault) from None
    rows = [_row(item, of_file.published.get(item.name)) for item in used]
    files = coefficient_files(path)
    if model is not None and model not in files:
        raise UsageError(
            "no published coefficients of this model",
            file=path,
            value=model,
            allowed=list(files),
            remedy=nearest(model, files),
        )
    terms = viscous_terms(used)
    compared = [] if model is None else _shared_terms(terms, read_coefficients(files[model]))
    return {
        "vehicle": of_file.name,
        "title": of_file.title,
        "file": str(path),
        "parameter_set": parameter_set,
        "coefficients": rows,
        "viscous_model": terms,
        "model": {"name": model, "terms": compared} if model else None,
    }


def print_coefficients(vehicle: str, *, parameter_set: str, model: str | None) -> None:
    """Print `coefficients_of` as text."""
    document = coefficients_of(vehicle, parameter_set=parameter_set, model=model)
    answer(document)
    _print(document)


def _used(vehicle: Vehicle, parameter_set: str) -> tuple[Coefficient, ...]:
    """Return the coefficients of a parameter set.

    Formulas for `as_printed` and `corrected`; the published ones with their
    replacements for `as_simulated`.
    """
    if parameter_set in PARAMETER_SETS and parameter_set != "as_simulated":
        return strip_theory_of(vehicle, corrected=parameter_set == "corrected")
    order = list(KINDS)
    return tuple(
        sorted(
            parameter_coefficients(vehicle, parameter_set), key=lambda item: order.index(item.kind)
        )
    )


def _row(item: Coefficient, published: Coefficient | None) -> dict[str, Any]:
    row: dict[str, Any] = {
        "name": item.name,
        "kind": item.kind,
        "value": item.value,
        "unit": item.unit,
        "formula": item.formula,
        "source": item.source,
        "note": item.note,
    }
    if published is not None and published.kind == item.kind:
        row["published"], row["published_source"] = published.value, published.source
    return row


def _shared_terms(
    ours: Mapping[str, Mapping[str, float]], theirs: Mapping[str, Mapping[str, float]]
) -> list[dict[str, Any]]:
    """Return the terms that both have, with both values."""
    shared = (
        (axis, term)
        for axis, terms in ours.items()
        for term in terms
        if term in theirs.get(axis, {})
    )
    return [
        {
            "axis": axis,
            "term": term,
            "strip_theory": ours[axis][term],
            "published": theirs[axis][term],
        }
        for axis, term in shared
    ]


def _print(document: Mapping[str, Any]) -> None:
    print(f"{document['title']}, parameter set {document['parameter_set']}\n{document['file']}")
    for kind, title in KINDS.items():
        rows = [row for row in document["coefficients"] if row["kind"] == kind]
        if rows:
            print()
        table(
            ("name", "value", "unit", "published", "formula", "source", "note"),
            [
                (
                    row["name"],
                    significant(row["value"], 5),
                    row["unit"],
                    f"{row['published']:g} ({row['published_source']})"
                    if "published" in row
                    else "",
                    row["formula"] or "",
                    row["source"],
                    row["note"] or "",
                )
                for row in rows
            ],
            title=title,
            indent=2,
        )
    print("\nViscous model (drag and lift together), by axis and basis term")
    for axis, terms in document["viscous_model"].items():
        values = (
            f"{BASIS_TERMS[term].name} {significant(value, 5)}" for term, value in terms.items()
        )
        print(f"  {axis}  " + ", ".join(values))
    if document["model"]:
        print()
        table(
            ("axis", "term", "strip theory", "published"),
            [
                (
                    row["axis"],
                    row["term"],
                    significant(row["strip_theory"], 5),
                    significant(row["published"], 5),
                )
                for row in document["model"]["terms"]
            ],
            title=f"Compared with the published model {document['model']['name']}",
            indent=2,
        )
