"""The column map of a CSV log."""

from __future__ import annotations

from typing import Literal

from auvid.data_schemas.documents.model import Model


class TimeEntry(Model):
    """The time column."""

    column: str
    """Header."""
    unit: str
    """Unit; iso8601 or time_of_day (12:30:05.2) for text; hhmmss for 123005.2."""
    epoch: Literal["boot", "unix", "arbitrary"] | None = None
    """What zero means; default boot."""
    nanoseconds: str | None = None
    """Column of the nanoseconds within the second, as stamps of ROS have."""
    shift_s: float | None = None
    """Added to every time, where another clock is to be met."""
    start: object = None
    """Value of the time column from which legs count their seconds (a number in the
    unit of the column, or text); default the first row.
    """


class ColumnEntry(Model):
    """Columns."""

    column: str
    """Header in the file."""
    stream: str
    """Stream of auvid."""
    field: str
    """Field of the stream (u_m_s, gyro_x_rad_s ...)."""
    unit: str
    """Unit of the values in the file."""
    sign: Literal[1, -1] | None = None
    """Factor for a flipped axis."""
    frame: Literal["frd", "flu", "ned", "enu", "y_up"] | None = None
    """Frame of the file; the sign follows from it."""


class ColumnMapDocument(Model):
    """What the columns of a CSV log are."""

    time: TimeEntry
    """The time column."""
    accelerometer: Literal["specific_force", "inertial", "derivative"] | None = None
    """What the accelerometer columns measure."""
    columns: list[ColumnEntry]
    """The mapped columns."""
    missing: list[str] | None = None
    """Texts that stand for an empty cell."""
    held: list[str] | None = None
    """Streams whose rows repeat the last value until a new one comes."""
    delimiter: str | None = None
    """Column separator."""
    decimal: Literal[".", ","] | None = None
    """Decimal mark."""
