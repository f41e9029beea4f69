"""`auvid check`: the health of logs, before anything is fitted to them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from auvid.data_schemas.errors import DataError, UsageError
from auvid.pipeline.commands.check import check_page
from auvid.pipeline.commands.check.clock_alignment import align_clocks
from auvid.pipeline.commands.check.log_page import log_pages
from auvid.pipeline.store.atomic_files import write_atomically

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

    The code is 0 for fine, 1 for a log that is refused, 3 for losses or errors. Raises
    `PipelineError` for what concerns the call itself: no such campaign, a column map
    that does not hold, nothing to align.
    """
    pages = [page for target in targets for page in log_pages(target, columns)]
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
            write_atomically(Path(json_file), f"{text}\n".encode())
    if html_file is not None:
        write_atomically(html_file, check_page.html(pages, alignment).encode())
    if json_file != "-":
        check_page.print_pages(pages)
        if alignment is not None:
            print(alignment.text)
    if alignment_fault is not None:
        raise alignment_fault
    if refused:
        return REFUSED
    return LOSSES if any(page.losses for page in pages) else FINE
