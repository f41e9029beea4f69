"""Add a line to CHANGELOG.md, what is unreleased, by the others of its stage."""

from __future__ import annotations

import re
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

from auvid.data_schemas.errors import PipelineError
from auvid.pipeline.store.atomic_files import readable

FILE = "CHANGELOG.md"
UNRELEASED = "## Unreleased"
HEADING = re.compile(r"##\s+\[?v?(?P<version>\d[^\s\]]*)\]?(\s.*)?")


def current_version() -> str:
    """Return the version of auvid that runs."""
    return version("auvid")


def with_entry(path: Path, stage: str, words: str) -> bytes:
    """Return the changelog with the line `- stage: words`.

    Under `UNRELEASED` where it has that, else under the current version. Raises
    `PipelineError` where it has no heading for either.
    """
    with readable(path, file=path, what="changelog"):
        text = path.read_bytes().decode("utf-8", errors="surrogateescape")
    lines = text.splitlines()
    start, end = _section(lines, path)
    while end > start and not lines[end - 1].strip():
        end -= 1
    own = [place for place in range(start, end) if lines[place].startswith(f"- {stage}:")]
    place = _end_of_entry(lines, own[-1], end) if own else end
    blank = [""] if place == start else []
    lines[place:place] = [*blank, f"- {stage}: {words}"]
    return ("\n".join(lines) + "\n").encode("utf-8", errors="surrogateescape")


def _section(lines: Sequence[str], path: Path) -> tuple[int, int]:
    """Return the lines of the section for what is new, without its heading."""
    headings = {
        place: match["version"]
        for place, line in enumerate(lines)
        if (match := HEADING.fullmatch(line.rstrip()))
    }
    number = current_version()
    starts = [place for place, line in enumerate(lines) if line.rstrip() == UNRELEASED]
    starts += [place for place, in_heading in headings.items() if in_heading == number]
    if not starts:
        raise PipelineError(
            f"no heading for version {number}",
            file=path,
            allowed=list(headings.values()) or None,
            remedy=f"Write a line '## {number}'.",
        )
    after = (
        place for place in range(starts[0] + 1, len(lines)) if re.match(r"##?\s", lines[place])
    )
    return starts[0] + 1, next(after, len(lines))


def _end_of_entry(lines: Sequence[str], first: int, end: int) -> int:
    """Return the place after an entry and the indented lines that continue it."""
    return next((place for place in range(first + 1, end) if not lines[place].startswith(" ")), end)
