"""The report page: sections in order, rendered into one file that needs no network.

Every string that comes from a log or a manifest is escaped; control and direction
characters are made visible. The page forbids itself any script but its own (content
security policy with the script's hash), so that a hostile string could not run even if
it got through.
"""

from __future__ import annotations

import base64
import hashlib
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from importlib import resources
from itertools import groupby
from typing import Any

import jinja2
from markupsafe import Markup, escape

from auvid.stages.base import Document
from auvid.stages.number_format import (
    fixed,
    is_numeric,
    number,
    places_of_error,
    printed_number,
    printed_unit,
    symbols,
    term,
    visible,
)
from auvid.stages.page.colours import (
    AXIS_INKS,
    COMPONENTS,
    MODELS,
    ROLES,
    SPARE,
    Ink,
    inks_of,
    is_model,
    key,
    roles_of,
)
from auvid.stages.page.equations import mathml
from auvid.stages.page.first_screen import AXIS_WORDS, Alert, Summary, anchor
from auvid.stages.page.pictures.svg_plots import lay_out, samples_of
from auvid.stages.presentation import degrees, thin

PLOTTED_SAMPLES, FEWEST_SAMPLES = 82_000, 100
"""Most samples in the plots of a page together (6 to 9 bytes each), and least of a line."""
ROWS_SHOWN = 8
"""Of a longer table of the first screen so many rows stand open."""
VERDICTS = {
    "identified": "good",
    "excited": "good",
    "complete": "good",
    "weak": "fair",
    "truncated": "fair",
    "inseparable": "fair",
    "not excited": "poor",
    "not persistently exciting": "poor",
    "wrong sign": "poor",
    "damaged": "poor",
    "not applicable": "none",
    "met": "good",
    "missed": "poor",
    "measured": "good",
    "held": "good",
    "stable": "good",
    "unstable": "poor",
    "persistently exciting": "good",
}
RATIO = "J/J0"
MEANINGS = {
    **dict(zip("uvw", ("surge speed", "sway speed", "heave speed"), strict=True)),
    **dict(zip("pqr", ("roll rate", "pitch rate", "yaw rate"), strict=True)),
    **{
        axis: f"{word} {'force' if axis in 'XYZ' else 'moment'}"
        for axis, word in AXIS_WORDS.items()
    },
    "phi": "roll",
    "theta": "pitch",
    "psi": "yaw",
    "z": "depth, down",
    **{f"J/J0 {axis}": f"error over force in {word}" for axis, word in AXIS_WORDS.items()},
}
"""Symbol of a panel or column -> its name."""
LONG_TEXT = 200
SHORT_CELL, LONG_CELL = 22, 48
FOLDED_FROM, OPEN_UPTO = 4, 8
DAY = re.compile(r"^\d{4}-\d\d-\d\d")
"""At the begin of a cell: it stays in one line."""
NO_LOGS: Mapping[str, str] = {}


@dataclass(frozen=True)
class Cell:
    """One table cell as displayed: text, value to sort by (None: last), and class."""

    text: str
    sort: float | str | None
    kind: str = ""
    swatch: str = ""

    @property
    def html(self) -> Markup:
        """Return its element; what it sorts by stands there if it is not the text."""
        kind = f' class="{escape(self.kind)}"' if self.kind else ""
        value = str(self.sort)
        same = self.sort is None or value == self.text
        value = "" if same else f' data-v="{escape(visible(value))}"'
        swatch = (
            f'<i class="swatch" style="--c:var({escape(self.swatch)})"></i>' if self.swatch else ""
        )
        words = DAY.sub(r'<span class="day">\g<0></span>', str(escape(visible(self.text))))
        return Markup(f"\n<td{kind}{value}>{swatch}{words}</td>")


