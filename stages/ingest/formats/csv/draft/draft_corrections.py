"""A drafted column map, corrected by what the checks say of units and signs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from auvid.stages.ingest.formats.csv.draft.column_draft import (
    TWO_CLOCKS,
    ColumnDraft,
    DraftColumn,
)

SIGNS = ("gyro_sign", "velocity_sign", "depth_sign")
"""Findings that a turned sign of their fields mends."""
OF_GRAVITY, UPSIDE_DOWN_DEG = "accelerometer_direction", 170.0
OTHER_UNIT = {"rad": "deg", "deg": "rad", "rad/s": "deg/s", "deg/s": "rad/s"}
UNITS = {"attitude_unit": ("phi_", "theta_", "psi_"), "gyro_scale": ("gyro_",)}
"""Findings that the other unit of an angle mends, and the fields that they concern."""
EXCHANGED = {"u_m_s": "v_m_s", "v_m_s": "u_m_s"}


def corrected(draft: ColumnDraft, findings: Sequence[Mapping[str, Any]]) -> ColumnDraft:
    """Return the draft with what findings mend; the same one where they mend nothing.

    A unit that a name says stays; a sign or axis that no name says is turned, and the
    draft says why.
    """
    draft = _on_one_clock(_from_above(draft, findings), findings)
    for item in findings:
        change = _change(item)
        if change is not None:
            columns = tuple(change(column) for column in draft.columns)
            if columns != draft.columns:
                draft = replace(draft, columns=columns)
    return draft


def _from_above(draft: ColumnDraft, findings: Sequence[Mapping[str, Any]]) -> ColumnDraft:
    """Return the draft in forward-left-up axes where sway and yaw answer reversed.

    Without thrusters of sway heave stands for it. Two axes at once are a frame; one alone may
    as well be a thruster of the vehicle file.
    """
    reversed_fields = {
        field for item in findings if item["id"] == "response_sign" for field in item["fields"]
    }
    turned = "gyro_z_rad_s" in reversed_fields and {"v_m_s", "w_m_s"} & reversed_fields
    if not turned or {"u_m_s", "gyro_x_rad_s"} & reversed_fields:
        return draft
    why = "sway or heave and yaw answer the thrusters the wrong way round otherwise"
    return in_upward_body(draft, why=why)


def _on_one_clock(draft: ColumnDraft, findings: Sequence[Mapping[str, Any]]) -> ColumnDraft:
    """Return commands of another clock at the offset that the motion tells, if any."""
    own = draft.streams == ("actuators",) and draft.time_check.startswith(TWO_CLOCKS)
    for item in findings if own else ():
        # The remedy of an offset is a shift, that of a drift is a factor.
        if item["id"] == "pose_clock" and "shift_s" in item["remedy"] and item["value"]:
            text = str(item["text"]).split(":")[0]
            why = f"{TWO_CLOCKS}, moved to where the motion answers: before, {text}"
            return draft.shifted(float(item["value"]), why)
    return draft


def reversals(findings: Sequence[Mapping[str, Any]]) -> set[str]:
    """Return which findings say that signs of sensors are turned against each other."""
    return {
        str(item["id"])
        for item in findings
        if item["id"] in SIGNS
        or (item["id"] == OF_GRAVITY and (item["value"] or 0.0) > UPSIDE_DOWN_DEG)
    }


def in_upward_body(
    draft: ColumnDraft, *, why: str = "more than one sign is turned otherwise", heading: bool = True
) -> ColumnDraft:
    """Return the draft with velocity, imu and attitude in forward-left-up axes.

    heading: that of the attitude turns with them, unlike one of a compass.
    """
    columns = tuple(
        replace(item, frame="flu", sign=1, check=f"forward-left-up: {why}")
        if item.stream in ("velocity", "imu", "attitude")
        and not item.frame
        and (heading or item.field != "psi_rad")
        else item
        for item in draft.columns
    )
    return replace(draft, columns=columns)


def in_upward_poses(draft: ColumnDraft) -> ColumnDraft:
    """Return the draft with z up for poses whose frame was assumed."""
    columns = tuple(
        replace(item, frame="flu", check="z up: commands answer so")
        if item.stream == "pose" and not item.frame and item.check
        else item
        for item in draft.columns
    )
    return replace(draft, columns=columns)


def _change(item: Mapping[str, Any]) -> Callable[[DraftColumn], DraftColumn] | None:
    """Return what a finding changes in a column; None for one that changes nothing."""
    name, fields = str(item["id"]), set(item["fields"])
    text = str(item["text"]).rstrip(".")
    if name in SIGNS:
        return lambda column: (
            replace(
                column, sign=-column.sign, frame="", check=_added(column, f"sign turned: {text}")
            )
            if column.field in fields
            else column
        )
    if name in UNITS and item.get("stream") != "pose":  # of poses: one map is of runs in both units
        return lambda column: (
            replace(
                column, unit=OTHER_UNIT[column.unit], check=_added(column, f"unit changed: {text}")
            )
            if column.field.startswith(UNITS[name])
            and column.check
            and column.unit in OTHER_UNIT
            and (not fields or column.field in fields)
            else column
        )
    if name == "accelerometer_unit":
        return lambda column: (
            replace(column, unit="g0", check=_added(column, f"unit changed: {text}"))
            if column.field.startswith("accel_") and column.check
            else column
        )
    if name == OF_GRAVITY and (item["value"] or 0.0) > UPSIDE_DOWN_DEG:
        return lambda column: (
            replace(column, sign=-column.sign, check=_added(column, f"sign turned: {text}"))
            if column.field.startswith("accel_")
            else column
        )
    if name == "pose_up":
        return lambda column: (
            replace(column, frame="y_up", check=f"{column.unit}, y up: only so heave is down")
            if column.stream == "pose" and not column.frame
            else column
        )
    if name == "velocity_axes":
        return lambda column: (
            replace(
                column, field=EXCHANGED[column.field], check=_added(column, f"exchanged: {text}")
            )
            if column.field in EXCHANGED and column.check
            else column
        )
    return None


def _added(column: DraftColumn, reason: str) -> str:
    """Return the check of a column with one more reason."""
    before = [part for part in column.check.split("; ") if ": " in part]
    return "; ".join([*before, reason])
