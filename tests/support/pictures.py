"""What a picture shows: its size in pixels, how many colours, how many bytes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from PIL import Image

from auvid.pipeline.commands.look.inspect import rerun_viewer as viewer

PICTURES = Path(__file__).parents[2] / "build" / "screenshots"


@dataclass(frozen=True)
class Look:
    """Width and height in pixels, number of colours, size of the file."""

    size: tuple[int, int]
    colours: int
    bytes: int


def look(file: Path) -> Look:
    """Look at a picture file."""
    with Image.open(file) as image:
        pixels = image.convert("RGB")
        return Look(pixels.size, len(pixels.getcolors(1 << 24) or ()), file.stat().st_size)


def assert_pictured(recording: Path, name: str) -> None:
    """Take a picture of how a run's recording opens, keep it as
    `build/screenshots/inspect_<name>.png`, and look whether it shows anything.

    Without the programs for pictures nothing is checked: `test_inspect.py` says so in
    the line of its skipped test.
    """
    if viewer.missing_for_pictures() is not None:
        return
    PICTURES.mkdir(parents=True, exist_ok=True)
    file = PICTURES / f"inspect_{name}.png"
    file.write_bytes(viewer.picture(recording, size=(800, 500)))
    picture = look(file)
    assert picture.size == (800, 500)
    assert picture.colours > 30, "an empty viewer has a handful of greys"
