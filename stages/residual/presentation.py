"""The report section and recording views of the residual force."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from auvid.hydro.arrays import AXES, Array
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.stages.columns import AXIS_UNITS, force_columns, rms
from auvid.stages.presentation import panel, plot, remark, section, series, table, view


def residual_section(
    segment: str,
    t: Array,
    components: Mapping[str, Array],
    direction_note: str,
    warning: str,
) -> dict[str, Any]:
    """Return the section: notes, the components over time t (n,) and their RMS."""
    panels = [
        panel(
            axis,
            AXIS_UNITS[axis],
            [series(_title(name), t, force[:, index], name) for name, force in components.items()],
        )
        for index, axis in enumerate(AXES)
    ]
    rows = [
        [_title(name), *(rms(force[:, index]) for index in range(6))]
        for name, force in components.items()
    ]
    blocks = [
        *([remark(direction_note)] if direction_note else []),
        *([remark(warning, "warning")] if warning else []),
        plot(
            "Components of the residual force",
            panels,
            group="time",
            look_for=(
                "tau_bar is what the other components leave over. Where one of them dominates, its"
                " errors do too."
            ),
        ),
        table("RMS of each component", ["component", *AXIS_UNITS.items()], rows),
    ]
    return section(f"Residual force of {segment}", blocks, order=40)


def voltage_note(vehicle: Vehicle, bare: float) -> str:
    """Return what a battery voltage missing in a share `bare` means for the thrust."""
    if vehicle.thrusters is None or vehicle.thrusters.curve.voltage_exponent == 0.0 or bare == 0.0:
        return ""
    if bare == 1.0:
        return (
            f"No battery voltage: thrust is taken at {vehicle.thrusters.curve.voltage_v:g} V, the"
            " voltage of the thrust curve."
        )
    return (
        f"The battery voltage is missing in {100.0 * bare:.1f} % of the segment; the nearest"
        " measured one is used."
    )


def residual_views(components: Iterable[str]) -> dict[str, Any]:
    """Return the residual force beside the models, and its components in a tab."""
    names = list(components)
    groups = []
    for index, axis in enumerate(AXES):
        groups += [
            view(
                f"residual/{axis}",
                "residual",
                [force_columns("tau_bar")[index]],
                ["measured"],
                tab="Answer",
                names=[f"{axis} measured"],
            ),
            view(
                f"components/{axis}",
                "residual",
                [force_columns(name)[index] for name in names],
                names,
                tab="Components",
                names=[f"{axis} {_title(name)}" for name in names],
            ),
        ]
    return {"groups": groups}


def _title(component: str) -> str:
    return component if component == "tau_bar" else component.replace("_", " ")