@dataclass(frozen=True)
class SectionView:
    """One section under a heading.

    `label` is empty where the heading has one part only. `open`: whether it is unfolded
    at first.
    """

    label: str
    item: str
    anchor: str
    document: Document
    open: bool = True

    @property
    def warnings(self) -> int:
        """Return how many warnings stand in it."""
        return sum(
            block["kind"] == "remark" and block["level"] == "warning"
            for block in self.document["blocks"]
        )

    @property
    def groups(self) -> list[tuple[str, str, list[Mapping[str, Any]]]]:
        """Return title, anchor and blocks of each fold in order; no title: in the open.

        A block has `anchor`, the link to it.
        """
        blocks: list[Mapping[str, Any]] = [
            {**in_degrees(block), "anchor": f"{self.anchor}-{place}"}
            for place, block in enumerate(self.document["blocks"])
        ]
        return [
            (title, f"{members[0]['anchor']}-fold", members)
            for title, members in (
                (title, list(some))
                for title, some in groupby(blocks, key=lambda block: str(block.get("fold", "")))
            )
        ]


@dataclass(frozen=True)
class Chapter:
    """A heading of the report with the sections under it."""

    title: str
    anchor: str
    look_for: str
    parts: tuple[SectionView, ...]
    open: bool = False

    @property
    def folds(self) -> bool:
        """Return whether its parts are many, so that they fold."""
        return len(self.parts) >= FOLDED_FROM

    @property
    def warnings(self) -> int:
        """Return how many warnings stand in all of it."""
        return sum(part.warnings for part in self.parts)


def render(
    title: str,
    subtitle: str,
    notes: str,
    summary: Summary,
    sections: Mapping[str, Document],
    log_of: Mapping[str, str] = NO_LOGS,
    pictures: Sequence[Markup] = (),
    share: float | None = None,
) -> bytes:
    """Return the whole page as UTF-8.

    `sections` is keyed `stage/item`; `notes` are the manifest's remarks on the data.

    `pictures` stand on the first screen.

    `log_of` (segment -> log) is given where a campaign has several logs: their clocks
    differ, so only plots of one log zoom together. `share` of the samples of plots is
    drawn; None: as many as a page has place for.
    """
    script = _text("pictures/plots.js") + _text("templates/page.js")
    page = _environment().get_template("page.html.j2")
    preferred = [model.name for model in summary.models]
    if summary.recommended:
        preferred.insert(0, summary.recommended)
    titles = {model.name: model.title for model in summary.models}
    colours = inks_of(roles_of(sections))
    drawn = drawn_share(sections.values()) if share is None else share
    words = page.render(
        title=title,
        subtitle=subtitle,
        notes=notes,
        summary=summary,
        pictures=pictures,
        axis_words=AXIS_WORDS,
        alerts=alerts(summary, sections),
        chapters=arrange(without_quoted(sections, f"{summary.headline}. {summary.explanation}")),
        style=Markup(_text("templates/style.css") + _text("pictures/pictures.css") + inks(colours)),
        script=Markup(script),
        script_hash=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
        lay_out=lambda block, item: lay_out(
            thinned(block, drawn), preferred, titles, log_of.get(item, ""), colours
        ),
        mathml=lambda latex: Markup(mathml(visible(latex))),
        cells=cells,
        meaning=meaning,
        heat=heat,
        ink_of=lambda name: f"--ink-{key(name) or 'none'}",
        is_model=is_model,
        symbols=symbols,
        verdict_of=verdict_of,
        printed_unit=printed_unit,
        rows_shown=ROWS_SHOWN,
    )
    return words.encode("utf-8")


def drawn_share(sections: Iterable[Document]) -> float:
    """Return the share of the samples of their plots that a page has place for."""
    return min(1.0, PLOTTED_SAMPLES / max(1, plotted_samples(sections)))


def plotted_samples(sections: Iterable[Document]) -> int:
    """Return how many samples the plots of all sections have."""
    return sum(
        len(series["x"])
        for document in sections
        for block in document["blocks"]
        if block["kind"] == "plot"
        for panel in block["panels"]
        for series in panel["series"]
    )


