"""The model file's card of a glider: its drag and lift as viscous terms, its trim."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from auvid.data_schemas.records.models import ModelCard, RankingRecord, TermCard, Verdict
from auvid.data_schemas.records.partial import (
    AxisSource,
    DisplacedMass,
    FigureVerdict,
    LackingAxis,
    MassFreeFigure,
    PartialFigures,
)
from auvid.hydro.arrays import AXES, Array
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.dynamics.gliding.hull_terms import HULL_TERMS, hull_terms
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.basis import coefficient_unit
from auvid.hydro.identification.glide.comparison import GlideComparison
from auvid.hydro.identification.glide.fit import GlideEstimate
from auvid.hydro.identification.glide.problem import UNKNOWNS, polar_of, slopes_of
from auvid.hydro.identification.regression.verdicts import clear_of_zero
from auvid.stages import few_axes
from auvid.stages.columns import AXIS_UNITS
from auvid.stages.glide.legs import GlideLegs

NAME, TITLE = "glide", "Settled glides"
IN_PLANE = ("X", "Z")
MADE_OF = {
    ("X", "u*u"): ("C_D0",),
    ("X", "u*w"): ("alpha_0",),
    ("X", "w*w"): ("C_L_alpha", "C_D1"),
    ("Z", "u*u"): ("alpha_0",),
    ("Z", "u*w"): ("C_L_alpha",),
}
"""Term -> unknowns that give most of it, and its verdict."""
WORST: tuple[FigureVerdict, ...] = ("inseparable", "weak", "from the prior", "identified")
SIDEWAYS = LackingAxis(
    verdict="not excited",
    words="settled glides stay in the vertical plane",
    remedy="Log turns with roll and heading.",
)
PITCH = LackingAxis(
    verdict="not excited",
    words="settled glides keep their pitch",
    remedy="Log the pitch and its actuator while they change.",
)


def glide_card(comparison: GlideComparison, glides: GlideLegs, vehicle: Vehicle) -> ModelCard:
    """Return the card of surge and heave: the terms of `hull_terms`, in newtons.

    The pitch is the caller's, and so is the force of the buoyancy drive, rho g V upwards.
    """
    estimate, rows = comparison.estimate, glides.rows
    at_rows = estimate.predict(rows)
    alpha = float(np.nanmean(np.abs(at_rows.alpha_rad)))
    values = _terms(estimate.values, estimate, alpha)
    slope = slopes_of(lambda unknowns: _terms(unknowns, estimate, alpha), estimate.values)
    covariance = slope @ estimate.covariance @ slope.T
    measured = rows.depth_rate_m_s
    rms = (
        float(np.sqrt(np.mean((measured - measured.mean()) ** 2))),
        estimate.residual_m_s[0],
    )
    axes = {}
    for axis in AXES:
        places = [place for place, (own, _) in enumerate(HULL_TERMS) if own == axis]
        if not places:
            axes[axis] = few_axes.empty_axis_card(AXIS_UNITS[axis])
            continue
        terms = [
            _term(estimate, place, float(values[place]), float(covariance[place, place]) ** 0.5)
            for place in places
        ]
        axes[axis] = few_axes.axis_card(
            AXIS_UNITS[axis],
            terms,
            covariance[np.ix_(places, places)],
            samples=estimate.rows,
            rms=rms,
        )
    along, across = np.cos(at_rows.alpha_rad), np.sin(at_rows.alpha_rad)
    return ModelCard(
        name=NAME,
        title=TITLE,
        vehicle=vehicle.title,
        source="drag and lift of Merckelbach et al. 2010, to second order in w / u",
        n_bar=len(HULL_TERMS),
        n_bar_declared=len(HULL_TERMS),
        rank=len(estimate.free),
        samples=estimate.rows,
        trim=False,
        assumed=list(vehicle.assumed),
        axes=axes,
        not_applicable=[],
        conditions={
            "u": few_axes.speed_range(at_rows.speed_m_s * along),
            "w": few_axes.speed_range(at_rows.speed_m_s * across),
        },
        predictor=few_axes.predictor_of(axes),
        method="glides",
        partial=_partial(comparison, vehicle),
    )


def glide_ranking(card: ModelCard) -> RankingRecord:
    """Return whether the model simulates: by the depth rate of glides left out."""
    j0, j = card.axes["Z"].j0, card.axes["Z"].j
    assert j0 is not None
    assert j is not None
    trained = dict.fromkeys(IN_PLANE, 100.0 * (1.0 - j / j0))
    rule = "the depth rate of alternate glides, by a fit to the others"
    return few_axes.ranking(card, trained, rule=rule)


def _terms(unknowns: Array, estimate: GlideEstimate, alpha_rad: float) -> Array:
    return hull_terms(polar_of(unknowns), estimate.body, alpha_rad=alpha_rad)


def _term(estimate: GlideEstimate, place: int, value: float, error: float) -> TermCard:
    axis, term = HULL_TERMS[place]
    verdicts = [estimate.verdicts[name] for name in MADE_OF[axis, term]]
    verdict: Verdict = next(word for word in WORST if word in verdicts)
    if verdict == "identified" and not clear_of_zero(value, error):
        verdict = "weak"  # a small angle is well known, and its product with a slope is near 0
    return TermCard(
        term=term,
        unit=coefficient_unit(axis, term),
        value=value,
        standard_error=error,
        verdict=verdict,
    )


def _partial(comparison: GlideComparison, vehicle: Vehicle) -> PartialFigures:
    estimate = comparison.estimate
    by = "pressure and speed" if "C_L_alpha" in estimate.free else "pressure"
    judged = np.isfinite(comparison.fit_percent) and estimate.verdicts["C_D0"] != "inseparable"
    source = AxisSource(
        source="fitted",
        name=f"{estimate.glides} settled glides, {by}",
        held_out_percent=comparison.fit_percent if judged else None,
        lag_s=0.0,
        lag_verdict="assumed",
    )
    density = estimate.body.neutral_kg_m3
    mass = vehicle.mass_kg + density * estimate.value("trim")
    half = density * NORMAL_95 * estimate.standard_error("trim")
    return PartialFigures(
        unit_of_mass=None,
        axes={"X": source, "Z": source},
        lacking={"Y": SIDEWAYS, "K": SIDEWAYS, "M": PITCH, "N": SIDEWAYS},
        without_newtons=_coefficients(estimate),
        gains=[],
        displaced=DisplacedMass(
            value_kg=mass,
            interval_95=[mass - half, mass + half],
            verdict=estimate.verdicts["trim"],
        ),
    )


def _coefficients(estimate: GlideEstimate) -> list[MassFreeFigure]:
    """Return drag and lift as coefficients, per area of the vehicle file."""
    units: Mapping[str, str] = {"C_D0": "1", "C_D1": "1/rad^2", "C_L_alpha": "1/rad"}
    figures = []
    for name in UNKNOWNS[:4]:
        value, half = estimate.value(name), NORMAL_95 * estimate.standard_error(name)
        figures.append(
            MassFreeFigure(
                axis="Z" if name in ("C_L_alpha", "alpha_0") else "X",
                quantity=name,
                value=value,
                unit=units.get(name, "rad"),
                interval_95=[value - half, value + half],
                verdict=estimate.verdicts[name],
            )
        )
    return figures
