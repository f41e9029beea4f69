"""Stage pipendulum on swings and decays of known truth: figures, what it says of the
recorder, and what it refuses.
"""

from __future__ import annotations

import copy
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc
import pytest
from scipy.spatial.transform import Rotation

from auvid.data_schemas.documents import check_document
from auvid.data_schemas.documents.apparatus import ApparatusDocument
from auvid.data_schemas.documents.model import parse
from auvid.data_schemas.errors import CampaignError, DataError
from auvid.data_schemas.schemas import schema
from auvid.data_schemas.tables import make_table
from auvid.hydro.dynamics.simulation.bench_motion import (
    BenchMotion,
    PhysicalPendulum,
    Quadrifilar,
    free_decay,
    swing,
)
from auvid.stages import pipendulum
from auvid.stages.base import collection
from tests.support.motions import log_document, shipped_vehicle

Array = npt.NDArray[np.float64]
VEHICLE = shipped_vehicle("thaus")
G, START_US, HELD_S = 9.80665, 3_000_000, 2.0
ARM, WEIGHT = 3.66, 10.55
INERTIA = {"tray": 2.1970, "tube": 2.8590, "vehicle": 2.1970 + 1.7428}
MASS = {"tray": 9.8, "tube": 12.18, "vehicle": 47.9}
X_UDOT, X_U, POLE = -87.1206, -45.9694, -4.1996


def quantity(value: float, unit: str) -> dict[str, Any]:
    return {"value": value, "unit": unit, "source": "test"}


APPARATUS: dict[str, Any] = {
    "title": "Bench",
    "source": "test",
    "quadrifilar": {
        "radius_ceiling": quantity(0.47, "m"),
        "radius_tray": quantity(0.47, "m"),
        "line_length": quantity(4.23, "m"),
        "tray_mass": quantity(9.8, "kg"),
        "swings": [
            {"id": "tray", "role": "empty_tray", "legs": ["tray"]},
            {
                "id": "tube",
                "role": "object",
                "mass": quantity(2.38, "kg"),
                "legs": ["tube"],
                "cylinder": {
                    "length": quantity(1.82, "m"),
                    "outer_radius": quantity(25.4, "mm"),
                    "inner_radius": quantity(21.9, "mm"),
                },
            },
            {
                "id": "thaus_x",
                "role": "object",
                "axis": "x",
                "mass": quantity(38.10, "kg"),
                "legs": ["vehicle"],
            },
        ],
    },
    "free_decay": {
        "arm": quantity(ARM, "m"),
        "parts": [
            {"name": "pole and weight", "mass": quantity(WEIGHT, "kg"), "arm": quantity(ARM, "m")}
        ],
        "decays": [
            {"id": "surge", "role": "vehicle", "dof": "surge", "legs": ["decay", "check"]},
            {"id": "empty", "role": "empty_pendulum", "legs": ["empty"]},
        ],
    },
}
LEGS: list[dict[str, Any]] = [
    {"id": name, "log": name, "use": "validation" if name == "check" else "training"}
    for name in (*INERTIA, "decay", "check", "empty")
]


@cache
def motion_of(name: str, X_u: float) -> BenchMotion:
    """Angle and rate (n, 2) after the release; `X_u` damps the vehicle."""
    if name in INERTIA:
        return swing(
            Quadrifilar(INERTIA[name], MASS[name], 0.47, 0.47, 4.23, 0.004, G),
            np.radians(6.0),
            60.0,
        )
    loaded = name != "empty"
    inertia = (WEIGHT - POLE + loaded * (38.10 - X_UDOT)) * ARM**2
    pendulum = PhysicalPendulum(inertia, WEIGHT * G * ARM, (-1.0 + loaded * X_u) * ARM**2, 0.0)
    return free_decay(pendulum, np.radians(18.0 if name == "check" else 22.0), 60.0)


