"""Published vehicles of the shelf, judged on the user's own dive.

Every set of the shelf brings mass, buoyancy, inertia, added mass and viscous forces;
the actuators and the sensors stay those of the campaign's vehicle.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any

import numpy as np
import pyarrow as pa

from auvid.data_schemas.errors import DataError
from auvid.data_schemas.records.model_file import ModelFile
from auvid.data_schemas.records.models import RankingRecord
from auvid.data_schemas.records.motion import SegmentRecord
from auvid.data_schemas.tables import column, has_columns, make_table, matrix
from auvid.hydro.arrays import AXES, VELOCITIES, Array
from auvid.hydro.dynamics.actuators.lag import first_order_lag
from auvid.hydro.dynamics.equations_of_motion import inertia_force, restoring_of
from auvid.hydro.dynamics.mechanics.rigid_body import coriolis_force
from auvid.hydro.dynamics.simulation.free_run import FreeRuns
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.basis import needs_propeller_speed
from auvid.hydro.dynamics.viscous.coefficients import viscous_terms
from auvid.hydro.dynamics.viscous.models import IdentifiedModel
from auvid.hydro.identification.regression.error_measures import TOTAL, ErrorSums
from auvid.hydro.model_file import vehicle_of, viscous_model
from auvid.stages.base import Collection, Document, Stage, param, port
from auvid.stages.columns import (
    ACCELERATION,
    ACTUATORS,
    POSE,
    VELOCITY,
    clock,
    force_columns,
    forces,
)
from auvid.stages.free_run import LONG_S, measured_motion, run_segment
from auvid.stages.number_format import significant
from auvid.stages.page.first_screen import AXIS_WORDS
from auvid.stages.presentation import Block, remark, section, table, text

INERTIAL = ("mass_kg", "displaced_mass_kg", "r_G", "r_B", "inertia", "added_mass", "gravity")
"""What a vehicle takes from the set that is judged; actuators stay the user's."""
SAME_POINT_M = 0.02
OWN = "this dive"
"""The row of the campaign's own model."""
RATIOS = {axis: f"ratio_{axis}" for axis in AXES} | {TOTAL: "ratio"}
"""Axis of `ErrorMeasures` -> column of `shelf_scores`."""
RMS = tuple(f"{name}_rms_{'m_s' if i < 3 else 'rad_s'}" for i, name in enumerate(VELOCITIES))


@dataclass(frozen=True)
class Inputs:
    """The shelf by name, forces and motion of every segment, and own scores."""

    residual: Collection[pa.Table] = port("residual", many=True)
    fused: Collection[pa.Table] = port("fused", many=True)
    controls: Collection[pa.Table] = port("controls", many=True)
    segment: Collection[SegmentRecord] = port("segment", many=True)
    error_table: pa.Table = port("error_table")
    free_run: pa.Table = port("free_run")
    ranking: RankingRecord = port("ranking")
    vehicle: Vehicle = port("vehicle")
    shelf: Mapping[str, Vehicle] | None = port("vehicle", many=True, optional=True)


@dataclass(frozen=True)
class Params:
    every_s: float = param("s", 5.0, meaning="time between starting points", low=0.1, high=1000.0)
    minimum_speed_m_s: float = param(
        "m/s", 0.05, meaning="lower bound of U in eta = u_c(n)/U", low=1e-3, high=1.0
    )


@dataclass(frozen=True)
class Outputs:
    """A row per set and use; nothing for a campaign without a shelf."""

    shelf_scores: pa.Table | None = port("shelf_scores", optional=True)
    section: Document | None = port("section", optional=True)


