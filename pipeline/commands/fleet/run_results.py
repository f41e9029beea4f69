"""What the run of one campaign of a fleet came to: state, verdicts, coefficients."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from auvid.data_schemas.records.fleet import FleetCoefficient, FleetRun, FleetVerdict
from auvid.data_schemas.records.models import AxisCard, ModelCard, RankingRecord, VelocityRange
from auvid.data_schemas.records.motion import InstallationRecord
from auvid.hydro.arrays import AXES
from auvid.hydro.identification.fleet.drag import drag_terms
from auvid.hydro.identification.fleet.figures import covariance_of, figures_of_installation
from auvid.hydro.identification.fleet.thruster_strength import ThrusterStrength
from auvid.pipeline.commands.fleet.fleet_tables import INSTALLATION, THRUSTERS
from auvid.pipeline.commands.run.answer import answer_of
from auvid.pipeline.execution.runner import Run
from auvid.pipeline.graph import ONCE
from auvid.stages.model_use import damping_verdict
from auvid.stages.page.first_screen import ALL
from auvid.stages.synthesise.wiring import strengths, thruster_legs

DETERMINED = ("identified", "weak", "persistently exciting")
USES = ("control", "simulation", "forces")


def results_of(run: Run, root: Path, key: str, reason: str) -> FleetRun:
    """Return what a campaign of the fleet in folder `root` gave, as far as it ran.

    `reason`: why it ended before its last stage; empty where it did not.
    """
    cards = list(run.documents("model_card"))
    ranking: RankingRecord | None = next(run.documents("ranking"), None)
    figures = [
        (str(document["title"]), row)
        for document in run.documents("results")
        for row in document["rows"]
    ]
    choice = "" if ranking is None else ranking.choice or ""
    reached = [stage.name for stage in run.graph.stages if run.manifests[stage.name].records]
    answer = answer_of(run)
    usable = bool(choice) or any(row.get("verdict") in DETERMINED for _, row in figures)
    headline = answer.partition("\n")[0]
    if not reason and not usable:
        reason = headline or "nothing that it fits is determined"
    speeds: dict[str, VelocityRange] = next(
        (card.conditions for card in cards if card.name == choice), {}
    )
    return FleetRun(
        key=key,
        id=run.campaign.name,
        state="partly" if reason else "done",
        reason=reason,
        reached=reached[-1] if reached else "",
        headline=headline,
        model=choice,
        verdicts=[] if ranking is None else list(_verdicts(ranking, cards)),
        coefficients=[
            *(item for card in cards for item in _terms(card, recommended=card.name == choice)),
            *(_figure(title, row) for title, row in figures),
            *(item for record in run.documents("installation") for item in _sensors(record)),
            *_thrusters(run),
        ],
        speeds={name: item.rms for name, item in speeds.items()},
        report=_path(run, "report_html", root) if answer else "",
        recording=_path(run, "recording", root) if answer else "",
    )


def _strengths(run: Run) -> Iterator[ThrusterStrength]:
    """Yield the strengths of the thrusters of the legs that a model is fitted on."""
    vehicle = run.campaign.vehicle
    if vehicle.thrusters is not None:
        tables = zip(run.documents("residual"), run.documents("controls"), strict=True)
        yield from strengths(thruster_legs(tables, vehicle), vehicle)


def _path(run: Run, schema: str, root: Path) -> str:
    (port,) = run.graph.producers(schema)
    return str((run.manifests[port.stage.name].folder / port.path(ONCE)).relative_to(root))


def _verdicts(ranking: RankingRecord, cards: list[ModelCard]) -> Iterator[FleetVerdict]:
    by_name = {card.name: card for card in cards}
    for model in ranking.models:
        recommended = model.name == ranking.choice
        for axis, merit in model.axes.items():
            card = by_name.get(model.name)
            damping = "" if axis == ALL or card is None else damping_verdict(card, axis)
            use = ""
            if recommended and ranking.usable is not None and axis != ALL:
                use = next((name for name in USES if axis in getattr(ranking.usable, name)), "")
            yield FleetVerdict(
                model=model.name,
                recommended=recommended,
                axis=axis,
                validation=merit.validation,
                training=merit.training,
                free_run=merit.free_run,
                identified=merit.identified,
                coefficients=merit.coefficients,
                damping=damping,
                use=use,
            )


def _terms(card: ModelCard, *, recommended: bool) -> Iterator[FleetCoefficient]:
    for axis in (axis for axis in AXES if axis in card.axes):
        correlation = _trade(card.axes[axis], axis)
        for item in card.axes[axis].terms:
            yield FleetCoefficient(
                model=card.name,
                recommended=recommended,
                axis=axis,
                term=item.term,
                unit=item.unit,
                value=item.value,
                standard_error=item.standard_error,
                verdict=item.verdict,
                correlation=correlation if item.term in drag_terms(axis) else None,
            )


def _trade(part: AxisCard, axis: str) -> float | None:
    """Return the correlation of linear and quadratic damping of an axis."""
    terms = part.covariance.terms
    if any(term not in terms for term in drag_terms(axis)):
        return None
    linear, quadratic = map(terms.index, drag_terms(axis))
    covariance = covariance_of(part)
    scale = covariance[linear, linear] * covariance[quadratic, quadratic]
    return float(covariance[linear, quadratic] / np.sqrt(scale)) if scale > 0.0 else None


def _sensors(record: InstallationRecord) -> Iterator[FleetCoefficient]:
    """Yield the departures of sensors that the legs show."""
    for name, (value, error) in figures_of_installation(record).items():
        quantity, _, unit = name.rpartition(" [")
        yield _extra(INSTALLATION, quantity, unit.rstrip("]"), value, error, "identified")


def _thrusters(run: Run) -> Iterator[FleetCoefficient]:
    """Yield the strength of each thruster over its like, or why legs do not tell it."""
    for thruster in _strengths(run):
        separable = bool(np.isfinite(thruster.strength))
        yield _extra(
            THRUSTERS,
            f"thruster {thruster.thruster}",
            "1",
            thruster.strength if separable else None,
            thruster.standard_error if separable else None,
            "identified" if thruster.verdict == "as the others" else thruster.verdict,
        )


def _extra(
    model: str, term: str, unit: str, value: float | None, error: float | None, verdict: str
) -> FleetCoefficient:
    return FleetCoefficient(
        model=model,
        recommended=False,
        axis="",
        term=term,
        unit=unit,
        value=value,
        standard_error=error,
        verdict=verdict,
    )


def _figure(title: str, row: dict[str, Any]) -> FleetCoefficient:
    return FleetCoefficient(
        model=title,
        recommended=True,
        axis="",
        term=str(row["quantity"]),
        unit=str(row["unit"]),
        value=row["value"],
        standard_error=row.get("standard_error"),
        verdict=row.get("verdict") or "",
    )
