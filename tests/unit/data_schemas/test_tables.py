"""What a table's schema refuses, with row, value and what is allowed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from auvid.data_schemas import tables
from auvid.data_schemas.errors import PipelineError
from auvid.data_schemas.tables import make_table


@pytest.mark.parametrize("voltage", [0.0, 16.8, 1000.0])
def test_a_range_holds_its_ends(voltage: float) -> None:
    make_table("battery", {"time_us": [1, 2], "voltage_v": [12.0, voltage]})


@pytest.mark.parametrize("gap", [False, True])
@pytest.mark.parametrize("voltage", [-0.1, 1000.1, np.inf])
def test_a_value_outside_its_range_is_named_also_beside_gaps(voltage: float, gap: bool) -> None:
    readings = [np.nan if gap else 12.0, voltage, 12.0]
    with pytest.raises(PipelineError, match=r"row 3, field 'voltage_v': 1 values out of range"):
        make_table("battery", {"time_us": [1, 2, 3], "voltage_v": readings})


PLAIN: list[tuple[Any, pa.DataType]] = [
    ([1.0, None, 2, float("nan")], pa.float64()),
    ([1, None, 3], pa.int64()),
    ([True, None, False] * 7, pa.bool_()),
    ([None, None], pa.float64()),
    (["a", None, "\u00fc"], pa.string()),
    ([], pa.string()),
    (np.array([True, False] * 9), pa.bool_()),
    (np.array(["x", None], dtype=object), pa.string()),
    (np.arange(5)[::2], pa.int64()),
    (np.arange(5, dtype=np.int32), pa.float64()),
    ([np.float64(0.5)], pa.float64()),
]


def test_columns_are_those_of_arrow_itself_without_the_import_of_pandas(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    expected = [pa.array(values, kind, from_pandas=False) for values, kind in PLAIN]
    with monkeypatch.context() as patch:
        patch.setattr(pa, "array", lambda *_, **__: pytest.fail("this imports pandas"))
        columns = [tables.arrow_array(values, kind) for values, kind in PLAIN]
    for column, plain in zip(columns, expected, strict=True):
        column.validate(full=True)
        assert column.type == plain.type
        assert str(column.to_pylist()) == str(plain.to_pylist())
        twice = pa.chunked_array([column, column[1:]])
        if pa.types.is_primitive(column.type):
            np.testing.assert_array_equal(tables.numbers(twice), twice.to_numpy())
            assert tables.numbers(twice).dtype == twice.to_numpy().dtype
    for values, kind in ((["a", 1], pa.string()), ([True], pa.int64())):
        with pytest.raises((pa.ArrowInvalid, pa.ArrowTypeError)):
            tables.arrow_array(values, kind)
