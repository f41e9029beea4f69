"""The simulators that models are exported to, each loaded when it is named."""

from __future__ import annotations

from importlib import import_module

from auvid.export.exported import Target

_MODULES = {
    **{name: name for name in ("gazebo", "uuv", "mss", "pvs", "holoocean", "stonefish")},
    **{name: name for name in ("mujoco", "sitl", "python")},
    "json": "json_file",
    "draws": "draws",
}
TARGETS = tuple(_MODULES)
"""Targets by their names on the command line."""


def load_target(name: str) -> Target:
    """Return a target of `TARGETS`; each imports what its own form needs."""
    module = import_module(f"auvid.export.targets.{_MODULES[name]}")
    target: Target = getattr(module, name.upper())
    return target
