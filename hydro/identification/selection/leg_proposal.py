"""Legs proposed where a vehicle moves, parted into training and validation.

Everything works on half seconds of a dive, from cumulated sums, so that a log is passed
over once.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from auvid.hydro.arrays import VELOCITIES, Array, Index, Mask, runs_of
from auvid.hydro.identification.regression.excitation import THRESHOLDS
from auvid.hydro.identification.signals.resampling import gaps

STEP_S = 0.5
"""Width of the pieces of a dive; a vehicle answers a command within one to three seconds."""
SHORTEST_LEG_S = 8.0
"""Five seconds that resample needs for a segment, and the ends that filters cut off."""
LONGEST_LEG_S = 1800.0
"""Longer ones are cut, so that one fits into the memory of a small machine."""
NEAR_S = 5.0
"""Motion within this time belongs to a stretch that moves."""
LONGEST_REST_S = 30.0
"""A shorter rest does not part two stretches."""
ONE_WAY_S = 2.0
"""Motion beyond the threshold for so long counts as motion in that direction."""
LEAST_SHARE, BEST_SHARE, MOST_SHARE = 0.2, 0.3, 0.4
"""Shares of the moving time that validation takes."""
MOST_BORDERS = 400
"""Places at which a validation block may begin or end."""
HALF_S = 20.0
"""One training leg alone is cut in two of so much or more: each then judges the other."""
LONGEST_CHANNEL_S = 600.0
"""More of one channel hardly narrows its figures and takes long to fit."""

Use = Literal["training", "validation"]
_Cut = tuple[int, int, Use, int]
"""First and last + 1 of the pieces of a leg among all that move, its use, its stretch."""


@dataclass(frozen=True)
class DivePieces:
    """A dive in pieces of STEP_S from the start of its log.

    `usable` (n,): every sensor is there, armed, in the water, no jump. `driven` (n,):
    actuators act, or are not logged. `mean`, `square` (n, 6): mean and mean square of u v
    w p q r [m/s, rad/s]; nan in the columns that nothing measures.
    """

    usable: Mask
    driven: Mask
    mean: Array
    square: Array

    @property
    def measured(self) -> Mask:
        """Return which of the six velocities (6,) something measures."""
        return np.asarray(np.isfinite(self.square).all(axis=0))


@dataclass(frozen=True)
class ProposedLeg:
    """A leg of dive number `dive`, in seconds of its log.

    `excited` and `both_ways`: axes whose RMS reaches its threshold, and which of them
    move in both directions. `channel`: the one axis that it is for, of a single channel.
    """

    dive: int
    start_s: float
    end_s: float
    use: Use
    excited: tuple[str, ...]
    both_ways: tuple[str, ...]
    channel: str | None = None


@dataclass(frozen=True)
class LegProposal:
    """Proposed legs, the axes that move, and what each part lacks of them in words.

    `dropped_s`: moving time [s] in stretches too short for a leg; 0 of single channels.
    """

    legs: tuple[ProposedLeg, ...]
    axes: tuple[str, ...]
    lacking: Mapping[Use, Mapping[str, str]]
    dropped_s: float = 0.0

    def inside(self, dive: int, t_s: Array) -> Mask:
        """Return which times (n,) [s] of a dive are in one of its legs."""
        own = [leg for leg in self.legs if leg.dive == dive]
        masks = [(t_s >= leg.start_s) & (t_s <= leg.end_s) for leg in own]
        return np.asarray(np.any(masks, axis=0)) if masks else np.zeros(t_s.size, dtype=bool)


def dive_pieces(
    duration_s: float,
    motion: Mapping[str, tuple[Array, Array]],
    *,
    clocks: Sequence[Array],
    excluded: Sequence[tuple[float, float]] = (),
    driven: tuple[Array, Mask] | None = None,
    max_gap_s: float = 1.0,
) -> DivePieces:
    """Return a dive in pieces.

    motion: u v w p q r -> times (n,) [s] and values (n,); clocks: the sample times (n,)
    [s] of every sensor that a model needs; excluded: from and to [s] of what no leg may
    have; driven: times (n,) and whether an actuator acts (n,).
    """
    edges: Array = np.arange(int(max(duration_s, 0.0) / STEP_S) + 1, dtype=np.float64) * STEP_S
    usable = np.ones(edges.size - 1, dtype=bool)
    for clock in clocks:
        covered = np.zeros(usable.size, dtype=bool)
        for first, last in gaps(clock, max_gap_s):
            start, end = np.searchsorted(edges, (clock[first], clock[last - 1] + 1e-9))
            covered[start : max(start, end - 1)] = True
        usable &= covered
    for begin, end in excluded:
        usable[max(0, int(begin / STEP_S)) : max(0, int(np.ceil(end / STEP_S)))] = False
    mean = np.full((usable.size, 6), np.nan)
    square = np.full((usable.size, 6), np.nan)
    for axis, (t_s, values) in motion.items():
        if t_s.size > 1:
            column = VELOCITIES.index(axis)
            mean[:, column] = _means(t_s, values, edges)
            square[:, column] = _means(t_s, values**2, edges)
    acting = np.ones(usable.size, dtype=bool)
    if driven is not None and driven[0].size > 1:
        acting = _means(driven[0], driven[1].astype(np.float64), edges) > 0.0
    return DivePieces(usable, acting, mean, square)


def _means(t_s: Array, values: Array, edges: Array) -> Array:
    """Return the mean of a signal (n,) between edges (m+1,), linear between samples."""
    area = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(t_s))])
    return np.asarray(np.diff(np.interp(edges, t_s, area)) / np.diff(edges))


def moving_spans(dive: DivePieces, axes: Sequence[str] = VELOCITIES) -> list[tuple[int, int]]:
    """Return first and last + 1 of moving stretches that are long enough for a leg."""
    return [
        (first, last)
        for first, last in _stretches(dive, axes)
        if (last - first) * STEP_S >= SHORTEST_LEG_S
    ]


def _stretches(dive: DivePieces, axes: Sequence[str]) -> list[tuple[int, int]]:
    """Return first and last + 1 of runs of pieces that are usable and move."""
    columns = [VELOCITIES.index(axis) for axis in axes]
    beyond = dive.square[:, columns] >= np.array([THRESHOLDS[axis] ** 2 for axis in axes])
    near = int(NEAR_S / STEP_S)
    active = (
        _widened(np.asarray(beyond.any(axis=1)), near) & _widened(dive.driven, near) & dive.usable
    )
    bridged = runs_of(active)
    spans: list[tuple[int, int]] = []
    for first, last in bridged:
        rest = spans and (first - spans[-1][1]) * STEP_S <= LONGEST_REST_S
        if rest and dive.usable[spans[-1][1] : first].all():
            spans[-1] = (spans[-1][0], last)
        else:
            spans.append((first, last))
    return spans


def _widened(mask: Mask, pieces: int) -> Mask:
    """Return a mask (n,) with so many pieces more at both ends of each run."""
    total = np.concatenate([[0], np.cumsum(mask)])
    at = np.arange(mask.size)
    first, last = np.maximum(at - pieces, 0), np.minimum(at + pieces + 1, mask.size)
    return np.asarray(total[last] > total[first])


@dataclass(frozen=True)
class _Sums:
    """Cumulated sums (n + 1, 6): squares, pieces forward, pieces backward."""

    square: Array
    forward: Array
    backward: Array

    @classmethod
    def of(cls, dives: Sequence[DivePieces], pieces: Sequence[Index]) -> _Sums:
        """Return the sums over chosen pieces of dives, joined."""
        limit = np.array([THRESHOLDS[axis] for axis in VELOCITIES])
        square = np.concatenate([dive.square[at] for dive, at in zip(dives, pieces, strict=True)])
        mean = np.concatenate([dive.mean[at] for dive, at in zip(dives, pieces, strict=True)])
        parts = (np.nan_to_num(square), mean > limit, mean < -limit)
        start = np.zeros((1, 6))
        return cls(*(np.concatenate([start, np.cumsum(part, axis=0)]) for part in parts))

    def between(self, first: Index, last: Index) -> tuple[Mask, Mask]:
        """Return which axes move enough and both ways (k, 6), first to last (k,)."""
        return _excitation(
            self.square[last] - self.square[first],
            self.forward[last] - self.forward[first],
            self.backward[last] - self.backward[first],
            last - first,
        )

    def outside(self, first: Index, last: Index) -> tuple[Mask, Mask]:
        """Return the same (k, 6) of all pieces but those."""
        return _excitation(
            self.square[-1] - (self.square[last] - self.square[first]),
            self.forward[-1] - (self.forward[last] - self.forward[first]),
            self.backward[-1] - (self.backward[last] - self.backward[first]),
            self.square.shape[0] - 1 - (last - first),
        )


def _excitation(square: Array, forward: Array, backward: Array, count: Index) -> tuple[Mask, Mask]:
    limit = np.array([THRESHOLDS[axis] for axis in VELOCITIES])
    excited = square >= limit**2 * np.maximum(count, 1)[..., None]
    both = np.minimum(forward, backward) * STEP_S >= ONE_WAY_S
    return np.asarray(excited), np.asarray(excited & both)


def propose_legs(dives: Sequence[DivePieces]) -> LegProposal:
    """Return training and validation legs from the moving stretches of all dives.

    Validation is one block of the joined stretches, 20 to 40 % of them. Of all blocks
    that one is taken after which both parts have most axes excited, then most of them in
    both directions, then nearest to 30 % and late. Where no border of stretches gives such
    a share, any may be taken. A training leg that would be the only one is cut in two. No
    leg where less than twice SHORTEST_LEG_S moves.
    """
    spans = [
        (number, first, last)
        for number, dive in enumerate(dives)
        for first, last in moving_spans(dive)
    ]
    pieces = [np.arange(first, last) for _, first, last in spans]
    total = sum(at.size for at in pieces)
    moving = sum(last - first for dive in dives for first, last in _stretches(dive, VELOCITIES))
    if total * STEP_S < 2.0 * SHORTEST_LEG_S:
        return LegProposal((), (), {}, moving * STEP_S)
    sums = _Sums.of([dives[number] for number, _, _ in spans], pieces)
    borders = np.cumsum([0, *(at.size for at in pieces)])
    first, last = _validation_block(sums, borders)
    cuts: list[_Cut] = []
    for span, (low, high) in enumerate(itertools.pairwise(borders.tolist())):
        cuts += _cut(low, min(high, first), "training", span)
        cuts += _cut(max(low, first), min(high, last), "validation", span)
        cuts += _cut(max(low, last), high, "training", span)
    legs = []
    for at, stop, use, span in _with_two_training(cuts, sums):
        number, start, _ = spans[span]
        excited, both = sums.between(np.array([at]), np.array([stop]))
        shift = start - int(borders[span])
        times = float(at + shift) * STEP_S, float(stop + shift) * STEP_S
        legs.append(ProposedLeg(number, *times, use, _names(excited[0]), _names(both[0])))
    total_excited, _ = sums.between(np.array([0]), np.array([total]))
    axes = _names(total_excited[0])
    # Every piece is in a leg: inside and outside of the block are what the legs hold.
    by_use: dict[Use, tuple[Mask, Mask]] = {
        "training": sums.outside(np.array([first]), np.array([last])),
        "validation": sums.between(np.array([first]), np.array([last])),
    }
    lacking = {
        use: {
            axis: "hardly moves" if axis not in _names(excited[0]) else "moves one way only"
            for axis in axes
            if axis not in _names(both[0])
        }
        for use, (excited, both) in by_use.items()
    }
    return LegProposal(tuple(legs), axes, lacking, (moving - total) * STEP_S)


def _cut(begin: int, end: int, use: Use, span: int) -> list[_Cut]:
    """Return the legs of a stretch, none longer than LONGEST_LEG_S."""
    if end <= begin:
        return []
    parts = int(np.ceil((end - begin) * STEP_S / LONGEST_LEG_S))
    marks = np.linspace(begin, end, parts + 1).astype(int).tolist()
    return [(at, stop, use, span) for at, stop in itertools.pairwise(marks)]


def _with_two_training(cuts: list[_Cut], sums: _Sums) -> list[_Cut]:
    """Return legs with the only training leg cut in two, where it is long enough.

    After the cut both halves have most axes excited, most of them both ways, and it is
    nearest to the middle.
    """
    training = [item for item in cuts if item[2] == "training"]
    least = int(HALF_S / STEP_S)
    if len(training) != 1 or training[0][1] - training[0][0] < 2 * least:
        return cuts
    begin, end, use, span = training[0]
    places = np.arange(begin + least, end - least + 1)
    excited, both = sums.between(np.full_like(places, begin), places)
    later, later_both = sums.between(places, np.full_like(places, end))
    score = 10.0 * (excited & later).sum(axis=1) + (both & later_both).sum(axis=1)
    place = int(places[np.lexsort((-np.abs(2 * places - begin - end), score))[-1]])
    halves: list[_Cut] = [(begin, place, use, span), (place, end, use, span)]
    return [half for item in cuts for half in (halves if item is training[0] else [item])]


def _validation_block(sums: _Sums, borders: Index) -> tuple[int, int]:
    """Return first and last + 1 of the validation block among all moving pieces.

    borders: ends (m + 1,) of the joined stretches. The block begins and ends at one of
    them or SHORTEST_LEG_S inside a stretch, so that no remainder is too short for a leg.
    """
    least = int(np.ceil(SHORTEST_LEG_S / STEP_S))
    total = int(borders[-1])
    inside = [np.arange(a + least, b - least + 1) for a, b in itertools.pairwise(borders)]
    places = np.unique(np.concatenate([borders, *inside]))
    if places.size > MOST_BORDERS:
        places = places[np.linspace(0, places.size - 1, MOST_BORDERS).astype(np.intp)]
    begin, end = np.triu_indices(places.size, 1)
    first, last = places[begin], places[end]
    share = (last - first) / total
    possible = (last - first >= least) & (last - first < total)
    preferred = possible & (share >= LEAST_SHARE) & (share <= MOST_SHARE)
    chosen = preferred if preferred.any() else possible
    first, last, share = first[chosen], last[chosen], share[chosen]
    excited, both = sums.between(first, last)
    rest_excited, rest_both = sums.outside(first, last)
    score = 10.0 * (excited & rest_excited).sum(axis=1) + (both & rest_both).sum(axis=1)
    ends = (first == 0) | (last == total)
    rank = -20.0 * np.abs(share - BEST_SHARE) + 0.5 * ends + 0.1 * first / total
    top = np.lexsort((rank, score))[-1]
    return int(first[top]), int(last[top])


def propose_channel_legs(dives: Sequence[DivePieces], channels: Sequence[str]) -> LegProposal:
    """Return one leg for each channel (u v w p q r), where that one moves most.

    It is a moving stretch, cut at LONGEST_CHANNEL_S: one in which the channel moves both
    ways where there is any, and of these the one with the largest sum of squares.
    """
    legs, lacking = [], {}
    for channel in channels:
        column = VELOCITIES.index(channel)
        stretches = [
            stretch
            for number, dive in enumerate(dives)
            if dive.measured[column]
            for stretch in _channel_stretches(number, dive, channel)
        ]
        if stretches:
            _, leg = max(
                stretches, key=lambda stretch: (channel in stretch[1].both_ways, stretch[0])
            )
            legs.append(leg)
            if channel not in leg.both_ways:
                lacking[channel] = "moves one way only"
    axes = tuple(str(leg.channel) for leg in legs)
    return LegProposal(tuple(legs), axes, {"training": lacking})


def _channel_stretches(
    number: int, dive: DivePieces, channel: str
) -> Iterator[tuple[float, ProposedLeg]]:
    """Yield a leg, and its energy, for each stretch in which a channel moves."""
    column = VELOCITIES.index(channel)
    for first, last in moving_spans(dive, (channel,)):
        sums = _Sums.of([dive], [np.arange(first, last)])
        width = min(last - first, int(LONGEST_CHANNEL_S / STEP_S))
        starts = np.arange(last - first - width + 1)
        energy = sums.square[starts + width, column] - sums.square[starts, column]
        excited, both = sums.between(starts, starts + width)
        at = int(np.lexsort((energy, both[:, column]))[-1])
        if excited[at, column]:
            span = (first + at) * STEP_S, (first + at + width) * STEP_S
            names = _names(excited[at]), _names(both[at])
            yield float(energy[at]), ProposedLeg(number, *span, "training", *names, channel)


def _names(mask: Mask) -> tuple[str, ...]:
    return tuple(axis for axis, moves in zip(VELOCITIES, mask.tolist(), strict=True) if moves)
