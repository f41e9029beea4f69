"""Names of columns as laboratories and programs write them: what is taken, what is not."""

from __future__ import annotations

import numpy as np
import pytest

from auvid.stages.ingest.formats.csv.column_names import NamedColumn, named_columns
from auvid.stages.ingest.formats.csv.column_proposal import ahead_words
from tests.support.column_drafts import T_S, drafted, wave
from tests.support.tools import ROOT

TABLE = ROOT / "tests/data/column_names.txt"


def headers() -> list[list[tuple[str, str, str]]]:
    """Return name, field and unit of every name, by header."""
    blocks = []
    for block in TABLE.read_text(encoding="utf-8").split("\n\n")[1:]:
        items = [item.strip().rsplit("=", 1) for item in block.replace("\n", " | ").split("|")]
        pairs = [item for item in items if len(item) == 2]
        blocks.append([(name, *field.partition("@")[::2]) for name, field in pairs])
    return blocks


def taken_for(item: NamedColumn) -> str:
    """Return what a column is taken for, as the table writes it."""
    if item.place is not None:
        return item.place[1]
    return f"q_{item.part}" if item.in_quaternion else "-"


def test_names_are_taken_for_what_they_are_and_no_other_for_anything() -> None:
    wrong, count = [], 0
    for header in headers():
        columns = named_columns([name for name, _, _ in header])
        for (name, field, unit), item in zip(header, columns, strict=True):
            count += 1
            field_fits = item.may_be_time if field == "t" else taken_for(item) == field
            if not field_fits or (unit and unit != item.unit):
                wrong.append(f"{name}: {taken_for(item)}@{item.unit}, not {field}@{unit}")
    assert count > 1400
    assert wrong == []


@pytest.mark.parametrize(
    ("column", "fields"),
    [("rudder_deg", ("fin_b_rad", "fin_t_rad")), ("stern_plane", ("fin_s_rad", "fin_p_rad"))],
)
def test_a_pair_of_fins_moves_both_and_its_sign_is_spoken_of(
    column: str, fields: tuple[str, str]
) -> None:
    draft = drafted({"t_s": T_S, column: wave(12.0), "shaft_rpm": 500.0 + wave(100.0)})
    fins = [item for item in draft.columns if item.field.startswith("fin_")]
    assert tuple(item.field for item in fins) == fields
    assert {(item.column, item.unit) for item in fins} == {(column, "deg")}
    assert all("stern to starboard or up" in item.check for item in fins)


def test_names_that_leave_something_open_are_marked() -> None:
    draft = drafted(
        {
            "t_s": T_S,
            "depth_sensor_m": 3.0 + wave(1.0),
            "depth_filtered_m": 3.0 + wave(1.0),
            "surge": wave(0.5),
            "sway": wave(0.5),
        }
    )
    checks = {item.column: item.check for item in draft.columns}
    assert "or depth_filtered_m, by the name" in checks["depth_sensor_m"]
    assert checks["surge"] == "a command, as no unit tells otherwise; else u_m_s"
    steered = drafted({"t_s": T_S, "surge": wave(0.5), "sway": wave(0.5), "yaw": wave(170.0)})
    assert "beyond 1: another unit, or a set point" in steered.columns[2].check
    assert "divide the column by 1000" in steered.columns[2].check
    assert "else psi_rad" in steered.columns[2].check
    assert "beyond 1" not in steered.columns[0].check
    for name in ("speed_log_m_s", "surge_mps", "speed_mps"):
        towed = drafted({"t_s": T_S, "tension_N": 9.0 + wave(1.0), name: 1.0 + wave(0.1)})
        assert [item.field for item in towed.columns] == ["tow_force_n", "tow_speed_m_s"]
    assert "taken for the speed of the tow" in towed.columns[1].check
    (words,) = ahead_words(drafted({"t_s": T_S, "surge_mps": 1.0 + wave(0.1)}).ahead)
    assert words.startswith("surge_mps: speed through the water ahead")


def test_a_wave_height_below_zero_is_no_depth() -> None:
    below = -5.0 + wave(1.0)
    assert drafted({"t_s": T_S, "relative_altitude_m": below}).streams == ("depth",)
    draft = drafted({"t_s": T_S, "wave_height_m": below, "roll_deg": np.zeros(T_S.size)})
    assert draft.streams == ()


@pytest.mark.parametrize(("name", "frame"), [("cmd_heave_up", "flu"), ("heave_cmd_down", "")])
def test_a_command_of_heave_that_says_where_it_pushes_is_one(name: str, frame: str) -> None:
    (item,) = named_columns([name])
    assert (item.place, item.frame) == (("actuators", "command_heave"), frame)
