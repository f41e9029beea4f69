"""The terminal: tables, paths, and texts from logs and files made harmless."""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import RenderableType

ESCAPES = re.compile(r"\x1b\[[0-?]*[ -/]*[@-~]|\x1b\][^\x07\x1b]*(?:\x07|\x1b\\)|\x1b.")
CONTROLS = re.compile("[\x00-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069]")
NUMBER = re.compile(r"[-+±<>]?\s?[\d.]+(e[-+]?\d+)?( ± \S+)?( %)?|nan|-|")
PIPE_WIDTH = 4000
"""Columns where standard output is no terminal: wide enough that nothing wraps."""


def plain(text: object) -> str:
    """Return a text without escapes, control characters and marks of direction."""
    return CONTROLS.sub(" ", ESCAPES.sub("", str(text)))


def plain_lines(text: object) -> str:
    """Return the same, line by line."""
    return "\n".join(plain(line) for line in str(text).split("\n"))


def show(*parts: RenderableType) -> None:
    """Print texts and tables of rich; as wide as the text where output is a pipe."""
    from rich.console import Console

    width = None if sys.stdout.isatty() else PIPE_WIDTH
    output = Console(highlight=False, markup=False, emoji=False, width=width)
    with output.capture() as captured:
        for part in parts:
            output.print(part)
    print("\n".join(line.rstrip() for line in captured.get().splitlines()))


def table(
    columns: Sequence[str], rows: Sequence[Sequence[object]], *, title: str = "", indent: int = 0
) -> None:
    """Print rows under the names of their columns; None is printed as "-".

    Columns of numbers are aligned right. On a terminal that is too narrow, cells fold;
    nothing is cut. Without rows, nothing is printed.
    """
    from rich.padding import Padding
    from rich.table import Table
    from rich.text import Text

    if not rows:
        return
    cells = [["-" if cell is None else plain(cell) for cell in row] for row in rows]
    grid = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="dim")
    for index, name in enumerate(columns):
        numbers = all(NUMBER.fullmatch(row[index]) for row in cells)
        grid.add_column(Text(name), justify="right" if numbers else "left", overflow="fold")
    for row in cells:
        grid.add_row(*map(Text, row))
    if title:
        show(Padding(Text(plain(title), style="bold"), (0, 0, 0, indent)))
    show(Padding(grid, (0, 0, 0, indent)))


def path_from_here(path: Path) -> str:
    """Return a path relative to the current folder if it lies below, else in full."""
    return str(path.relative_to(Path.cwd())) if path.is_relative_to(Path.cwd()) else str(path)
