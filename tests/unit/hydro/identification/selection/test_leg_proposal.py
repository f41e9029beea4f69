"""Legs are proposed where a vehicle moves, both parts with every axis in both directions."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np
import pytest

from auvid.hydro.arrays import VELOCITIES, Array
from auvid.hydro.identification.regression.excitation import THRESHOLDS
from auvid.hydro.identification.selection.leg_proposal import (
    LONGEST_LEG_S,
    ONE_WAY_S,
    SHORTEST_LEG_S,
    STEP_S,
    DivePieces,
    LegProposal,
    dive_pieces,
    moving_spans,
    propose_channel_legs,
    propose_legs,
)

CLOCK = np.arange(0.0, 300.0, 0.1)


def wave(period_s: float, *, size: float = 0.2, between: tuple[float, float] = (0.0, 1e9)) -> Array:
    inside = (between[0] <= CLOCK) & (between[1] > CLOCK)
    return np.where(inside, size * np.sin(2.0 * np.pi * CLOCK / period_s), 0.0)


def dive(
    motion: Mapping[str, Array],
    *,
    clocks: tuple[Array, ...] = (CLOCK,),
    excluded: tuple[tuple[float, float], ...] = (),
    driven: Array | None = None,
) -> DivePieces:
    return dive_pieces(
        float(CLOCK[-1]),
        {axis: (CLOCK, values) for axis, values in motion.items()},
        clocks=clocks,
        excluded=excluded,
        driven=None if driven is None else (CLOCK, driven.astype(bool)),
    )


def test_both_parts_have_each_axis_both_ways() -> None:
    proposal = propose_legs([dive({"u": wave(20.0), "r": wave(31.0)})])
    assert proposal.axes == ("u", "r")
    assert proposal.lacking == {"training": {}, "validation": {}}
    for leg in proposal.legs:
        assert leg.both_ways == ("u", "r")
    length = {
        use: sum(leg.end_s - leg.start_s for leg in proposal.legs if leg.use == use)
        for use in ("training", "validation")
    }
    assert 0.2 < length["validation"] / sum(length.values()) < 0.4
    assert [leg.use for leg in proposal.legs] == ["training", "training", "validation"]  # late


def test_the_only_training_leg_is_cut_where_both_halves_move_each_axis() -> None:
    # Sway moves both ways from 30 to 45 s and from 60 to 75 s of a training leg of 210 s.
    sway = wave(7.0, between=(30.0, 45.0)) + wave(7.0, between=(60.0, 75.0))
    sway += wave(10.0, between=(220.0, 290.0))
    proposal = propose_legs([dive({"u": wave(20.0), "v": sway})])
    first, second, validation = proposal.legs
    assert (first.use, second.use, validation.use) == ("training", "training", "validation")
    assert first.end_s == second.start_s
    assert 45.0 < first.end_s < 75.0
    short = propose_legs([dive({"u": wave(9.0, between=(0.0, 45.0))})])
    assert [leg.use for leg in short.legs].count("training") == 1


def test_validation_is_where_the_rare_axis_moves_twice() -> None:
    # Sway moves from 20 to 60 s and from 100 to 140 s only; surge all the time. The last
    # 30 % would have no sway.
    sway = wave(10.0, between=(20.0, 60.0)) + wave(10.0, between=(100.0, 140.0))
    proposal = propose_legs([dive({"u": wave(20.0), "v": sway})])
    assert proposal.lacking == {"training": {}, "validation": {}}
    (validation,) = [leg for leg in proposal.legs if leg.use == "validation"]
    assert validation.end_s < 200.0
    assert "v" in validation.both_ways


def test_an_axis_that_goes_one_way_is_said() -> None:
    proposal = propose_legs([dive({"u": np.abs(wave(20.0)), "v": wave(20.0)})])
    assert proposal.lacking["training"] == {"u": "moves one way only"}
    assert proposal.lacking["validation"] == {"u": "moves one way only"}


def test_a_gap_of_any_sensor_and_excluded_stretches_are_in_no_leg() -> None:
    gap = CLOCK[(CLOCK < 100.0) | (CLOCK > 110.0)]
    proposal = propose_legs(
        [dive({"u": wave(20.0)}, clocks=(CLOCK, gap), excluded=((0.0, 30.0), (200.0, 203.0)))]
    )
    for start, end in ((0.0, 30.0), (100.2, 109.8), (200.0, 203.0)):
        assert all(leg.end_s <= start or leg.start_s >= end for leg in proposal.legs)
    assert {leg.use for leg in proposal.legs} == {"training", "validation"}
    assert sum(leg.end_s - leg.start_s for leg in proposal.legs) > 240.0


def test_rest_and_idle_actuators_are_in_no_leg() -> None:
    moving = wave(10.0, between=(100.0, 180.0))
    assert moving_spans(dive({"u": moving})) == [(190, 370)]  # five seconds on either side
    coasting = dive({"u": wave(10.0)}, driven=(CLOCK > 100.0) & (CLOCK < 150.0))
    ((first, last),) = moving_spans(coasting)
    assert 94.0 <= first * 0.5 <= 96.0
    assert 154.0 <= last * 0.5 <= 156.0


def test_no_leg_where_too_little_moves() -> None:
    assert propose_legs([dive({"u": wave(5.0, between=(0.0, 3.0))})]).legs == ()
    assert propose_legs([dive({"u": wave(5.0)}, excluded=((12.0, 300.0),))]).legs == ()
    assert propose_legs([dive({"u": 0.01 * wave(5.0)})]).legs == ()


def test_several_dives_share_one_validation_block() -> None:
    dives = [dive({"u": wave(20.0)}), dive({"u": wave(20.0), "v": wave(15.0)})]
    proposal = propose_legs(dives)
    assert {leg.dive for leg in proposal.legs} == {0, 1}
    assert proposal.lacking == {"training": {}, "validation": {}}
    assert all(leg.end_s - leg.start_s >= SHORTEST_LEG_S for leg in proposal.legs)


def test_a_channel_leg_is_where_that_channel_moves_most() -> None:
    yaw = wave(20.0, size=0.05) + wave(10.0, size=0.5, between=(200.0, 280.0))
    heave = wave(15.0, between=(10.0, 90.0))
    proposal = propose_channel_legs([dive({"w": heave, "r": yaw})], ("w", "r", "u"))
    by_channel = {leg.channel: leg for leg in proposal.legs}
    assert set(by_channel) == {"w", "r"}
    assert by_channel["w"].end_s < 100.0
    assert by_channel["r"].end_s > 270.0


def test_four_hours_take_one_pass() -> None:
    t_s = np.arange(0.0, 4 * 3600.0, 0.1)
    motion = {axis: (t_s, 0.2 * np.sin(t_s / (5.0 + k))) for k, axis in enumerate("uvwpqr")}
    pieces = dive_pieces(float(t_s[-1]), motion, clocks=(t_s,))
    assert pieces.usable.size == 28_799
    legs = propose_legs([pieces]).legs
    assert {leg.use for leg in legs} == {"training", "validation"}
    assert max(leg.end_s - leg.start_s for leg in legs) <= LONGEST_LEG_S
    assert sum(leg.end_s - leg.start_s for leg in legs) > 0.99 * 4 * 3600.0
    assert all(a.end_s == b.start_s for a, b in pairwise(legs))


def pieces_of_stretches(
    stretches: list[tuple[float, float]], motion: Mapping[str, Array]
) -> DivePieces:
    ends = [0.0, *(edge for stretch in stretches for edge in stretch), float(CLOCK[-1])]
    return dive(motion, excluded=tuple(zip(ends[::2], ends[1::2], strict=True)))


def seconds_in_legs(proposal: LegProposal) -> float:
    return sum(leg.end_s - leg.start_s for leg in proposal.legs)


def test_short_stretches_are_not_cut_and_none_is_lost() -> None:
    stretches = [(0.0, 9.5), (29.5, 39.0), (71.5, 81.0), (107.5, 125.0)]
    motion = {"u": wave(5.0), "v": wave(4.0, between=(0.0, 39.0))}
    proposal = propose_legs([pieces_of_stretches(stretches, motion)])
    assert {leg.use for leg in proposal.legs} == {"training", "validation"}
    assert seconds_in_legs(proposal) == 46.0
    assert proposal.dropped_s == 0.0
    assert proposal.axes == ("u", "v")
    assert proposal.lacking == {"training": {}, "validation": {}}


@pytest.mark.parametrize("seed", range(60))
def test_each_moving_second_is_in_one_leg_or_counted(seed: int) -> None:
    random = np.random.default_rng(seed)
    edges = np.cumsum(random.integers(6, 40, size=(random.integers(3, 11), 2)).ravel()) * STEP_S
    stretches = [(float(a), float(b)) for a, b in edges.reshape(-1, 2) if b < CLOCK[-1]]
    drift = np.cumsum(random.uniform(-0.5, 0.5, (2, CLOCK.size)), axis=1) * 0.02
    pieces = pieces_of_stretches(stretches, {"u": wave(5.0), "v": drift[0], "r": drift[1]})
    proposal = propose_legs([pieces])
    assert seconds_in_legs(proposal) + proposal.dropped_s == sum(b - a for a, b in stretches)

    long = [b - a for a, b in stretches if b - a >= SHORTEST_LEG_S]
    if sum(long) >= 2.0 * SHORTEST_LEG_S:
        assert seconds_in_legs(proposal) == sum(long)
        assert {leg.use for leg in proposal.legs} == {"training", "validation"}
    assert all(leg.end_s - leg.start_s >= SHORTEST_LEG_S for leg in proposal.legs)
    assert all(a.end_s <= b.start_s for a, b in pairwise(proposal.legs))
    for use, lacking in proposal.lacking.items():
        rows = np.concatenate(
            [
                np.arange(int(leg.start_s / STEP_S), int(leg.end_s / STEP_S))
                for leg in proposal.legs
                if leg.use == use
            ]
        )
        expected = {}
        for axis in proposal.axes:
            column = VELOCITIES.index(axis)
            mean, limit = pieces.mean[rows, column], THRESHOLDS[axis]
            one_way = min((mean > limit).sum(), (mean < -limit).sum()) * STEP_S < ONE_WAY_S
            if pieces.square[rows, column].mean() < limit**2:
                expected[axis] = "hardly moves"
            elif one_way:
                expected[axis] = "moves one way only"
        assert lacking == expected
