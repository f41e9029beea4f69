"""What is computed once, and no further than it counts, while a log is checked again."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest

from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.tables import make_table
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.stages.columns import LINEAR_VELOCITY
from auvid.stages.ingest.health.actuation.unrelated_commands import actuator_commands
from auvid.stages.ingest.health.causes import by_cause, by_mass
from auvid.stages.ingest.health.finding import CheckedLog, Finding, finding
from auvid.stages.ingest.health.vehicle import body_findings
from tests.support.motions import shipped_vehicle
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


def test_arrays_of_a_log_are_made_once_and_anew_where_it_is_mended_or_cut(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    log = checked_log()
    values = log.values("velocity", LINEAR_VELOCITY)
    assert log.values("velocity", LINEAR_VELOCITY) is values
    assert log.once("of nothing", (), lambda: 3) == 3
    assert log.without("depth").values("velocity", LINEAR_VELOCITY) is values
    with monkeypatch.context() as slow:
        slow.delattr(pa, "array")  # it imports pandas: .4 s of each check of a log
        turned = log.with_columns("velocity", {"u_m_s": -log.column("velocity", "u_m_s")})
    np.testing.assert_array_equal(turned.values("velocity", LINEAR_VELOCITY)[:, 0], -values[:, 0])
    np.testing.assert_array_equal(log.values("velocity", LINEAR_VELOCITY), values)
    rows = (log.t_s("velocity") >= 10.0) & (log.t_s("velocity") < 20.0)
    cut = log.between(10.0, 20.0).values("velocity", LINEAR_VELOCITY)
    np.testing.assert_array_equal(cut, values[rows])


def test_commands_are_those_of_the_outputs_that_a_mended_vehicle_names() -> None:
    log = checked_log()
    document = shipped_vehicle("bluerov2_heavy").document.model_dump(exclude_none=True)
    before = actuator_commands(replace(log, vehicle=vehicle_from_document(document)))
    document["actuators"]["thrusters"]["outputs"].reverse()
    mended = actuator_commands(replace(log, vehicle=vehicle_from_document(document)))
    np.testing.assert_array_equal(mended, before[:, ::-1])


@pytest.mark.parametrize(
    ("factors", "words", "folded"),
    [
        ((1e3, 1.0), "if mass is about 1000 times too large (in g)", "body_size"),
        ((1.0, 1e-3), "if displaced_mass is about 1000 times too small (in t)", "body_size"),
        ((1e3, 1e3), "mass and displaced_mass are both about 1000 times", "added_mass_size"),
        ((2.2046, 1.0), "if mass is about 2.205 times too large (in lb)", "weight_held"),
    ],
)
def test_wrong_masses_of_a_vehicle_file_are_one_finding(
    factors: tuple[float, float], words: str, folded: str
) -> None:
    """Findings that the forces make of it go where a sound mass leaves none, or stay."""
    document = shipped_vehicle("bluerov2_heavy").document.model_dump(exclude_none=True)
    for name, factor in zip(("mass", "displaced_mass"), factors, strict=True):
        document["rigid_body"][name]["value"] *= factor
    log = replace(checked_log(), vehicle=vehicle_from_document(document))
    heavy = finding("weight_held", "heavy.", stream="actuators")
    kept, explained, mended = by_mass(log, [*body_findings(log), heavy], lambda _: ())
    assert words in kept[0]["text"], kept[0]["text"]
    assert len(kept) == 1
    assert {folded, "weight_held"} <= {item["id"] for item in explained}
    assert not list(body_findings(mended))
    kept, *_ = by_mass(log, [*body_findings(log), heavy], lambda _: [heavy])
    assert kept[-1] is heavy
