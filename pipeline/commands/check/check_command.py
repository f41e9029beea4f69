"""`auvid check`: the health of logs, before anything is fitted to them."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from auvid.data_schemas.errors import DataError, UsageError
from auvid.pipeline.commands.check import check_page
from auvid.pipeline.commands.check.clock_alignment import align_clocks
from auvid.pipeline.commands.check.log_page import campaign_refusal, log_pages, names_campaign
from auvid.pipeline.output import FAILED, FINE, LOSSES, answer
from auvid.pipeline.store.atomic_files import write_output
from auvid.pipeline.terminal import plain_lines


def check(
    targets: Sequence[str],
    *,
    columns: Path | None = None,
    html_file: Path | None = None,
    align: bool = False,
) -> int:
    """Print the health page of every log and return the exit code.

    The code is 1 for a log that cannot be read and a campaign whose run would stop at
    its findings, 3 for losses, errors, or a finding that would stop a run, else 0.
    Raises `PipelineError` for what concerns the call itself: no such campaign, a column
    map that does not hold, nothing to align.
    """
    if columns is not None and (campaign := next(filter(names_campaign, targets), None)):
        raise UsageError(
            "--columns is for CSV files; a campaign names the column maps of its logs",
            value=campaign,
            remedy=f"auvid check {campaign}",
        )
    by_target = {target: log_pages(target, columns) for target in targets}
    pages = [page for group in by_target.values() for page in group]
    if align and len(pages) != 2:
        raise UsageError(
            "--align needs exactly two logs",
            value=len(pages),
            remedy="auvid check dive.tlog dive.BIN --align",
        )
    refused = any(page.refused is not None for page in pages)
    alignment = alignment_fault = None
    if align and not refused:
        try:
            alignment = align_clocks(*pages)
        except DataError as fault:
            alignment_fault = fault
    if html_file is not None:
        write_output(html_file, check_page.html(pages, alignment).encode())
    check_page.print_pages(pages)
    if alignment is not None:
        print(alignment.text)
    stopped = [
        refusal
        for target, group in by_target.items()
        if names_campaign(target) and (refusal := campaign_refusal(target, group)) is not None
    ]
    answer(
        {
            "logs": [page.document for page in pages],
            "stopped": [str(refusal) for refusal in stopped],
            "alignment": None if alignment is None else alignment.document,
        }
    )
    for refusal in stopped:
        print(plain_lines(f"auvid run would stop: {refusal}"), file=sys.stderr)
    if alignment_fault is not None:
        raise alignment_fault
    if refused or stopped:
        return FAILED
    campaigns = {target for target in targets if names_campaign(target)}
    losses = any(
        page.losses or (page.stops and target not in campaigns)
        for target, group in by_target.items()
        for page in group
    )
    return LOSSES if losses else FINE