def log_of(
    name: str,
    *,
    turn: Rotation | None = None,
    noise: float = 0.0,
    clip: float = np.inf,
    drift: float = 0.0,
) -> dict[str, pa.Table]:
    """Streams of a recorder: pole and tray turn it in pitch or yaw; `turn` is how it is
    mounted.
    """
    t = np.arange(-HELD_S, 50.0, 0.02)
    states, _ = motion_of(name, X_U)(t)
    axis = np.array([0.0, 0.0, 1.0] if name in INERTIA else [0.0, 1.0, 0.0])
    body = turn or Rotation.identity()
    attitude = Rotation.from_rotvec(np.outer(states[:, 0], axis)) * body
    rng = np.random.default_rng(1)
    gyro = (
        np.outer(states[:, 1], body.inv().apply(axis))
        + noise * rng.standard_normal((t.size, 3))
        + drift * (1.0 + 0.01 * t)[:, None]
    )
    accel = attitude.inv().apply(np.tile([0.0, 0.0, -G], (t.size, 1)))
    euler = attitude.as_euler("ZYX")[:, ::-1]
    time = START_US + np.rint(1e6 * (t + HELD_S)).astype(np.int64)
    gyro = np.clip(gyro, -clip, clip)
    imu = {f"gyro_{n}_rad_s": gyro[:, i] for i, n in enumerate("xyz")} | {
        f"accel_{n}_m_s2": accel[:, i] for i, n in enumerate("xyz")
    }
    angles = {f"{n}_rad": euler[:, i] for i, n in enumerate(("phi", "theta", "psi"))}
    return {
        "imu": make_table("imu", {"time_us": time, **imu}),
        "attitude": make_table("attitude", {"time_us": time, **angles}),
    }


def run(apparatus: dict[str, Any], logs: dict[str, dict[str, pa.Table]]) -> pipendulum.Outputs:
    checked = parse(ApparatusDocument, apparatus)
    info = {name: log_document(start_us=START_US, end_us=START_US + 60_000_000) for name in logs}
    streams = {
        stream: collection({name: log[stream] for name, log in logs.items() if stream in log})
        for stream in ("imu", "attitude")
    }
    legs = [leg for leg in LEGS if leg["log"] in logs]
    return pipendulum.run(
        pipendulum.Inputs(
            {"legs": legs},
            VEHICLE,
            collection(info),
            checked,
            streams["imu"],
            streams["attitude"],
        ),
        pipendulum.Params(),
    )


def part(name: str, **changes: Any) -> dict[str, Any]:
    out = {key: copy.deepcopy(APPARATUS[key]) for key in ("title", "source", name)}
    out[name].update(changes)
    return out


def figures(outputs: pipendulum.Outputs) -> dict[str, dict[str, Any]]:
    assert outputs.results is not None
    rows = outputs.results["rows"]
    assert len({row["quantity"] for row in rows}) == len(rows)
    return {row["quantity"]: row for row in rows}


def remarks(outputs: pipendulum.Outputs, level: str) -> str:
    assert outputs.section is not None
    return " ".join(
        block["text"]
        for block in outputs.section["blocks"]
        if block["kind"] == "remark" and block["level"] == level
    )


SWINGS = tuple(INERTIA)
DECAYS = ("decay", "check", "empty")


