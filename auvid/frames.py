"""Tables of a run as pandas DataFrames that know their units."""

from __future__ import annotations

import pandas as pd
import pyarrow as pa

from auvid.data_schemas.schemas import schema


def as_frame(table: pa.Table, name: str) -> pd.DataFrame:
    """Return a table of schema `name` as a DataFrame.

    Parameters
    ----------
    table : pyarrow.Table
        A table that fits the schema.
    name : str
        Name of the schema, as ``fused``.

    Returns
    -------
    pandas.DataFrame
        ``attrs`` holds ``schema``, ``meaning``, and ``units``, ``frames`` and
        ``meanings`` by column.
    """
    kind = schema(name)
    frame: pd.DataFrame = table.to_pandas()
    columns = {key: kind.columns[key] for key in frame.columns if key in kind.columns}
    frame.attrs = {
        "schema": name,
        "meaning": kind.meaning,
        "units": {key: item.unit for key, item in columns.items()},
        "frames": {key: item.frame for key, item in columns.items()},
        "meanings": {key: item.meaning for key, item in columns.items()},
    }
    return frame
