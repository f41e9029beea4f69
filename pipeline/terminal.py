"""Texts for the terminal: what comes from logs and files cannot act on it."""

from __future__ import annotations

import re

ESCAPES = re.compile(r"\x1b\[[0-?]*[ -/]*[@-~]|\x1b\][^\x07\x1b]*(?:\x07|\x1b\\)|\x1b.")
CONTROLS = re.compile("[\x00-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069]")


def plain(text: object) -> str:
    """A text without terminal escapes, control characters and marks that turn the
    direction of writing.
    """
    return CONTROLS.sub(" ", ESCAPES.sub("", str(text)))


def plain_lines(text: object) -> str:
    """The same, line by line."""
    return "\n".join(plain(line) for line in str(text).split("\n"))
