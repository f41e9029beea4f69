"""What people read in a recording: degrees, depths downwards, titles of models."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from auvid.stages.base import Document
from auvid.stages.number_format import printed_unit
from auvid.stages.page.colours import is_model
from auvid.stages.presentation import degrees

DEPTHS = ("depth_m", "z_m")
"""Ends of the names of columns with a depth."""


def readable(unit: str, columns: Sequence[str], names: Sequence[str] = ()) -> tuple[float, str]:
    """Return the factor and the unit of series as people read them.

    Rerun draws larger values higher, so a depth has a minus sign.

    >>> readable("rad/s", ["r_rad_s"])[1], readable("m", ["measured_depth_m"])
    ('deg/s', (-1.0, 'm, downwards'))
    """
    is_depth = all(name.endswith(DEPTHS) for name in columns) or (
        bool(names) and all(name.startswith("depth") for name in names)
    )
    return (-1.0, "m, downwards") if unit == "m" and is_depth else degrees(unit)


def readable_group(group: Document) -> tuple[float, str]:
    """Return factor and unit of a group of a `views` document."""
    columns, names = (list(map(str, group[key])) for key in ("columns", "names"))
    factor, unit = readable(str(group["unit"]), columns, names)
    return factor, printed_unit(unit)


def titled(name: str, role: str, titles: Mapping[str, str]) -> str:
    """Return the name of a line with the title of its model.

    >>> titled("X symmetric_quadratic", "symmetric_quadratic", {"symmetric_quadratic": "Quadratic"})
    'X Quadratic'
    """
    return name.replace(role, titles[role]) if is_model(role) and role in titles else name
