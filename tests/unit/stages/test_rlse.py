"""Stage rlse on runs of known truth: figures, verdicts, what it says, and what it
refuses.
"""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pytest

from auvid.data_schemas.documents.campaign import LegEntry
from auvid.data_schemas.errors import DataError
from auvid.data_schemas.schemas import schema
from auvid.data_schemas.tables import column, make_table
from auvid.data_schemas.yaml_text import read_yaml
from auvid.hydro.dynamics.actuators.thrusters import thruster_force, thruster_forces
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.hydro.identification.bench.channel_records import ChannelRun
from auvid.hydro.identification.bench.output_error import SingleRun
from auvid.hydro.identification.bench.single_channel import estimate_channel
from auvid.stages import rlse
from tests.support.motions import log_document
from tests.support.single_channel import stepped_run

Array = npt.NDArray[np.float64]
DOCUMENT = read_yaml(
    (Path(__file__).parents[3] / "vehicles/thaus.yaml").read_text(encoding="utf-8")
)
THAUS = vehicle_from_document(DOCUMENT)
CHANNELS = ("surge", "sway", "heave", "roll", "pitch", "yaw")
OUTPUT = {"surge": 1, "sway": 2, "heave": 3, "roll": 4, "yaw": 5}
PERCENT = (40, 80, 30, -50, -90, -30, 60, 90, 20, -70, -40, 50)
MASS, LINEAR, QUADRATIC = 129.85, -20.0, -132.2
START_US, HOLD_S = 5_000_000, 6.0


def pulses(channel: str, percent: float) -> Array:
    out = np.full(5, 1500.0)
    out[OUTPUT[channel] - 1] += 4.0 * percent
    return out


def leg_of(channel: str, **changes: Any) -> dict[str, Any]:
    return {
        "id": "tank",
        "log": "log",
        "channel": channel,
        "start_s": None,
        "end_s": None,
        **changes,
    }


def tables_of(
    channel: str,
    percent: tuple[float, ...] = PERCENT,
    *,
    noise: float = 0.0,
    rate_hz: float = 8.0,
    seed: int = 0,
    trim: float = 0.0,
    linear: float = LINEAR,
) -> dict[str, pa.Table]:
    """Velocity or gyro and attitude, depth, and actuators of a run under steps, with
    white noise on the velocity.
    """
    axis = CHANNELS.index(channel)
    width = np.array([pulses(channel, value) for value in percent])
    force = thruster_force(THAUS.thrusters, thruster_forces(THAUS.thrusters, width))[:, axis]  # type: ignore[arg-type]
    lever = 38.10 * 9.80665 * 0.02 if channel == "roll" else 0.0
    mass, one, two = (MASS, linear, QUADRATIC) if axis < 3 else (2.5, -0.5, -3.0)
    t, x, s, _ = stepped_run(
        force,
        HOLD_S,
        rate_hz,
        lambda x, s, f: (f + one * x + two * x * abs(x) - lever * np.sin(s) + trim) / mass,
    )
    x = x + noise * np.random.default_rng(seed).standard_normal(x.size)
    time = START_US + np.rint(1e6 * t).astype(np.int64)
    zero = np.zeros(t.size)
    hold = START_US + np.arange(len(percent)) * int(1e6 * HOLD_S)
    tables = {
        "actuators": make_table(
            "actuators", {"time_us": hold, **{f"pwm_{n + 1}_us": width[:, n] for n in range(5)}}
        ),
        "depth": make_table(
            "depth", {"time_us": time, "depth_m": 3.0 + (s if channel == "heave" else zero)}
        ),
    }
    if axis < 3:
        tables["velocity"] = make_table(
            "velocity",
            {
                "time_us": time,
                **{f"{n}_m_s": x if i == axis else zero for i, n in enumerate("uvw")},
            },
        )
    else:
        gyro = {f"gyro_{n}_rad_s": x if i == axis - 3 else zero for i, n in enumerate("xyz")}
        tables["imu"] = make_table(
            "imu", {"time_us": time, **gyro, **{f"accel_{n}_m_s2": zero for n in "xyz"}}
        )
        angle = {
            f"{n}_rad": s if i == axis - 3 else zero for i, n in enumerate(("phi", "theta", "psi"))
        }
        tables["attitude"] = make_table("attitude", {"time_us": time, **angle})
    return tables