def test_whole_bench() -> None:
    outputs = run(APPARATUS, {name: log_of(name) for name in (*SWINGS, *DECAYS)})
    values = figures(outputs)
    assert values["T of tray"]["value"] == pytest.approx(4.1571, abs=2e-4)
    assert values["I of tube"]["value"] == pytest.approx(0.6620, rel=1e-4)
    assert values["I of tube by (58)"]["value"] == pytest.approx(0.6576, abs=5e-5)
    assert values["I of tube against (58)"]["value"] == pytest.approx(0.67, abs=0.02)
    assert values["I_x"]["value"] == pytest.approx(1.7428, rel=1e-4)
    assert values["surge: X_udot"]["value"] == pytest.approx(X_UDOT, rel=1e-5)
    assert values["surge: X_u"]["value"] == pytest.approx(X_U, rel=1e-5)
    assert values["empty: added mass"]["value"] == pytest.approx(POLE, rel=1e-4)
    assert values["surge: X_udot (point mass)"]["value"] == pytest.approx(
        X_UDOT, rel=1e-5
    )  # every mass of this bench is at the arm
    for method in ("recursive", "batch"):
        assert values[f"surge: X_udot (linear, {method})"]["value"] == pytest.approx(
            X_UDOT, rel=0.01
        )
    # I = G/k: 1 % of G is 1 % of all inertia over the square of the arm.
    total = WEIGHT - POLE + 38.10 - X_UDOT
    assert values["surge: X_udot per 1 % of restoring moment"]["value"] == pytest.approx(
        -0.01 * total, rel=1e-4
    )
    assert outputs.decays is not None
    swing = outputs.decays.filter(pc.equal(outputs.decays["recording"], "decay")).to_pydict()
    assert values["surge: largest speed"]["value"] == pytest.approx(
        np.abs(swing["speed_m_s"]).max(), rel=1e-3
    )
    slope = 3.66 * np.gradient(swing["theta_measured_rad"], swing["t_s"])
    np.testing.assert_allclose(swing["speed_m_s"][1:-1], slope[1:-1], atol=0.01)
    assert "linear damping predicts the validation leg best" in remarks(outputs, "finding")
    assert "correlation 1" in remarks(outputs, "note")
    check_document(outputs.inertia, "inertia")
    assert outputs.inertia is not None
    assert set(outputs.inertia) == {"vehicle", "source", "I_x"}
    assert outputs.views is not None
    for group in outputs.views["groups"]:
        assert set(group["columns"]) <= set(schema(group["table"]).columns)
        table = getattr(outputs, group["table"])
        assert group["filter"]["recording"] in set(table["recording"].to_pylist())


def test_no_apparatus_gives_nothing() -> None:
    inputs = pipendulum.Inputs({"legs": []}, VEHICLE, collection({}))
    assert pipendulum.run(inputs, pipendulum.Params()) == pipendulum.Outputs()


def test_timed_oscillations_in_the_place_of_logs() -> None:
    apparatus = part("quadrifilar")
    swings = apparatus["quadrifilar"]["swings"]
    for entry, seconds in zip(swings[:2], (83.142, 85.076), strict=True):
        del entry["legs"]
        entry["timed"] = [
            {"oscillations": 20, "duration_s": seconds},
            {"oscillations": 20, "duration_s": seconds},
        ]
    apparatus["quadrifilar"]["swings"] = swings[:2]
    values = figures(run(apparatus, {}))
    assert values["I of tube"]["value"] == pytest.approx(0.6620, rel=2e-3)
    # 0.2 s of a stop watch over 20 swings, twice.
    assert values["T of tray"]["standard_error"] == pytest.approx(0.01 / np.sqrt(2.0))
    # A swing of 40 degrees is 0.7 % slow; said so, the period is taken back.
    swings[0]["timed"] = [{"oscillations": 20, "duration_s": 83.142, "amplitude_deg": 40.0}]
    assert figures(run(apparatus, {}))["T of tray"]["value"] == pytest.approx(
        4.1571 * (1.0 - np.radians(40.0) ** 2 / 16.0), rel=1e-3
    )


def test_turned_and_drifting_recorder() -> None:
    turn = Rotation.from_euler("ZYX", [20.0, 12.0, -8.0], degrees=True)
    logs = {name: log_of(name, turn=turn, noise=0.002, drift=0.01) for name in (*SWINGS, *DECAYS)}
    outputs = run(APPARATUS, logs)
    values = figures(outputs)
    assert values["I of tube"]["value"] == pytest.approx(0.6620, rel=0.007)
    for name, truth in (("surge: X_udot", X_UDOT), ("surge: X_u", X_U), ("I_x", 1.7428)):
        assert abs(values[name]["value"] - truth) < 4.0 * values[name]["standard_error"]
    assert values["surge: X_udot"]["value"] == pytest.approx(X_UDOT, rel=0.01)
    assert "The recorder sits askew" in remarks(outputs, "warning")


