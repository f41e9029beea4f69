"""The training legs as the passes read them: their samples, lag, currents, wiring."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial, reduce

import numpy as np
import pyarrow as pa

from auvid.data_schemas.errors import DataError
from auvid.data_schemas.records.likelihood import LagFit
from auvid.data_schemas.records.models import DiveCurrent
from auvid.data_schemas.records.motion import FusionRecord, SegmentRecord
from auvid.data_schemas.tables import has_columns
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.constrained.actuator_lag import measured_lag
from auvid.hydro.identification.constrained.steady_current import (
    SteadyCurrent,
    current_scatter,
    measured_currents,
)
from auvid.hydro.identification.regression.assumed_figures import CURRENT
from auvid.hydro.identification.regression.least_squares import TriangularFactor
from auvid.hydro.identification.regression.normal_changes import NormalChange
from auvid.hydro.identification.selection.folds import parts_of
from auvid.hydro.long_series.threads import together
from auvid.stages.base import Collection
from auvid.stages.presentation import Block, remark
from auvid.stages.synthesise.presentation import lag_words, low_pass_words, stated_lag_words
from auvid.stages.synthesise.training import (
    RESIDUAL_COLUMNS,
    STATE_COLUMNS,
    STILL_WATER,
    DataErrors,
    LegTables,
    MovingWater,
    TrainingData,
    TrainingSegment,
    driven_leg,
    leg_over_ground,
    merged_figures,
    motion_factor,
)
from auvid.stages.synthesise.wiring import torque_blocks, wiring_blocks

VERTICAL_SHARE = 1.0 / 3.0
"""Of the scatter of a current within a dive: a steady vertical one, which no sensor over ground
shows (decision 0107).
"""


@dataclass(frozen=True)
class DiveConditions:
    """What acts on all models of a campaign: lag of the actuators, currents by log.

    vehicle: with the standard deviations of both among its spreads.
    """

    lag: LagFit | None
    currents: Mapping[str, SteadyCurrent]
    scatter_m_s: float
    vehicle: Vehicle

    @property
    def lag_s(self) -> float:
        """Return the lag of the actuators, 0 where none is known."""
        return 0.0 if self.lag is None else self.lag.value_s

    @property
    def current_records(self) -> dict[str, DiveCurrent]:
        """Return the current under each log, as a card has it."""
        return {
            log: DiveCurrent(value_m_s=own.value.tolist(), sd_m_s=own.sd.tolist(), clear=own.clear)
            for log, own in self.currents.items()
        }


@dataclass(frozen=True)
class TrainingLegs:
    """The training legs of a campaign by key; tables are loaded one leg at a time."""

    keys: tuple[str, ...]
    vehicle: Vehicle
    residual: Collection[pa.Table]
    segment: Collection[SegmentRecord]
    fused: Collection[pa.Table] | None
    fusion: Collection[FusionRecord] | None
    controls: Collection[pa.Table] | None

    @property
    def names(self) -> list[str]:
        """Return the names of the parts that are held out in turn, one for each leg."""
        return parts_of([self.segment[key].leg for key in self.keys])

    @property
    def with_ratio(self) -> bool:
        """Return whether all legs know the ratio of propeller to water speed."""
        return all(
            has_columns(self.residual.part(key, ("eta_ratio",)), ("eta_ratio",))
            for key in self.keys
        )

    def tables(self, key: str, *, with_state: bool = True) -> LegTables:
        """Return the tables of a leg; some passes take no state and commands."""
        if not with_state:
            residual = self.residual.part(key, RESIDUAL_COLUMNS)
            return LegTables(residual, self.segment[key], None, None, None)
        of_fuse = self.fused
        residual, fused = together(
            partial(self.residual.part, key, RESIDUAL_COLUMNS),
            lambda: None if of_fuse is None else of_fuse.part(key, STATE_COLUMNS),
        )
        return LegTables(
            residual,
            self.segment[key],
            fused,
            None if self.fusion is None else self.fusion[key],
            None if self.controls is None else self.controls[key],
        )

    def segments(
        self,
        conditions: DiveConditions,
        lag_s: float | None = None,
        *,
        with_ratio: bool = False,
        with_state: bool = True,
    ) -> Iterator[TrainingSegment]:
        """Yield the samples of each leg; lag_s: in place of that of the conditions."""
        return (
            TrainingSegment.of(
                self.tables(key, with_state=with_state),
                with_ratio=with_ratio,
                lag_s=conditions.lag_s if lag_s is None else lag_s,
                water=moving_water(
                    conditions.currents, conditions.scatter_m_s, self.segment[key].log
                ),
            )
            for key in self.keys
        )

    def motion_factors(self, terms: tuple[str, ...], lag_s: float) -> dict[str, TriangularFactor]:
        """Return each part's factor with accelerations and rates of the actuator force.

        Raises `DataError` without the fused state.
        """
        if self.fused is None:
            raise DataError(
                "fitting inertia needs the acceleration, and there is no fused state",
                field="stages.synthesise.inertia",
            )
        factors: dict[str, TriangularFactor] = {}
        for name, key in zip(self.names, self.keys, strict=True):
            own = motion_factor(
                self.residual.part(key, RESIDUAL_COLUMNS),
                self.fused.part(key, STATE_COLUMNS),
                terms,
                lag_s,
            )
            factors[name] = factors[name].merge(own) if name in factors else own
        return factors

    def motion_figures(
        self, terms: tuple[str, ...], conditions: DiveConditions
    ) -> dict[str, tuple[NormalChange, ...]]:
        """Return what assumed figures do to the normal equations with accelerations."""
        legs = self.segments(replace(conditions, scatter_m_s=0.0))
        return reduce(
            merged_figures,
            (DataErrors.of_motion(leg, terms, conditions.vehicle) for leg in legs),
        )


def data_of_parts(
    legs: TrainingLegs,
    segments: Iterator[TrainingSegment],
    terms: Sequence[str],
    vehicle: Vehicle,
    *,
    excitation: str,
) -> tuple[dict[str, TriangularFactor], TrainingData]:
    """Return the factor of each part of the legs, and the data of all of them."""
    factors: dict[str, TriangularFactor] = {}
    of_legs: TrainingData | None = None
    for name, leg in zip(legs.names, segments, strict=True):
        own = TrainingData.of(leg, terms, vehicle, excitation=excitation)
        factors[name] = factors[name].merge(own.factor) if name in factors else own.factor
        of_legs = own if of_legs is None else of_legs.merge(own)
        del leg  # the next pass starts without the samples of the last leg
    assert of_legs is not None
    return factors, replace(of_legs, factor=reduce(TriangularFactor.merge, factors.values()))


def dive_conditions(legs: TrainingLegs, lag: LagFit | None, *, usual_m_s: float) -> DiveConditions:
    """Return what acts on all models, with the currents that the legs show.

    usual_m_s: standard deviation of a current before; 0 for still water.
    """
    vehicle = legs.vehicle
    if lag is not None and lag.standard_error_s is not None:
        spreads = {**vehicle.spreads, "thrust_lag": lag.standard_error_s}
        vehicle = replace(vehicle, spreads=spreads)
    lag_s = 0.0 if lag is None else lag.value_s
    currents, scatter_m_s = _currents(legs, lag_s, usual_m_s)
    if currents:
        rms = [own.rms for own in currents.values()]
        spread = float(np.sqrt(scatter_m_s**2 + np.mean(np.square(rms))))
        vehicle = replace(vehicle, spreads={**vehicle.spreads, CURRENT: spread})
    return DiveConditions(lag, currents, scatter_m_s, vehicle)


def wiring_of(legs: TrainingLegs) -> list[Block]:
    """Return warnings on thrusters and propellers that the vehicle file has wrong."""
    return [
        *wiring_blocks((legs.tables(key) for key in legs.keys), legs.vehicle),
        *torque_blocks((legs.residual[key] for key in legs.keys), legs.vehicle),
    ]


def lag_of(legs: TrainingLegs) -> tuple[LagFit | None, list[Block]]:
    """Return the lag of the actuators that all models go with, and words on it.

    One that the vehicle file states counts; where the legs show another, words warn.
    """
    driven = (driven_leg(legs.tables(key)) for key in legs.keys)
    lag = measured_lag([leg for leg in driven if leg is not None])
    stated, spread = legs.vehicle.actuator_lag_s, legs.vehicle.spreads.get("thrust_lag")
    if stated is not None:
        departs = lag is not None and lag.of_thrusters and lag.departs_from(stated, spread or 0.0)
        words = stated_lag_words(stated, spread, lag)
        return (
            LagFit(value_s=stated, standard_error_s=spread, verdict="stated"),
            [remark(words, "warning" if departs else "note")],
        )
    if lag is None or not (lag.clear and lag.of_thrusters):
        return None, []
    fit = LagFit(
        value_s=lag.value_s,
        standard_error_s=lag.sd_s,
        verdict="identified" if lag.by_gyro else "inseparable",
    )
    return fit, [remark(lag_words(lag, spread), "note" if lag.by_gyro else "warning")]


def _currents(
    legs: TrainingLegs, lag_s: float, usual_m_s: float
) -> tuple[dict[str, SteadyCurrent], float]:
    """Return log -> its current, where velocity is over ground, and its scatter."""
    if not usual_m_s:
        return {}, 0.0
    velocities = (leg_over_ground(legs.tables(key), lag_s) for key in legs.keys)
    over_ground = [leg for leg in velocities if leg is not None]
    if not over_ground:
        return {}, 0.0
    currents = measured_currents(over_ground, legs.vehicle, usual_m_s=usual_m_s)
    scatter_m_s = current_scatter(over_ground, legs.vehicle, currents, usual_m_s=usual_m_s)
    return currents, scatter_m_s


def moving_water(
    currents: Mapping[str, SteadyCurrent], scatter_m_s: float, log: str
) -> MovingWater:
    """Return what moves the water under a leg of a log."""
    if not currents:
        return STILL_WATER
    own = {name: float(name == log) for name in currents}
    vertical = np.array([0.0, 0.0, VERTICAL_SHARE * scatter_m_s])
    errors = {name: np.vstack([item.errors, vertical]) for name, item in currents.items()}
    return MovingWater(
        np.array([own[name] * current.established for name, current in currents.items()]),
        np.vstack([own[name] * row for name, row in errors.items()]),
        scatter_m_s,
    )


def low_pass_blocks(legs: TrainingLegs, leaning: Mapping[str, Sequence[str]]) -> list[Block]:
    """Return a warning on a low-pass that leans coefficients, by title of the model."""
    if not leaning or legs.fusion is None:
        return []
    used = [legs.fusion[key].cutoff_hz for key in legs.keys if key in legs.fusion]
    cutoffs = [cutoff for cutoff in used if cutoff is not None]
    return [remark(low_pass_words(min(cutoffs), leaning), "warning")]