def run(
    leg: dict[str, Any],
    tables: dict[str, pa.Table],
    vehicle: dict[str, Any] = DOCUMENT,
    **params: Any,
) -> rlse.Outputs:
    end = max(int(column(table, "time_us")[-1]) for table in tables.values())
    info = log_document(start_us=START_US, end_us=end)
    return rlse.run(
        rlse.Inputs(LegEntry(**leg), info, vehicle_from_document(vehicle), **tables),
        rlse.Params(**params),
    )


def figures(outputs: rlse.Outputs) -> dict[str, dict[str, Any]]:
    assert outputs.results is not None
    return {row["quantity"]: row for row in outputs.results["rows"]}


def remarks(outputs: rlse.Outputs, level: str) -> str:
    assert outputs.section is not None
    return " ".join(
        block["text"]
        for block in outputs.section["blocks"]
        if block["kind"] == "remark" and block["level"] == level
    )


@pytest.mark.parametrize(
    ("channel", "names"),
    [("surge", "Xu"), ("sway", "Yv"), ("heave", "Zw"), ("roll", "Kp"), ("yaw", "Nr")],
)
def test_channels_give_their_truth(channel: str, names: str) -> None:
    values = figures(run(leg_of(channel), tables_of(channel, rate_hz=20.0)))
    axis, x = names
    mass, one, two = (MASS, LINEAR, QUADRATIC) if channel in CHANNELS[:3] else (2.5, -0.5, -3.0)
    total = (
        f"m - {axis}_{x}dot"
        if channel in CHANNELS[:3]
        else f"I_{'x' if channel == 'roll' else 'z'} - {axis}_{x}dot"
    )
    dry = 38.10 if channel in CHANNELS[:3] else {"roll": 1.7428, "yaw": 1.4046}[channel]
    # Times are whole microseconds.
    assert values[total]["value"] == pytest.approx(mass, rel=1e-5)
    assert values[f"{axis}_{x}dot"]["value"] == pytest.approx(dry - mass, rel=1e-5)
    assert values[f"{axis}_{x}"]["value"] == pytest.approx(one, rel=1e-4)
    assert values[f"{axis}_{x}|{x}|"]["value"] == pytest.approx(two, rel=1e-4)
    assert values[total]["verdict"] == "identified"
    assert values[total]["headline"]
    # Straight lines between samples of 20 Hz cost the recursive estimate a few parts in
    # a thousand.
    assert values[f"{total} (linear and quadratic, recursive)"]["value"] == pytest.approx(
        mass, rel=0.01 if dry > 10 else 0.05
    )


def test_noisy_run_chooses_the_damping_and_says_what_it_is_sure_of() -> None:
    outputs = run(leg_of("surge"), tables_of("surge", noise=0.01))
    values = figures(outputs)
    total = values["m - X_udot"]
    assert total["low"] < MASS < total["high"]
    assert abs(total["value"] / MASS - 1.0) < 0.024
    assert values["rmse (linear)"]["value"] > 2.0 * values["rmse (linear and quadratic)"]["value"]
    assert values["smallest eigenvalue of C_n (quadratic)"]["verdict"] == "persistently exciting"
    assert "Persistently exciting" in remarks(outputs, "finding")
    assert outputs.channel_run is not None
    assert outputs.channel_history is not None
    last = column(outputs.channel_history, "mass")[-1]
    assert last == pytest.approx(values["m - X_udot (linear and quadratic, recursive)"]["value"])
    assert set(outputs.channel_history["damping"].to_pylist()) == {
        "linear",
        "quadratic",
        "linear and quadratic",
    }
    error = column(outputs.channel_run, "measured") - column(
        outputs.channel_run, "linear_and_quadratic"
    )
    assert np.std(error) == pytest.approx(0.01, rel=0.1)
    assert set(outputs.channel_run["chosen"].to_pylist()) == {"linear and quadratic"}
    assert outputs.views is not None
    for group in outputs.views["groups"]:
        assert set(group["columns"]) <= set(schema(group["table"]).columns)


def test_single_step_is_not_persistently_exciting() -> None:
    outputs = run(leg_of("surge"), tables_of("surge", (60.0,) * 6, noise=0.01))
    values = figures(outputs)
    assert values["m - X_udot (quadratic)"]["verdict"] == "not persistently exciting"
    assert "Not persistently exciting" in remarks(outputs, "warning")


