"""What the page and the recording show of the chosen model's flight."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from auvid.data_schemas.records.models import ModelCard
from auvid.data_schemas.records.motion import SegmentRecord
from auvid.hydro.dynamics.simulation.growth import CORIOLIS, RIGHTING, Growth
from auvid.hydro.identification.selection.conformal import LEAST_LEGS
from auvid.stages.columns import ATTITUDE, VELOCITY
from auvid.stages.page.first_screen import AXIS_WORDS
from auvid.stages.presentation import Block, panel, plot, series, symbol, table, unit_of, view
from auvid.stages.validate.flight import HIGH, LEVEL, LOW, NAMES, FreeFlight, ModelDraws

SEGMENTS_DRAWN = 3
"""Segments with a picture on the page; the recording has all of them."""
TAB = "Free run"
LIMITS_NAMED = 3
SLOWEST_1_S = 0.005
"""Growth below which nothing grows: a motion that neither grows nor decays has 1e-17."""
"""Limits that are named, those of most draws."""


def flight_blocks(
    name: str,
    card: ModelCard,
    flights: Mapping[str, FreeFlight],
    segments: Mapping[str, SegmentRecord],
    draws: ModelDraws,
    *,
    window_s: float,
) -> list[Block]:
    """Return a picture per segment of the chosen model's flight, and its reach."""
    blocks = [
        _picture(name, card.title, segments[key], flight, window_s)
        for key, flight in list(flights.items())[:SEGMENTS_DRAWN]
    ]
    if flights:
        blocks.append(_coverage(card, list(flights.values()), draws, window_s))
    return blocks


def _picture(
    name: str, title: str, segment: SegmentRecord, flight: FreeFlight, window_s: float
) -> Block:
    t = flight.t_s + float(segment.leg_start_s)
    panels = [
        panel(
            symbol(column),
            unit_of("simulated_motion", column),
            [
                series("lower edge", t, flight.low[:, i], "band"),
                series("upper edge", t, flight.high[:, i], "band"),
                series("measured", t, flight.measured[:, i], "measured"),
                series(name, t, flight.simulated[:, i], name),
            ],
        )
        for i, column in enumerate(NAMES)
    ]
    return plot(
        f"Free run of {title} on {segment.id}, from measured controls",
        panels,
        group="time",
        look_for=(
            f"Started from the measured state every {window_s:g} s, then by itself: near the"
            " measured line the model moves as the vehicle did. It has not seen this leg."
        ),
    )


def _coverage(
    card: ModelCard, flights: Sequence[FreeFlight], draws: ModelDraws, window_s: float
) -> Block:
    shares = np.mean([flight.coverage() for flight in flights], axis=0)
    lost, flown = max(flight.lost for flight in flights), max(flight.flown for flight in flights)
    legs = len(flights)
    if legs >= LEAST_LEGS:
        kind = f"split conformal over {legs} legs, each band from the other {legs - 1}"
    else:
        kind = "the model's own, from the covariance of its coefficients and its force error in"
        kind += " training, larger by as much as the actuators push harder here; not calibrated:"
        kind += f" that takes {LEAST_LEGS} validation legs"
    words = f"Band for {100 * LEVEL:g} % of the time: {kind}."
    words += f" Of {len(draws.models)} draws of {card.title}'s coefficients"
    words += f" {_moved_words(card, draws)}; of {flown} that flew {window_s:g} s each"
    words += f" {lost} diverged{_cause_words(flights)}."
    heads = ["state", "all", *map(symbol, NAMES)]
    cells = [f"{100 * share:.0f} %" for share in (float(np.mean(shares)), *shares.tolist())]
    return table(
        "Share of the time that the measured state lies in the band",
        heads,
        [["in the band", *cells]],
        note=words,
    )


def _moved_words(card: ModelCard, draws: ModelDraws) -> str:
    """Return how many draws lay outside which limit, and why so many."""
    if card.damping == "free" and not draws.moved:
        return "none was moved, as no limit on damping was asked for"
    words = f"{draws.moved} lay outside the physical limits"
    if draws.outside:
        often = sorted(draws.outside.items(), key=lambda item: -item[1])[:LIMITS_NAMED]
        words += f" ({', '.join(f'{name}: {count}' for name, count in often)})"
    words += " and count at the nearest point within, none rejected"
    if card.limits and 2 * draws.moved > len(draws.models):
        words += " (the estimate itself lies on the limit, so most draws around it lie outside)"
    return words


def _cause_words(flights: Sequence[FreeFlight]) -> str:
    """Return what grows in the first lost draw; nothing where nothing grows."""
    cause = next((flight.cause for flight in flights if flight.cause is not None), None)
    words = "" if cause is None else growth_words(cause)
    return f" (in the first {words})" if words else ""


def growth_words(cause: Growth) -> str:
    """Return what grows: `roll grows at 5.1 1/s, mostly by K_p`; or nothing."""
    if cause.rate < SLOWEST_1_S:
        return ""
    words = f"{AXIS_WORDS[cause.axis]} grows at {cause.rate:.2g} 1/s"
    return words + (f", mostly by {named_cause(cause.cause)}" if cause.cause else "")


def named_cause(cause: str) -> str:
    """Return what makes a motion grow, in words: a coefficient or a force."""
    names = {CORIOLIS: "the Coriolis force of its inertia", RIGHTING: "its righting moment"}
    return names.get(cause, cause)


def flight_views(name: str, segments: Sequence[str]) -> list[dict[str, Any]]:
    """Return the groups of the recording: run, band and measured state, by quantity."""
    groups = []
    for key in segments:
        for columns in (VELOCITY[:3], VELOCITY[3:], ATTITUDE):
            for column in columns:
                i, table_name = NAMES.index(column), f"simulated_motion/{key}"
                entity = f"free_run/{key}/{symbol(column)}"
                groups += [
                    view(f"{entity}/measured", f"fuse/{key}/fused", [column], ["measured"],
                         tab=TAB, names=[f"{symbol(column)} measured"]),
                    view(f"{entity}/run", table_name, [column], [name], tab=TAB,
                         names=[f"{symbol(column)} {name}"]),
                    view(f"{entity}/band", table_name, [LOW[i], HIGH[i]], ["band", "band"],
                         tab=TAB, names=["lower edge", "upper edge"]),
                ]  # fmt: skip
    return groups
