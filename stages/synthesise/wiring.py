"""What training legs show of wrong thrusters, and of a propeller's torque."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import pyarrow as pa

from auvid.data_schemas.tables import has_columns, matrix
from auvid.hydro.arrays import AXES
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.identification.checks.torque_sign import RollLeg, torque_share
from auvid.hydro.identification.fleet.thruster_strength import (
    BLOCK_S,
    UNEVEN,
    ThrusterLeg,
    ThrusterStrength,
    thruster_strengths,
)
from auvid.hydro.identification.fleet.wiring import (
    CERTAIN,
    WiringFault,
    missing_thruster,
    wiring_fault,
)
from auvid.stages.columns import VELOCITY, clock, force_columns
from auvid.stages.presentation import Block, remark
from auvid.stages.synthesise.training import LegTables

STEP_S = 0.1
MOST_SAMPLES = 30_000
"""Samples of `STEP_S` that are looked at: fifty minutes."""


def wiring_blocks(legs: Iterable[LegTables], vehicle: Vehicle) -> list[Block]:
    """Return a warning that names the outputs, those of weak thrusters, or nothing.

    Strengths are looked at where the wiring is right: two exchanged outputs make all of
    them wrong.
    """
    if vehicle.thrusters is None:
        return []
    parts = thruster_legs(((leg.residual, leg.controls) for leg in legs), vehicle)
    if not parts:
        return []
    fault = wiring_fault(parts, vehicle.thrusters.allocation)
    if fault is not None:
        return [remark(_words(fault, vehicle.thrusters.outputs), "warning")]
    every = strengths(parts, vehicle)
    idle = [vehicle.thrusters.outputs[item.thruster - 1] for item in every if item.is_idle]
    blocks = [remark(_idle_words(idle))] if idle else []
    uneven = [item for item in every if item.verdict in UNEVEN]
    if uneven:
        return [remark(_uneven_words(uneven, vehicle.thrusters.outputs), "warning"), *blocks]
    fault = missing_thruster(parts, vehicle.thrusters.allocation)
    return blocks if fault is None else [remark(_missing_words(fault, vehicle), "warning"), *blocks]


def torque_blocks(tables: Iterable[pa.Table], vehicle: Vehicle) -> list[Block]:
    """Return a warning on a propeller whose torque has the wrong sign, or nothing."""
    if vehicle.propeller is None:
        return []
    roll = AXES.index("K")
    legs = [
        RollLeg(
            matrix(table, VELOCITY),
            matrix(table, force_columns("tau_bar"))[:, roll],
            matrix(table, force_columns("propeller"))[:, roll],
            float(np.mean(np.diff(clock(table)))),
        )
        for table in tables
        if has_columns(table, force_columns("propeller"))
    ]
    share = torque_share(legs)
    if share is None or not share.backward:
        return []
    words = (
        "The torque of the propeller rolls the vehicle the other way than the vehicle file says:"
        f" the training legs show {share.value:.2g} +- {NORMAL_95 * share.standard_error:.1g} of it"
        " (95 %). Turn the signs of actuators.propeller.torque_coefficient: they are negative where"
        " the propeller turns clockwise seen from astern. Roll damping and its constant are wrong"
        " until then."
    )
    return [remark(words, "warning")]


def thruster_legs(
    tables: Iterable[tuple[pa.Table, pa.Table | None]], vehicle: Vehicle
) -> list[ThrusterLeg]:
    """Return legs of residual and controls, none where a leg lacks thrusts."""
    assert vehicle.thrusters is not None
    count = vehicle.thrusters.allocation.shape[1]
    names = [f"thruster_{number}_N" for number in range(1, count + 1)]
    parts: list[ThrusterLeg] = []
    for residual, controls in tables:
        if controls is None or not has_columns(controls, names):
            return []
        t_s = clock(residual)
        rows = slice(0, None, max(1, round(STEP_S / float(t_s[1] - t_s[0]))))
        every = (
            t_s[rows],
            matrix(residual, VELOCITY)[rows],
            matrix(residual, force_columns("tau_bar"))[rows],
            matrix(controls, names)[rows],
        )
        parts.append(ThrusterLeg(*(part.copy() for part in every)))  # views would keep the rest
        if sum(part.t_s.size for part in parts) > MOST_SAMPLES:
            break
    return parts


def strengths(legs: Sequence[ThrusterLeg], vehicle: Vehicle) -> tuple[ThrusterStrength, ...]:
    """Return the strength of each thruster; none where the legs are too short."""
    length_s = sum(float(leg.t_s[-1] - leg.t_s[0]) for leg in legs)
    if vehicle.thrusters is None or length_s < 4.0 * BLOCK_S:
        return ()
    return thruster_strengths(legs, vehicle.thrusters.allocation)


def _idle_words(outputs: Sequence[int]) -> str:
    numbers = ", ".join(map(str, outputs))
    which = (
        f"thrusters of outputs {numbers} do"
        if len(outputs) > 1
        else f"thruster of output {numbers} does"
    )
    return (
        f"The {which} not push in the training legs, or always as much: nothing tells the"
        " strength, and a dead one would not show."
    )


def _uneven_words(uneven: Sequence[ThrusterStrength], outputs: tuple[int, ...]) -> str:
    """Return the warning on thrusters that give another thrust than those like them."""
    if len(uneven) > 1:
        each = "; ".join(
            f"output {outputs[item.thruster - 1]} {item.verdict}, {item.strength:.2f} (standard"
            f" error {item.standard_error:.2f})"
            for item in uneven
        )
        return (
            f"{len(uneven)} thrusters give another thrust than those that act as they do: {each}."
            " Look at their propellers, motors and cables. Where these are sound the vehicle file"
            " is wrong: another thrust curve, or positions, axes or order of thrusters. The forces"
            " of this dive are wrong by the difference."
        )
    (item,) = uneven
    others = ", ".join(str(outputs[number - 1]) for number in item.others)
    look = (
        f"Either these are weak (outputs {others}), or the thrust curve of the vehicle file is not"
        " its own"
        if item.verdict == "stronger"
        else "Look at its propeller, its motor and its cable"
    )
    return (
        f"The thruster of output {outputs[item.thruster - 1]} looks {item.verdict}:"
        f" {item.strength:.2f} of the thrust of those that act as it does (outputs {others};"
        f" standard error {item.standard_error:.2f}). {look}; the forces of this dive are wrong by"
        " the difference."
    )


def _words(fault: WiringFault, outputs: tuple[int, ...]) -> str:
    numbers = [outputs[index - 1] for index in fault.outputs]
    why = (
        f" {100.0 * fault.gain:.0f} % of what the thrusters leave unexplained on these axes goes"
        f" (logarithm of the likelihood over that of any one thruster of another strength, less"
        f" that of the faults tried: {fault.log_ratio:.1f}; named from {CERTAIN:.1f})"
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


def _missing_words(fault: WiringFault, vehicle: Vehicle) -> str:
    assert vehicle.thrusters is not None
    output = vehicle.thrusters.outputs[fault.outputs[0] - 1]
    return (
        f"Thruster output {output} looks dead or reversed: without its force"
        f" {100.0 * fault.gain:.0f} % of what the thrusters leave unexplained on its axes goes"
        f" (logarithm of the likelihood {fault.log_ratio:.1f}; named from {CERTAIN:.1f}). Which of"
        " the two the log does not tell, as another thruster always pushes with it: check its"
        " propeller, its direction, and the order of the outputs."
    )