@pytest.mark.parametrize("stream", ["imu", "attitude"])
def test_gyro_or_attitude_is_enough(stream: str) -> None:
    logs = {name: {stream: log_of(name)[stream]} for name in (*SWINGS, *DECAYS)}
    values = figures(run(APPARATUS, logs))
    assert values["I of tube"]["value"] == pytest.approx(0.6620, rel=2e-3)
    for suffix in (
        "",
        " (linear and quadratic)",
        " (linear, recursive)",
        " (linear and quadratic, recursive)",
    ):
        # The regression integrates noise-free samples at 50 Hz; without an angle it
        # needs the constants of the gyro.
        assert values[f"surge: X_udot{suffix}"]["value"] == pytest.approx(
            X_UDOT, rel=0.01 if "recursive" in suffix else 2e-3
        )
        assert values[f"empty: added mass{suffix}"]["value"] == pytest.approx(
            POLE, rel=0.02 if "recursive" in suffix else 2e-3
        )


def test_clipped_gyro() -> None:
    outputs = run(part("quadrifilar"), {name: log_of(name, clip=0.12) for name in SWINGS})
    assert "The gyro is clipped in" in remarks(outputs, "warning")
    assert figures(outputs)["I of tube"]["value"] == pytest.approx(0.6620, rel=5e-3)


def test_clipped_gyro_of_a_turned_recorder() -> None:
    turn = Rotation.from_euler("ZYX", [35.0, 30.0, 20.0], degrees=True)
    outputs = run(
        part("quadrifilar"),
        {name: log_of(name, turn=turn, noise=0.001, clip=0.1) for name in SWINGS},
    )
    assert "The gyro is clipped in" in remarks(outputs, "warning")
    assert figures(outputs)["I of tube"]["value"] == pytest.approx(0.6620, rel=5e-3)
    with pytest.raises(DataError, match="leg 'tray' is clipped in"):
        run(part("quadrifilar"), {name: log_of(name, clip=0.01) for name in SWINGS})


def test_attitude_that_shows_less_than_the_gyro() -> None:
    logs = {name: log_of(name, noise=0.001) for name in DECAYS}
    for log in logs.values():
        angles = {
            name: 0.9 * log["attitude"][name].to_numpy()
            for name in ("phi_rad", "theta_rad", "psi_rad")
        }
        log["attitude"] = make_table(
            "attitude", {"time_us": log["attitude"]["time_us"].to_numpy(), **angles}
        )
    outputs = run(part("free_decay"), logs)
    assert "shows 90 % of the swing that the gyro shows" in remarks(outputs, "warning")
    value = figures(outputs)["surge: X_udot"]
    assert abs(value["value"] - X_UDOT) < 4.0 * value["standard_error"]


def test_leg_of_the_other_pendulum() -> None:
    apparatus = part(
        "free_decay", decays=[{"id": "surge", "role": "vehicle", "dof": "surge", "legs": ["tray"]}]
    )
    outputs = run(apparatus, {"tray": log_of("tray")})
    warned = remarks(outputs, "warning")
    assert "should be level: is this the right leg?" in warned
    assert "No decay of the empty pendulum" in warned


def test_overdamped_and_short_decays(monkeypatch: pytest.MonkeyPatch) -> None:
    apparatus = part(
        "free_decay", decays=[{"id": "surge", "role": "vehicle", "dof": "surge", "legs": ["decay"]}]
    )
    log = log_of("decay")
    short = {name: table.slice(0, 200) for name, table in log.items()}
    with pytest.raises(DataError, match="leg 'decay': the pendulum does not swing back"):
        run(apparatus, {"decay": short})
    monkeypatch.setitem(globals(), "X_U", -400.0)
    with pytest.raises(DataError, match="leg 'decay': the pendulum does not swing back"):
        run(apparatus, {"decay": log_of("decay")})


