"""Fit the axes that the logs measure, by output error over windows of all legs.

The result is a model of some axes: no six, no velocity log and no newtons are needed.
Axes that the logs do not give are named with the reason, or filled from a published set
or a bench and marked as such.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import cast, get_args

import numpy as np
import pyarrow as pa

from auvid.data_schemas.errors import DataError
from auvid.data_schemas.records.axes import AxisWindowsRecord
from auvid.data_schemas.records.models import ModelCard, RankingRecord
from auvid.data_schemas.records.priors import PriorSourcesRecord
from auvid.data_schemas.tables import column, make_table
from auvid.hydro.arrays import AXES, Array
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.stages.axis_tables import axis_record_of
from auvid.stages.base import Collection, Document, Stage, param, port
from auvid.stages.columns import VELOCITY
from auvid.stages.fit_axes.card import model_card, ranking
from auvid.stages.fit_axes.filling import FillSources, filled_axes
from auvid.stages.fit_axes.fitted import ArmChoice, AxisFits, AxisMotion
from auvid.stages.fit_axes.fitting import fit_all
from auvid.stages.fit_axes.flight import FitOptions, LegData
from auvid.stages.fit_axes.presentation import RATE_OF, fit_section, fit_views
from auvid.stages.fit_axes.scaling import fitted_vehicle, scaled
from auvid.stages.free_run import FIT, NAMES, PERSISTENCE

RMS_OF = dict(zip(VELOCITY, NAMES[:6], strict=True))
"""Column of a velocity -> that of its error in the table of free runs."""


@dataclass(frozen=True)
class Inputs:
    axis_record: Collection[pa.Table] = port("axis_record", many=True)
    axis_windows: Collection[AxisWindowsRecord] = port("axis_windows", many=True)
    vehicle: Vehicle = port("vehicle")
    campaign: Document = port("campaign", keys=("fill",))
    shelf: Mapping[str, Vehicle] | None = port("vehicle", many=True, optional=True)
    prior_sources: PriorSourcesRecord | None = port("prior_sources", optional=True)


@dataclass(frozen=True)
class Params:
    axes: tuple[str, ...] = param(
        "1", (), meaning="axes to fit, as [Z, N]; none: those that the legs measure", names=AXES
    )
    given_inertia: tuple[str, ...] = param(
        "1",
        ("X", "Y", "Z"),
        meaning="axes whose apparent inertia has that of the vehicle file for its prior; of"
        " others the force in newtons gives it alone",
        names=AXES,
    )
    inertia_sd: float = param(
        "1",
        0.3,
        meaning="standard deviation of a given inertia, as a share; 0 where it is measured",
        low=0.0,
        high=1.0,
    )
    surge_in_heave: bool | None = param(
        "1",
        None,
        meaning="fit a force ahead in heave beside it, under a prior around 0; null: where depth"
        " measures heave and what is held out is flown better with it",
    )
    linear_drag: tuple[str, ...] = param(
        "1",
        (),
        meaning="axes in which the vehicle only creeps, so that no quadratic drag is fitted; all"
        " are then fitted one by one",
        names=AXES,
    )
    together: str = param(
        "1",
        "better",
        meaning="fit axes together, with Coriolis force: where that is better on what is held out,"
        " never, or always",
        allowed=("better", "never", "always"),
    )
    lag_s: float = param(
        "s", 0.05, meaning="first-order lag between command and force", low=0.01, high=2.0
    )
    fit_lag: bool = param(
        "1", True, meaning="fit the lag where it is clear and better on what is held out"
    )
    fit_curve: bool = param(
        "1",
        True,
        meaning="fit dead band and curve of commands where that is better on what is held out",
    )
    marker_arm: str = param(
        "1",
        "where_assumed",
        meaning="where markers of poses or the velocity log sit: as the vehicle file says, as all"
        " legs show (estimated), or as they show where the file has no arm or an assumed one",
        allowed=get_args(ArmChoice),
    )
    newtons_from: str = param(
        "1",
        "pull",
        meaning="what turns full commands into newtons: full_force of the vehicle file where it"
        " is given (pull), or the mass of the vehicle file (mass)",
        allowed=("pull", "mass"),
    )


@dataclass(frozen=True)
class Outputs:
    model_card: Mapping[str, ModelCard] = port("model_card", many=True)
    ranking: RankingRecord = port("ranking")
    axis_fit: pa.Table = port("axis_fit")
    free_run: pa.Table = port("free_run")
    axis_motion: Mapping[str, pa.Table] = port("axis_motion", many=True)
    section: Document = port("section")
    views: Document = port("views")


def run(inputs: Inputs, params: Params) -> Outputs:
    """Return the model of the axes that the legs give.

    Raises `DataError` where no axis has windows enough.
    """
    legs = {
        key: LegData(axis_record_of(inputs.axis_record[key], windows), windows)
        for key, windows in inputs.axis_windows.items()
    }
    options = FitOptions(
        axes=params.axes,
        lag_s=params.lag_s,
        fit_lag=params.fit_lag,
        fit_curve=params.fit_curve,
        given_inertia=params.given_inertia,
        inertia_sd=params.inertia_sd,
        surge_in_heave=params.surge_in_heave,
        linear_drag=params.linear_drag,
        together="never" if params.linear_drag else params.together,
        marker_arm=cast(ArmChoice, params.marker_arm),
        newtons_from="mass" if params.newtons_from == "mass" else "pull",
    )
    fits = fit_all(legs, inputs.vehicle, options)
    if not fits.fitted:
        raise DataError(
            "no axis of these legs can be fitted: "
            + "; ".join(f"{item.axis}: {item.words}" for item in fits.lacking),
            field="legs",
            remedy="docs/axes.md says what a dive needs.",
        )
    forces = scaled(fits, inputs.vehicle, by=options.newtons_from, inertia_sd=params.inertia_sd)
    benches = inputs.prior_sources.sources if inputs.prior_sources is not None else []
    filled = filled_axes(
        inputs.campaign.get("fill") or {},
        FillSources(inputs.shelf or {}, {item.file: item for item in benches}),
        fitted=[item.axis for item in fits.fitted],
        vehicle=fitted_vehicle(fits, inputs.vehicle),
        unit_of_mass=forces.unit_of_mass,
    )
    card = model_card(fits, forces, filled, inputs.vehicle)
    by_leg = {
        leg: [part for item in fits.fitted for part in item.motion if part.leg == leg]
        for leg in legs
    }
    return Outputs(
        model_card={card.name: card},
        ranking=ranking(card, fits),
        axis_fit=_fit_table(fits),
        free_run=_free_run(fits, card.name),
        axis_motion={
            leg: _motion_table(parts, column(inputs.axis_record[leg], "t_us"))
            for leg, parts in by_leg.items()
        },
        section=fit_section(fits, card),
        views=fit_views(by_leg, [item.axis for item in fits.fitted]),
    )


def _fit_table(fits: AxisFits) -> pa.Table:
    rows = [
        row
        for item in fits.fitted
        for row in (
            (item.axis, "training", item.windows, item.training_percent),
            *((item.axis, part.what, part.windows, part.percent) for part in item.held_out),
            *(
                (item.axis, f"leg {leg}", count, percent)
                for leg, (percent, count) in item.per_leg.items()
            ),
        )
    ]
    heads = ("axis", "judged_on", "windows", "fit_percent")
    return make_table(
        "axis_fit", {head: [row[place] for row in rows] for place, head in enumerate(heads)}
    )


def _free_run(fits: AxisFits, model: str) -> pa.Table:
    """Return the error of each rate over the windows of each leg, and of no change."""
    rows: list[dict[str, object]] = []
    for leg in fits.legs:
        parts = [(item, part) for item in fits.fitted for part in item.motion if part.leg == leg]
        if not parts:
            continue
        windows = max(len(part.windows) for _, part in parts)
        length = max(part.longest_s for _, part in parts)
        head = {"segment": leg, "as_measured": "", "horizon_s": length, "starts": windows}
        head |= {
            "diverged": 0,
            "first_divergence_s": np.nan,
            **dict.fromkeys((*NAMES, *FIT), np.nan),
        }
        errors: dict[str, dict[str, float]] = {model: {}, PERSISTENCE: {}}
        for item, part in parts:
            name = RMS_OF[RATE_OF[item.axis]]
            errors[model][name], errors[PERSISTENCE][name] = part.rms_errors()
        rows += [head | {"model": name} | own for name, own in errors.items()]
    names = ("segment", "model", "as_measured", "horizon_s", "starts", "diverged")
    heads = (*names, "first_divergence_s", *NAMES, *FIT)
    return make_table("free_run", {name: [row[name] for row in rows] for name in heads})


def _motion_table(parts: list[AxisMotion], t_us: Array) -> pa.Table:
    columns: dict[str, Array] = {"t_us": t_us}
    of = {part.axis: part for part in parts}
    nothing = np.full(len(t_us), np.nan)
    for axis, name in RATE_OF.items():
        columns[f"measured_{name}"] = of[axis].measured if axis in of else nothing
        columns[f"simulated_{name}"] = of[axis].simulated if axis in of else nothing
    for part in parts:
        if part.depth_measured is not None and part.depth_simulated is not None:
            columns["measured_depth_m"] = part.depth_measured
            columns["simulated_depth_m"] = part.depth_simulated
    return make_table("axis_motion", columns)


STAGE = Stage(
    "fit_axes",
    "Fit the axes that the logs measure, each by output error over windows",
    "campaign",
    Inputs,
    Params,
    Outputs,
    run,
)
