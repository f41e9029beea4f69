"""One variant of the chain on one plan, measured against the truth, and its bounds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from auvid.data_schemas.errors import CampaignError, DataError, nearest
from auvid.data_schemas.records.models import ModelCard
from auvid.data_schemas.tables import matrix
from auvid.hydro.arrays import Array
from auvid.stages.base import Document
from auvid.stages.columns import VELOCITY, clock, force_columns, forces
from auvid.stages.reference_check import ReferenceCheck
from auvid.stages.reproduce.artefacts import Artefacts
from auvid.stages.truth_lookup import bias_errors, drawn_biases, true_values

SETS = ("training", "validation")
TURN_TERMS = ("u*r", "r*|u|")
"""The terms of the sway force that carry the transport acceleration on data with u > 0."""
FIGURES = {
    "j0": "J0",
    "ratio": "J/J0",
    "order": "J/J0 in groups: largest of one over smallest of the next",
    "force_error": "RMS error of the residual force over six axes",
    "velocity_error": "RMS error of u, v, w",
    "gyro_bias": "RMS error of the gyro bias",
    "accel_bias": "RMS error of the accelerometer bias",
    "sway_gap": "largest RMS of integrated minus measured sway",
}


@dataclass(frozen=True)
class ModelErrors:
    """Errors of one model on one set, over all axes and legs."""

    title: str
    n_bar: int
    rank: int
    j: float
    ratio: float


@dataclass(frozen=True)
class VariantMeasures:
    """One variant on one plan.

    `force_error` (6,), `force` (6,), `velocity_error` (6,): RMS per axis over all legs.
    `turn`: the number c that fits the sway force by c u r alone on the training legs,
    `turn_added` the same for the error of the sway force. `turn_terms`: model -> term
    and fitted value.
    """

    scores: Mapping[tuple[str, str], ModelErrors]
    j0: Mapping[str, float]
    force: Array
    force_error: Array
    velocity_error: Array
    gyro_bias: float | None
    accel_bias: float | None
    sway_gap: float | None
    turn: float
    turn_added: float
    turn_terms: Mapping[str, tuple[str, float]]
    warnings: tuple[str, ...]

    @property
    def total_force(self) -> float:
        return root_mean_square(self.force)

    @property
    def total_force_error(self) -> float:
        return root_mean_square(self.force_error)

    def figure(self, name: str) -> float | None:
        """Return a figure of `FIGURES` that is one number."""
        if name == "force_error":
            return self.total_force_error
        if name == "velocity_error":
            return root_mean_square(self.velocity_error[:3])
        value: float | None = getattr(self, name)
        return value


@dataclass(frozen=True)
class VariantCheck:
    """A bound on a variant of a plan beside what was measured."""

    plan: str
    variant: str
    check: ReferenceCheck


def root_mean_square(values: Array) -> float:
    """Return the root mean square over all entries."""
    return float(np.sqrt(np.mean(np.square(values))))


def measure(key: str, inputs: Artefacts) -> VariantMeasures:
    """Measure the artefacts of `PLAN/VARIANT` against the truth of the twin."""
    errors: list[Array] = []
    true_forces: list[Array] = []
    velocities: list[Array] = []
    bias_error: dict[str, list[Array]] = {}
    sway: list[float] = []
    turn: list[tuple[Array, Array, Array]] = []
    warnings: list[str] = []
    rotation = inputs.vehicle.imu.rotation
    biases = drawn_biases(inputs.simulation[key])
    for segment_key in inputs.residual:
        if not segment_key.startswith(f"{key}/"):
            continue
        segment, fusion = inputs.segment[segment_key], inputs.fusion[segment_key]
        residual = inputs.residual[segment_key]
        truth = inputs.truth[f"{key}/{segment.log}"]
        at = clock(residual) + float(segment.leg_start_s)
        bar, nu = forces(residual, "tau_bar"), matrix(residual, VELOCITY)
        true_bar = true_values(truth, force_columns("tau_bar"), at)
        true_nu = true_values(truth, VELOCITY, at)
        errors.append(bar - true_bar)
        true_forces.append(true_bar)
        velocities.append(nu - true_nu)
        if segment.use == "training":
            turn.append((true_nu[:, 0] * true_nu[:, 5], bar[:, 1], bar[:, 1] - true_bar[:, 1]))
        for name, (error, _) in bias_errors(fusion, biases[str(segment.log)], rotation).items():
            bias_error.setdefault(name, []).append(error)
        if fusion.integrated_sway_rms_m_s is not None:
            sway.append(float(fusion.integrated_sway_rms_m_s))
        warnings += fusion.warnings
    if not turn:
        raise DataError(f"no training leg of '{key}' was run")
    rate, bar_y, added = (np.concatenate(parts) for parts in zip(*turn, strict=True))
    cards = {
        name.rpartition("/")[2]: inputs.model_card[name]
        for name in inputs.model_card
        if name.startswith(f"{key}/")
    }
    totals = [
        row for row in inputs.error_table[key].to_pylist() if row["leg"] == row["axis"] == "all"
    ]
    return VariantMeasures(
        scores={
            (row["use"], row["model"]): ModelErrors(
                str(cards[row["model"]].title),
                row["n_bar"],
                row["rank"],
                row["rms"],
                row["ratio"],
            )
            for row in totals
        },
        j0={row["use"]: row["j0"] for row in totals},
        force=_rms(true_forces),
        force_error=_rms(errors),
        velocity_error=_rms(velocities),
        gyro_bias=_total_of(bias_error.get("gyro_bias_rad_s")),
        accel_bias=_total_of(bias_error.get("accel_bias_m_s2")),
        sway_gap=max(sway, default=None),
        turn=float(rate @ bar_y / (rate @ rate)),
        turn_added=float(rate @ added / (rate @ rate)),
        turn_terms=_turn_terms(cards),
        warnings=tuple(warnings),
    )


def _total_of(parts: Sequence[Array] | None) -> float | None:
    return None if parts is None else root_mean_square(np.concatenate(parts))


def _rms(parts: Sequence[Array]) -> Array:
    return np.asarray(np.sqrt(np.mean(np.square(np.concatenate(parts)), axis=0)))


def _turn_terms(cards: Mapping[str, ModelCard]) -> dict[str, tuple[str, float]]:
    """Return the transport term of each model's sway force and its value."""
    return {
        model: (term, float(sway[term]))
        for model, card in cards.items()
        for sway in [card.predictor.get("Y", {})]
        for term in TURN_TERMS
        if term in sway
    }


