"""Seeded damage for binary logs of any format, with a map of what stayed whole.

`mutations(data, seed)` returns the damaged bytes and the source ranges that were copied
without change, with the place they moved to. A record of the source whose bytes lie in
one kept range is still in the damaged file, byte for byte, at `Kept.moved(offset)`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

HOSTILE = (
    b"\x00",
    b"\x01",
    b"\x02",
    b"\xff",
    b"\x7f",
    b"\xff\xff",
    b"\x00\x00",
    b"\xff\xff\xff\x7f",
    b"\xff\xff\xff\xff",
    b"\x00" * 8,
)


class Kept(NamedTuple):
    """Source bytes `start:stop` that stand unchanged at `offset` in the damaged file."""

    start: int
    stop: int
    offset: int

    def moved(self, source: int) -> int:
        return source - self.start + self.offset


class Edit(NamedTuple):
    """Source bytes `start:stop` become `new`."""

    start: int
    stop: int
    new: bytes


def _flips(data: bytes, at: int, rng: np.random.Generator) -> Edit:
    return Edit(at, at + 1, bytes([data[at] ^ (1 << int(rng.integers(8)))]))


def _overwrite(data: bytes, at: int, rng: np.random.Generator) -> Edit:
    stop = min(len(data), at + int(rng.integers(1, 700)))
    return Edit(at, stop, rng.bytes(stop - at))


def _removal(data: bytes, at: int, rng: np.random.Generator) -> Edit:
    return Edit(at, min(len(data), at + int(rng.integers(1, 500))), b"")


def _zeros(data: bytes, at: int, rng: np.random.Generator) -> Edit:
    stop = min(len(data), at + int(rng.integers(1, 1500)))
    return Edit(at, stop, bytes(stop - at))


def _repeat(data: bytes, at: int, rng: np.random.Generator) -> Edit:
    return Edit(at, at, data[max(0, at - int(rng.integers(1, 400))) : at])


def _splice(data: bytes, at: int, rng: np.random.Generator) -> Edit:
    source = int(rng.integers(len(data)))
    return Edit(at, at, data[source : source + int(rng.integers(1, 600))])


def _hostile(data: bytes, at: int, rng: np.random.Generator) -> Edit:
    value = HOSTILE[int(rng.integers(len(HOSTILE)))]
    stop = min(len(data), at + len(value))
    return Edit(at, stop, value[: stop - at])


KINDS: dict[str, Callable[[bytes, int, np.random.Generator], Edit]] = {
    "flips": _flips,
    "overwrite": _overwrite,
    "removal": _removal,
    "zeros": _zeros,
    "repeat": _repeat,
    "splice": _splice,
    "hostile": _hostile,
}


def mutations(
    data: bytes, seed: int, kinds: Sequence[str] = tuple(KINDS), protect: int = 0
) -> tuple[bytes, list[Kept]]:
    """Damage `data` in one to a dozen places (up to forty flips), the same way for the
    same seed.

    Args:
        data: the whole file, at least two bytes longer than `protect`. seed: chooses
        kinds, places and values. kinds: names of `KINDS` to draw from; an edit of each
        drawn kind may occur several times. One file in ten is truncated too. protect:
        leading bytes that no edit starts in.

    Returns:
        The damaged bytes, and the source ranges left whole, in ascending order of both
        source and new offset.
    """
    rng = np.random.default_rng(seed)
    edits: list[Edit] = []
    for name in rng.choice(list(kinds), size=int(rng.integers(1, 4))):
        places = int(rng.integers(1, 41 if name in ("flips", "hostile") else 5))
        edits += [
            KINDS[str(name)](data, int(at), rng)
            for at in rng.integers(protect, len(data), size=places)
        ]
    if rng.random() < 0.1:
        at = int(rng.integers(protect + 1, len(data)))
        edits.append(Edit(at, len(data), b""))
    return apply_edits(data, edits)


def apply_edits(data: bytes, edits: Sequence[Edit]) -> tuple[bytes, list[Kept]]:
    """Apply edits in order of place; one that overlaps an earlier one is left out."""
    out: list[bytes] = []
    kept: list[Kept] = []
    position = size = 0
    for edit in sorted(edits):
        if edit.start < position:
            continue
        if edit.start > position:
            kept.append(Kept(position, edit.start, size))
        out += [data[position : edit.start], edit.new]
        size += edit.start - position + len(edit.new)
        position = edit.stop
    if position < len(data):
        kept.append(Kept(position, len(data), size))
        out.append(data[position:])
    return b"".join(out), kept
