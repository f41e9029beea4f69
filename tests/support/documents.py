"""README and the documents: their fenced blocks, links and headings."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
GENERATED = "Written by `make declarations`"
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
INDENTED = re.compile(r"(?:^ {4}(?:auvid|make|\. |cd |dvc ).*\n(?:^ {4}\S.*\n)*)", re.MULTILINE)
PROMPTED = re.compile(r"^(?:\$ )?(auvid (?!.*\[--).*)$", re.MULTILINE)
"""Commands in blocks of text and of a terminal, without those that show a syntax."""
INLINE = re.compile(r"`((?:auvid|make) [^`]+)`")
LINK = re.compile(r"!?\[[^\]]*(?:\[[^\]]*\][^\]]*)?\]\(([^)\s]+)\)")


@dataclass(frozen=True)
class Command:
    """One line of a shell block, and the document it stands in."""

    document: str
    line: str


@cache
def documents() -> dict[str, str]:
    """Return every document by its path in the repository."""
    paths = [ROOT / "README.md", ROOT / "pipeline/templates/README.md"]
    paths += sorted((ROOT / "docs").rglob("*.md"))
    return {str(path.relative_to(ROOT)): path.read_text(encoding="utf-8") for path in paths}


def blocks(text: str, language: str) -> list[str]:
    """Return the fenced blocks of one language."""
    return [body for name, body in FENCE.findall(text) if name == language]


def commands(document: str) -> Iterator[Command]:
    """Yield the commands of a document's blocks, comments taken off."""
    text = documents()[document]
    without = FENCE.sub("", text)
    shell = blocks(text, "sh") + [
        re.sub("^ {4}", "", block, flags=re.MULTILINE) for block in INDENTED.findall(without)
    ]
    for language in ("text", "console"):
        shell += ["\n".join(PROMPTED.findall(block)) for block in blocks(text, language)]
    for block in shell:
        for line in block.splitlines():
            if line := re.sub(r"(?:^|\s+)#.*$", "", line).strip():
                yield Command(document, line)


def inline_commands(text: str) -> list[str]:
    """Return the commands that are named within sentences."""
    return INLINE.findall(FENCE.sub("", text))


def links(text: str) -> list[str]:
    """Return the targets of links and pictures, code blocks aside."""
    return LINK.findall(re.sub(r"`[^`\n]*`", "", FENCE.sub("", text)))


@cache
def anchors(path: Path) -> frozenset[str]:
    """Return the anchors of a document's headings, as its readers make them."""
    text = FENCE.sub("", path.read_text(encoding="utf-8"))
    counts: dict[str, int] = {}
    names = set()
    for heading in re.findall(r"^#{1,6} +(.+?) *$", text, re.MULTILINE):
        words = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading)
        name = re.sub(r"[^\w\- ]", "", words.lower()).replace(" ", "-")
        number = counts.get(name, 0)
        counts[name] = number + 1
        names.add(f"{name}-{number}" if number else name)
    return frozenset(names)


def own_log() -> str:
    """40 s at 10 Hz in the columns, units and frames of the map of docs/howto/own_csv.md."""
    t = np.arange(400) / 10.0
    yaw = 20.0 * np.sin(0.3 * t)
    columns = {
        "t": 1000.0 * t,
        "roll": 0.8 * np.sin(0.5 * t),
        "pitch": 0.6 * np.cos(0.4 * t),
        "heading": yaw,
        "p": 0.4 * np.cos(0.5 * t),
        "q": -0.24 * np.sin(0.4 * t),
        "r": 6.0 * np.cos(0.3 * t),
        "pressure_depth": 5.0 + 0.1 * np.sin(0.2 * t),
        "forward": 0.5 + 0.2 * np.sin(0.4 * t),
        "left": 0.05 * np.cos(0.4 * t),
        "up": -0.02 * np.cos(0.2 * t),
        "m1": 1600.0 + 50.0 * np.sin(0.4 * t),
        "battery": 16.0 + 0.0 * t,
    }
    rows = [
        ",".join(f"{value:.4f}" for value in row) for row in np.column_stack(list(columns.values()))
    ]
    rows[100] = rows[100].rpartition(",")[0] + ",n/a"
    return "\n".join([",".join(columns), *rows]) + "\n"
