"""The README beside exported files: use, convention, what is lost."""

from __future__ import annotations

from collections.abc import Sequence

from auvid.data_schemas.records.model_file import AS_PUBLISHED, ModelFile
from auvid.export.exported import Exported, Target
from auvid.export.losses import ExportLosses
from auvid.export.text import one_line
from auvid.hydro.arrays import AXES


def readme(
    model: ModelFile,
    target: Target,
    exported: Exported,
    losses: ExportLosses,
    *,
    name: str,
    head: Sequence[str],
) -> str:
    """Return the page in Markdown.

    head: what each file says first of the model: origin, use, behaviour, flown range.
    """
    judged = "all, since no validation leg judges it" if model.use.axes is None else None
    parts = [
        f"# {name}: {one_line(model.title)} for {target.name}",
        f"{target.title}. Files: {', '.join(f'`{file}`' for file in exported.files)}.",
        "## The model",
        "\n".join(f"- {line}" for line in (*head, f"Why this one: {model.use.rule}.")),
        "## How to use it",
        exported.usage.strip(),
        "## Convention",
        exported.convention,
        "## What is lost",
        loss_table(losses),
    ]
    if losses.notes:
        parts.append("\n".join(f"- {note}" for note in losses.notes))
    if losses.rows:
        parts.append(
            f"RMS force over velocities spread evenly {losses.within}, in N and N m; the last"
            " row is the model's own viscous force."
            f" Axes that the model is usable for: {judged or ', '.join(losses.judged)}."
        )
    parts += ["## Where it comes from", _origin(model, target)]
    return "\n\n".join(parts) + "\n"


def loss_table(losses: ExportLosses) -> str:
    """Return the losses as a table in Markdown."""
    if not losses.rows:
        return "Nothing: the files hold every force of the model."
    head = ["what is lost", "why", *AXES]
    rows = [[row.what, row.why, *map(three_digits, row.rms)] for row in losses.rows]
    rows.append(["**all together**", "", *map(three_digits, losses.total_rms)])
    shares = [percent(share) for share in losses.shares.values()]
    rows.append(["share of the viscous force", "", *shares])
    rows.append(["viscous force of the model", "", *map(three_digits, losses.viscous_rms)])
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(_cell(cell) for cell in line)} |" for line in lines)


def percent(share: float) -> str:
    """Return a share in per cent, "-" for one of nothing.

    >>> percent(0.0308), percent(1.45), percent(float("inf"))
    ('3.08 %', '145 %', '-')
    """
    if share == float("inf"):
        return "-"
    return f"{100.0 * share:.3g} %" if share < 10.0 else f"{100.0 * share:.0f} %"


def three_digits(value: float) -> str:
    """Return a number as the table of losses prints it."""
    return f"{value:.3g}"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def _origin(model: ModelFile, target: Target) -> str:
    origin = model.origin
    files = [
        f"- log {log}: {', '.join(f'{k} {v}' for k, v in item.items() if v is not None)}"
        for log, items in origin.logs.items()
        for item in items
    ]
    campaign = "" if model.method == AS_PUBLISHED else f", campaign {origin.campaign}"
    return "\n".join(
        [
            f"- auvid {model.auvid}{campaign}, vehicle {model.vehicle.title}"
            f" ({origin.vehicle_hash})",
            f"- model {model.name}: {model.source}; fitted by {model.method}",
            *files,
            f"- formula of the target: {target.source}",
            f"- assumed values of the vehicle: {len(model.assumed)}, listed by the target json",
            *(
                f"- {word}: {one_line(text)}"
                for word, text in (
                    ("remarks on the vehicle", model.vehicle.notes),
                    ("licence of its numbers", model.vehicle.licence),
                )
                if text
            ),
        ]
    )
