"""What one variant of the chain found on one plan, measured against the truth of the
twin; and bounds held against it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from auvid.data_schemas.errors import CampaignError, DataError, nearest
from auvid.data_schemas.tables import matrix
from auvid.hydro.arrays import Array
from auvid.stages.base import Document
from auvid.stages.columns import VELOCITY, clock, force_columns, forces
from auvid.stages.truth_lookup import bias_errors, drawn_biases, true_values

if TYPE_CHECKING:
    from auvid.stages.reproduce import Inputs

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
class Score:
    """Errors of one model on one set, over all axes and legs."""

    title: str
    n_bar: int
    rank: int
    j: float
    ratio: float


@dataclass(frozen=True)
class Found:
    """One variant on one plan.

    `force_error` (6,), `force` (6,), `velocity_error` (6,): RMS per axis over all legs.
    `turn`: the number c that fits the sway force by c u r alone on the training legs,
    and `turn_added` the same for the error of the sway force. `turn_terms`: model ->
    fitted value.
    """

    scores: Mapping[tuple[str, str], Score]
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

    def figure(self, name: str) -> float | None:
        """A figure of `FIGURES` that is one number."""
        if name == "force_error":
            return total(self.force_error)
        if name == "velocity_error":
            return total(self.velocity_error[:3])
        value: float | None = getattr(self, name)
        return value


@dataclass(frozen=True)
class Check:
    """A bound beside what was measured: all values from `least` to `most`."""

    plan: str
    variant: str
    asked: str
    low: float | None
    high: float | None
    least: float
    most: float
    known: str = field(default="")

    @property
    def met(self) -> bool:
        """Whether every value is within the bounds."""
        return (self.low is None or self.least >= self.low) and (
            self.high is None or self.most <= self.high
        )


def total(per_axis: Array) -> float:
    """Root mean square over axes."""
    return float(np.sqrt(np.mean(np.square(per_axis))))


def measure(key: str, inputs: Inputs) -> Found:
    """What the artefacts of `plan/variant` say."""
    plan = key.split("/")[0]
    errors: list[Array] = []
    true_forces: list[Array] = []
    velocities: list[Array] = []
    found_biases: dict[str, list[Array]] = {}
    sway: list[float] = []
    turn: list[tuple[Array, Array, Array]] = []
    warnings: list[str] = []
    rotation, biases = (
        inputs.vehicle.imu.rotation,
        drawn_biases(inputs.simulation[plan]),
    )
    for segment_key in inputs.residual:
        if not segment_key.startswith(f"{key}/"):
            continue
        segment, fusion, residual = (
            inputs.segment[segment_key],
            inputs.fusion[segment_key],
            inputs.residual[segment_key],
        )
        truth = inputs.truth[f"{plan}/{segment['log']}"]
        at = clock(residual) + float(segment["leg_start_s"])
        bar, nu = forces(residual, "tau_bar"), matrix(residual, VELOCITY)
        true_bar, true_nu = (
            true_values(truth, force_columns("tau_bar"), at),
            true_values(truth, VELOCITY, at),
        )
        errors.append(bar - true_bar)
        true_forces.append(true_bar)
        velocities.append(nu - true_nu)
        if segment["use"] == "training":
            turn.append((true_nu[:, 0] * true_nu[:, 5], bar[:, 1], bar[:, 1] - true_bar[:, 1]))
        for name, (wrong, _) in bias_errors(fusion, biases[str(segment["log"])], rotation).items():
            found_biases.setdefault(name, []).append(wrong)
        if fusion["integrated_sway_rms_m_s"] is not None:
            sway.append(float(fusion["integrated_sway_rms_m_s"]))
        warnings += fusion["warnings"]
    if not turn:
        raise DataError(f"no training leg of '{key}' was run")
    rate, bar_y, added = (np.concatenate(parts) for parts in zip(*turn, strict=True))
    scores, j0 = _scores(inputs.error_table[key].to_pylist(), _titles(key, inputs))
    return Found(
        scores=scores,
        j0=j0,
        force=_rms(true_forces),
        force_error=_rms(errors),
        velocity_error=_rms(velocities),
        gyro_bias=_total_of(found_biases.get("gyro_bias_rad_s")),
        accel_bias=_total_of(found_biases.get("accel_bias_m_s2")),
        sway_gap=max(sway, default=None),
        turn=float(rate @ bar_y / (rate @ rate)),
        turn_added=float(rate @ added / (rate @ rate)),
        turn_terms=_turn_terms(key, inputs),
        warnings=tuple(warnings),
    )


def _total_of(parts: Sequence[Array] | None) -> float | None:
    return None if parts is None else total(np.concatenate(parts))


def _rms(parts: Sequence[Array]) -> Array:
    return np.asarray(np.sqrt(np.mean(np.square(np.concatenate(parts)), axis=0)))


def _titles(key: str, inputs: Inputs) -> dict[str, str]:
    return {
        name.rpartition("/")[2]: str(card["title"])
        for name in inputs.model_card
        if name.startswith(f"{key}/")
        for card in [inputs.model_card[name]]
    }


def _scores(
    rows: Sequence[Mapping[str, Any]], titles: Mapping[str, str]
) -> tuple[dict[tuple[str, str], Score], dict[str, float]]:
    whole = [row for row in rows if row["leg"] == row["axis"] == "all"]
    scores = {
        (row["use"], row["model"]): Score(
            titles[row["model"]], row["n_bar"], row["rank"], row["rms"], row["ratio"]
        )
        for row in whole
    }
    return scores, {row["use"]: row["j0"] for row in whole}


def _turn_terms(key: str, inputs: Inputs) -> dict[str, tuple[str, float]]:
    found = {}
    for name in inputs.model_card:
        if name.startswith(f"{key}/"):
            sway = inputs.model_card[name]["solution"].get("Y", {})
            for term in TURN_TERMS:
                if term in sway:
                    found[name.rpartition("/")[2]] = (term, float(sway[term]))
    return found


def checks(document: Document, found: Mapping[str, Found]) -> list[Check]:
    """The bounds of a document beside what was measured. Raises `CampaignError` for a
    bound on what was not run or not measured.
    """
    return [_check(entry, index, found) for index, entry in enumerate(document["expected"])]


def _check(entry: Mapping[str, Any], index: int, found: Mapping[str, Found]) -> Check:
    key, at = f"{entry['plan']}/{entry['variant']}", f"expected[{index}]"
    if key not in found:
        raise CampaignError(
            "no such variant of a plan was run",
            field=at,
            value=key,
            allowed=tuple(found),
            remedy=nearest(key, found),
        )
    item, name = found[key], str(entry["figure"])
    sets = entry.get("sets") or [use for use in SETS if use in item.j0]
    words, low, high = FIGURES[name], entry.get("low"), entry.get("high")
    if name == "j0":
        values = [item.j0[use] for use in sets]
    elif name == "ratio":
        models = entry.get("models") or list(dict.fromkeys(model for _, model in item.scores))
        values = [_ratio(item, use, model, at) for use in sets for model in models]
        words += f" of {', '.join(_title(item, model) for model in models)}"
    elif name == "order":
        values = [step for use in sets for step in _steps(item, use, entry.get("groups") or [], at)]
        high = 1.0 if high is None else high
        words += f": {' < '.join(', '.join(_title(item, model) for model in group) for group in entry.get('groups') or [])}"
    else:
        value = item.figure(name)
        if value is None:
            raise CampaignError(f"'{key}' has no such figure", field=at, value=name)
        values = [value]
    if not values:
        raise CampaignError("nothing to hold against this bound", field=at, value=name)
    if name in ("j0", "ratio", "order") and len(sets) == 1:
        words += f", {sets[0]}"
    return Check(
        entry["plan"],
        entry["variant"],
        words,
        low,
        high,
        min(values),
        max(values),
        str(entry.get("known", "")),
    )


def _ratio(item: Found, use: str, model: str, at: str) -> float:
    if (use, model) not in item.scores:
        known = sorted({name for _, name in item.scores})
        raise CampaignError(
            "no such model was fitted",
            field=at,
            value=model,
            allowed=known,
            remedy=nearest(model, known),
        )
    return item.scores[(use, model)].ratio


def _title(item: Found, model: str) -> str:
    return next((score.title for (_, name), score in item.scores.items() if name == model), model)


def _steps(item: Found, use: str, groups: Sequence[Sequence[str]], at: str) -> list[float]:
    """For each pair of neighbouring groups: the largest J/J0 of the first over the
    smallest of the second.
    """
    ratios = [[_ratio(item, use, model, at) for model in group] for group in groups]
    return [max(first) / min(second) for first, second in pairwise(ratios)]
