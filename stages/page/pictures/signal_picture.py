"""A picture of signals over time, for campaigns without a dive: bench and control."""

from __future__ import annotations

from collections.abc import Sequence

from markupsafe import Markup

from auvid.stages.page.pictures.drawing import (
    CurveRow,
    Span,
    curve_row,
    figure,
    legend,
    time_axis,
)


def signal_picture(
    title: str,
    note: str,
    rows: Sequence[tuple[CurveRow, Span]],
    entries: Sequence[tuple[str, str]],
) -> Markup:
    """Return rows of curves, each over its own span; `entries`: (name, role) drawn.

    Rows that share a span share the axis below the last of them.
    """
    parts = []
    for place, (row, span) in enumerate(rows):
        parts.append(curve_row(row, span))
        if place + 1 == len(rows) or rows[place + 1][1] != span:
            parts.append(time_axis(span, "time in s"))
    body = Markup('<div class="split single"><div class="rows">{}</div></div>').format(
        Markup("").join(parts)
    )
    drawn = legend([(name, role, False) for name, role in entries])
    return figure("signals", title, note, drawn, body)
