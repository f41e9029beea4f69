"""The Rerun viewer as a program: in a window, for a browser, or for a picture."""

from __future__ import annotations

import io
import os
import shutil
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from auvid.data_schemas.errors import PipelineError

INSTALL = "Install it with: pip install 'auvid[view]', or pip install rerun-sdk pillow."
PACKAGES = ("xvfb", "xauth", "mesa-vulkan-drivers")
TIMEOUTS_S = (180.0, 360.0, 600.0)
"""Of the tries to take a picture: a slow or busy machine gets more time each time."""
QUIET = {"RUST_LOG": "error"}
"""Else the viewer's warnings (of containers, of drawing in software) lie over the
picture for some seconds.
"""
STARTS_WITHIN_S = 2.0
ELSEWHERE = (
    "Look at it in a browser with --web, keep it with --save FILE.rrd, or take a picture with"
    " --screenshot FILE.png."
)
WINDOW = (1600, 1000)
COLOURS, STEP = 256, 8
LEAST_DRAWN = 0.01
LEAST_BYTES = 15_000
"""A picture of the viewer that opened nothing has 11 kB, one with a page of text 40 kB
and more.
"""


def require_rerun() -> None:
    """Raise `PipelineError` where the package that draws is not installed."""
    if find_spec("rerun") is None:
        raise PipelineError("rerun-sdk is not installed", remedy=INSTALL)


def program() -> Path:
    """Return the Rerun viewer. Raises `PipelineError` where it is not installed."""
    own = Path(sys.executable).with_name("rerun")
    path = own if own.is_file() else shutil.which("rerun")
    if path is None:
        remedy = f"{INSTALL} Or keep the recording with --save FILE.rrd and open it elsewhere."
        raise PipelineError("the Rerun viewer is not installed", remedy=remedy)
    return Path(path)


def require_display(name: str) -> None:
    """Raise `PipelineError` where a window to show `name` in cannot be opened."""
    if sys.platform.startswith("linux") and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    ):
        raise PipelineError(
            "there is no display to open the viewer on", value=name, remedy=ELSEWHERE
        )


def _environment() -> dict[str, str]:
    """Return that of a viewer, which keeps freed memory for its next picture."""
    return {name: value for name, value in os.environ.items() if name != "MIMALLOC_PURGE_DELAY"}


