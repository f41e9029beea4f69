"""Versions of the packages that shape the numbers."""

from __future__ import annotations

from functools import cache
from importlib import metadata

PACKAGES = ("numpy", "scipy", "pyarrow", "auvid")


@cache
def package_versions() -> dict[str, str]:
    """Return the versions of the packages that shape the numbers."""
    return {name: metadata.version(name) for name in PACKAGES}
