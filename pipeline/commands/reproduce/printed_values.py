"""`auvid reproduce` for a campaign that names printed values: what its run found,
beside them, on the terminal.
"""

from __future__ import annotations

from auvid.pipeline.commands.open_run import open_run
from auvid.pipeline.commands.reproduce.variants import FILE
from auvid.pipeline.commands.run.run_summary import comparison_rows, result_files
from auvid.pipeline.execution.runner import Run
from auvid.pipeline.terminal import path_from_here

PUBLISHED = "published_values"
LIMITS = (("least", ">="), ("most", "<="))


def open_comparison(name: str) -> Run | None:
    """The run of a campaign that names printed values and has no document of variants;
    None for any other.
    """
    run = open_run(name)
    if PUBLISHED not in run.campaign.documents or (run.campaign.folder / FILE).is_file():
        return None
    return run


def print_comparison(run: Run) -> bool:
    """Print every printed value beside ours, and the bounds; returns whether all that
    is asked is met.
    """
    rows = comparison_rows(run)
    table = None
    width = max([len(row["quantity"]) for row in rows], default=0) + 2
    print(
        f"{'':<{width + 2}}{'printed':>12}{'to be found':>13}{'ours':>12}"
        f"{'printed off':>13}{'ours off':>11}"
    )
    for row in rows:
        if row["table"] != table:
            table = row["table"]
            print(f"\n{table}")
        values = f"{_cell(row['printed']):>12}{_cell(row['truth']):>13}{_cell(row['ours']):>12}"
        errors = f"{_percent(row['printed_error']):>13}{_percent(row['our_error']):>11}"
        limits = " and ".join(
            f"{word} {row[key]:g}" for key, word in LIMITS if row[key] is not None
        )
        told = "  ".join(
            part
            for part in (
                f"  asked {limits}" if limits else "",
                f"  {row['verdict']}" if row["asked_verdict"] else "",
            )
            if part
        )
        miss = "  MISSED" if row["met"] is False else ""
        print(f"  {row['quantity']:<{width}}{values}{errors}{told}{miss}")
    asked_of = [row for row in rows if row["met"] is not None]
    missed = [row for row in asked_of if not row["met"]]
    print(f"\nbounds: {len(asked_of) - len(missed)} of {len(asked_of)} met")
    page = result_files(run).get("report")
    if page is not None:
        print(f"page: {path_from_here(page)}")
    return not missed


def _cell(value: float | None) -> str:
    return "-" if value is None else f"{value:.4f}"


def _percent(value: float | None) -> str:
    """Two decimals, or the order of magnitude of what is smaller."""
    if value is None or value == 0.0:
        return "-" if value is None else "0 %"
    percent = 100.0 * value
    return f"{percent:+.2f} %" if abs(percent) >= 0.01 else f"{percent:+.0e} %"