def show(recording: Path) -> None:
    """Open a recording in a window, which stays when this program ends.

    Raises `PipelineError` without a display, and where the viewer ends at once.
    """
    require_display(str(recording))
    with tempfile.TemporaryFile() as output:
        process = subprocess.Popen(
            [str(program()), str(recording)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=output,
            start_new_session=True,
            env=_environment(),
        )
        try:
            status = process.wait(timeout=STARTS_WITHIN_S)
        except subprocess.TimeoutExpired:
            return
        if status:
            output.seek(0)
            lines = output.read().decode(errors="replace").strip().splitlines()
            words = (lines or ["nothing said"])[-1][:300]
            raise PipelineError("the viewer opened no window", value=words, remedy=ELSEWHERE)


def serve(recording: Path) -> None:
    """Serve the viewer with a recording to browsers here, until interrupted."""
    try:
        subprocess.run(
            [
                str(program()),
                str(recording),
                "--web-viewer",
                "--bind",
                "127.0.0.1",
                "--port",
                "auto",
            ],
            check=False,
            env=_environment(),
        )
    except KeyboardInterrupt:
        return


def missing_for_pictures() -> str | None:
    """Return what this machine lacks for pictures, with the remedy, or None."""
    lacking = [name for name in ("xvfb-run", "xauth") if shutil.which(name) is None]
    if not lacking:
        return None
    return f"pictures need {' and '.join(lacking)}: apt-get install {' '.join(PACKAGES)}"


def picture(recording: Path, *, size: tuple[int, int] = WINDOW) -> bytes:
    """Return a PNG of how a recording opens, of `size` pixels with few colours.

    Raises `PipelineError` where programs are missing, the viewer fails, or the
    recording is from a version that it cannot read.
    """
    lacking = missing_for_pictures()
    if lacking is not None:
        raise PipelineError(
            "no picture can be taken",
            value=str(recording),
            remedy=f"{lacking}; or keep the recording with --save FILE.rrd.",
        )
    verify(recording)
    target = recording.with_name(f".{recording.stem}.{os.getpid()}.png")
    size_words = f"{size[0]}x{size[1]}"
    # the pointer rests in the middle of the screen: outside the window, which has two
    # pixels a point
    screen = f"-screen 0 {4 * size[0] + 400}x{4 * size[1] + 400}x24"
    command = ["xvfb-run", "-a", "-s", screen, str(program()), str(recording)]
    command += [
        "--screenshot-to",
        str(target),
        "--window-size",
        size_words,
        "--port",
        "auto",
        "--bind",
        "127.0.0.1",
    ]
    try:
        for timeout in TIMEOUTS_S:
            target.unlink(missing_ok=True)
            try:
                return _taken(command, target, size, timeout)
            except ViewerFault as fault:
                last = fault
        raise PipelineError(last.message, value=last.value, remedy=last.remedy) from None
    finally:
        target.unlink(missing_ok=True)


class ViewerFault(Exception):
    """A picture that was not taken, or shows nothing; another try may do better."""

    def __init__(self, message: str, value: str, remedy: str) -> None:
        super().__init__(message)
        self.message, self.value, self.remedy = message, value, remedy


def _taken(command: list[str], target: Path, size: tuple[int, int], timeout: float) -> bytes:
    """Return a picture that shows something. Raises `ViewerFault` without one."""
    try:
        done = subprocess.run(
            command,
            capture_output=True,
            text=True,
            timeout=timeout,
            check=False,
            env=_environment() | QUIET,
        )
    except subprocess.TimeoutExpired:
        raise ViewerFault(
            "the viewer took too long",
            f"{timeout:g} s in the last of {len(TIMEOUTS_S)} tries",
            "Draw less: --save FILE.rrd, and open it on a machine with a graphics card.",
        ) from None
    if not target.is_file():
        words = (done.stderr.strip().splitlines() or ["nothing said"])[-1][:300]
        raise ViewerFault(
            "the viewer took no picture",
            words,
            f"It draws with Vulkan: apt-get install {PACKAGES[-1]}.",
        )
    drawn = _small(target.read_bytes(), size)
    if len(drawn) < LEAST_BYTES or drawn_share(drawn) < LEAST_DRAWN:
        raise ViewerFault(
            "the viewer took a picture without the recording in it",
            f"{len(drawn)} bytes, {100 * drawn_share(drawn):.2g} % of it drawn",
            "Too many plots, or a recording of another version: keep it with --save FILE.rrd"
            " and look at it in the viewer.",
        )
    return drawn


def drawn_share(content: bytes) -> float:
    """Return the share of a picture between its bars that is not its commonest grey."""
    from PIL import Image

    with Image.open(io.BytesIO(content)) as image:
        inner = np.asarray(image.convert("L"))[image.height // 12 : -image.height // 12]
    return 1.0 - float(np.bincount(inner.ravel()).max()) / inner.size


def verify(recording: Path) -> None:
    """Raise `PipelineError` for a file that this version of Rerun cannot read."""
    done = subprocess.run(
        [str(program()), "rrd", "verify", str(recording)],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode or not recording.stat().st_size:
        words = (done.stderr.strip().splitlines() or ["nothing said"])[-1][:300]
        remedy = (
            "It may be from another version of Rerun, or cut off: make it again with auvid report"
            " CAMPAIGN --rebuild."
        )
        raise PipelineError(
            "the recording cannot be read", file=recording, value=words, remedy=remedy
        )


def _small(content: bytes, size: tuple[int, int]) -> bytes:
    """Return the picture scaled to `size`, in its own most frequent colours.

    Thin lines keep their colours, which a palette by area would grey.
    """
    from PIL import Image

    with Image.open(io.BytesIO(content)) as image:
        scaled = image.convert("RGB").resize(size, Image.Resampling.LANCZOS)
    coarse = np.minimum((np.asarray(scaled, dtype=np.int64) + STEP // 2) // STEP * STEP, 255)
    codes, counts = np.unique(coarse @ np.array([1 << 16, 1 << 8, 1]), return_counts=True)
    kept = codes[np.argsort(-counts, kind="stable")[:COLOURS]]
    palette = Image.new("P", (1, 1))
    palette.putpalette(
        [int(part) for code in kept for part in (code >> 16, code >> 8 & 255, code & 255)]
    )
    sink = io.BytesIO()
    scaled.quantize(palette=palette, dither=Image.Dither.NONE).save(sink, "PNG", optimize=True)
    return sink.getvalue()