@dataclass(frozen=True)
class PublishedSet:
    """A set of the shelf, or another model, on the actuators of the user's vehicle."""

    title: str
    vehicle: Vehicle
    model: IdentifiedModel
    lag_s: float = 0.0

    @classmethod
    def of(cls, published: Vehicle, own: Vehicle) -> PublishedSet:
        """Return a published vehicle with the actuators of the user's own.

        Raises `DataError` for one without damping, one with terms in the propulsion ratio
        for a vehicle without propeller, and as `in_body`.
        """
        terms = viscous_terms(published.published.values())
        ratio = [term for row in terms.values() for term in row if needs_propeller_speed(term)]
        if ratio and own.propeller is None:
            raise DataError(
                f"{len(ratio)} terms have the propulsion ratio, and '{own.name}' has no propeller",
                value=published.name,
                field="published",
            )
        own_speed = dict(zip(AXES, VELOCITIES, strict=True))
        still = [
            axis for axis in AXES if not any(own_speed[axis] in t for t in terms.get(axis, {}))
        ]
        if len(still) == len(AXES):
            raise DataError(
                "the vehicle file publishes no damping, so there is nothing to judge",
                value=published.name,
                field="published",
                remedy="Write coefficients such as X_u, X_u|u| under `published`.",
            )
        title = published.title
        if still:
            title += f" (no damping in {', '.join(AXIS_WORDS[axis] for axis in still)})"
        return cls(title, in_body(published, own), IdentifiedModel(published.name, terms))

    @classmethod
    def of_file(cls, file: ModelFile, own: Vehicle) -> PublishedSet:
        """Return a model of a file with the actuators of the user's vehicle."""
        body = in_body(vehicle_of(file), own)
        return cls(file.title, body, viscous_model(file)[0], file.dynamics.actuator_lag_s)

    def missing_force(self, residual: pa.Table, fused: pa.Table) -> Array:
        """Return the force (n, 6) [N, N m] that the set leaves unexplained.

        M nu_dot + C(nu) nu - tau_G - tau_U - tau_nu with M, C, tau_G and tau_nu of the
        set, McCarter (4.4); tau_U as the residual has it, late by the lag of the set.
        """
        nu, nu_dot = matrix(fused, VELOCITY), matrix(fused, ACCELERATION)
        M = self.vehicle.mass_matrix
        force = inertia_force(M, nu_dot) + coriolis_force(M, nu)
        force -= restoring_of(self.vehicle, matrix(fused, POSE))
        names = [name for name in ACTUATORS if has_columns(residual, force_columns(name))]
        acting = np.sum([forces(residual, name) for name in names], axis=0)
        if self.lag_s > 0.0:
            step_s = float(np.mean(np.diff(clock(residual))))
            acting = first_order_lag(acting, lag_s=self.lag_s, step_s=step_s)
        force -= acting
        if not self.model.terms:
            return force
        ratio = column(residual, "eta_ratio") if has_columns(residual, ("eta_ratio",)) else None
        return force - self.model.force(nu, ratio)


def in_body(published: Vehicle, own: Vehicle) -> Vehicle:
    """Return the user's vehicle with mass, buoyancy and inertia of another.

    Raises `DataError` where their centres of gravity lie apart from one another as seen
    from their origins: moments, arms and velocities would count from different points.
    """
    apart_m = np.abs(np.asarray(published.r_G) - np.asarray(own.r_G)).max()
    if apart_m > SAME_POINT_M:
        raise DataError(
            f"the origin of '{published.name}' is another point than that of '{own.name}'",
            field="rigid_body.centre_of_gravity",
            value=np.asarray(published.r_G).tolist(),
            allowed=f"{np.asarray(own.r_G).tolist()}, to {SAME_POINT_M:g} m",
            remedy="Write the vehicle file about that point.",
        )
    return replace(own, **{name: getattr(published, name) for name in INERTIAL})


@dataclass(frozen=True)
class Score:
    """J/J0 by axis and in total on a use, and free runs to the horizon on it."""

    ratios: Mapping[str, float]
    runs: tuple[FreeRuns, ...] = ()

    def row(self) -> dict[str, Any]:
        """Return the columns of `shelf_scores` that hold figures.

        The RMS is nan where a run was lost: those of that set that have not diverged yet are
        about to, and rounding decides how far they are.
        """
        errors = [run.errors[0, :, -1, :6][run.reached[:, -1]] for run in self.runs]
        lost = [run.diverged_s[0][run.reached[:, -1]] for run in self.runs]
        stacked = np.concatenate(errors) if errors else np.zeros((0, 6))
        rms = np.sqrt(np.mean(stacked**2, axis=0)) if len(stacked) else np.full(6, np.nan)
        return {
            **{RATIOS[axis]: value for axis, value in self.ratios.items()},
            "starts": len(stacked),
            "diverged": int(sum(np.isfinite(part).sum() for part in lost)),
            **dict(zip(RMS, rms.tolist(), strict=True)),
        }


