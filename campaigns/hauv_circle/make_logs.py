"""Fly the H-AUV in closed loop and write what its sensors record as DataFlash logs into
logs/.

    python campaigns/hauv_circle/make_logs.py

The vehicle has the coefficients of the thesis's simulations (as_simulated) and flies
under the regulator of campaigns/hauv. Then `auvid run hauv_circle` identifies a model
from the logs, and `auvid run hauv_redesign` flies controllers on it; `make circle` does
it all.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from auvid.data_schemas.yaml_text import read_yaml
from auvid.hydro.control.closed_loop import fly
from auvid.hydro.control.controllers import design
from auvid.hydro.control.equilibrium import equilibrium
from auvid.hydro.control.paths.paths import Curve, helix, path_of_pieces, saw_tooth
from auvid.hydro.control.paths.trajectories import fly_path
from auvid.hydro.control.plants import HybridPlant
from auvid.hydro.dynamics.simulation.simulation import Actuation, Motion
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.stages.control.cases import limits_of, weights_of
from auvid.stages.control.flying import models_of
from auvid.stages.simulate.dataflash_writer import write_dataflash
from auvid.stages.simulate.plans import plan_from_document
from auvid.stages.simulate.sensing import record

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
SEED, TICK_S, DURATION_S, DEPTH_M = 7, 0.02, 60.0, 20.0
START = (0.0, 0.0, DEPTH_M)


def weave(radius: float, run: float, pitch_run: float) -> Curve:
    """Turns to either side of growing length, with a dive and a rise in between."""
    pieces = []
    for index in range(12):
        side = 1.0 if index % 2 == 0 else -1.0
        slope = (0.0, 1.0, 0.0, -1.0)[index % 4]
        pieces.append(("turn", run * (1.0 + 0.3 * (index % 3)), side / radius, slope / pitch_run))
    return path_of_pieces(START, 0.0, -0.1, pieces, ramp_m=1.0)


LEGS = {
    "weave": (weave(7.0, 6.0, 40.0), 1.5),
    "weave_slow": (weave(5.0, 4.0, 30.0), 1.0),
    "dives": (
        saw_tooth(leg_m=6.0, pitch_rad=0.35, tip_radius_m=6.0, legs=9, ramp_m=1.0, start=START),
        1.5,
    ),
    "helix_port": (
        helix(radius_m=8.0, pitch_rad=-0.1, turns=2.0, starboard=False, ramp_m=3.0, start=START),
        1.3,
    ),
    "weave_validation": (weave(9.0, 7.0, 35.0), 1.4),
}


@dataclass(frozen=True)
class Logged:
    """A closed-loop flight as the sensors of a twin want it."""

    simulated: Any
    leg: Any
    log_end_s: float
    states: CubicSpline
    rates: CubicSpline
    t_s: np.ndarray
    U: np.ndarray
    newtons: float
    offset_s: float = 0.0

    def motion(self, t_s: np.ndarray) -> Motion:
        """The true motion; inputs are held from tick to tick."""
        chi, U = (
            self.states(t_s),
            self.U[np.clip((t_s / TICK_S + 1e-6).astype(int), 0, len(self.U) - 1)],
        )
        fins = np.column_stack([U[:, 2], U[:, 3], U[:, 1], U[:, 1]])
        actuation = Actuation(
            np.sqrt(np.maximum(U[:, 0], 0.0) / self.newtons), fins, np.zeros((len(t_s), 6))
        )
        return Motion(
            t_s, chi[:, 6:], chi[:, :6], self.rates(t_s)[:, :6], actuation, np.zeros((len(t_s), 6))
        )


def flights() -> dict[str, bytes]:
    """Log files by name."""
    document = read_yaml((HERE / "vehicle.yaml").read_text())
    vehicle = vehicle_from_document(document)
    cases = read_yaml((ROOT / "campaigns/hauv/cases.yaml").read_text())
    plant = models_of(
        vehicle_from_document(read_yaml((ROOT / "vehicles/hauv.yaml").read_text())),
        None,
        {**cases, "redesign": []},
        limits_of(cases),
    ).plant
    assert isinstance(plant, HybridPlant)
    plan = plan_from_document(
        read_yaml((HERE / "sensors.yaml").read_text()), vehicle, file="sensors.yaml"
    )
    assert vehicle.propeller is not None
    newtons = vehicle.propeller.thrust[2] * vehicle.water_density * vehicle.propeller.diameter_m**4
    logs = {}
    for name, (path, speed) in LEGS.items():
        trimmed = equilibrium(
            plant, fly_path(path, speed_m_s=speed, step_s=TICK_S, duration_s=DURATION_S)
        )
        flown = fly(plant, design(plant, trimmed, weights_of(cases)["thrust_mode"], stride=25))
        chi = flown.chi[0]
        rate = plant.rate(
            chi, flown.U[0], mass_kg=trimmed.mass_kg, force_ned_N=None, current_ned_m_s=None
        )
        leg = Logged(
            simulated=SimpleNamespace(vehicle=vehicle),
            leg=SimpleNamespace(id=name),
            log_end_s=float(flown.t_s[-1]),
            states=CubicSpline(flown.t_s, chi),
            rates=CubicSpline(flown.t_s, rate),
            t_s=flown.t_s,
            U=flown.U[0],
            newtons=float(newtons),
        )
        logs[f"{name}.BIN"] = write_dataflash(
            record(leg, plan, seed=SEED, text=f"H-AUV in closed loop, {name}")
        )  # type: ignore[arg-type]
    return logs


def main() -> None:
    """Write the logs."""
    (HERE / "logs").mkdir(exist_ok=True)
    for name, data in flights().items():
        (HERE / "logs" / name).write_bytes(data)
        print(f"{name}: {len(data)} bytes")


if __name__ == "__main__":
    main()
