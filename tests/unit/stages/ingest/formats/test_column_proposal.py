"""The draft of a column map from the names of the columns: what it takes for what, what
it leaves open, and that it can be read.
"""

from __future__ import annotations

from typing import Any

import pytest

from auvid.data_schemas.yaml_text import read_yaml
from auvid.stages.ingest.formats.csv.column_map import column_map
from auvid.stages.ingest.formats.csv.column_proposal import proposed_map

TANK = [
    "t_s",
    "x_m",
    "y_m",
    "z_m",
    "roll_rad",
    "pitch_rad",
    "yaw_rad",
    "u_mps",
    "v_mps",
    "w_mps",
    "p_radps",
    "q_radps",
    "r_radps",
    "cmd0",
]
BLUEYE = ("Time", "Surge", "Sway", "Heave", "Yaw", "Depth", "Yaw Angle", "Desired Depth")


def draft(names: tuple[str, ...] | list[str]) -> tuple[str, dict[str, Any]]:
    comment, text = proposed_map(names).split("\n", 1)
    return comment, read_yaml(text)


def test_names_with_units_give_a_map_that_holds_as_it_is() -> None:
    comment, proposed = draft(TANK)
    mapped = column_map(proposed, TANK, file="tank.csv")
    assert mapped.time == "t_s"
    assert {(item.column, item.field) for item in mapped.columns} >= {
        ("u_mps", "u_m_s"),
        ("yaw_rad", "psi_rad"),
        ("p_radps", "gyro_x_rad_s"),
    }
    assert "nothing looks like depth (resample), actuators (residual)" in comment
    assert "# no guess for cmd0" in proposed_map(TANK)


def test_a_speed_log_tells_lift_of_a_glider_and_is_named_elsewhere() -> None:
    of_glider = ["t_s", "pressure_dbar", "pitch_deg", "ballast_pumped_cm3", "density_kg_m3"]
    for name in ("speed_log_m_s", "stw_m_s", "em_log_kn", "speed_through_water_m_s", "u_dvl"):
        places = {item["column"]: item["field"] for item in draft([*of_glider, name])[1]["columns"]}
        assert places.get(name) == "speed_m_s"
    text = proposed_map(["t_s", "depth_m", "roll_deg", "stw_m_s", "sog_m_s"])
    assert "# stw_m_s: speed through the water ahead" in text
    assert "sog_m_s: speed" not in text


def test_outputs_in_percent_are_proposed_as_such() -> None:
    names = ["t_s", "thruster_1_percent", "thruster_2_pct", "thruster_3", "surge_cmd_percent"]
    units = {item["column"]: item["unit"] for item in draft(names)[1]["columns"]}
    assert [units[name] for name in names[1:]] == ["percent", "percent", "us", "percent"]


def test_commands_are_not_taken_for_angles_nor_wishes_for_measurements() -> None:
    comment, proposed = draft(BLUEYE)
    places = {item["column"]: item["field"] for item in proposed["columns"]}
    assert places["Yaw"] == "command_yaw"
    assert places["Yaw Angle"] == "psi_rad"
    assert places["Depth"] == "depth_m"
    assert "Desired Depth" not in places
    assert "attitude (without phi_rad, theta_rad)" in comment
    assert {item["unit"] for item in proposed["columns"] if item["column"] == "Depth"} == {"?"}, (
        "no name tells this unit"
    )


def test_velocity_called_by_where_it_points_has_its_frame() -> None:
    _, proposed = draft(["time [s]", "forward [m/s]", "left [m/s]"])
    assert [(item["field"], item["unit"], item.get("frame")) for item in proposed["columns"]] == [
        ("u_m_s", "m/s", None),
        ("v_m_s", "m/s", "flu"),
    ]


def test_a_unit_tells_a_velocity_from_a_command() -> None:
    names = ["time_s", "surge_mps", "sway [m/s]", "heave_mps", "yaw [deg/s]", "roll_deg"]
    _, proposed = draft(names)
    assert {item["column"]: (item["field"], item["unit"]) for item in proposed["columns"]} == {
        "surge_mps": ("u_m_s", "m/s"),
        "sway [m/s]": ("v_m_s", "m/s"),
        "heave_mps": ("w_m_s", "m/s"),
        "yaw [deg/s]": ("gyro_z_rad_s", "deg/s"),
        "roll_deg": ("phi_rad", "deg"),
    }
    _, proposed = draft(["time_s", "fwd_mps", "port_mps", "down_mps"])
    assert [(item["field"], item.get("frame")) for item in proposed["columns"]] == [
        ("u_m_s", None),
        ("v_m_s", "flu"),
        ("w_m_s", None),
    ]


@pytest.mark.parametrize(
    "names",
    [("a", "b"), ("t",), ("",), ("x: {y", "- '\"", "depth\t\\", "no"), ("time", "é", "深度_m")],
)
def test_odd_names_leave_a_draft_that_can_be_read(names: tuple[str, ...]) -> None:
    _, proposed = draft(names)
    assert proposed["time"]["column"] in names
    assert {item["column"] for item in proposed["columns"]} <= {*names, "?"}