def run(inputs: Inputs, params: Params) -> Outputs:
    """Judge every set of the shelf as the campaign's own models are judged."""
    if not inputs.shelf:
        return Outputs()
    sets = {name: PublishedSet.of(item, inputs.vehicle) for name, item in inputs.shelf.items()}
    rows = judge(sets, inputs, params)
    heads = ("set", "title", "use", *RATIOS.values(), "starts", "diverged", *RMS)
    scores = make_table("shelf_scores", {head: [row[head] for row in rows] for head in heads})
    return Outputs(scores, shelf_section(rows, compared_after(inputs)))


def judge(sets: Mapping[str, PublishedSet], inputs: Inputs, params: Params) -> list[dict[str, Any]]:
    """Return a row per set and use, those of the campaign's own model first.

    A constant force per axis is fitted to the training legs for each set, as for the
    models of the campaign: net buoyancy and tether are the day's, not the vehicle's.
    """
    uses = {key: str(segment.use) for key, segment in inputs.segment.items()}
    rows = list(_own_rows(inputs))
    for name, own in sets.items():
        trim = _trim(own, inputs, uses)
        rows += [
            {"set": name, "title": own.title, "use": use, **score.row()}
            for use, score in _scores(own, trim, inputs, params, uses)
        ]
    return rows


def compared_after(inputs: Inputs) -> float:
    """Return the horizon [s] at which the campaign's own free runs are compared."""
    return LONG_S if inputs.ranking.horizon_s is None else inputs.ranking.horizon_s


def _trim(own: PublishedSet, inputs: Inputs, uses: Mapping[str, str]) -> Array:
    total, count = np.zeros(6), 0
    for key, residual in inputs.residual.items():
        if uses[key] == "training":
            missing = own.missing_force(residual, inputs.fused[key])
            total, count = total + missing.sum(axis=0), count + len(missing)
    return total / max(count, 1)


def _scores(
    own: PublishedSet, trim: Array, inputs: Inputs, params: Params, uses: Mapping[str, str]
) -> Iterator[tuple[str, Score]]:
    sums: dict[str, list[ErrorSums]] = {}
    runs: dict[str, list[FreeRuns]] = {}
    for key, residual in inputs.residual.items():
        fused, measured = inputs.fused[key], forces(residual, "tau_bar")
        missing = own.missing_force(residual, fused) - trim
        sums.setdefault(uses[key], []).append(ErrorSums.of(measured, measured - missing))
        if uses[key] == "validation":
            flown = run_segment(
                own.vehicle,
                [own.model],
                trim[None],
                np.zeros((1, 6, 6)),
                measured_motion(fused, inputs.controls[key]),
                horizons_s=(compared_after(inputs),),
                lags_s=np.array([own.lag_s]),
                every_s=params.every_s,
                minimum_speed=params.minimum_speed_m_s,
            )
            runs.setdefault("validation", []).extend([] if flown is None else [flown])
    for use, parts in sums.items():
        total = reduce(ErrorSums.merge, parts)
        measures = total.measures(np.zeros(6))
        ratios = {axis: measures[axis].normalised for axis in (*AXES, TOTAL)}
        yield use, Score(ratios, tuple(runs.get(use, ())))


def _own_rows(inputs: Inputs) -> Iterator[dict[str, Any]]:
    """Yield the rows of the recommended model, from the campaign's own tables."""
    choice = inputs.ranking.choice
    if choice is None:
        return
    flights = [
        row
        for row in inputs.free_run.to_pylist()
        if row["model"] == choice
        and not row["as_measured"]
        and abs(row["horizon_s"] - compared_after(inputs)) < 1e-9
    ]
    errors = [
        row
        for row in inputs.error_table.to_pylist()
        if row["model"] == choice and row["leg"] == "all"
    ]
    for use in dict.fromkeys(row["use"] for row in errors):
        ratios = {
            TOTAL if row["axis"] == "all" else row["axis"]: row["ratio"]
            for row in errors
            if row["use"] == use
        }
        own = flights if use == "validation" else []
        starts, lost = (sum(row[name] for row in own) for name in ("starts", "diverged"))
        rms = dict.fromkeys(RMS, np.nan)
        if starts and not lost:
            flown = [row for row in own if row["starts"]]
            for name in RMS:
                squares = sum(row["starts"] * row[name] ** 2 for row in flown)
                rms[name] = float(np.sqrt(squares / starts))
        yield {
            "set": OWN,
            "title": f"{choice}, identified from {OWN}",
            "use": use,
            **{RATIOS[axis]: value for axis, value in ratios.items()},
            "starts": starts,
            "diverged": lost,
            **rms,
        }


