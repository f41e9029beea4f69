"""The health page in the terminal and as one HTML file. Texts that come from logs are
stripped of control characters, or escaped.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from importlib import resources
from typing import TYPE_CHECKING, Any

import jinja2
from rich.console import Console, Group
from rich.padding import Padding
from rich.rule import Rule
from rich.table import Table
from rich.text import Text

from auvid.hydro.arrays import VELOCITIES
from auvid.pipeline.terminal import plain, plain_lines
from auvid.stages.ingest.health.usability import NO_FORCE, NO_STATE

if TYPE_CHECKING:
    from auvid.pipeline.commands.check.check_command import Alignment, Page

SYMBOLS = {"error": ("✗", "bold red"), "warning": ("!", "bold yellow"), "note": ("·", "cyan")}
STATUS = {"complete": "green", "truncated": "yellow", "damaged": "red"}


def show(pages: Sequence[Page]) -> None:
    """Print the pages to standard output."""
    console = Console(highlight=False, soft_wrap=False)
    for page in pages:
        console.print(_page(page))


def show_alignment(found: Alignment) -> None:
    """Print the offset between two clocks."""
    Console(highlight=False).print(Text(alignment_text(found)))


def alignment_text(found: Alignment) -> str:
    """The offset between two clocks in one sentence."""
    offset = found.offset
    digits = 4 if offset.std_s >= 1e-4 else 6
    seconds = round(offset.offset_s, digits) + 0.0  # no minus before a zero
    spread = max(offset.std_s, 10.0**-digits)  # not known better than it is printed
    return (
        f"clock of {plain(found.second)} {seconds:+.{digits}f} s = clock of {plain(found.first)}"
        f" (standard deviation {spread:.{digits}f} s; {found.signal}, correlation"
        f" {offset.correlation:.2f} over {offset.overlap_s:.0f} s)"
    )


def _page(page: Page) -> Group:
    title = Rule(Text(plain(page.name), style="bold"), align="left", style="dim")
    if page.health is None:
        return Group(
            title, Text.assemble(("✗ refused ", "bold red"), plain_lines(page.refused)), Text()
        )
    health = page.health
    return Group(
        title,
        _header(health),
        Padding(_streams(health["streams"]), (1, 0)),
        *_findings(health["findings"]),
        Text(),
        *_uses(health),
        *_legs(page.legs),
        Text(),
    )


def _header(health: Mapping[str, Any]) -> Text:
    size = health["bytes"]
    about = f"{', '.join(health['formats'])}, {size / 1e6:.2f} MB, {health['duration_s']:.1f} s, "
    vehicle = plain(health["vehicle"] or "vehicle not named")
    return Text.assemble(vehicle, "   ", about, (health["status"], STATUS[health["status"]]))


def _streams(streams: Mapping[str, Mapping[str, Any]]) -> Table:
    rejected = any(item["rejected"] for item in streams.values())
    table = Table(box=None, pad_edge=False, header_style="dim")
    for name in (
        "stream",
        "source",
        "samples",
        "Hz",
        "jitter ms",
        "gap s",
        *(["rejected"] if rejected else []),
        "also there",
    ):
        text = name in (
            "source",
            "also there",
        )  # numbers stay whole on a narrow screen, texts go on in the next line
        table.add_column(
            name,
            justify="left" if text or name == "stream" else "right",
            no_wrap=not text,
            overflow="fold",
        )
    for name, item in streams.items():
        others = [*item["others"], *(f"({source})" for source in item["refused"])]
        table.add_row(
            name,
            plain(item["source"]),
            str(item["rows"]),
            "" if item["rate_hz"] is None else f"{item['rate_hz']:.3g}",
            "" if item["jitter_s"] is None else _short(item["jitter_s"] * 1e3),
            "" if item["rate_hz"] is None else f"{item['longest_gap_s']:.3g}",
            *([str(item["rejected"] or "")] if rejected else []),
            plain(", ".join(others)),
        )
    return table


def _short(milliseconds: float) -> str:
    """Three digits, none beyond the microseconds of the clock."""
    return f"{round(milliseconds, 3):.3g}"


def _findings(findings: Sequence[Mapping[str, Any]]) -> Iterator[Table | Text]:
    if not findings:
        yield Text("✓ nothing found", style="green")
        return
    grid = Table.grid(padding=(0, 1))
    grid.add_column(no_wrap=True)
    grid.add_column(overflow="fold")
    for item in findings:
        symbol, style = SYMBOLS[item["severity"]]
        text = Text.assemble(plain(item["text"]), ("  " + item["id"], "dim"))
        if item["severity"] != "note":
            text.append(f"\n{plain(item['remedy'])}", style="dim italic")
        grid.add_row(Text(symbol, style=style), text)
    yield grid


def _uses(health: Mapping[str, Any]) -> Iterator[Text]:
    good = any(
        item["possible"] for item in health["capabilities"] if item["name"].startswith("synthesise")
    )
    yield Text.assemble(
        ("✓ " if good else "✗ ", "bold green" if good else "bold red"),
        (plain(health["verdict"]), "bold"),
    )
    uses = health["capabilities"]
    can = _together([item["name"] for item in uses if item["possible"]])
    cannot: dict[str, list[str]] = {}
    for item in uses:
        if not item["possible"]:
            cannot.setdefault(item["reason"], []).append(item["name"])
    follows = _together(
        [name for why in (NO_STATE, NO_FORCE) for name in cannot.pop(why, [])], short=True
    )
    said = [f"{_together(names)}: {why}" for why, names in cannot.items()]
    if can:
        yield Text.assemble(("can run:    ", "dim"), can)
    if said:
        yield Text.assemble(
            ("cannot run: ", "dim"),
            plain("; ".join(said) + (f"; and so not {follows}" if follows else "")),
        )
    parts: list[Any] = [("motion RMS: ", "dim")]
    for axis in VELOCITIES:
        item = health["excitation"][axis]
        value = "-" if item["rms"] is None else f"{item['rms']:.3g}"
        parts += [
            f"{axis} ",
            (value, "green" if item["excited"] else "yellow" if item["rms"] is not None else "dim"),
            "  ",
        ]
    yield Text.assemble(*parts, ("(m/s, rad/s)", "dim"))


def _together(names: Sequence[str], *, short: bool = False) -> str:
    """Names of stages with the axes of `synthesise` behind one word (`short`: without
    them).
    """
    axes = [name.removeprefix("synthesise ") for name in names if name.startswith("synthesise ")]
    others = [name for name in names if not name.startswith("synthesise ")]
    return ", ".join(
        [*others, *(["synthesise" if short else f"synthesise {', '.join(axes)}"] if axes else [])]
    )


def _legs(legs: Sequence[Mapping[str, Any]]) -> Iterator[Table | Text]:
    if not legs:
        return
    table = Table(
        box=None,
        pad_edge=False,
        header_style="dim",
        title="legs",
        title_justify="left",
        title_style="dim",
    )
    for name in ("leg", "use", "from s", "to s", "covered s", "outputs active", "moves in"):
        table.add_column(name)
    for leg in legs:
        active = "" if leg["active_share"] is None else f"{100 * leg['active_share']:.0f} %"
        moves = ", ".join(leg["excited"]) if leg["inside"] else "outside the log"
        span = [f"{leg[key]:.1f}" for key in ("start_s", "end_s", "covered_s")]
        table.add_row(plain(leg["id"]), plain(leg["use"] or ""), *span, active, moves)
    yield Text()
    yield table


def html(pages: Sequence[Page], aligned: Alignment | None = None) -> str:
    """The pages as one self-contained HTML file."""
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["plain"] = plain
    environment.filters["plain_lines"] = plain_lines
    source = (resources.files(__package__) / "check_page.html.j2").read_text(encoding="utf-8")
    return environment.from_string(source).render(
        pages=pages, axes=VELOCITIES, alignment=aligned and alignment_text(aligned)
    )