def thinned(block: Mapping[str, Any], share: float) -> Mapping[str, Any]:
    """Return a plot with this share of its samples: the extremes of each bin."""
    if share >= 1.0:
        return block

    def fewer(series: Mapping[str, Any]) -> dict[str, Any]:
        points = max(FEWEST_SAMPLES, int(share * len(series["x"])))
        x, y = thin(*samples_of(series), points)
        return {**series, "x": x, "y": y}

    panels = [
        {**panel, "series": [fewer(series) for series in panel["series"]]}
        for panel in block["panels"]
    ]
    return {**block, "panels": panels}


def without_quoted(sections: Mapping[str, Document], answer: str) -> dict[str, Document]:
    """Return the sections without the findings that the answer quotes."""

    def quoted(block: Mapping[str, Any]) -> bool:
        is_finding = block["kind"] == "remark" and block["level"] == "finding"
        return is_finding and str(block["text"]).lower() in answer.lower()

    return {
        path: {**document, "blocks": [b for b in document["blocks"] if not quoted(b)]}
        for path, document in sections.items()
    }


def arrange(sections: Mapping[str, Document]) -> tuple[Chapter, ...]:
    """Return chapters in order, with sections that belong together under one heading.

    These are sections of one stage that differ only in their item, or that name one
    chapter.

    Of many parts the first is open, of very many none. Chapters of sections that are
    open are open; where no section is, the first chapter.
    """
    ordered = sorted(
        sections.items(), key=lambda pair: (int(pair[1]["order"]), pair[0].partition("/")[0])
    )
    chapters = []
    for (_, stage), pairs in groupby(
        ordered, key=lambda pair: (int(pair[1]["order"]), pair[0].partition("/")[0])
    ):
        named = [(path.partition("/")[2], document) for path, document in pairs]
        common = {str(document.get("chapter") or "") for _, document in named}
        stems = {_stem(str(document["title"]), item) for item, document in named}
        if len(named) > 1 and (len(stems) == 1 or (len(common) == 1 and common != {""})):
            title = stems.pop() if len(stems) == 1 else common.pop()
            labels = [
                item if not document.get("chapter") else str(document["title"])
                for item, document in named
            ]
            opened = [
                len(named) < FOLDED_FROM or (place == 0 and len(named) <= OPEN_UPTO)
                for place in range(len(named))
            ]
            parts = tuple(
                SectionView(label, item, anchor(stage, item), document, unfolded)
                for label, unfolded, (item, document) in zip(labels, opened, named, strict=True)
            )
            is_open = any(document.get("is_open") for _, document in named)
            look_for = str(named[0][1].get("look_for", ""))
            chapters.append(Chapter(title, anchor(stage), look_for, parts, is_open))
            continue
        for item, document in named:
            parts = (SectionView("", item, anchor(stage, item, "part"), document),)
            chapters.append(
                Chapter(
                    str(document["title"]),
                    anchor(stage, item),
                    str(document.get("look_for", "")),
                    parts,
                    bool(document.get("is_open")),
                )
            )
    if chapters and not any(chapter.open for chapter in chapters):
        chapters[0] = replace(chapters[0], open=True)
    return tuple(chapters)


def alerts(summary: Summary, sections: Mapping[str, Document]) -> tuple[Alert, ...]:
    """Return the alerts of a first screen, each with the place that says more.

    That is the one it names, or the block of a section that holds its words.
    """
    chapters = arrange(sections)
    places = {
        str(block["text"]): block["anchor"]
        for chapter in chapters
        for part in chapter.parts
        for _, _, blocks in part.groups
        for block in blocks
        if block["kind"] == "remark"
    }
    anchors = {"models", "coefficients", *(chapter.anchor for chapter in chapters)}
    anchors |= {part.anchor for chapter in chapters for part in chapter.parts}
    return tuple(
        Alert(words, places.get(words, words.place if words.place in anchors else ""), words.level)
        for words in summary.alerts
    )


