"""Whether the training legs show exchanged outputs, or a reversed thruster."""

from __future__ import annotations

from collections.abc import Iterable

from auvid.data_schemas.tables import has_columns, matrix
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.fleet.thruster_strength import ThrusterLeg
from auvid.hydro.identification.fleet.wiring import WiringFault, wiring_fault
from auvid.stages.columns import VELOCITY, clock, force_columns
from auvid.stages.presentation import Block, remark
from auvid.stages.synthesise.training import LegTables

STEP_S = 0.1
MOST_SAMPLES = 30_000
"""Samples of `STEP_S` that are looked at: fifty minutes."""


def wiring_blocks(legs: Iterable[LegTables], vehicle: Vehicle) -> list[Block]:
    """Return a warning that names the outputs, or nothing."""
    if vehicle.thrusters is None:
        return []
    count = vehicle.thrusters.allocation.shape[1]
    names = [f"thruster_{number}_N" for number in range(1, count + 1)]
    parts: list[ThrusterLeg] = []
    for leg in legs:
        if leg.controls is None or not has_columns(leg.controls, names):
            return []
        t_s = clock(leg.residual)
        rows = slice(0, None, max(1, round(STEP_S / float(t_s[1] - t_s[0]))))
        parts.append(
            ThrusterLeg(
                t_s[rows],
                matrix(leg.residual, VELOCITY)[rows],
                matrix(leg.residual, force_columns("tau_bar"))[rows],
                matrix(leg.controls, names)[rows],
            )
        )
        if sum(part.t_s.size for part in parts) > MOST_SAMPLES:
            break
    fault = wiring_fault(parts, vehicle.thrusters.allocation)
    return [] if fault is None else [remark(_words(fault, vehicle.thrusters.outputs), "warning")]


def _words(fault: WiringFault, outputs: tuple[int, ...]) -> str:
    numbers = [outputs[index - 1] for index in fault.outputs]
    why = (
        f" {100.0 * fault.gain:.0f} % of what the thrusters leave unexplained on these axes goes"
        f" ({fault.certainty:.1f} standard deviations)"
    )
    if len(numbers) == 2:
        return (
            f"Thruster outputs {numbers[0]} and {numbers[1]} look exchanged: with the two the"
            f" other way round{why}. Check the wiring, and order, position and axis of"
            " actuators.thrusters in the vehicle file."
        )
    return (
        f"Thruster output {numbers[0]} looks reversed: with its force the other way{why}. Check"
        f" its direction (MOT_{numbers[0]}_DIRECTION of the autopilot, which a log brings, else"
        " actuators.thrusters.direction in the vehicle file)."
    )