def test_recursion_from_a_small_covariance_misses_the_mass_of_a_step() -> None:
    """The effect of Table 3: a step leaves Theta near zero, so that the mass is far too
    large, while varying steps bring it to the truth from the same start.
    """
    step, varying = (
        figures(
            run(
                leg_of("surge"),
                tables_of("surge", percent, noise=0.01),
                second_prior_spread=4.57,
            )
        )
        for percent in ((60.0,) * 6, (60.0, -40.0, 80.0, -60.0, 30.0, -80.0))
    )
    added, small = "X_udot (quadratic, recursive)", "X_udot (quadratic, recursive, gamma_0 4.57)"
    true = varying["X_udot (quadratic)"]["value"]
    assert step[added]["value"] == pytest.approx(true, rel=0.2)
    assert abs(step[small]["value"] / true - 1.0) > 3.0 * abs(varying[small]["value"] / true - 1.0)
    assert step[small]["value"] < 1.5 * true < 0.0
    assert small not in figures(run(leg_of("surge"), tables_of("surge", (60.0,) * 6, noise=0.01)))


def test_intervals_hold_the_truth_also_under_a_single_step() -> None:
    """As in Table 3, with a run that the added mass is told by a few samples of only."""
    t, u, _, force = stepped_run(
        [22.0], 30.0, 8.0, lambda x, _, f: (f - 27.7411 * x * abs(x)) / 34.4778
    )
    at, none = np.arange(t.size), np.zeros(0, dtype=np.intp)
    rng = np.random.default_rng(3)
    seeds, hits, fired = 40, np.zeros(2), 0
    for _ in range(seeds):
        noisy = u + 0.01 * rng.standard_normal(u.size)
        estimate = estimate_channel(
            ChannelRun(SingleRun(t, force, force, at, noisy, none, np.zeros(0)), noisy, at),
            filter_rate=1.0,
        )
        fit = estimate.fits["quadratic"]
        hits += (
            fit.mass_interval[0] < 34.4778 < fit.mass_interval[1],
            abs(fit.values[2] + 27.7411) < 1.96 * fit.standard_errors[2],
        )
        fired += estimate.excitation["quadratic"].status == "not persistently exciting"
    # 95 % nominal; the binomial standard deviation over 40 seeds is 3.4 %.
    assert np.all(hits / seeds >= 0.85)
    assert fired == seeds


def test_constant_force_is_found_where_asked() -> None:
    tables = tables_of("heave", trim=3.0, noise=0.002, rate_hz=20.0)
    values = figures(run(leg_of("heave"), tables))
    assert values["constant force"]["value"] == pytest.approx(
        3.0, abs=4.0 * values["constant force"]["standard_error"]
    )
    assert "constant force" not in figures(run(leg_of("heave"), tables, constant_force=()))


def test_heave_from_depth_alone() -> None:
    tables = tables_of("heave", rate_hz=10.0)
    del tables["velocity"]
    outputs = run(leg_of("heave"), tables)
    assert figures(outputs)["m - Z_wdot"]["value"] == pytest.approx(MASS, rel=1e-3)
    assert figures(outputs)["rmse (quadratic)"]["unit"] == "m"


def test_commands_without_a_unit_give_ratios_only() -> None:
    tables = tables_of("surge", noise=0.002)
    percent = np.array(PERCENT) / 100.0
    tables["actuators"] = make_table(
        "actuators",
        {"time_us": tables["actuators"]["time_us"].to_numpy(), "command_surge": percent},
    )
    outputs = run(leg_of("surge"), tables)
    values = figures(outputs)
    assert "X_udot" not in values
    assert {"1/(m - X_udot)", "X_u|u|/(m - X_udot)"} <= set(values)
    assert values["1/(m - X_udot)"]["unit"] == "m/s^2"
    assert "without a unit of force" in remarks(outputs, "note")


def test_leg_without_channel_gives_nothing() -> None:
    leg = leg_of("surge")
    del leg["channel"]
    assert run(leg, tables_of("surge")) == rlse.Outputs()