def _stem(title: str, item: str) -> str:
    """Return a title without its item: `State of train (rts)` -> `State (rts)`.

    `Health of log dive` -> `Health, log by log`.
    """
    if not item:
        return title
    rest = (
        re.sub(rf"[\s:,–-]*(\b(of|in|on|for)\s+)?(?<!\w){re.escape(item)}(?!\w)", "", title).strip()
        or title
    )
    return re.sub(r" of (leg|log)$", r", \1 by \1", rest)


def lead(words: str) -> tuple[str, str]:
    """Split a long text into its first sentence and the rest, which the page folds.

    A short text stays as it is.
    """
    first, _, rest = words.partition(". ")
    return (f"{first}.", rest) if rest and len(words) > LONG_TEXT else (words, "")


def cells(block: Document) -> list[list[Cell]]:
    """Return the rows of a table block as displayed.

    Numbers of a column of like size get the same decimals, so that they line up.

    A column of texts that are all numbers keeps the digits that its stage has chosen,
    and is shown and sorted as numbers.
    """
    names = [str(head["name"]) for head in block["columns"]]
    columns = [[row[index] for row in block["rows"]] for index in range(len(names))]
    decimals = [
        3 if name.startswith(RATIO) else _decimals(column)
        for name, column in zip(names, columns, strict=True)
    ]
    digits = [
        name != "unit" and _all_numeric(column) for name, column in zip(names, columns, strict=True)
    ]
    if "unit" in names:
        own_units = [not str(head.get("unit", "")) for head in block["columns"]]
        by_row = [_decimals_of_row(row, names) for row in block["rows"]]
    else:
        own_units, by_row = [False] * len(names), [None] * len(block["rows"])
    return [
        [
            _cell(value, name, of_row if of_unit else places, text)
            for value, name, places, text, of_unit in zip(
                row, names, decimals, digits, own_units, strict=True
            )
        ]
        for row, of_row in zip(block["rows"], by_row, strict=True)
    ]


def _decimals_of_row(row: Sequence[Any], names: Sequence[str]) -> int | None:
    """Return the decimals of a row with a unit of its own: two figures of its interval.

    None without an interval, or with one of no width.
    """
    figures = {
        name: float(value)
        for name, value in zip(names, row, strict=True)
        if isinstance(value, int | float) and not isinstance(value, bool)
    }
    widths = [value for name, value in figures.items() if name.startswith("± 95 %")]
    widths += [
        (figures[high] - figures[low]) / 2.0
        for low, high in (("from", "to"), ("low", "high"))
        if low in figures and high in figures
    ]
    value = next(iter(figures.values()), 0.0)
    return places_of_error(widths[0], value) if widths and widths[0] > 0.0 else None


def _all_numeric(column: Sequence[Any]) -> bool:
    texts = [value for value in column if value not in (None, "")]
    return bool(texts) and all(isinstance(value, str) and is_numeric(value) for value in texts)


def _decimals(column: Sequence[Any]) -> int | None:
    """Return the decimals that show four figures of the largest number.

    None where the sizes differ too much, or all are integers.
    """
    sizes = [
        abs(value)
        for value in column
        if isinstance(value, int | float) and not isinstance(value, bool) and value
    ]
    if not any(isinstance(value, float) and value != int(value) for value in sizes) or max(
        sizes
    ) > 300 * min(sizes):
        return None
    most = 3 - math.floor(math.log10(max(sizes)))
    if most > 6:
        return None
    exact = (places for places in range(most) if all(round(x, places) == x for x in sizes))
    return next(exact, max(most, 0))


def _cell(value: Any, column: str, decimals: int | None, digits: bool) -> Cell:
    if value is None or (digits and value == ""):
        return Cell("–", None, "empty")
    if digits:
        return Cell(printed_number(value), float(value), "number")
    if isinstance(value, bool):
        return Cell("yes" if value else "no", str(value))
    if isinstance(value, int | float):
        kind = f"number {heat(float(value))}" if column.startswith(RATIO) else "number"
        words = number(value) if decimals is None else fixed(value, decimals).replace("-", "−")
        return Cell(words, value, kind)
    words = str(value)
    if column == "term":
        return Cell(term(words), words, "term")
    if column == "unit":
        return Cell("" if words == "1" else printed_unit(words).replace(" ", "\u00a0"), words)
    verdict = verdict_of(words)
    kind = (
        f"verdict {verdict}"
        if verdict
        else "long"
        if len(words) > LONG_CELL
        else "words"
        if len(words) > SHORT_CELL
        else ""
    )
    named = column == "model" and is_model(words)
    return Cell(symbols(words), words, kind, f"--ink-{key(words)}" if named else "")


