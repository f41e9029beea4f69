"""The real dive within physical limits: force, yaw inertia, and motion that stays.

The default: symmetric structure with constants, damping that takes energy out in the
flown box, a prior on roll and pitch damping, which the autopilot hides, and yaw inertia.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import reduce
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from auvid.data_schemas.tables import matrix
from auvid.hydro.arrays import AXES, Array
from auvid.hydro.dynamics.equations_of_motion import Control
from auvid.hydro.dynamics.simulation.free_run import FreeRuns, MeasuredMotion, free_runs
from auvid.hydro.dynamics.viscous.basis import BASIS_TERMS, basis_rows, needs_propeller_speed
from auvid.hydro.dynamics.viscous.models import IdentifiedModel
from auvid.hydro.dynamics.viscous.structures import symmetric
from auvid.hydro.identification.constrained.equations import (
    ACCELERATIONS,
    ACTUATOR_RATES,
    ForceEquations,
    Unknown,
    added_mass_change,
    extra_rows,
    inertia_equations,
    viscous_equations,
)
from auvid.hydro.identification.constrained.fit import ConstrainedFit, fit_within, force_error
from auvid.hydro.identification.constrained.inertia import inertia_against_lag
from auvid.hydro.identification.constrained.limits import (
    damping,
    dissipation,
    dissipation_cuts,
    envelope,
)
from auvid.hydro.identification.constrained.priors import NormalPrior
from auvid.hydro.identification.regression.excitation import THRESHOLDS
from auvid.hydro.identification.regression.least_squares import TriangularFactor
from auvid.hydro.identification.regression.verdicts import IDENTIFIED
from auvid.hydro.identification.selection.information import inflation
from auvid.pipeline.campaigns.vehicle_files import load_vehicle
from auvid.stages.columns import ACCELERATION, POSE, VELOCITY, clock, forces

TERMS = tuple(term for term in BASIS_TERMS if not needs_propeller_speed(term))
VISCOUS = viscous_equations(symmetric(), trim=True)
PRIOR = NormalPrior.independent(
    "vehicle", {Unknown("K", "p"): (-1.0, 0.5), Unknown("M", "q"): (-1.0, 0.5)}
)
STEP_S = 0.02


@dataclass(frozen=True)
class Leg:
    t_s: Array
    state: Array
    rows: dict[str, Array]
    force: Array
    thrusters: Array

    @classmethod
    def read(cls, run: Path, name: str) -> Leg:
        residual = pq.ParquetFile(run / f"residual/{name}/residual.parquet").read()
        fused = pq.ParquetFile(run / f"fuse/{name}/fused.parquet").read()
        controls = pq.ParquetFile(run / f"residual/{name}/controls.parquet").read()
        nu = matrix(residual, VELOCITY)
        extra = extra_rows(
            matrix(fused, ACCELERATION), forces(residual, "thrusters"), step_s=STEP_S
        )
        names = (*TERMS, *ACCELERATIONS, *ACTUATOR_RATES)
        values = [*basis_rows(nu.T, None, TERMS), *extra]
        thrusters = [item for item in controls.column_names if item.startswith("thruster_")]
        return cls(
            clock(residual),
            np.hstack([nu, matrix(fused, POSE)]),
            dict(zip(names, values, strict=True)),
            forces(residual, "tau_bar"),
            matrix(controls, thrusters),
        )

    def until(self, end_s: float) -> Leg:
        rows = self.t_s <= end_s
        return Leg(
            self.t_s[rows],
            self.state[rows],
            {name: row[rows] for name, row in self.rows.items()},
            self.force[rows],
            self.thrusters[rows],
        )

    def factor(self) -> TriangularFactor:
        empty = TriangularFactor.empty(tuple(self.rows))
        return empty.update(np.array(list(self.rows.values())), self.force)

    def residual(self, equations: ForceEquations, values: Array) -> Array:
        columns = {**self.rows, "constant": np.ones(len(self.t_s))}
        parts = []
        for i, axis in enumerate(AXES):
            names = equations.columns_of(axis)
            force = equations.weights(axis, names) @ values
            parts.append(self.force[:, i] - force @ np.array([columns[name] for name in names]))
        return np.array(parts).T


@dataclass(frozen=True)
class Fitted:
    factor: TriangularFactor
    equations: ForceEquations
    noise: dict[str, float]
    fit: ConstrainedFit


def fitted(*legs: Leg, inertia: bool = True) -> Fitted:
    factor = reduce(TriangularFactor.merge, [leg.factor() for leg in legs])
    equations = VISCOUS
    if inertia:
        equations = equations.with_unknowns_of(inertia_equations(["N_rdot"]))
    first = fit_within(factor, equations)
    left = [leg.residual(equations, first.values) for leg in legs]
    noise = {
        axis: float(first.noise[i] * np.sqrt(inflation([part[:, i] for part in left])))
        for i, axis in enumerate(AXES)
    }
    least = np.array([THRESHOLDS[name] for name in "uvwpqr"])
    high = np.maximum(np.max([np.abs(leg.state[:, :6]).max(axis=0) for leg in legs], axis=0), least)
    u = equations.unknowns
    fit = fit_within(
        factor,
        equations,
        limits=[damping(u), dissipation(u, envelope(-high, high))],
        cuts=[dissipation_cuts(u, -high, high)],
        priors=[PRIOR],
        noise=noise,
    )
    return Fitted(factor, equations, noise, fit)


@pytest.fixture(scope="module")
def legs(committed_run: Callable[[str], Path]) -> tuple[Leg, Leg]:
    run = committed_run("bluerov2_dvl") / "runs/bluerov2_dvl"
    return Leg.read(run, "train"), Leg.read(run, "check")


@pytest.fixture(scope="module")
def default(legs: tuple[Leg, Leg]) -> Fitted:
    return fitted(legs[0])


def check_error(result: Fitted, leg: Leg) -> float:
    factor = leg.factor()
    error = force_error(factor, result.equations, result.fit.values)
    return float(np.linalg.norm(error) / np.linalg.norm(factor.column_rms[-6:]))


def simulated(result: Fitted, leg: Leg) -> FreeRuns:
    root = Path(__file__).parents[2]
    vehicle = load_vehicle(root / "vehicles/bluerov2_heavy.yaml").vehicle
    values = dict(zip(result.fit.unknowns, result.fit.values.tolist(), strict=True))
    heavier = replace(vehicle, added_mass=vehicle.added_mass + added_mass_change(values))
    table = result.fit.by_axis()
    model = IdentifiedModel(
        "symmetric",
        {
            axis: {term: value for term, value in terms.items() if term in BASIS_TERMS}
            for axis, terms in table.items()
        },
    )
    return free_runs(
        heavier,
        [model],
        np.array([[table[axis]["constant"] for axis in AXES]]),
        MeasuredMotion(leg.t_s, leg.state, Control(thruster_force_N=leg.thrusters)),
        starts_s=np.arange(0.0, leg.t_s[-1] - leg.t_s[0], 5.0),
        horizons_s=np.array([5.0, 10.0, 30.0]),
    )


def test_the_force_is_explained_on_both_legs(default: Fitted, legs: tuple[Leg, Leg]) -> None:
    assert default.fit.normalised <= 0.15
    assert default.fit.cost < 0.005
    assert check_error(default, legs[1]) <= 0.48
    assert check_error(fitted(legs[0], inertia=False), legs[1]) <= 0.49


def test_free_runs_of_all_six_axes_stay(default: Fitted, legs: tuple[Leg, Leg]) -> None:
    runs = simulated(default, legs[1])
    assert np.isnan(runs.diverged_s).all()
    assert np.sum(np.isfinite(runs.errors[0, :, :, 0]), axis=0).tolist() == [7, 6, 2]
    at_10_s = runs.rms()[0, 1, :6]
    assert at_10_s[0] <= 0.04
    assert at_10_s[1] <= 0.03
    assert at_10_s[2] <= 0.03
    assert at_10_s[5] <= 0.12


def test_main_damping_hardly_moves_with_forty_seconds_more(
    default: Fitted, legs: tuple[Leg, Leg]
) -> None:
    more = fitted(*legs)
    for axis, term in (("X", "u"), ("Y", "v"), ("Z", "w"), ("N", "r")):
        before, after = default.fit.value(axis, term), more.fit.value(axis, term)
        assert after == pytest.approx(before, rel=0.2), axis


def test_yaw_inertia_is_clear_only_with_the_turns_of_the_check_leg(
    default: Fitted, legs: tuple[Leg, Leg]
) -> None:
    file = 0.37 + 0.2215
    clear = []
    for result in (default, fitted(*legs)):
        assert 2.8 <= file - result.fit.value("N", "rdot") <= 3.15
        trade = inertia_against_lag(result.factor, VISCOUS, "N_rdot", noise=result.noise)
        clear.append(abs(trade.joint[0] / trade.joint_errors[0]))
    # On the training leg alone at the limit of two standard errors beside a lag.
    assert clear[0] < 3.0
    assert clear[1] > 6.0
    assert trade.verdict == IDENTIFIED
    assert trade.gain[0] > 3.0 * trade.gain[1]
