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

from auvid.data_schemas.yaml_text import read_yaml

SEVERITIES = ("error", "warning", "note")
INTRODUCTION = """# What `auvid check` finds

Every finding of the health page: what it means, the threshold beyond which it is
reported and why it lies there, and what to do about it. An *error* means that the chain
would refuse the log or use wrong data, a *warning* that results depend on it, a *note*
is good to know.

A finding that *stops a run* means that units, signs, axes or clocks are probably wrong:
`auvid run` goes no further than the decoding of the logs. Who knows better writes
`accept: [FINDING]` into the manifest, for one log or for the campaign; an accepted
finding stays in the report. Of the other warnings those that coefficients follow stand under
the verdict ("But first: ..."): places, turns, scales and lags of sensors that are off.

`auvid run` and `auvid check CAMPAIGN` agree in their exit codes: 1 if a log cannot be
read, a finding stops the run, or the campaign cannot feed its stages. `auvid check`
exits with 3 for losses and errors that stop nothing, as `auvid run --strict` does for
losses, and with 0 otherwise.

Below the findings stands what the log *cannot* show, as `not observable: NAME (why)`:
a wrong figure there passes every check. Scale of the thrust, mass and added mass, weight
in water, a steady current, turn and scale of the velocity log, clocks: each is listed
unless something in the log shows it.

This page is made from `data_schemas/formats/checks.yaml`:
`python -m auvid.data_schemas.checks > docs/checks.md`.
"""

SUMMARY = """
## All findings

| finding | severity | stops a run |
|---|---|---|
"""
MISTAKES = """
## Mistakes and what finds them

Each of these is made by a test, in a small healthy log or its column map; *refused*
means that the log is not read, with file, row and field. All whose finding says above that
it *stops a run* stop it before anything is fitted; the others stand on the first screen.

| mistake | found as |
|---|---|
"""
TRIED = """
## Damage and faults that were tried

Two campaigns of `make fuzz` on 28 November 2026: every 29th case of each kind, to its end
(`python -m tests.faults.fuzz --every 29`, commit 0b4ce088, all 5,902 cases), and every
fifth, stopped after an even sample of each (`--every 5`, commit 6bf44de7, 10,151 of 34,142
cases); the table has both, in this order, or one figure where they agree. Nothing crashed,
hung, was invented or had a wrong value.

| class | tried | failed | refused | recovered, mean % | worst % |
|---|---|---|---|---|---|
| one bit of DataFlash | 1,084; 788 | 0 | 0 | 100 | 100 |
| one bit of telemetry | 1,020; 789 | 0 | 0 | 100 | 100 |
| one bit of ULog | 1,288; 985 | 0 | 0 | 100 | 100 |
| DataFlash cut | 136; 197 | 0 | 4; 5 | 100; 99.9879 | 100; 97.7 (a) |
| telemetry cut | 128; 185 | 0 | 1; 1 | 100 | 100 |
| ULog cut | 161; 187 | 0 | 1; 1 | 100 | 100 |
| DataFlash, overwritten, removed, doubled, mixed | 417; 1,404 | 0 | 0 | 99.9994; 99.9998 | 99.7 |
| DataFlash as text, the same | 417; 1,404 | 0 | 0; 2 | 100 | 100 |
| telemetry, the same | 417; 1,404 | 0 | 0 | 99.9995; 99.9998 | 99.8 |
| ULog, the same | 417; 1,404 | 0 | 0 | 99.9918; 99.9901 | 99.1; 92.9 (a) |
| CSV, the same | 417; 1,404 | 0 | 150; 438 (b) | 100 | 100 |

Peak memory on damaged logs of .9 to 2.4 MB, in logs: DataFlash 3.3, its text 2.3, telemetry
3.2, ULog 2.7, CSV 4.9 (allowed 10; commit 0b4ce088).

(a) No more than two records are lost. (b) Cells that are no numbers, or another number of
columns: row, column and value are named.

Earlier campaigns tried more. Of every seventh case (24,395) none failed, and a bit in a
definition, or in its number, cost three records, up to 4.4 % of a short log. Of 96,965
cases before it, a campaign that was stopped, three failed: a bit of the type's number in a
definition or a record of an instance of equal size, which ULog and DataFlash have no
checksum for (2), and two halves of telemetry messages whose checksum of 16 bits fits by
chance; pymavlink reads them too.

Faults of files are of an earlier campaign (`python -m tests.faults.disk_faults`, toy
stages, every fault at each of 362 operations); what was tried again, and faults that no
list had: [0123](decisions/0123-faults-tried-again.md).

| class | tried | failed |
|---|---|---|
| process killed at a file operation | 362 | 0 |
| killed with half of it written | 362 | 0 |
| ENOSPC once, and for good | 724 | 0 |
| EIO | 362 | 0 |
| EACCES | 362 | 0 |
| EDQUOT | 362 | 0 |
| one bit of an artefact, read by seven commands and Python | 464 | 0 |
| two thrusters exchanged, or one reversed, on the real dive | 36 | 20 (c) |
| wiring right: synthetic dives (dead, uneven thrusters, tether), the real dive | 1,321 | 2 (d) |

(c) The fault is the best explanation each time, but in 20 below the limit that names it,
which synthetic dives wired rightly set; of all 126 s it is the best in 34 and named in 13.
(d) A fault is named that is not there: 1 of 60 with a tether force of 10 N / 0.5 s that
feedback answers, 1 of 60 with 40 N / 4 s; none with less than 40 N that changes slowly.
"""


