"""The first screen as text for the terminal."""

from __future__ import annotations

from textwrap import wrap

from auvid.stages.page.first_screen import Summary
from auvid.stages.page.html import lead

WIDTH = 79
MARGIN = "  "


def answer_text(summary: Summary) -> str:
    """Return verdict, uses, what was identified and what is unknown, wrapped.

    Of a long remark the first sentence. Warnings, findings of logs, and figures of
    bench and control stages are printed by their own tables; what may make the answer
    wrong stands under the verdict, too.
    """
    lines = [summary.headline]
    for words in summary.log_findings:
        if words.misleads:
            lines += _wrapped(f"But first: {lead(words)[0]}")
    lines += _wrapped(f"{summary.explanation} {summary.rule}")
    lines += [
        line
        for use in summary.uses
        for line in _item(f"{use.label}: {use.axes}" if use.axes else use.label, use.reason)
    ]
    if summary.identified:
        lines += [
            "",
            "identified (± is 95 %, by the parts in brackets together):",
        ]
        for entry in summary.identified:
            lines += _item(entry.label, "; ".join(entry.figures))
    if summary.missing:
        lines += ["", "missing or uncertain:"]
        lines += [line for words in summary.missing for line in _bullet(lead(words)[0])]
    return "\n".join(lines) + "\n"


def _wrapped(words: str, indent: str = MARGIN) -> list[str]:
    return wrap(
        words,
        WIDTH,
        initial_indent=indent,
        subsequent_indent=indent,
        break_on_hyphens=False,
    )


def _item(label: str, words: str) -> list[str]:
    return wrap(f"{label}: {words}", WIDTH, initial_indent=MARGIN, subsequent_indent=2 * MARGIN)


def _bullet(words: str) -> list[str]:
    return wrap(words, WIDTH, initial_indent="- ", subsequent_indent=MARGIN)
