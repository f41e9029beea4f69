"""Priors of a campaign: results of benches, cards of campaigns, published sets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from auvid.data_schemas.documents import delivered
from auvid.data_schemas.documents.campaign import PriorEntry
from auvid.data_schemas.errors import CampaignError, nearest
from auvid.data_schemas.records.models import ModelCard
from auvid.hydro.arrays import AXES
from auvid.hydro.dynamics.viscous.basis import BASIS_TERMS, coefficient_unit
from auvid.hydro.dynamics.viscous.coefficients import viscous_terms
from auvid.pipeline.campaigns.vehicle_files import load_published
from auvid.pipeline.campaigns.yaml_files import load_yaml

NAMES = {f"{axis}_{term.replace('*', '')}": (axis, term) for axis in AXES for term in BASIS_TERMS}
"""Name of a coefficient -> axis and term: `X_u|u|`."""
RESTING = ("at its bound", "from the prior", "from the shelf", "from a bench")
"""Verdicts of numbers that are not of that campaign's data."""
SHELF_SD = 0.5
"""Standard deviation of a published coefficient as a share of its value."""


class FileValues(NamedTuple):
    """Coefficients of a file by name, and their covariances by pairs of names."""

    values: Mapping[str, float]
    covariances: Mapping[tuple[str, str], float]


def prior_source(entry: PriorEntry, path: Path, *, named_in: Path, field: str) -> dict[str, Any]:
    """Return the document of a `PriorSource`; `CampaignError` for unknown terms."""
    kind, label = "shelf", str(entry.shelf)
    if entry.shelf is not None:
        content = _of_shelf(path, entry.prior_sd or SHELF_SD, named_in=named_in)
    else:
        kind, label = "bench" if entry.bench is not None else "campaign", path.name
        file = load_yaml(path, named_in=named_in, what=field)  # JSON is YAML
        content = _of_bench(file.value, path) if kind == "bench" else _of_model(file.value, path)
    for index, name in enumerate(entry.terms or ()):
        if name not in content.values:
            raise CampaignError(
                "the file has no such coefficient with a standard error",
                file=named_in,
                field=f"{field}.terms[{index}]",
                value=name,
                allowed=list(content.values),
                remedy=nearest(name, content.values),
            )
    names = entry.terms or list(content.values)
    if not names:
        raise CampaignError(
            "the file has no coefficient of damping with a standard error",
            file=named_in,
            field=field,
            value=str(path),
        )
    factor = entry.widen**2
    return {
        "kind": kind,
        "file": label,
        "terms": [
            {"axis": NAMES[name][0], "term": NAMES[name][1], "value": content.values[name]}
            for name in names
        ],
        "lower": [
            [factor * content.covariances.get((name, other), 0.0) for other in names[: i + 1]]
            for i, name in enumerate(names)
        ],
    }


def _of_shelf(path: Path, relative_sd: float, *, named_in: Path) -> FileValues:
    """Return damping and lift of a published set, independent of each other."""
    published = viscous_terms(load_published(path, named_in=named_in).published.values())
    values = {
        name: published[axis][term]
        for name, (axis, term) in NAMES.items()
        if published.get(axis, {}).get(term)
    }
    errors = {(name, name): (relative_sd * value) ** 2 for name, value in values.items()}
    return FileValues(values, errors)


def _of_bench(document: object, path: Path) -> FileValues:
    """Return the figures of `results` that are coefficients in SI, independent."""
    results = delivered(document, "results", file=path)
    values, covariances = {}, {}
    rows: Sequence[Mapping[str, Any]] = results["rows"]
    for row in rows:
        name, error = row["quantity"], row.get("standard_error")
        if name not in NAMES or row["value"] is None or not error:
            continue
        unit = coefficient_unit(*NAMES[name])
        if row["unit"].replace("*", " ") != unit.replace("*", " "):
            raise CampaignError(
                "a bench result in another unit is no prior",
                file=path,
                field=name,
                value=row["unit"],
                allowed=unit,
            )
        values[name] = float(row["value"])
        covariances[name, name] = float(error) ** 2
    return FileValues(values, covariances)


def _of_model(document: object, path: Path) -> FileValues:
    """Return the posterior of a model card in newtons, else raise `CampaignError`."""
    if isinstance(document, Mapping) and "dynamics" in document:
        raise CampaignError(
            "a model file is no prior: a model card is",
            file=path,
            remedy="Name runs/CAMPAIGN/STAGE/model_card/MODEL.json of the run that made it.",
        )
    card = delivered(document, "model_card", file=path)
    for axis, part in card.axes.items():
        for item in part.terms:
            unit = coefficient_unit(axis, item.term) if item.term in BASIS_TERMS else item.unit
            if item.value is not None and item.unit.replace("*", " ") != unit.replace("*", " "):
                raise CampaignError(
                    "a model in other units is no prior: without newtons a fit gives damping over"
                    " mass",
                    file=path,
                    field=f"{axis}_{item.term.replace('*', '')}",
                    value=item.unit,
                    allowed=unit,
                    remedy="Give its campaign newtons (full_force, or newtons_from: mass) and run"
                    " it again.",
                )
    return _of_card(card)


def _of_card(card: ModelCard) -> FileValues:
    """Return the posterior of a card, in the size of the printed standard errors."""
    values, covariances = {}, {}
    for axis, part in card.axes.items():
        terms = {
            item.term: item
            for item in part.terms
            if item.value is not None and item.standard_error and item.verdict not in RESTING
        }
        listed, lower = part.covariance.terms, part.covariance.lower
        name_of = {term: f"{axis}_{term.replace('*', '')}" for term in listed}
        kept = [i for i, term in enumerate(listed) if term in terms and term in BASIS_TERMS]
        scale = {
            i: terms[listed[i]].standard_error / lower[i][i] ** 0.5 for i in kept if lower[i][i] > 0
        }
        for i in scale:
            values[name_of[listed[i]]] = float(terms[listed[i]].value or 0.0)
            for j in scale:
                if j <= i:
                    covariances[name_of[listed[i]], name_of[listed[j]]] = (
                        lower[i][j] * scale[i] * scale[j]
                    )
    both = {(b, a): value for (a, b), value in covariances.items()}
    return FileValues(values, both | covariances)