def in_degrees(block: Document) -> Document:
    """Return a plot or table with its angles and rates in degrees.

    In a table these are columns with such a unit, and rows of one whose column `unit`
    has it: all numbers of other columns without a unit there.
    """
    if block["kind"] == "plot":
        factors = [degrees(str(panel["unit"])) for panel in block["panels"]]
        panels = [
            {
                **panel,
                "unit": unit,
                "series": [
                    {**line, "y": [None if y is None else factor * y for y in line["y"]]}
                    for line in panel["series"]
                ],
            }
            if factor != 1.0
            else panel
            for panel, (factor, unit) in zip(block["panels"], factors, strict=True)
        ]
        return {**block, "panels": panels}
    if block["kind"] != "table":
        return block
    heads = block["columns"]
    units = [degrees(str(head.get("unit", ""))) for head in heads]
    names = [str(head["name"]) for head in heads]
    column = names.index("unit") if "unit" in names else None
    rows = []
    for row in block["rows"]:
        own, unit = (1.0, "") if column is None else degrees(str(row[column]))
        cells_of_row = [
            value * (factor if head.get("unit") else own)
            if isinstance(value, float)
            else unit
            if place == column and own != 1.0
            else value
            for place, (value, head, (factor, _)) in enumerate(zip(row, heads, units, strict=True))
        ]
        rows.append(cells_of_row)
    heads = [{**head, "unit": unit} for head, (_, unit) in zip(heads, units, strict=True)]
    return {**block, "columns": heads, "rows": rows}


def meaning(symbol: str) -> str:
    """Return what a symbol stands for: `surge speed` of u; empty for other words."""
    return MEANINGS.get(symbol, "")


@lru_cache(maxsize=4096)
def verdict_of(words: str) -> str:
    """The class of a verdict: good, fair, poor or none; empty for other words."""
    return VERDICTS.get(words) or VERDICTS.get(words.partition(" from ")[0], "")


def heat(ratio: float | None) -> str:
    """Return the class of a J/J0 figure: h0 (best) to h4.

    h4 is 1 or more: no better than predicting no force.
    """
    if ratio is None:
        return ""
    return f"h{sum(ratio >= edge for edge in (0.25, 0.5, 0.75, 1.0))}"


def inks(own_inks: Mapping[str, Ink]) -> str:
    """CSS variables of all colours, on paper and on a dark screen."""
    by_name = {**AXIS_INKS, **MODELS, **COMPONENTS, **ROLES, "none": Ink(*SPARE[0]), **own_inks}
    light = ";".join(f"--ink-{name}:{item.light}" for name, item in sorted(by_name.items()))
    dark = ";".join(f"--ink-{name}:{item.dark}" for name, item in sorted(by_name.items()))
    system = (
        f"@media screen and (prefers-color-scheme:dark){{:root:not([data-theme=light]){{{dark}}}}}"
    )
    return f":root{{{light}}}\n{system}\n@media screen{{:root[data-theme=dark]{{{dark}}}}}\n"


@cache
def _text(name: str) -> str:
    return (resources.files(__package__) / name).read_text(encoding="utf-8")


@cache
def _environment() -> jinja2.Environment:
    names = ("page.html.j2", "blocks.html.j2", "how_to_read.html.j2")
    templates = {name: _text(f"templates/{name}") for name in names}
    return jinja2.Environment(
        loader=jinja2.DictLoader(templates),
        autoescape=True,
        finalize=visible,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
