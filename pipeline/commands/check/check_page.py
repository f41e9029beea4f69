"""The health page in the terminal and as one HTML file.

Texts that come from logs are stripped of control characters, or escaped.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from importlib import resources
from typing import Any

import jinja2
from rich.table import Table
from rich.text import Text

from auvid.data_schemas.records.logs import FindingRecord, HealthRecord, StreamRecord, UnseenRecord
from auvid.pipeline.commands.check.axes_route import axes_fed
from auvid.pipeline.commands.check.clock_alignment import ClockAlignment
from auvid.pipeline.commands.check.log_page import LogPage
from auvid.pipeline.terminal import plain, plain_lines, show, table
from auvid.stages.ingest.health.finding import CheckedLog
from auvid.stages.ingest.health.usability import (
    GLIDE,
    NO_FORCE,
    NO_STATE,
    PASSIVE_KIND,
)
from auvid.stages.number_format import fixed, percent, significant

SYMBOLS = {"error": ("✗", "bold red"), "warning": ("!", "bold yellow"), "note": ("·", "cyan")}
REASONS = "(why: --json, unseen; report, Health)"
"""Where it stands why a log does not show something."""
MOST_SPANS = 5
STATUS = {"complete": "green", "truncated": "yellow", "damaged": "red"}


def print_pages(pages: Sequence[LogPage]) -> None:
    """Print the pages to standard output."""
    for page in pages:
        name = plain(page.name)
        show(Text.assemble((name, "bold"), (f" {'─' * max(3, 79 - len(name))}", "dim")))
        if page.health is None:
            show(Text.assemble(("✗ refused ", "bold red"), plain_lines(page.refused)))
        else:
            health = HealthRecord.model_validate(page.health)
            show(_header(health), "")
            _print_streams(health.streams)
            show(Text.assemble(("all run together: ", "dim"), shared_spans(health.shared_spans_s)))
            show("", *_findings(health.findings), *_unseen(health.unseen))
            show("", *_uses(health), *_axes(page, health))
            _print_legs(page.legs)
        print()


def _header(health: HealthRecord) -> Text:
    size = health.bytes
    about = f"{', '.join(health.formats)}, {size / 1e6:.2f} MB, {health.duration_s:.1f} s, "
    vehicle = plain(health.vehicle or "vehicle not named")
    return Text.assemble(vehicle, "   ", about, (health.status, STATUS[health.status]))


def _print_streams(streams: Mapping[str, StreamRecord]) -> None:
    rejected = any(item.rejected for item in streams.values())
    columns = ("stream", "source", "samples", "from s", "to s", "Hz", "jitter ms", "gap s")
    rows = []
    for name, item in streams.items():
        # Jitter has three digits, none beyond the microseconds of the clock.
        rows.append(
            (
                name,
                item.source,
                item.rows,
                fixed(item.start_s, 1),
                fixed(item.end_s, 1),
                significant(item.rate_hz, empty=""),
                "" if item.jitter_s is None else significant(round(item.jitter_s * 1e3, 3)),
                "" if item.rate_hz is None else significant(item.longest_gap_s),
                *([item.rejected or ""] if rejected else []),
                ", ".join([*item.others, *(f"({source})" for source in item.refused)]),
            )
        )
    table((*columns, *(["rejected"] if rejected else []), "also there"), rows)


def shared_spans(spans: Sequence[Sequence[float]]) -> str:
    """Return in words when all sensors and commands run together."""
    words = [f"{start:.1f} to {end:.1f} s" for start, end in spans[:MOST_SPANS]]
    if len(spans) > MOST_SPANS:
        words.append(f"{len(spans) - MOST_SPANS} more")
    return ", ".join(words) or "never"


def _findings(findings: Sequence[FindingRecord]) -> Iterator[Table | Text]:
    if not findings:
        yield Text("✓ nothing found", style="green")
        return
    grid = Table.grid(padding=(0, 1))
    grid.add_column(no_wrap=True)
    grid.add_column(overflow="fold")
    for item in findings:
        symbol, style = SYMBOLS[item.severity]
        text = Text.assemble(plain(item.text), ("  " + item.id, "dim"))
        if item.severity != "note":
            text.append(f"\n{plain(item.remedy)}", style="dim italic")
        grid.add_row(Text(symbol, style=style), text)
    yield grid


def _unseen(rows: Sequence[UnseenRecord]) -> Iterator[Text]:
    """Yield what nothing in the log tells, in one paragraph: reasons fill a screen."""
    if rows:
        names = "; ".join(item.name for item in rows)
        yield Text.assemble(("? not observable: ", "bold"), names, (f"  {REASONS}", "dim"))


def _axes(page: LogPage, health: HealthRecord) -> Iterator[Text]:
    """Yield what axes can be fitted one by one, where no force model can.

    A body that nothing drives has none, which its verdict says.
    """
    assert page.outputs is not None
    outputs = page.outputs
    uses = {item.name: item.possible for item in health.capabilities}
    if uses.get(GLIDE):
        return  # buoyancy drives it
    if any(good for name, good in uses.items() if name.startswith("synthesise")):
        return
    fed = axes_fed(CheckedLog(page.streams, outputs.log_info, outputs.dropped, page.vehicle))
    if not fed.axes and uses.get(PASSIVE_KIND):
        return
    mark = ("✓ ", "bold green") if fed.axes else ("✗ ", "bold red")
    yield Text.assemble(mark, (plain(fed.words), "bold"))
    yield from (Text.assemble(("! ", "bold yellow"), plain(words)) for words in fed.warnings)


def _uses(health: HealthRecord) -> Iterator[Text]:
    good = any(
        item.possible
        for item in health.capabilities
        if item.name.startswith("synthesise") or item.name in (GLIDE, PASSIVE_KIND)
    )
    yield Text.assemble(
        ("✓ " if good else "✗ ", "bold green" if good else "bold red"),
        (plain(health.verdict), "bold"),
    )
    uses = health.capabilities
    can = _together([item.name for item in uses if item.possible])
    cannot: dict[str, list[str]] = {}
    for item in uses:
        if not item.possible:
            cannot.setdefault(item.reason, []).append(item.name)
    follows = _together(
        [name for why in (NO_STATE, NO_FORCE) for name in cannot.pop(why, [])], short=True
    )
    sentences = [f"{_together(names)}: {why}" for why, names in cannot.items()]
    if can:
        yield Text.assemble(("can run:    ", "dim"), can)
    if sentences:
        yield Text.assemble(
            ("cannot run: ", "dim"),
            plain("; ".join(sentences) + (f"; and so not {follows}" if follows else "")),
        )
    parts: list[Any] = [("motion RMS: ", "dim")]
    for axis, motion in health.excitation.items():
        value = significant(motion.rms)
        parts += [
            f"{axis} ",
            (value, "green" if motion.excited else "yellow" if motion.rms is not None else "dim"),
            "  ",
        ]
    yield Text.assemble(*parts, ("(m/s, rad/s)", "dim"))


def _together(names: Sequence[str], *, short: bool = False) -> str:
    """Return names of stages, the axes of `synthesise` behind one word.

    `short`: without the axes.
    """
    axes = [name.removeprefix("synthesise ") for name in names if name.startswith("synthesise ")]
    others = [name for name in names if not name.startswith("synthesise ")]
    return ", ".join(
        [*others, *(["synthesise" if short else f"synthesise {', '.join(axes)}"] if axes else [])]
    )


def _print_legs(legs: Sequence[Mapping[str, Any]]) -> None:
    if legs:
        print()
    rows = [
        (
            leg["id"],
            leg["use"] or "",
            *(fixed(leg[key], 1) for key in ("start_s", "end_s", "covered_s")),
            percent(leg["active_share"], 2, empty=""),
            ", ".join(leg["excited"]) if leg["inside"] else "outside the log",
            "; ".join(leg["unusable"]),
        )
        for leg in legs
    ]
    columns = ["leg", "use", "from s", "to s", "covered s", "outputs active", "moves in"]
    if any(row[-1] for row in rows):
        columns.append("not usable")
    table(columns, [row[: len(columns)] for row in rows], title="legs")


def html(pages: Sequence[LogPage], alignment: ClockAlignment | None = None) -> str:
    """Return the pages as one self-contained HTML file."""
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["plain"] = plain
    environment.filters["shared_spans"] = shared_spans
    environment.filters["plain_lines"] = plain_lines
    source = (resources.files(__package__) / "check_page.html.j2").read_text(encoding="utf-8")
    return environment.from_string(source).render(
        pages=pages, alignment=alignment and alignment.text
    )
