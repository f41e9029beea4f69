"""What a user sees when a run is over: errors, losses, warnings and result files."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from math import inf, isnan
from pathlib import Path
from typing import Any

from auvid.data_schemas.checks import log_findings
from auvid.data_schemas.documents.published_values import reference_words
from auvid.pipeline.execution.runner import Run
from auvid.pipeline.graph import ONCE, AnyStage
from auvid.pipeline.output import OUTPUT
from auvid.pipeline.terminal import path_from_here, plain, table
from auvid.stages.free_run import PERSISTENCE
from auvid.stages.number_format import fixed, significant
from auvid.stages.page.campaign_sections import shared_data
from auvid.stages.reference_check import JUDGED, ReferenceCheck, check_rows, count_bounds

RESULTS = {
    "report_html": "report",
    "error_table": "error table",
    "tables_text": "tables as text",
    "model_file": "model files",
    "recording": "recording",
}
MAX_LINES = 20


def print_summary(run: Run) -> None:
    """Print the answer, errors in short, findings and warnings, and the result files.

    With --quiet without findings and warnings; with --verbose these are not cut.
    """
    for text in run.documents("answer"):
        print("\n" + "\n".join(map(plain, text.decode("utf-8").splitlines())))
    models = [
        (
            row["model"],
            f"{row['identified']} of {row['coefficients']}" if row["coefficients"] else "",
            fixed(row["training"], 3),
            fixed(row["validation"], 3),
        )
        for row in error_rows(run)
    ]
    if models:
        print()
    heads = ("model", "identified", "training", "validation")
    table(heads, models, title="J/J0 (1 explains nothing), best first")
    errors = [
        (quantity, "  ".join(f"{axis} {significant(value, 2)}" for axis, value in parts), unit)
        for quantity, unit, parts in truth_rows(run)
    ]
    if errors:
        print()
    title = "estimate against truth (RMS error over all legs)"
    table(("quantity", "by axis", "unit"), errors, title=title)
    checks = bounds(run)
    if checks:
        print_checks((), [((), check) for check in checks])
    rows = comparison_rows(run)
    compared = _compared(rows)
    if any(check.met is not None for check in compared):
        words = reference_words(row["printed"] is row["corrected"] is None for row in rows)
        print(
            f"\nbounds on {words}: {count_bounds(compared)}; auvid reproduce"
            f" {run.campaign.name} prints them"
        )
    if not OUTPUT.quiet:
        _print_remarks(run)
    files = result_files(run)
    if files:
        print()
    for name, path in files.items():
        print(f"{name + ':':<16}{path_from_here(path)}")
    name = run.campaign.name
    if "report" in files:
        inspect = f"; auvid inspect {name}" if "recording" in files else ""
        print(f"{'to look at it:':<16}auvid report {name} --open{inspect}")


def _print_remarks(run: Run) -> None:
    for title, lines in (
        (f"findings in the logs, all in auvid check {run.campaign.name}", findings(run)),
        ("lost", losses(run)),
        ("warnings", warnings(run)),
    ):
        if lines:
            print(f"\n{title} ({len(lines)}):")
            print("\n".join(f"  {plain(line)}" for line in shortened(lines)))


def summary_document(run: Run) -> dict[str, Any]:
    """Return the same as a document: verdict, errors, remarks, and the result files."""
    texts = [text.decode("utf-8") for text in run.documents("answer")]
    rankings = list(run.documents("ranking"))
    verdict = None
    if texts:
        sentence, _, rest = texts[0].partition("\n")
        verdict = {"sentence": sentence, "text": rest}
        for ranking in rankings:
            verdict |= {
                "model": ranking.choice,
                "rule": ranking.rule,
                "usable": ranking.usable and ranking.usable.model_dump(mode="json"),
            }
    return {
        "campaign": run.campaign.name,
        "verdict": verdict,
        "models": error_rows(run),
        "free_runs": free_run_rows(run),
        "truth": [
            {"quantity": quantity, "unit": unit, "rms_error": dict(parts)}
            for quantity, unit, parts in truth_rows(run)
        ],
        "bounds": [check.document for check in bounds(run)],
        "findings": findings(run),
        "lost": losses(run),
        "warnings": warnings(run),
        "files": result_files(run),
    }


def bound_missed(run: Run, stages: Sequence[AnyStage]) -> bool:
    """Return whether a bound of the campaign is missed by stages that were run."""
    names = {stage.name for stage in stages}
    checked = any(port.stage.name in names for port in run.graph.producers("trust_checks"))
    return checked and not all(check.met for check in bounds(run))


def result_files(run: Run) -> dict[str, Path]:
    """Return where the results are: what they are -> file, or folder of several."""
    files: dict[str, Path] = {}
    for schema_name, name in RESULTS.items():
        for port in run.graph.producers(schema_name):
            artefacts = list(run.artefacts_of(port, ONCE).values())
            if artefacts:
                key = name if name not in files else f"{name}, {port.stage.name}"
                files[key] = artefacts[0].path.parent if port.many else artefacts[0].path
    return files


def free_run_rows(run: Run) -> list[dict[str, Any]]:
    """Return errors and fits in % of free runs with all axes simulated.

    Of the recommended model, and of the guess of no change.
    """
    named = {PERSISTENCE, *(ranking.choice for ranking in run.documents("ranking"))}
    return [
        {
            name: None if isinstance(value, float) and isnan(value) else value
            for name, value in row.items()
        }
        for rows in run.documents("free_run")
        for row in rows.to_pylist()
        if row["model"] in named and not row["as_measured"]
    ]


def error_rows(run: Run) -> list[dict[str, Any]]:
    """Return per model how many coefficients are identified, and J/J0 on both uses.

    Over all axes and legs; the recommended model first, then by J/J0 on validation.
    """
    rankings = list(run.documents("ranking"))
    merits = {item.name: item.axes["all"] for ranking in rankings for item in ranking.models}
    chosen = {ranking.choice for ranking in rankings}
    rows: dict[str, dict[str, Any]] = {}
    for artefact in run.documents("error_table"):
        for row in artefact.to_pylist():
            if row["axis"] == row["leg"] == "all":
                rows.setdefault(row["model"], {})[row["use"]] = row["ratio"]
    listed = [
        {
            "model": model,
            "recommended": model in chosen,
            "identified": merits[model].identified if model in merits else None,
            "coefficients": merits[model].coefficients if model in merits else None,
            "training": by_use.get("training"),
            "validation": by_use.get("validation"),
        }
        for model, by_use in rows.items()
    ]
    return sorted(listed, key=lambda row: (not row["recommended"], _ratio(row["validation"])))


def _ratio(value: float | None) -> float:
    return inf if value is None or isnan(value) else value


def truth_rows(run: Run) -> list[tuple[str, str, list[tuple[str, float]]]]:
    """Return quantity, unit, and RMS error per axis of a twin's estimates.

    Over all legs.

    Models have their own table.
    """
    by_quantity: dict[tuple[str, str], list[tuple[str, float]]] = {}
    for rows in run.documents("truth_errors"):
        for row in rows.to_pylist():
            if row["use"] == row["segment"] == "all" and not row["quantity"].startswith("model "):
                by_quantity.setdefault((row["quantity"], row["unit"]), []).append(
                    (row["axis"], row["rms_error"])
                )
    return [(quantity, unit, parts) for (quantity, unit), parts in by_quantity.items()]


def bounds(run: Run) -> list[ReferenceCheck]:
    """Return the bounds of a twin campaign with what was measured (`trust_checks`)."""
    return [
        ReferenceCheck(
            row["figure"],
            row["value"],
            row["unit"],
            high=row["bound"],
            evidence=row["evidence"],
            evidence_reason=row["reason"],
        )
        for table in run.documents("trust_checks")
        for row in table.to_pylist()
    ]


def comparison_rows(run: Run) -> list[dict[str, Any]]:
    """Return printed values, those of the run, and their bounds (`comparison`)."""
    return [row for table in run.documents("comparison") for row in table.to_pylist()]


def _compared(rows: Sequence[Mapping[str, Any]]) -> list[ReferenceCheck]:
    """Return the checks of rows of `comparison`, which few kinds of campaigns have."""
    if not rows:
        return []
    from auvid.stages.check_published.presentation import check_of

    return [check_of(row) for row in rows]


def health_of(run: Run) -> dict[str, dict[str, Any]]:
    """Return the health of every log by its id."""
    return dict(run.loaded("health"))


def findings(run: Run) -> list[str]:
    """Return the findings of the logs that the campaign does not accept."""
    return list(map(str, log_findings(run.campaign.document, health_of(run))))


def losses(run: Run) -> list[str]:
    """Return what of the logs did not reach the results: damage, rejected samples."""
    rows = []
    for log, info in run.loaded("log_info"):
        if info.status != "complete":
            skipped = sum(part.bytes for file in info.files for part in file.skipped)
            seconds = sum(file.seconds_lost for file in info.files)
            rows.append(
                f"log '{log}' is {info.status}: {skipped} bytes skipped, {seconds:.1f} s lost"
            )
    for log, dropped in run.loaded("dropped"):
        counts: Counter[str] = Counter()
        for row in (
            row for row in dropped.to_pylist() if row.get("bytes") is None
        ):  # bytes are in the line above
            counts[f"{row['stream']}: {row['reason']}"] += row["count"]
        rows += [
            f"log '{log}': {count} rejected ({reason})" for reason, count in counts.items() if count
        ]
    return rows


def warnings(run: Run) -> list[str]:
    """Return warnings of sections and Python, notes on segments, legs without any."""
    counts: Counter[str] = Counter()
    for document in run.documents("section"):
        counts.update(
            block["text"]
            for block in document["blocks"]
            if block["kind"] == "remark" and block["level"] == "warning"
        )
    segments = {segment.id: segment for segment in run.documents("segment")}
    counts.update(
        f"{name}: {words}" for name, segment in segments.items() for words in segment.notes
    )
    counts.update(shared_data(segments))
    for stage in run.graph.stages:
        manifest = run.manifests[stage.name]
        for item, record in manifest.records.items():
            counts.update(
                {
                    f"{stage.name}, {item}: {words}": count
                    for words, count in record.warnings.items()
                }
            )
            if stage.yields and not manifest.keys(item):
                counts[f"{stage.name}: leg '{item}' gave no segment"] += 1
    return [words if count == 1 else f"{words} ({count} times)" for words, count in counts.items()]


def print_checks(
    labels: Sequence[str],
    checks: Sequence[tuple[Sequence[object], ReferenceCheck]],
    *,
    missed_only: bool = False,
) -> None:
    """Print how many bounds are met, and each check after its labels."""
    print(f"\nbounds: {count_bounds([check for _, check in checks])}")
    printed = [item for item in checks if not (missed_only and item[1].met)]
    table(*check_rows(labels, printed, JUDGED))


def shortened(lines: list[str]) -> list[str]:
    """Return the first twenty lines and the count of the rest; all if verbose."""
    return (
        lines
        if OUTPUT.verbose or len(lines) <= MAX_LINES
        else [*lines[:MAX_LINES], f"... and {len(lines) - MAX_LINES} more"]
    )
