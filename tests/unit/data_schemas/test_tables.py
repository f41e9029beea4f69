"""What a table's schema refuses, with row, value and what is allowed."""

from __future__ import annotations

import numpy as np
import pytest

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