def nearest_set(rows: Sequence[Mapping[str, Any]]) -> Mapping[str, Any] | None:
    """Return the row of the published set with the least total J/J0 on validation.

    On training where there is no validation; None without any set.
    """
    published = [row for row in rows if row["set"] != OWN]
    judged = [row for row in published if row["use"] == "validation"] or published
    return min(judged, key=lambda row: row["ratio"], default=None)


def worse_than_nothing(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return the axes on which every published set errs more than no force would."""
    best = nearest_set(rows)
    if best is None:
        return []
    judged = [row for row in rows if row["set"] != OWN and row["use"] == best["use"]]
    return [axis for axis in AXES if all(row[RATIOS[axis]] > 1.0 for row in judged)]


def shelf_section(rows: Sequence[Mapping[str, Any]], horizon_s: float) -> dict[str, Any]:
    """Return the report section: which published set is nearest, and both tables."""
    best, axes = nearest_set(rows), worse_than_nothing(rows)
    own = next(
        (row for row in rows if best and (row["set"], row["use"]) == (OWN, best["use"])), None
    )
    blocks: list[Block] = [
        text(
            "Published sets of coefficients that the campaign names under `shelf`, with their own"
            " mass, inertia, added mass and buoyancy, moved by the thrust of this dive. Each has a"
            " constant force per axis fitted to the training legs, as the models of this dive have."
        )
    ]
    if best is not None:
        words = f"Nearest is {best['title']}: J/J0 {significant(best['ratio'], 2)}"
        words += f" on {best['use']}"
        if own is not None:
            words += f", {significant(own['ratio'], 2)} for the model of this dive"
        blocks.append(remark(f"{words}.", "finding"))
    if axes:
        named = ", ".join(AXIS_WORDS[axis] for axis in axes)
        blocks.append(
            remark(f"In {named} every published set errs more than no model at all.", "finding")
        )
    used = best["use"] if best is not None else "training"
    judged = sorted((row for row in rows if row["use"] == used), key=lambda row: row["ratio"])
    heads = ("set", "name", *(AXIS_WORDS[axis] for axis in AXES), "total")
    cells = [
        [row["title"], row["set"], *(significant(row[RATIOS[axis]], 2) for axis in (*AXES, TOTAL))]
        for row in judged
    ]
    note = "Nearest first. Above 1: worse than no force. auvid export takes a set by its name."
    blocks.append(table(f"J/J0 on {used}", heads, cells, note=note))
    flown = [row for row in judged if row["starts"]]
    if flown:
        units = ["m/s"] * 3 + ["rad/s"] * 3
        heads_of_runs: list[str | tuple[str, str]] = [
            "set",
            ("lost", "runs"),
            *((name, unit) for name, unit in zip(VELOCITIES, units, strict=True)),
        ]
        runs = [
            [
                row["title"],
                f"{row['diverged']} of {row['starts']}",
                *(significant(_number(row[name]), 2) for name in RMS),
            ]
            for row in flown
        ]
        title = f"RMS error of free runs after {horizon_s:g} s"
        lost = any(row["diverged"] for row in flown)
        note = "A set that loses a run has no RMS." if lost else ""
        blocks.append(table(title, heads_of_runs, runs, note=note))
    return section(
        "Published sets on this dive",
        blocks,
        order=11,
        look_for="A published set may be nearer on one axis than on another.",
    )


def _number(value: float | None) -> float | None:
    return None if value is None or not np.isfinite(value) else value


STAGE: Stage[Inputs, Params, Outputs] = Stage(
    name="score_shelf",
    summary="Published vehicles judged on this dive",
    maps_over="campaign",
    inputs=Inputs,
    params=Params,
    outputs=Outputs,
    run=run,
    no_views="tables of single values have no series",
)
