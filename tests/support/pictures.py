"""What a picture shows: its size in pixels, how many colours, how many bytes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from PIL import Image


@dataclass(frozen=True)
class Look:
    """Width and height in pixels, number of colours, size of the file."""

    size: tuple[int, int]
    colours: int
    bytes: int


def look(file: Path) -> Look:
    """Look at a picture file."""
    with Image.open(file) as image:
        shown = image.convert("RGB")
        return Look(shown.size, len(shown.getcolors(1 << 24) or ()), file.stat().st_size)
