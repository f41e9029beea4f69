"""The warning about exchanged and reversed thrusters, from the tables of legs."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np
import pyarrow as pa

from auvid.data_schemas.records.motion import SegmentRecord
from auvid.hydro.arrays import Array
from auvid.stages.columns import VELOCITY, force_columns, named
from auvid.stages.synthesise.training import LegTables
from auvid.stages.synthesise.wiring import torque_blocks, wiring_blocks
from tests.support.motions import shipped_vehicle
from tests.unit.hydro.identification.checks.test_torque_sign import roll_leg
from tests.unit.hydro.identification.fleet.test_wiring import HEAVY, B, leg


def tables(wiring: Array) -> LegTables:
    flown = leg(wiring)
    residual = {"t_s": flown.t_s, **named(VELOCITY, flown.nu)}
    residual |= named(force_columns("tau_bar"), flown.tau_bar)
    controls = {"t_s": flown.t_s}
    controls |= named([f"thruster_{number}_N" for number in range(1, 9)], flown.thrust_N)
    unused = cast(SegmentRecord, None)
    return LegTables(pa.table(residual), unused, None, None, pa.table(controls))


def test_the_outputs_and_the_remedy_are_named() -> None:
    (exchanged,) = wiring_blocks([tables(B[:, [0, 1, 3, 2, *range(4, 8)]])], HEAVY)
    assert str(exchanged["text"]).startswith(
        "Thruster outputs 3 and 4 look exchanged: with the two"
    )
    assert exchanged["level"] == "warning"
    turned = B * np.where(np.arange(8) == 5, -1.0, 1.0)
    (reversed_one,) = wiring_blocks([tables(turned)], HEAVY)
    assert str(reversed_one["text"]).startswith("Thruster output 6 looks reversed")
    assert "MOT_6_DIRECTION" in str(reversed_one["text"])


def test_a_torque_of_the_wrong_sign_names_the_figure_of_the_file() -> None:
    texts = []
    for feels in (1.0, -1.0):
        flown = roll_leg(feels)
        force = {name: np.zeros((len(flown.nu), 6)) for name in ("tau_bar", "propeller")}
        force["tau_bar"][:, 3], force["propeller"][:, 3] = flown.moment, flown.torque
        columns = {"t_s": flown.step_s * np.arange(len(flown.nu)), **named(VELOCITY, flown.nu)}
        for name, values in force.items():
            columns |= named(force_columns(name), values)
        table = pa.table(columns)
        assert torque_blocks([table], HEAVY) == [], "it has no propeller"
        texts.append([str(b["text"]) for b in torque_blocks([table], shipped_vehicle("vt690"))])
    assert texts[0] == []
    assert "Turn the signs of actuators.propeller.torque_coefficient" in texts[1][0]


def test_right_wiring_and_missing_thrusts_say_nothing() -> None:
    right = tables(B)
    assert wiring_blocks([right], HEAVY) == []
    without = LegTables(right.residual, right.segment, None, None, None)
    assert wiring_blocks([without], HEAVY) == []


def test_a_thruster_at_half_strength_is_named_by_its_output() -> None:
    undamaged = tables(B * np.where(np.arange(8) == 2, 0.5, 1.0))
    (weak,) = wiring_blocks([undamaged], HEAVY)
    assert str(weak["text"]).startswith("The thruster of output 3 looks weak")
    assert weak["level"] == "warning"


def test_several_weak_thrusters_are_named_in_one_warning() -> None:
    uneven = tables(B * np.where(np.isin(np.arange(8), [2, 3, 5]), 0.5, 1.0))
    (weak,) = wiring_blocks([uneven], HEAVY)
    words = str(weak["text"])
    assert words.startswith("3 thrusters give another thrust than those that act as they do: ")
    assert all(f"output {number} weak, 0." in words for number in (3, 4, 6))
    strong = tables(B * np.where(np.arange(8) == 2, 1.0, 0.5))
    (one,) = wiring_blocks([strong], HEAVY)
    assert "The thruster of output 3 looks stronger: " in str(one["text"])
    assert "these are weak (outputs 1, 2, 4)" in str(one["text"])


def test_a_dead_thruster_is_not_called_reversed() -> None:
    still = tables(B * np.where(np.arange(8) == 2, 0.0, 1.0))
    (dead,) = wiring_blocks([still], HEAVY)
    assert str(dead["text"]).startswith("The thruster of output 3 looks dead")


def test_a_thruster_that_never_pushes_is_named_as_one_of_which_nothing_is_known() -> None:
    right = tables(B)
    controls = right.controls
    assert controls is not None
    place = controls.column_names.index("thruster_5_N")
    still = pa.array(np.zeros(controls.num_rows))
    idle = replace(right, controls=controls.set_column(place, "thruster_5_N", still))
    (note,) = wiring_blocks([idle], HEAVY)
    assert note["level"] == "note"
    assert str(note["text"]).startswith("The thruster of output 5 does not push")
