"""Column maps drafted from generated CSV files."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from auvid.hydro.arrays import Array
from auvid.stages.base import RawFile
from auvid.stages.ingest.formats.csv.column_map import column_map
from auvid.stages.ingest.formats.csv.draft.column_draft import ColumnDraft
from auvid.stages.ingest.formats.csv.draft.drafting import draft_columns

T_S = np.arange(0.0, 60.0, 0.1)


def drafted(
    columns: Mapping[str, Array], *, delimiter: str = ",", decimal: str = "."
) -> ColumnDraft:
    """Return the draft of a CSV file with these columns, after a look that it holds."""
    rows = [delimiter.join(columns)]
    for row in zip(*columns.values(), strict=True):
        cells = [item if isinstance(item, str) else f"{float(item):.6f}" for item in row]
        rows.append(delimiter.join(cell.replace(".", decimal) for cell in cells))
    data = ("\n".join(rows) + "\n").encode()
    draft = draft_columns(RawFile("log.csv", np.frombuffer(data, np.uint8), None))
    column_map(draft.document(), list(columns), file="log.csv")
    return draft


def wave(size: float, period_s: float = 7.0) -> Array:
    """Return a sine at T_S."""
    return np.asarray(size * np.sin(2.0 * np.pi * T_S / period_s))
