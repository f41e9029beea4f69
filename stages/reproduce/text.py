"""The first screen and the sections of a reproduction, with the text of its campaign.

The campaign gives the text as a template: Jinja over Markdown, in which `# NAME` or
`# NAME: TITLE` begins a part. A paragraph is plain text, an equation (`$$ LATEX $$
MEANING`), a remark (`> finding: TEXT`), or tables by name (`[[plan_tables]]`).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import jinja2
from jinja2.sandbox import ImmutableSandboxedEnvironment

from auvid.data_schemas.errors import CampaignError, nearest
from auvid.stages.page.first_screen import Alert, Fact, Summary, anchor
from auvid.stages.presentation import Block, equation, remark, section, text
from auvid.stages.reference_check import count_bounds, count_met
from auvid.stages.reproduce.content import ReproductionContent
from auvid.stages.reproduce.tables import (
    check_table,
    error_tables,
    force_tables,
    plan_tables,
    print_errors,
    repeats,
    turn_force_table,
    turn_term_table,
    variant_titles,
)

TABLES: dict[str, Callable[[ReproductionContent], Iterable[Block]]] = {
    "plan_tables": plan_tables,
    "turn_force_table": lambda content: [turn_force_table(content)],
    "turn_term_table": lambda content: [turn_term_table(content)],
}
"""Tables that the text names."""
SECTIONS = {"why": 2, "chosen": 8}
"""Parts that become sections of the page, and their order there."""
SENTENCES = ("headline", "explanation", "limits", "table_notes")
PART = re.compile(r"^# *(\w+)(?: *: *(.*))?$", re.MULTILINE)


@dataclass(frozen=True)
class TextPart:
    """One part of the text of a campaign."""

    title: str
    paragraphs: tuple[str, ...]

    def blocks(self, content: ReproductionContent) -> list[Block]:
        """Return the paragraphs as blocks of a section."""
        blocks: list[Block] = []
        for words in self.paragraphs:
            if formula := re.fullmatch(r"\$\$(.+)\$\$(.*)", words):
                blocks.append(equation(formula[1].strip(), formula[2].strip()))
            elif note := re.fullmatch(r"> *(finding|note|warning): *(.+)", words):
                blocks.append(remark(note[2], note[1]))  # type: ignore[arg-type]
            elif named := re.fullmatch(r"\[\[(\w+)\]\]", words):
                if named[1] not in TABLES:
                    raise _fault("no such table", named[1], TABLES)
                blocks += TABLES[named[1]](content)
            else:
                blocks.append(text(words))
        return blocks


NO_TEXT = TextPart("", ())


def campaign_text(content: ReproductionContent) -> dict[str, TextPart]:
    """Fill in the template of the campaign and return its parts by name.

    Raises `CampaignError` where the template is not valid.
    """
    published_label, published = content.compared("published")
    corrected_label, corrected = content.compared("corrected")
    excess, expected = content.transport
    environment = ImmutableSandboxedEnvironment(
        undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    try:
        words = environment.from_string(str(content.document.get("text") or "")).render(
            content=content,
            published=published,
            published_label=published_label,
            corrected=corrected,
            corrected_label=corrected_label,
            excess_kg=excess,
            expected_kg=expected,
            agrees=_agrees(content),
            use=_judged_on(content),
        )
    except jinja2.TemplateError as fault:
        row = getattr(fault, "lineno", None)
        raise CampaignError(
            f"the text cannot be filled in: {fault}", field="text", row=row
        ) from None
    _, *pieces = PART.split(words)
    parts: dict[str, TextPart] = {}
    for name, title, body in zip(pieces[::3], pieces[1::3], pieces[2::3], strict=True):
        if name not in (*SENTENCES, *SECTIONS):
            raise _fault("no such part", name, (*SENTENCES, *SECTIONS))
        paragraphs = (" ".join(part.split()) for part in re.split(r"\n\s*\n", body))
        parts[name] = TextPart(title or "", tuple(filter(None, paragraphs)))
    return parts


def _fault(message: str, name: str, allowed: Iterable[str]) -> CampaignError:
    names = tuple(allowed)
    return CampaignError(
        f"{message} in the text",
        field="text",
        value=name,
        allowed=names,
        remedy=nearest(name, names),
    )


def _agrees(content: ReproductionContent) -> bool:
    """Return whether the published procedure meets all its bounds on the first plan."""
    place = (content.plan, content.document["compared"]["published"])
    own = [item.check for item in content.checks if (item.plan, item.variant) == place]
    return bool(own) and all(check.met for check in own)


def _judged_on(content: ReproductionContent) -> str:
    return "validation" if "validation" in content.compared("published")[1].j0 else "training"


def summary(content: ReproductionContent) -> Summary:
    """Return the first screen."""
    parts = campaign_text(content)
    agrees, missed = _agrees(content), content.missed
    level = "fair"
    if agrees:
        level = "good"
    if missed:
        level = "poor"
    outcome = "comes out" if agrees else "does not come out"
    headline = parts.get("headline", TextPart("", (f"The published table {outcome}",)))
    return Summary(
        level=level,  # type: ignore[arg-type]
        headline=" ".join(headline.paragraphs),
        explanation=" ".join(parts.get("explanation", NO_TEXT).paragraphs),
        recommended=None,
        judged_on=_judged_on(content),
        facts=_facts(content),
        models=(),
        identified=(),
        missing=tuple(
            Alert(words, anchor("bounds"))
            for words in (*parts.get("limits", NO_TEXT).paragraphs, *_accepted_misses(content))
        ),
        warnings=tuple(
            Alert(
                f"{item.check.quantity}: {item.check.shortfall} ({item.plan}, {item.variant})",
                anchor("bounds"),
                "poor",
            )
            for item in missed
        ),
    )


def _facts(content: ReproductionContent) -> tuple[Fact, ...]:
    first, published = content.compared("published")
    second, corrected = content.compared("corrected")
    checks = [item.check for item in content.checks]
    tests = [check for check in checks if check.evidence == "method"]
    accepted = sum(check.met is False and not check.failed for check in checks)
    return (
        Fact(
            "bounds that test the method",
            count_met(tests),
            f"of {len(checks)} bounds {accepted} are missed for an accepted reason"
            if accepted
            else count_bounds(checks),
        ),
        Fact(
            f"error of the force in {first}",
            f"{published.total_force_error:.1f}",
            f"RMS over six axes; the true force has {published.total_force:.1f}",
        ),
        Fact(
            f"error of the force in {second}",
            f"{corrected.total_force_error:.2f}",
            "with the transport term removed",
        ),
        Fact(
            "sway force per u r",
            f"{published.turn:.0f} kg",
            f"{first}; {corrected.turn:.0f} kg with {second}",
        ),
    )


def _accepted_misses(content: ReproductionContent) -> list[str]:
    """Return a sentence per accepted reason on the bounds that it excuses."""
    missed: dict[str, dict[str, None]] = {}
    for item in content.checks:
        if item.check.met is False and item.check.accepted_reason:
            where = f"{content.label(item.variant)} on plan {item.plan}"
            missed.setdefault(item.check.accepted_reason, {})[where] = None
    return [f"Bounds missed by {', '.join(where)}: {reason}." for reason, where in missed.items()]


def sections(content: ReproductionContent) -> dict[str, dict[str, Any]]:
    """Return the sections before the figures, by name."""
    parts = campaign_text(content)
    document = {
        name: section(parts[name].title, parts[name].blocks(content), order=order)
        for name, order in SECTIONS.items()
        if name in parts
    }
    document["tables"] = section(
        "Tables 5.1 and 5.2 beside the twin's",
        [
            variant_titles(content),
            *error_tables(content, content.plan, printed=True),
            *repeats(content),
            *print_errors(content),
            *parts.get("table_notes", NO_TEXT).blocks(content),
        ],
        order=3,
        look_for=(
            f"Column {content.compared('published')[0]} against the thesis; then the last two"
            " models where the force is right."
        ),
    )
    document["bounds"] = section("Bounds", [check_table(content)], order=4)
    document["force"] = section(
        "Errors of the force and the motion", list(force_tables(content)), order=5
    )
    for index, entry in enumerate(content.document["plans"]):
        plan = entry["id"]
        if plan not in (content.plan, *content.repeated) and content.of(plan):
            words = text(f"Plan {plan}: {entry['meaning']}.")
            document[f"plan{index}"] = section(
                f"The same tables on plan {plan}",
                [words, *error_tables(content, plan, printed=False)],
                order=6,
            )
    return document
