"""`auvid reproduce` for printed values: those of a run next to them, as a table."""

from __future__ import annotations

from itertools import groupby

from auvid.pipeline.commands.open_run import open_run
from auvid.pipeline.commands.reproduce.variants import FILE
from auvid.pipeline.commands.run.run_summary import comparison_rows, result_files
from auvid.pipeline.execution.runner import Run
from auvid.pipeline.output import answer
from auvid.pipeline.terminal import path_from_here, table
from auvid.stages.check_published.presentation import check_of, evidence_table, printed_rows
from auvid.stages.reference_check import count_bounds

PUBLISHED = "published_values"


def open_comparison(name: str) -> Run | None:
    """Return the run of a campaign with printed values but no variants, else None."""
    run = open_run(name)
    if PUBLISHED not in run.campaign.documents or (run.campaign.folder / FILE).is_file():
        return None
    return run


def print_comparison(run: Run) -> bool:
    """Print every printed value beside ours, and return whether all bounds are met."""
    rows = comparison_rows(run)
    answer(
        {
            "page": result_files(run).get("report"),
            "met": all(check_of(row).met is not False for row in rows),
            "rows": rows,
        }
    )
    for name, own in groupby(rows, key=lambda row: row["table"]):
        table(*printed_rows(list(own)), title=name)
        print()
    checks = [check_of(row) for row in rows]
    table(*evidence_table(rows), title="bounds by what meeting them shows")
    print(f"\nbounds: {count_bounds(checks)}")
    page = result_files(run).get("report")
    if page is not None:
        print(f"page: {path_from_here(page)}")
    return all(check.met is not False for check in checks)
