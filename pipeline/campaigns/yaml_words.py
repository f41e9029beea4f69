"""What is wrong with text that is no YAML, in words: cause, line and remedy."""

from __future__ import annotations

import re

SECOND_COLON = re.compile(r"^\s*(- )?[\w.-]+:\s+[^'\"#{\[].*:\s")
NO_SPACE = re.compile(r"^\s*(- )?[\w.-]+:[^\s'\"/\\]")
ENTRY = re.compile(r"^\s*(- )?[\w.-]+:\s+\S")


def indent(line: str) -> int:
    """Return by how many spaces a line is indented."""
    return len(line) - len(line.lstrip(" "))


def yaml_fault(text: str, row: int, problem: str) -> tuple[int, str, str]:
    """Return the row (from 1) of a fault that the parser met at `row`, cause, remedy.

    The parser names the place where it gave up, which for a wrong indentation or a
    missing space is often the line behind.
    """
    lines = text.splitlines() or [""]
    row = min(max(row, 1), len(lines))
    if "escape" in problem or "Unicode" in problem:
        return row, problem, "Write the character itself, or put the text in single quotes."
    tab = next((n for n, line in enumerate(lines, 1) if re.match(r" *\t", line)), None)
    if tab is not None and tab <= row:
        return tab, "a tab indents the line", "Indent with spaces; YAML takes no tabs."
    line, before = lines[row - 1], _before(lines, row)
    for number in (row, before):
        if (
            number is not None
            and NO_SPACE.match(lines[number - 1])
            and "{" not in lines[number - 1]
        ):
            return number, "no space behind the colon", "Write 'key: value', with a space."
    if SECOND_COLON.match(line):
        return row, "a second colon in the value", 'Put the value in quotes: key: "a: b".'
    opened = _open_bracket(lines[:row])
    if opened is not None:
        sign, number = opened
        return number, f"the {sign!r} of this line is not closed", "Close it, or take it away."
    if (
        before is not None
        and indent(line) > indent(lines[before - 1])
        and ENTRY.match(lines[before - 1])
    ):
        return (
            row,
            f"the line is indented by {indent(line)} spaces, below a line by"
            f" {indent(lines[before - 1])} that has its value already",
            "Indent the entries of one mapping or list alike.",
        )
    levels = sorted({indent(item) for item in lines[: row - 1] if item.strip()})
    if levels and indent(line) not in levels:
        return (
            row,
            f"the line is indented by {indent(line)} spaces; lines above it by"
            f" {', '.join(map(str, levels))}",
            "Indent the entries of one mapping or list alike.",
        )
    return row, f"the parser says: {problem}", "Look at indentation, brackets and quotes before it."


def _before(lines: list[str], row: int) -> int | None:
    """Return the row of the line before that holds something; None without one."""
    for number in range(row - 1, 0, -1):
        if lines[number - 1].strip() and not lines[number - 1].lstrip().startswith("#"):
            return number
    return None


def _open_bracket(lines: list[str]) -> tuple[str, int] | None:
    """Return the last bracket or quote that is opened and not closed, with its row."""
    opened: list[tuple[str, int]] = []
    pairs = {"}": "{", "]": "["}
    quote: tuple[str, int] | None = None
    for number, line in enumerate(lines, 1):
        for place, sign in enumerate(line):
            if quote is not None:
                quote = None if sign == quote[0] else quote
            elif sign == "#" and (place == 0 or line[place - 1] == " "):
                break
            elif sign in "'\"" and (place == 0 or line[place - 1] in " [{,"):
                quote = (sign, number)
            elif sign in "{[":
                opened.append((sign, number))
            elif sign in pairs and opened and opened[-1][0] == pairs[sign]:
                opened.pop()
    return quote or (opened[-1] if opened else None)
