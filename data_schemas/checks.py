"""The catalogue of findings of the health page, and its page in the documentation.

The catalogue itself is formats/checks.yaml.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources
from textwrap import fill
from types import MappingProxyType
from typing import Any

import yaml

SEVERITIES = ("error", "warning", "note")
INTRODUCTION = """# What `auvid check` finds

Every finding of the health page: what it means, the threshold beyond which it is
reported and why it lies there, and what to do about it. An *error* means that the chain
would refuse the log or use wrong data, a *warning* that results depend on it, a *note*
is good to know. `auvid check` exits with 0 if it found no error and no loss, with 3 if
it did, and with 1 if a log could not be read at all.

This page is made from `data_schemas/formats/checks.yaml`:
`python -m auvid.data_schemas.checks > docs/checks.md`.
"""


@dataclass(frozen=True)
class HealthCheck:
    """One kind of finding. `threshold` is None where it is a matter of yes or no."""

    id: str
    severity: str
    title: str
    threshold: float | None
    unit: str
    means: str
    reason: str
    remedy: str

    @property
    def limit(self) -> float:
        """The threshold of a check that has one."""
        assert self.threshold is not None
        return self.threshold


@cache
def checks() -> Mapping[str, HealthCheck]:
    """All checks by id, in the order of the catalogue."""
    text = (resources.files(__package__) / "formats" / "checks.yaml").read_text(encoding="utf-8")
    raw: dict[str, dict[str, Any]] = yaml.safe_load(text)
    return MappingProxyType({name: HealthCheck(id=name, **entry) for name, entry in raw.items()})


def documentation() -> str:
    """docs/checks.md: one section per finding, the severe ones first."""
    parts = [INTRODUCTION]
    for severity in SEVERITIES:
        parts.append(f"\n## {severity.capitalize()}s\n")
        for check in checks().values():
            if check.severity == severity:
                limit = (
                    ""
                    if check.threshold is None
                    else f"Threshold: {check.threshold:g}{_unit(check.unit)}. "
                )
                parts.append(f"\n### `{check.id}`: {check.title}\n")
                for words in (check.means, limit + check.reason, f"*Remedy:* {check.remedy}"):
                    parts.append(f"\n{fill(words, 88, break_on_hyphens=False)}\n")
    return "".join(parts)


def _unit(unit: str) -> str:
    return "" if unit in ("", "1") else f" {unit}"


if __name__ == "__main__":
    print(documentation(), end="")