@dataclass(frozen=True)
class HealthCheck:
    """One kind of finding. `threshold` is None where it is a matter of yes or no.

    `stops`: a run stops at it unless the manifest accepts it. `misleads`: coefficients
    follow the mistake, so it stands in the first lines of the answer.
    """

    id: str
    severity: str
    title: str
    threshold: float | None
    unit: str
    means: str
    reason: str
    remedy: str
    stops: bool = False
    misleads: bool = False

    @property
    def limit(self) -> float:
        """Return the threshold of a check that has one."""
        assert self.threshold is not None
        return self.threshold


@cache
def checks() -> Mapping[str, HealthCheck]:
    """Return all checks by id, in the order of the catalogue."""
    text = (resources.files(__package__) / "formats" / "checks.yaml").read_text(encoding="utf-8")
    raw: dict[str, dict[str, Any]] = read_yaml(text)
    return MappingProxyType({name: HealthCheck(id=name, **entry) for name, entry in raw.items()})


def accepted_findings(manifest: Mapping[str, Any], log: str) -> frozenset[str]:
    """Return the findings of a log that a manifest accepts, for it or all logs."""
    entry: Mapping[str, Any] = next(
        (item for item in manifest.get("logs", ()) if item["id"] == log), {}
    )
    return frozenset([*(manifest.get("accept") or ()), *(entry.get("accept") or ())])


def standing_findings(
    document: Mapping[str, Any], accepted: frozenset[str]
) -> list[Mapping[str, Any]]:
    """Return the findings of a `health` document, and what an accepted one explains.

    Who accepts a finding says that its mistake was not made, so what it explained has
    another cause.
    """
    others = [item for item in document.get("explained", ()) if item["by"] in accepted]
    return [*document["findings"], *others]


FORCE_MODEL_NEEDS = ("no_velocity", "no_depth", "no_actuators", "not_excited")
"""Findings on what a force model needs and a bench recording does not.

The stages of a bench name what they miss.
"""


@dataclass(frozen=True)
class LogFinding:
    """A finding of a log, which stands for `others` more logs that have it too."""

    log: str
    check: str
    text: str
    accepted: bool
    others: int

    @property
    def whose(self) -> str:
        """Return the log, and how many others have it too."""
        more = f" and {self.others} other{'s' * (self.others > 1)}" if self.others else ""
        return f"log '{self.log}'{more}"

    def __str__(self) -> str:
        return f"{self.whose}: {self.text} ({self.check}{', accepted' if self.accepted else ''})"


def log_findings(
    manifest: Mapping[str, Any], health: Mapping[str, Mapping[str, Any]]
) -> tuple[LogFinding, ...]:
    """Return errors, warnings and what stops a run; `health` by log.

    The first log stands for others with the same finding.
    """
    passed_over = FORCE_MODEL_NEEDS if str(manifest["kind"]).startswith("bench") else ()
    first: dict[tuple[str, bool, str], tuple[str, str]] = {}
    logs: dict[tuple[str, bool, str], list[str]] = {}
    for log, document in health.items():
        accepted = accepted_findings(manifest, log)
        for item in standing_findings(document, accepted):
            name = item["id"]
            if name in passed_over or (item["severity"] == "note" and not checks()[name].stops):
                continue
            key = (name, name in accepted, str(item["stream"]))
            first.setdefault(key, (log, item["text"]))
            if log not in logs.setdefault(key, []):
                logs[key].append(log)
    return tuple(
        LogFinding(log, key[0], text, key[1], len(logs[key]) - 1)
        for key, (log, text) in first.items()
    )


@cache
def mistakes() -> Mapping[str, str]:
    """Mistakes that tests make in column maps and logs: what stops or names each."""
    folder = resources.files(__package__) / "formats"
    raw: dict[str, str] = read_yaml((folder / "mistakes.yaml").read_text(encoding="utf-8"))
    return MappingProxyType(raw)


def documentation() -> str:
    """docs/checks.md: one section per finding, the severe ones first."""
    parts = [INTRODUCTION, SUMMARY]
    by_severity = sorted(checks().values(), key=lambda check: SEVERITIES.index(check.severity))
    parts += [
        f"| `{check.id}` | {check.severity} | {'yes' if check.stops else ''} |\n"
        for check in by_severity
    ]
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
                stops = "*Stops a run.* " if check.stops else ""
                for words in (
                    stops + check.means,
                    limit + check.reason,
                    f"*Remedy:* {check.remedy}",
                ):
                    parts.append(f"\n{fill(words, 88, break_on_hyphens=False)}\n")
    parts.append(MISTAKES)
    parts += [
        f"| {mistake} | {name if name == 'refused' else f'`{name}`'} |\n"
        for mistake, name in mistakes().items()
    ]
    return "".join([*parts, TRIED])


def _unit(unit: str) -> str:
    return "" if unit in ("", "1") else f" {unit}"


if __name__ == "__main__":
    print(documentation(), end="")