def test_few_swings_of_the_tray() -> None:
    log = {name: table.slice(0, 450) for name, table in log_of("tray").items()}
    with pytest.raises(DataError, match="too few swings"):
        run(part("quadrifilar", swings=APPARATUS["quadrifilar"]["swings"][:1]), {"tray": log})


def test_buoyancy_above_weight() -> None:
    apparatus = part("free_decay", vehicle_displaced_mass=quantity(60.0, "kg"))
    with pytest.raises(DataError, match="does not hang"):
        run(apparatus, {name: log_of(name) for name in DECAYS})


def test_exchanged_recordings_give_no_negative_inertia() -> None:
    apparatus = part("quadrifilar")
    swings = apparatus["quadrifilar"]["swings"]
    swings[0]["legs"], swings[1]["legs"] = ["tube"], ["tray"]
    swings[1]["mass"] = quantity(0.1, "kg")
    with pytest.raises(DataError, match="negative after the tray"):
        run(apparatus, {name: log_of(name) for name in SWINGS})


@pytest.mark.parametrize(
    ("change", "field", "message"),
    [
        (
            lambda a: a["quadrifilar"]["swings"].pop(0),
            "quadrifilar.swings",
            "one swing of the empty tray",
        ),
        (
            lambda a: a["quadrifilar"]["swings"][1].pop("mass"),
            "quadrifilar.swings[1].mass",
            "needs its mass",
        ),
        (
            lambda a: a["quadrifilar"]["swings"][1].update(legs=["tubee"]),
            "quadrifilar.swings[1].legs",
            "no such leg",
        ),
        (
            lambda a: a["quadrifilar"]["swings"][1].pop("legs"),
            "quadrifilar.swings[1]",
            "needs legs that recorded it, or timed",
        ),
        (
            lambda a: a["quadrifilar"].update(line_length=quantity(-4.23, "m")),
            "quadrifilar.line_length.value",
            "must be positive",
        ),
        (
            lambda a: a["quadrifilar"].update(radius_ceiling=quantity(5.0, "m")),
            "quadrifilar.line_length",
            "shorter than",
        ),
        (
            lambda a: a["free_decay"]["decays"][0].pop("dof"),
            "free_decay.decays[0].dof",
            "needs its direction",
        ),
        (
            lambda a: a["free_decay"]["decays"][0].update(legs=["check"]),
            "free_decay.decays[0].legs",
            "needs a leg of use training",
        ),
        (
            lambda a: a["free_decay"].update(arm=quantity(0.0, "m")),
            "free_decay.arm.value",
            "must be positive",
        ),
        (
            lambda a: a["free_decay"]["parts"][0].update(mass=quantity(-1.0, "kg")),
            "free_decay.parts[0].mass.value",
            "below zero",
        ),
        (
            lambda a: a["free_decay"]["decays"].append(a["free_decay"]["decays"][1]),
            "free_decay.decays",
            "at most one decay of the empty",
        ),
    ],
)
def test_faulty_apparatus(change: Any, field: str, message: str) -> None:
    apparatus = copy.deepcopy(APPARATUS)
    change(apparatus)
    if field.startswith("free_decay"):
        del apparatus["quadrifilar"]
    with pytest.raises(CampaignError, match=message) as caught:
        run(apparatus, {name: log_of(name) for name in (*SWINGS, *DECAYS)})
    assert caught.value.field == field


def test_recording_without_sensors() -> None:
    with pytest.raises(DataError, match="neither gyro nor attitude"):
        run(part("quadrifilar", swings=APPARATUS["quadrifilar"]["swings"][:1]), {"tray": {}})
