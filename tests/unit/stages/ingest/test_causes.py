"""What is computed once, and no further than it counts, while a log is checked again."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.tables import make_table
from auvid.stages.columns import LINEAR_VELOCITY
from auvid.stages.ingest.health.causes import by_cause
from auvid.stages.ingest.health.finding import CheckedLog, Finding, finding
from tests.support.sound_log import sound


def checked_log() -> CheckedLog:
    log = sound()
    tables = {name: make_table(name, columns) for name, columns in log.streams.items()}
    columns = {name: [] for name in ("stream", "reason", "count", "bytes", "first", "last")}
    return CheckedLog(tables, LogInfo.model_validate(log.info), make_table("dropped", columns))


def wrong(name: str) -> Finding:
    return finding(name, f"{name}.", stream="velocity", fields=("u_m_s",))


def test_a_mistake_that_leaves_too_much_is_not_checked_to_its_end() -> None:
    left = [wrong("velocity_sign"), wrong("response_sign")]
    read: list[str] = []

    def check(_: CheckedLog) -> Iterator[Finding]:
        for name in ("velocity_sign", "response_sign", "depth_sign"):
            read.append(name)
            yield wrong(name)

    assert by_cause(checked_log(), left, check) == (left, [])
    assert set(read) == {"velocity_sign", "response_sign"}


def test_arrays_of_a_log_are_made_once_and_anew_where_it_is_mended_or_cut() -> None:
    log = checked_log()
    values = log.values("velocity", LINEAR_VELOCITY)
    assert log.values("velocity", LINEAR_VELOCITY) is values
    assert log.once("of nothing", (), lambda: 3) == 3
    assert log.without("depth").values("velocity", LINEAR_VELOCITY) is values
    turned = log.with_columns("velocity", {"u_m_s": -log.column("velocity", "u_m_s")})
    np.testing.assert_array_equal(turned.values("velocity", LINEAR_VELOCITY)[:, 0], -values[:, 0])
    np.testing.assert_array_equal(log.values("velocity", LINEAR_VELOCITY), values)
    rows = (log.t_s("velocity") >= 10.0) & (log.t_s("velocity") < 20.0)
    cut = log.between(10.0, 20.0).values("velocity", LINEAR_VELOCITY)
    np.testing.assert_array_equal(cut, values[rows])
