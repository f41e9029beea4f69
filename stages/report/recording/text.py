"""The texts of a recording as Markdown: the first screen, and tables and remarks."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any

from auvid.data_schemas.records.motion import SegmentRecord
from auvid.stages.base import Document
from auvid.stages.number_format import number, visible
from auvid.stages.page.first_screen import AXIS_WORDS, Summary

MOST_ROWS = 60
MARKS = {"finding": "✓", "note": "·", "warning": "!"}


def markdown(
    title: str, summary: Summary, segments: Mapping[str, SegmentRecord], starts: Mapping[str, float]
) -> str:
    """The first screen; `starts`: where each segment begins on the timeline, in s."""
    lines = [f"# {title}", f"**{summary.headline}.** {summary.explanation}", ""]
    lines += [*(f"- {use.label}: {use.axes or use.reason}" for use in summary.uses), ""]
    if summary.identified:
        lines += [
            "## What was identified",
            *(
                f"- {item.label}: {'; '.join(item.figures)}. {item.note}"
                for item in summary.identified
            ),
            "",
        ]
    if summary.figures:
        parts: dict[str, list[list[str]]] = {}
        for item in summary.figures:
            parts.setdefault(item.part, []).append(
                [item.quantity, item.value, item.interval, item.verdict]
            )
        for part, rows in parts.items():
            kept = [column for column in range(4) if column < 2 or any(row[column] for row in rows)]
            heads = ["figure", "value", "interval", "verdict"]
            table = table_lines(
                [heads[column] for column in kept],
                [[row[column] for column in kept] for row in rows],
            )
            lines += [*([f"### {part}", ""] if len(parts) > 1 else []), *table, ""]
    if summary.bounds:
        lines += [
            f"## Compared with the {summary.bounds_on}",
            *(f"- {words}" for words in summary.bounds),
            "",
        ]
    if summary.models:
        heads = [f"J/J0, {summary.judged_on}", "all", *AXIS_WORDS]
        rows = []
        models = sorted(summary.models, key=lambda model: model.name != summary.recommended)
        for model in models:
            ratios = [
                merit.validation if summary.judged_on == "validation" else merit.training
                for merit in model.axes.values()
            ]
            cells = [
                "–" if ratio is None else f"**{ratio:.2f}**" if ratio > 1 else f"{ratio:.2f}"
                for ratio in ratios
            ]
            words = " (recommended)" if model.name == summary.recommended else ""
            rows.append([model.title + words, *cells])
        lines += [
            *table_lines(heads, rows),
            "",
            "Bold: above 1, no better than predicting no force.",
            "",
        ]
    missing = (*summary.log_findings, *summary.missing)
    if missing:
        lines += [
            "## What is missing or uncertain",
            *(f"- {words}" for words in missing),
            "",
        ]
    if warnings := summary.further_warnings:
        lines += ["## Warnings", *(f"- {words}" for words in warnings), ""]
    if segments:
        lines += [
            "## Segments",
            *(_segment_line(name, item, starts[name]) for name, item in segments.items()),
        ]
    return str(visible("\n".join(lines)))


def stage_texts(sections: Mapping[str, Document]) -> dict[str, str]:
    """Return the sections of each stage as Markdown.

    Texts, remarks and tables; plots stand in tabs of their own.
    """
    texts: dict[str, list[str]] = defaultdict(list)
    for name, document in sorted(sections.items(), key=lambda pair: int(pair[1]["order"])):
        lines = [line for block in document["blocks"] for line in _block(block)]
        if lines:
            texts[name.partition("/")[0]] += [f"## {document['title']}", "", *lines]
    return {stage: "\n".join(lines) for stage, lines in texts.items()}


def _block(block: Document) -> list[str]:
    if block["kind"] == "text":
        return [str(block["text"]), ""]
    if block["kind"] == "remark":
        return [f"- {MARKS[block['level']]} {block['text']}", ""]
    if block["kind"] != "table":
        return []
    heads = [
        f"{head['name']} [{head['unit']}]" if head["unit"] else str(head["name"])
        for head in block["columns"]
    ]
    rows = [[_cell(cell) for cell in row] for row in block["rows"][:MOST_ROWS]]
    more = len(block["rows"]) - len(rows)
    tail = [f"and {more} rows more, in the report"] if more else []
    return [
        f"**{block['title']}**",
        "",
        *table_lines(heads, rows),
        "",
        *tail,
        str(block.get("note") or ""),
        "",
    ]


def table_lines(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Return a Markdown table."""
    return [f"| {' | '.join(map(_plain, row))} |" for row in (heads, ["---"] * len(heads), *rows)]


def _plain(words: str) -> str:
    return str(visible(words)).replace("|", "\\|").replace("\n", " ")


def _cell(value: Any) -> str:
    if value is None:
        return "–"
    if isinstance(value, bool) or not isinstance(value, int | float):
        return str(value)
    return number(value)


def _segment_line(name: str, item: SegmentRecord, start: float) -> str:
    return f"- {name}: {item.use}, {start:.1f} to {start + item.duration_s:.1f} s (log {item.log})"
