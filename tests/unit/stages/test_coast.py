"""The stage coast: drag and thrust scale of a twin, and what lacks in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pyarrow as pa
import pytest

from auvid.data_schemas.documents import check_document
from auvid.data_schemas.documents.campaign import LegEntry
from auvid.data_schemas.documents.model import parse
from auvid.data_schemas.documents.plans.dive_plan import DivePlanDocument
from auvid.data_schemas.errors import CampaignError
from auvid.data_schemas.tables import make_table
from auvid.hydro.dynamics.simulation.rov.sensors import START_US, dive_in_memory
from auvid.hydro.dynamics.simulation.rov.truth import truth_of_model
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.hydro.dynamics.viscous.models import IdentifiedModel
from auvid.hydro.identification.coasting.decay import CoastDecay
from auvid.hydro.identification.coasting.thrust_scale import CommonScale, ThrustLag, ThrustScale
from auvid.stages import coast, fuse, resample, residual
from auvid.stages.base import Collection, collection
from auvid.stages.coast.presentation import AxisCoasts, scale_words
from tests.support.motions import log_document, shipped_vehicle

VEHICLE = shipped_vehicle("bluerov2_heavy")
TRUTH = {
    "X": {"u": -8.0, "u*|u|": -90.0},
    "Y": {"v": -10.0, "v*|v|": -140.0},
    "Z": {"w": -12.0, "w*|w|": -180.0},
    "K": {"p": -1.0, "p*|p|": -1.0},
    "M": {"q": -1.0, "q*|q|": -1.0},
    "N": {"r": -0.3, "r*|r|": -1.2},
}
SENSORS = {
    "imu": {"gyro_sd_rad_s": 0.0012, "accel_sd_m_s2": 0.01},
    "attitude": {"tilt_sd_deg": 0.1, "heading_sd_deg": 0.1},
    "dvl": {"sd_m_s": 0.002, "jitter_s": 0.012},
    "depth": {"sd_m": 0.004},
}
PUSHES = (0.5, -0.6, 0.7, -0.5, 0.6, -0.7, 0.4, -0.6)
DURATION_S = 62.0


def with_curve(scale: float) -> Vehicle:
    """Return the vehicle file with a thrust curve times `scale`."""
    thrusters = VEHICLE.thrusters
    assert thrusters is not None
    curve = replace(thrusters.curve, force_N=scale * thrusters.curve.force_N)
    return replace(VEHICLE, thrusters=replace(thrusters, curve=curve))


def inputs(
    vehicle: Vehicle, *, sticks: dict[str, Any], north_m_s: float = 0.0, lag_s: float = 0.1
) -> coast.Inputs:
    """What coast reads of one leg of a twin in a current, made by the stages before it."""
    leg = {
        "id": "a",
        "duration_s": DURATION_S,
        "use": "training",
        "modes": [{"at_s": 0, "mode": "alt_hold"}],
        "sticks": sticks,
    }
    document = {"kind": "dives", "title": "coasts", "depth_m": 14, "settle_s": 5, "legs": [leg]}
    water = {
        "unsteady": {"force_sd_N": [0.3] * 3, "moment_sd_N_m": [0.01] * 3, "correlation_s": 2.0}
    }
    plan = parse(DivePlanDocument, document | {"sensors": SENSORS, "water": water})
    still = truth_of_model(VEHICLE, IdentifiedModel("truth", TRUTH))
    truth = replace(
        still,
        current_m_s=np.array([north_m_s, 0.0, 0.0]),
        loss=replace(still.loss, lag_s=lag_s),
    )
    _, record = dive_in_memory(truth, plan, "a", seed=4)
    names = ("imu", "attitude", "velocity", "depth", "actuators", "battery")
    tables = {name: make_table(name, record.streams[name]) for name in names}
    end_us = max(int(columns["time_us"][-1]) for columns in record.streams.values())
    log = log_document(log="log", start_us=START_US, end_us=end_us)
    entry = LegEntry(id="a", log="log", start_s=2.0, end_s=2.0 + DURATION_S, use="training")
    cut = resample.run(
        resample.Inputs(leg=entry, log_info=log, vehicle=vehicle, **tables), resample.Params()
    )
    (key,) = cut.segment
    fused = fuse.run(
        fuse.Inputs(cut.segment[key], cut.resampled[key], vehicle, log),
        fuse.Params(cutoff_hz=2.0),
    )
    force = residual.run(
        residual.Inputs(
            cut.segment[key], fused.fused, fused.fusion, cut.resampled[key], vehicle, log
        ),
        residual.Params(),
    )
    return coast.Inputs(
        segment=collection(cut.segment),
        fused=collection({key: fused.fused}),
        fusion=collection({key: fused.fusion}),
        residual=collection({key: force.residual}),
        resampled=collection(cut.resampled),
        log_info=collection({"log": log}),
        vehicle=vehicle,
        samples_imu=collection(cut.samples_imu or {}),
        samples_velocity=collection(cut.samples_velocity or {}),
    )


def surge(push_s: float, rest_s: float) -> dict[str, Any]:
    """A forward stick that pushes and is let go of, by turns, between samples of the log."""
    at = 1.0 + np.arange(len(PUSHES)) * (push_s + rest_s + 0.03)
    times = np.column_stack([at, at + push_s]).ravel()
    values = np.column_stack([PUSHES, np.zeros(len(PUSHES))]).ravel()
    return {"forward": {"kind": "steps", "times_s": times.tolist(), "values": values.tolist()}}


def remarks(outputs: coast.Outputs, level: str) -> str:
    check_document(outputs.section, "section")
    blocks = [block for block in outputs.section["blocks"] if block["kind"] == "remark"]
    return "\n".join(block["text"] for block in blocks if block["level"] == level)


@pytest.mark.parametrize("scale", [1.0, 1.25])
def test_drag_is_found_whatever_the_thrust_curve_and_the_curve_is_judged(scale: float) -> None:
    outputs = coast.run(inputs(with_curve(scale), sticks=surge(3.5, 4.0)), coast.Params())
    row = outputs.coast_drag.to_pylist()[0]
    mass = float(VEHICLE.mass_matrix[0, 0])
    true = (8.0 + 90.0 * row["speed"]) / mass
    assert row["velocity"] == "u"
    assert row["coasts"] >= 6
    assert row["verdict"] == "identified"
    assert row["rate"] == pytest.approx(true, rel=0.08)
    assert abs(row["rate"] - true) < 3.0 * row["rate_se"]
    # Eight coasts of one axis; their standard error is 6 %.
    assert row["scale"] == pytest.approx(scale, rel=0.1)
    assert abs(row["scale"] - scale) < 1.96 * row["scale_se"]
    assert row["scale_se"] < 0.08 * scale
    warned = remarks(outputs, "warning")
    assert ("the thrust curve or the mass is off" in warned) == (scale == 1.25)
    assert ("the thrust curve holds" in remarks(outputs, "finding")) == (scale == 1.0)
    assert "heave (" in remarks(outputs, "note")
    taken = [item for item in outputs.coasts.to_pylist() if item["use"] == "taken"]
    assert {item["velocity"] for item in taken} >= {"u"}


def test_a_steady_current_is_no_drag_and_no_fault_of_the_thrust_curve() -> None:
    """The velocity log sees the bottom; the current is that along the bow."""
    twin = inputs(VEHICLE, sticks=surge(3.5, 4.0), north_m_s=0.12)
    outputs = coast.run(twin, coast.Params())
    row = outputs.coast_drag.to_pylist()[0]
    true = (8.0 + 90.0 * row["speed"]) / float(VEHICLE.mass_matrix[0, 0])
    assert abs(row["rate"] - true) < 3.0 * row["rate_se"]
    assert row["scale"] == pytest.approx(1.0, rel=0.1)
    assert not remarks(outputs, "warning")


def test_thrusters_that_follow_late_are_no_fault_of_the_thrust_curve() -> None:
    """The lag is that of the powered legs, not the 0.1 s that are assumed first."""
    sticks = surge(3.53, 4.0)
    outputs = coast.run(inputs(VEHICLE, sticks=sticks, lag_s=0.17), coast.Params())
    row = outputs.coast_drag.to_pylist()[0]
    assert row["thrust_lag_s"] == pytest.approx(0.17, abs=0.04)
    assert abs(row["scale"] - 1.0) < 1.96 * row["scale_se"]
    assert row["scale"] == pytest.approx(1.0, abs=0.2)


def test_a_lag_that_was_measured_is_taken_as_stated() -> None:
    twin = inputs(VEHICLE, sticks=surge(3.53, 4.0))

    def fitted(**stated: float) -> dict[str, Any]:
        row: dict[str, Any] = coast.run(twin, coast.Params(**stated)).coast_drag.to_pylist()[0]
        return row

    by_legs, stated = fitted(), fitted(thrust_lag_sd_s=0.005)
    assert stated["thrust_lag_s"] == 0.1
    assert stated["scale_se"] < 0.97 * by_legs["scale_se"]
    assert abs(stated["scale"] - 1.0) < 1.96 * stated["scale_se"]
    # What is stated counts, not what the powered legs show: thrust that fades slower would
    # leave the coasts more drag.
    late = fitted(thrust_lag_s=0.15, thrust_lag_sd_s=0.005)
    assert late["scale"] < stated["scale"] - 3.0 * stated["scale_se"]
    assert late["rate"] > stated["rate"]


def test_a_scale_that_the_mass_may_explain_is_no_fault_of_the_curve() -> None:
    decay = cast(CoastDecay, SimpleNamespace(coasts=25))
    fitted = {
        "u": AxisCoasts(
            decay=decay, scale=ThrustScale(1.08, 0.025, ThrustLag(0.1, 0.0, 0.01), 20.0)
        )
    }
    clear, doubtful = CommonScale(1.25, 0.025, 0.081), CommonScale(1.08, 0.025, 0.081)
    assert clear.alarming
    assert not clear.by_mass
    assert "times too large if the mass is right" in scale_words(fitted, clear)
    assert "multiply thrust_curve.force of the vehicle file by 0.80" in scale_words(fitted, clear)
    words = scale_words(fitted, doubtful)
    assert doubtful.departs
    assert not doubtful.alarming
    assert "may be all of it" in words
    assert "0.92 to 1.24 times" in words
    assert not CommonScale(1.03, 0.025, 0.081).by_mass


def test_columns_that_coasts_do_not_need_stay_on_disk() -> None:
    twin = inputs(VEHICLE, sticks=surge(3.5, 4.0))

    def in_part(tables: Collection[pa.Table]) -> Collection[pa.Table]:
        def part_of(key: str, columns: Sequence[str]) -> pa.Table:
            names = tables[key].column_names
            return tables[key].select([name for name in names if name in {"t_s", *columns}])

        return Collection({key: partial(pytest.fail, "loaded whole") for key in tables}, part_of)

    parts = {name: in_part(getattr(twin, name)) for name in ("fused", "residual", "resampled")}
    outputs = coast.run(replace(twin, **parts), coast.Params())
    complete = coast.run(twin, coast.Params())
    np.testing.assert_equal(outputs.coasts.to_pydict(), complete.coasts.to_pydict())


def test_coasts_of_less_than_a_second_are_too_few_in_plain_words() -> None:
    outputs = coast.run(inputs(VEHICLE, sticks=surge(3.5, 0.7)), coast.Params())
    assert all(np.isnan(item["rate"]) for item in outputs.coast_drag.to_pylist())
    note = remarks(outputs, "note")
    assert "shorter than 1 s" in note
    assert not remarks(outputs, "warning")
    assert "thrust curve was not checked" in note


def test_a_body_without_thrust_coasts_where_it_is_released() -> None:
    """The dive as if its vehicle had no thrusters, cut where they stop."""
    twin = inputs(VEHICLE, sticks=surge(3.5, 4.0))
    bare = replace(twin, vehicle=replace(VEHICLE, thrusters=None))
    outputs = coast.run(bare, coast.Params())
    assert "the vehicle has no thrust that could end" in remarks(outputs, "note")
    with pytest.raises(CampaignError, match="no such leg"):
        coast.run(bare, coast.Params(releases=("b",)))
    driven = coast.run(twin, coast.Params()).coasts.to_pylist()
    stops = [item["stop_s"] - 2.0 for item in driven if item["use"] == "taken"]
    released = coast.run(released_at(bare, stops), coast.Params(releases=tuple(names(stops))))
    row = released.coast_drag.to_pylist()[0]
    true = (8.0 + 90.0 * row["speed"]) / float(VEHICLE.mass_matrix[0, 0])
    assert row["coasts"] >= 6
    # The thrust that still fades is not seen as thrust: it takes up to a fifth of the drag.
    assert row["rate"] == pytest.approx(true, rel=0.2)


def names(stops: list[float]) -> list[str]:
    return [f"drop{index}" for index in range(len(stops))]


def released_at(twin: coast.Inputs, stops: list[float]) -> coast.Inputs:
    """Return the dive as legs of 3.8 s that begin 0.3 s after each stop."""
    ((key, segment),) = twin.segment.items()
    parts = {}
    for name, stop in zip(names(stops), stops, strict=True):
        first = stop + 0.3

        def cut(table: pa.Table, first: float = first) -> pa.Table:
            t = table["t_s"].to_numpy()
            rows = (t >= first - 1e-9) & (t <= first + 3.5)
            return table.filter(pa.array(rows))

        parts[name] = cut
    assert twin.samples_imu is not None
    assert twin.samples_velocity is not None
    tables = {
        field: collection({name: cut(getattr(twin, field)[key]) for name, cut in parts.items()})
        for field in ("fused", "residual", "resampled", "samples_imu", "samples_velocity")
    }
    return replace(
        twin,
        segment=collection(
            {name: segment.model_copy(update={"id": name, "leg": name}) for name in parts}
        ),
        fusion=collection(dict.fromkeys(parts, twin.fusion[key])),
        **tables,
    )