@pytest.mark.parametrize("driven", [True, False])
def test_channel_never_excited(driven: bool) -> None:
    tables = tables_of("surge")
    outputs = run(
        leg_of("sway" if driven else "surge"), tables if driven else tables_of("surge", (0.0,) * 6)
    )
    values = figures(outputs)
    assert all(row["value"] is None and row["verdict"] == "not excited" for row in values.values())
    assert "never excited" in remarks(outputs, "warning")
    assert outputs.channel_run is None


def test_gap_leaves_the_longest_part_and_says_so() -> None:
    tables = tables_of("surge", noise=0.002)
    velocity = tables["velocity"]
    t = column(velocity, "time_us") / 1e6 - 5.0
    tables["velocity"] = velocity.filter(pa.array((t < 10.0) | (t > 14.0)))
    outputs = run(leg_of("surge"), tables)
    assert figures(outputs)["m - X_udot"]["value"] == pytest.approx(MASS, rel=0.02)
    assert "1 gaps of more than 1 s" in remarks(outputs, "warning")


def test_unphysical_damping_is_said() -> None:
    outputs = run(leg_of("surge"), tables_of("surge", noise=0.002, linear=15.0))
    assert figures(outputs)["X_u"]["value"] == pytest.approx(15.0, abs=1.0)
    assert "X_u come out positive" in remarks(outputs, "warning")


def test_mass_of_another_vehicle_is_said() -> None:
    heavy = copy.deepcopy(DOCUMENT)
    heavy["rigid_body"]["mass"]["value"] = 200.0
    outputs = run(leg_of("surge"), tables_of("surge", noise=0.002), heavy)
    assert "X_udot comes out positive" in remarks(outputs, "warning")
    assert "comes out positive" not in remarks(
        run(leg_of("surge"), tables_of("surge", noise=0.002)), "warning"
    )


def test_ballast_of_a_leg_takes_the_place_of_the_vehicle_file() -> None:
    tables = tables_of("surge")
    heavy, plain = (
        figures(run(leg_of("surge", **ballast), tables))["X_udot"]["value"]
        for ballast in ({"mass_kg": 20.9}, {})
    )
    assert heavy == pytest.approx(20.9 - MASS, rel=1e-4)
    assert plain - heavy == pytest.approx(38.10 - 20.9, abs=1e-9)


@pytest.mark.parametrize(
    ("channel", "without", "message"),
    [
        ("surge", "velocity", "needs the stream 'velocity' for surge"),
        ("surge", "actuators", "needs the stream 'actuators'"),
        ("yaw", "imu attitude", "needs the stream 'imu' or 'attitude' for yaw"),
        ("pitch", "", "needs the stream 'velocity' for pitch"),
    ],
)
def test_missing_streams(channel: str, without: str, message: str) -> None:
    tables = tables_of("roll" if channel == "pitch" else channel)
    for name in without.split():
        del tables[name]
    with pytest.raises(DataError, match=message):
        run(leg_of(channel), tables)


def test_a_leg_without_force_or_command_is_refused() -> None:
    tables = tables_of("surge")
    time = tables["actuators"]["time_us"].to_numpy()
    tables["actuators"] = make_table(
        "actuators", {"time_us": time, "command_yaw": np.zeros(time.size)}
    )
    with pytest.raises(DataError, match="leg 'tank' has no force or command for surge"):
        run(leg_of("surge"), tables)


def test_leg_too_short() -> None:
    with pytest.raises(DataError, match="too few samples in leg 'tank'"):
        run(leg_of("surge", start_s=0.0, end_s=1.0), tables_of("surge"))


def test_pulse_of_nothing_is_no_thrust() -> None:
    """A disarmed autopilot writes pulses of 0: no thrust, not full reverse."""
    tables = tables_of("surge", (0.0, *PERCENT), noise=0.002)
    columns = {
        name: np.array(tables["actuators"][name]) for name in tables["actuators"].column_names
    }
    for number in range(1, 6):
        columns[f"pwm_{number}_us"] = np.where(
            np.arange(len(PERCENT) + 1) == 0, 0.0, columns[f"pwm_{number}_us"]
        )
    tables["actuators"] = make_table("actuators", columns)
    assert figures(run(leg_of("surge"), tables))["m - X_udot"]["value"] == pytest.approx(
        MASS, rel=0.01
    )