def checks(document: Document, measures: Mapping[str, VariantMeasures]) -> list[VariantCheck]:
    """Hold the bounds of a document against the measures.

    Raises `CampaignError` for a bound on what was not run or not measured.
    """
    return [_check(entry, index, measures) for index, entry in enumerate(document["expected"])]


def _check(entry: Document, index: int, measures: Mapping[str, VariantMeasures]) -> VariantCheck:
    key, at = f"{entry['plan']}/{entry['variant']}", f"expected[{index}]"
    if key not in measures:
        raise CampaignError(
            "no such variant of a plan was run",
            field=at,
            value=key,
            allowed=tuple(measures),
            remedy=nearest(key, measures),
        )
    item, name = measures[key], str(entry["figure"])
    sets = entry.get("sets") or [use for use in SETS if use in item.j0]
    quantity, low, high = FIGURES[name], entry.get("low"), entry.get("high")
    groups = entry.get("groups") or []
    if name == "j0":
        values = [item.j0[use] for use in sets]
    elif name == "ratio":
        models = entry.get("models") or list(dict.fromkeys(model for _, model in item.scores))
        values = [_ratio(item, use, model, at) for use in sets for model in models]
        quantity += f" of {_titles(item, models)}"
    elif name == "order":
        values = [step for use in sets for step in _steps(item, use, groups, at)]
        high = 1.0 if high is None else high
        quantity += f": {' < '.join(_titles(item, group) for group in groups)}"
    else:
        value = item.figure(name)
        if value is None:
            raise CampaignError(f"'{key}' has no such figure", field=at, value=name)
        values = [value]
    if not values:
        raise CampaignError("nothing to hold against this bound", field=at, value=name)
    if name in ("j0", "ratio", "order") and len(sets) == 1:
        quantity += f", {sets[0]}"
    check = ReferenceCheck(
        quantity,
        max(values),
        least=min(values),
        low=low,
        high=high,
        accepted_reason=str(entry.get("accepted_reason", "")),
        evidence=entry["evidence"],
        evidence_reason=str(entry["reason"]),
    )
    return VariantCheck(entry["plan"], entry["variant"], check)


def _ratio(item: VariantMeasures, use: str, model: str, at: str) -> float:
    if (use, model) not in item.scores:
        models = sorted({name for _, name in item.scores})
        raise CampaignError(
            "no such model was fitted",
            field=at,
            value=model,
            allowed=models,
            remedy=nearest(model, models),
        )
    return item.scores[use, model].ratio


def _titles(item: VariantMeasures, models: Sequence[str]) -> str:
    titles = {name: score.title for (_, name), score in item.scores.items()}
    return ", ".join(titles.get(model, model) for model in models)


def _steps(
    item: VariantMeasures, use: str, groups: Sequence[Sequence[str]], at: str
) -> list[float]:
    """Compare neighbouring groups.

    Largest J/J0 of the first over smallest of the next.
    """
    ratios = [[_ratio(item, use, model, at) for model in group] for group in groups]
    return [max(first) / min(second) for first, second in pairwise(ratios)]
