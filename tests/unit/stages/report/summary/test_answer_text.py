"""The answer on the terminal: what for, with what uncertainty, what is unknown."""

from __future__ import annotations

import re
from dataclasses import replace

from auvid.stages.page.first_screen import Alert, CoefficientLine, Summary, Use
from auvid.stages.report.summary.answer_text import WIDTH, answer_text

SUMMARY = Summary(
    level="good",
    headline="Symmetric: use it to predict forces",
    explanation="It explains the force. " * 10,
    recommended="symmetric",
    judged_on="validation",
    facts=(),
    models=(),
    identified=(
        CoefficientLine("surge damping", ("X_u = -57.9 (95 %: -59.3 to -56.5)",), "Note."),
    ),
    missing=("Roll is unknown.",),
    warnings=("A gap.",),
    uses=(Use("Forces", "surge and yaw", "below the force"), Use("Within", "", "u 0 to 1")),
    log_findings=(Alert("log 'dive': hardly any motion"),),
)


def test_the_answer_has_uses_intervals_and_what_is_unknown() -> None:
    lines = answer_text(SUMMARY).splitlines()
    assert lines[0] == SUMMARY.headline
    assert "  Forces: surge and yaw: below the force" in lines
    assert "  Within: u 0 to 1" in lines
    assert "  surge damping: X_u = -57.9 (95 %: -59.3 to -56.5)" in lines
    assert lines[-1] == "- Roll is unknown."
    assert max(map(len, lines)) <= WIDTH
    long = replace(SUMMARY, explanation=" ".join(["depth rates of held-out glides"] * 9))
    assert not re.search(r"-$", answer_text(long), re.MULTILINE), "words stay whole"


def test_what_the_terminal_has_printed_before_is_not_repeated() -> None:
    words = answer_text(SUMMARY)
    assert "A gap." not in words
    assert "hardly any motion" not in words
    turned = Alert("The velocity log sits elsewhere.", misleads=True)
    lines = answer_text(replace(SUMMARY, log_findings=(turned,))).splitlines()
    assert lines[:2] == [SUMMARY.headline, "  But first: The velocity log sits elsewhere."]
    bare = replace(SUMMARY, identified=(), missing=())
    assert "identified" not in answer_text(bare)
    assert "missing" not in answer_text(bare)
