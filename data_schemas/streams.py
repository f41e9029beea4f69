"""The declared mapping from log messages to streams (formats/streams.yaml).

It also gives what could supply a stream that is missing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib import resources
from typing import Any

from auvid.data_schemas.schemas import schema
from auvid.data_schemas.yaml_text import read_yaml

STREAMS = (
    "imu",
    "attitude",
    "depth",
    "velocity",
    "position",
    "actuators",
    "battery",
    "range",
    "mode",
    "events",
    "water_velocity",
    "sticks",
    "glider",
    "pose",
    "tow",
    "fixes",
)
NEEDED: Mapping[str, tuple[str, ...]] = {
    "imu": ("gyro_x_rad_s", "gyro_y_rad_s", "gyro_z_rad_s"),
    "attitude": ("phi_rad", "theta_rad", "psi_rad"),
    "depth": ("depth_m",),
    "velocity": ("u_m_s", "v_m_s", "w_m_s"),
    "position": ("x_m", "y_m", "z_m"),
    "actuators": (),
    "battery": ("voltage_v",),
    "range": ("range_m",),
    "mode": ("mode",),
    "events": ("text",),
    "water_velocity": ("u_m_s", "v_m_s", "w_m_s"),
    "sticks": ("stick_surge", "stick_sway", "stick_heave", "stick_yaw"),
    "glider": (),
    "pose": ("x_m", "y_m", "z_m", "phi_rad", "theta_rad", "psi_rad"),
    "tow": ("tow_force_n",),
    "fixes": ("north_m", "east_m"),
}
"""Fields without which a row of the stream is no sample; of `actuators` and `glider` any
one field will do.
"""
CONDITIONS: Mapping[str, str] = {
    "aided": "only if the navigation filter had a velocity or position sensor",
    "placed": "only if it gives positions",
    "fast": "only if sent at 10 Hz or more",
    "varies": "only if it does not stand still over the whole log",
}
CHOICES: Mapping[str, str] = {
    "healthy": "the first instance that calls itself healthy",
    "submerged": "the instance in the water",
    "downward": "the instance that looks down",
}
"""What `when` and `choose` of a source mean."""


@dataclass(frozen=True)
class Linear:
    """One stream field as a column of the log.

    It gives the unit there, the sign, and whether the unit holds against what the log
    declares.
    """

    column: str
    unit: str
    sign: int
    forced: bool = False


@dataclass(frozen=True)
class StreamSource:
    """One way to fill a stream from a format.

    formats/streams.yaml explains each entry.
    """

    name: str
    message: str
    columns: tuple[str, ...]
    optional: tuple[str, ...] = ()
    fields: Mapping[str, Linear] = field(default_factory=dict)
    compute: str | None = None
    choose: str | None = None
    when: str | None = None
    also: tuple[str, ...] = ()
    note: str | None = None
    meaning: str | None = None


@dataclass(frozen=True)
class FormatStreams:
    """The sources of every stream in one log format, in order of preference."""

    title: str
    instance: tuple[str, ...]
    streams: Mapping[str, tuple[StreamSource, ...]]

    @property
    def messages(self) -> frozenset[str]:
        """Return all message types that any stream needs."""
        sources = [source for group in self.streams.values() for source in group]
        return frozenset(
            {source.message for source in sources}
            | {name for source in sources for name in source.also}
        )


@cache
def format_streams(name: str) -> FormatStreams | None:
    """Return the mapping of one log format.

    None for a format whose reader names its streams itself (CSV).
    """
    raw = _document().get(name)
    if raw is None:
        return None
    groups = {
        stream: tuple(_source(entry) for entry in entries)
        for stream, entries in raw["streams"].items()
    }
    return FormatStreams(str(raw["title"]), tuple(raw.get("instance", ())), groups)


def format_names() -> tuple[str, ...]:
    """Return the formats that have a mapping."""
    return tuple(_document())


@cache
def csv_dialects() -> Mapping[str, Mapping[str, Any]]:
    """Return the CSV files of known programs (formats/csv_dialects.yaml).

    Each has the columns to recognise it by, a column map and a note; some have columns
    that rows may have beyond their header.
    """
    text = (resources.files(__package__) / "formats" / "csv_dialects.yaml").read_text(
        encoding="utf-8"
    )
    dialects: dict[str, dict[str, Any]] = read_yaml(text)
    return dialects


@cache
def _document() -> dict[str, dict[str, Any]]:
    text = (resources.files(__package__) / "formats" / "streams.yaml").read_text(encoding="utf-8")
    document: dict[str, dict[str, Any]] = read_yaml(text)
    return document


def _source(entry: Mapping[str, object]) -> StreamSource:
    raw: dict[str, object] = dict(entry)
    name = str(raw.pop("source"))
    linear = {key: _linear(str(text)) for key, text in _mapping(raw.pop("fields", {})).items()}
    columns = _texts(raw.pop("columns", ())) or tuple(item.column for item in linear.values())
    texts = {
        key: None if key not in raw else str(raw.pop(key))
        for key in ("compute", "choose", "when", "note", "meaning")
    }
    message = str(raw.pop("message", name))
    optional, also = _texts(raw.pop("optional", ())), _texts(raw.pop("with", ()))
    if raw:
        raise ValueError(f"formats/streams.yaml: unknown key {sorted(raw)} at source {name}")
    return StreamSource(name, message, columns, optional, linear, also=also, **texts)


def _linear(text: str) -> Linear:
    column, unit = text.lstrip("-").split(" ", 1)
    return Linear(
        column, unit.removesuffix("!"), -1 if text.startswith("-") else 1, unit.endswith("!")
    )


def _mapping(value: object) -> Mapping[str, object]:
    assert isinstance(value, Mapping)
    return value


def _texts(value: object) -> tuple[str, ...]:
    assert isinstance(value, list | tuple)
    return tuple(str(item) for item in value)


def mapping_table(name: str) -> str:
    """The mapping of one format as a Markdown table, as docs/streams.md shows it."""
    spec = format_streams(name)
    assert spec is not None
    lines = ["| stream | source | columns | remarks |", "|---|---|---|---|"]
    for stream, sources in spec.streams.items():
        for source in sources:
            columns = ", ".join(f"`{column}`" for column in source.columns)
            remarks = [
                source.meaning,
                CONDITIONS.get(source.when or ""),
                CHOICES.get(source.choose or ""),
                source.note,
            ]
            lines.append(
                f"| {stream} | {source.name} | {columns} |"
                f" {'; '.join(text for text in remarks if text)} |"
            )
    return "\n".join(lines)


def supply_text(stream: str) -> str:
    """Return what could supply a stream, as text.

    It lists messages and columns per log format, and the fields a CSV column map can
    name.
    """
    parts = []
    for name in format_names():
        mapping = format_streams(name)
        assert mapping is not None
        ways = dict.fromkeys(
            f"{source.message} ({', '.join(source.columns)})"
            for source in mapping.streams.get(stream, ())
        )
        if ways:
            parts.append(f"{mapping.title}: {' or '.join(ways)}")
    fields = NEEDED[stream] or tuple(key for key in schema(stream).columns if key != "time_us")
    listed = ", ".join(fields) if len(fields) <= 6 else f"{fields[0]} ... {fields[-1]}"
    parts.append(f"CSV: columns mapped to {listed} of stream {stream}")
    return "; ".join(parts)
