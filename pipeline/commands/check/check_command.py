"""`auvid check`: the health of logs, before anything is fitted to them."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path

from auvid.data_schemas.errors import DataError, UsageError
from auvid.pipeline.commands.check import check_page
from auvid.pipeline.commands.check.clock_alignment import align_clocks
from auvid.pipeline.commands.check.log_page import campaign_refusal, log_pages, names_campaign
from auvid.pipeline.store.atomic_files import write_output
from auvid.pipeline.terminal import plain_lines

FINE, REFUSED, LOSSES = 0, 1, 3


def check(
    targets: Sequence[str],
    *,
    columns: Path | None = None,
    json_file: str | None = None,
    html_file: Path | None = None,
    align: bool = False,
) -> int:
    """Print the health page of every log and return the exit code.

    The code is 1 for a log that cannot be read and a campaign whose run would stop at
    its findings, 3 for losses, errors, or a finding that would stop a run, else 0.
    Raises
    `PipelineError` for what concerns the call itself: no such campaign, a column map
    that does not hold, nothing to align.
    """
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
    if json_file is not None:
        document: dict[str, object] = {"logs": [page.document for page in pages]}
        if alignment is not None:
            document["alignment"] = alignment.document
        text = json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False)
        if json_file == "-":
            print(text)
        else:
            write_output(Path(json_file), f"{text}\n".encode())
    if html_file is not None:
        write_output(html_file, check_page.html(pages, alignment).encode())
    if json_file != "-":
        check_page.print_pages(pages)
        if alignment is not None:
            print(alignment.text)
    stopped = [
        refusal
        for target, group in by_target.items()
        if names_campaign(target) and (refusal := campaign_refusal(target, group)) is not None
    ]
    for refusal in stopped:
        print(plain_lines(f"auvid run would stop: {refusal}"), file=sys.stderr)
    if alignment_fault is not None:
        raise alignment_fault
    if refused or stopped:
        return REFUSED
    campaigns = {target for target in targets if names_campaign(target)}
    losses = any(
        page.losses or (page.stops and target not in campaigns)
        for target, group in by_target.items()
        for page in group
    )
    return LOSSES if losses else FINE
