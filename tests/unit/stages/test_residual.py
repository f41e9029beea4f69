"""The stage residual: components that add up, where commands and motor directions come
from, and what it refuses.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from auvid.data_schemas.errors import DataError
from auvid.data_schemas.tables import column, make_table, matrix
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.actuators.thrusters import thruster_force, thruster_forces
from auvid.hydro.dynamics.equations_of_motion import Control
from auvid.hydro.identification.signals.filters import zero_phase_lowpass
from auvid.stages import residual
from auvid.stages.base import ports
from auvid.stages.columns import forces
from tests.support.dynamics_oracles import inverse_dynamics
from tests.support.motions import (
    FINS,
    Motion,
    fused_table,
    fusion_document,
    log_document,
    ratio_of,
    resampled_table,
    rich_motion,
    segment_document,
    shipped_vehicle,
)

ROV = shipped_vehicle("bluerov2_heavy")
PULSES = tuple(f"pwm_{number}_us" for number in range(1, 9))


@pytest.fixture(scope="module")
def motion() -> Motion:
    return rich_motion(20.0, seed=3)


def pulses(motion: Motion) -> Array:
    rng = np.random.default_rng(0)
    return np.asarray(
        1500.0
        + 200.0 * np.sin(np.outer(motion.t_s, rng.uniform(0.2, 1.0, 8)) + rng.uniform(0.0, 6.0, 8))
    )


def rov_table(
    motion: Motion, pwm: Array, *, voltage: Array | None = None, without: tuple[str, ...] = ()
) -> pa.Table:
    columns: dict[str, Any] = {
        name: np.zeros(motion.t_s.size)
        for name in ("z_m", "z_dot_m_s", "phi_rad", "theta_rad", "psi_rad")
    }
    columns |= {f"{name}_dot_rad_s": np.zeros(motion.t_s.size) for name in ("phi", "theta", "psi")}
    columns |= {name: pwm[:, index] for index, name in enumerate(PULSES) if name not in without}
    if voltage is not None:
        columns["voltage_v"] = voltage
    return make_table("resampled", {"t_s": motion.t_s, **columns})


def as_loaded(port: str, table: pa.Table) -> pa.Table:
    """The columns of a table that the runner loads for a port."""
    columns = {"t_s", *ports(residual.Inputs)[port]["columns"]}
    return table.select([name for name in table.column_names if name in columns])


def run(
    motion: Motion,
    table: pa.Table,
    vehicle: str = "vt690",
    *,
    fusion: Mapping[str, Any] | None = None,
    parameters: Mapping[str, float] | None = None,
    **params: Any,
) -> residual.Outputs:
    residual_inputs = residual.Inputs(
        segment_document(),
        as_loaded("fused", fused_table(motion)),
        fusion_document(**(fusion or {})),
        as_loaded("resampled", table),
        shipped_vehicle(vehicle),
        log_document(parameters=dict(parameters or {})),
    )
    return residual.run(residual_inputs, residual.Params(**params))


def warnings(outputs: residual.Outputs) -> list[str]:
    return [
        block["text"]
        for block in outputs.section["blocks"]
        if block["kind"] == "remark" and block["level"] == "warning"
    ]


def test_components_add_up_to_the_residual_force(motion: Motion) -> None:
    table = run(motion, resampled_table(motion)).residual
    inertial = (
        "rigid_body_inertia",
        "added_mass_inertia",
        "rigid_body_coriolis",
        "added_mass_coriolis",
    )
    total = sum(forces(table, name) for name in inertial) - sum(
        forces(table, name) for name in ("restoring", "fins", "propeller")
    )
    np.testing.assert_allclose(
        forces(table, "tau_bar"), total, rtol=0.0, atol=1e-10
    )  # N, N m; parts up to 500
    assert "thrusters_X_N" not in table.column_names
    np.testing.assert_allclose(column(table, "eta_ratio"), ratio_of(motion), rtol=1e-14)
    vehicle = shipped_vehicle("vt690")
    control = Control(propeller_rev_s=motion.rev_s, fins_rad=motion.fins)
    expected = inverse_dynamics(vehicle, motion.eta, motion.nu, motion.nu_dot, control)
    np.testing.assert_allclose(forces(table, "tau_bar"), expected, rtol=0.0, atol=1e-9)


def test_thruster_vehicle_has_no_propulsion_ratio(motion: Motion) -> None:
    table = run(motion, rov_table(motion, pulses(motion)), "bluerov2_heavy").residual
    assert "eta_ratio" not in table.column_names
    assert not {"fins_X_N", "propeller_X_N"} & set(table.column_names)
    assert ROV.thrusters is not None
    expected = thruster_force(ROV.thrusters, thruster_forces(ROV.thrusters, pulses(motion)))
    np.testing.assert_allclose(forces(table, "thrusters"), expected, rtol=0.0, atol=1e-10)


def test_horizontal_thrusters_below_the_origin_turn_the_vehicle(motion: Motion) -> None:
    """Thrusters 1 to 4 at z = +0.085 m: surge thrust X gives the pitch moment +0.085 X,
    sway thrust Y the roll moment -0.085 Y.
    """
    pwm = np.full((motion.t_s.size, 8), 1500.0)
    pwm[:, :4] = pulses(motion)[:, :4]
    thrust = forces(run(motion, rov_table(motion, pwm), "bluerov2_heavy").residual, "thrusters")
    np.testing.assert_allclose(thrust[:, 4], 0.085 * thrust[:, 0], rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(thrust[:, 3], -0.085 * thrust[:, 1], rtol=0.0, atol=1e-10)
    assert np.abs(thrust[:, [0, 1, 5]]).max(axis=0).min() > 1.0
    np.testing.assert_array_equal(thrust[:, 2], 0.0)


def test_actuators_pass_the_filter_of_the_state(motion: Motion) -> None:
    table, fusion = resampled_table(motion), {"cutoff_hz": 1.0}
    filtered = run(motion, table, fusion=fusion).residual
    rev_s = zero_phase_lowpass(motion.t_s, motion.rev_s, cutoff_hz=1.0)
    fins = zero_phase_lowpass(motion.t_s, motion.fins, cutoff_hz=1.0)
    control = Control(propeller_rev_s=rev_s, fins_rad=fins)
    expected = inverse_dynamics(
        shipped_vehicle("vt690"),
        motion.eta,
        motion.nu,
        motion.nu_dot,
        control,
    )
    np.testing.assert_allclose(forces(filtered, "tau_bar"), expected, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(
        column(filtered, "eta_ratio"), ratio_of(motion), rtol=1e-14
    )  # u_c of the command, not of the filtered speed
    bare = run(motion, table, fusion=fusion, filter_actuators=False).residual
    np.testing.assert_array_equal(
        forces(bare, "tau_bar"), forces(run(motion, table).residual, "tau_bar")
    )


def test_commands_are_those_of_the_times_that_fuse_kept(motion: Motion) -> None:
    complete = run(motion, resampled_table(motion)).residual
    rows = slice(25, -25)
    inner = Motion(*(values[rows] for values in vars(motion).values()))
    residual_inputs = residual.Inputs(
        segment_document(),
        fused_table(inner),
        fusion_document(),
        resampled_table(motion),
        shipped_vehicle("vt690"),
        log_document(),
    )
    cut = residual.run(residual_inputs, residual.Params()).residual
    # the last bit depends on where a row falls in a vector register of numpy
    np.testing.assert_allclose(
        matrix(cut, complete.column_names),
        matrix(complete, complete.column_names)[rows],
        rtol=1e-14,
        atol=1e-13,
    )


def test_motor_directions_of_the_log_override_those_of_the_vehicle(motion: Motion) -> None:
    table = rov_table(motion, pulses(motion))
    assert ROV.thrusters is not None
    turned = {
        f"MOT_{number}_DIRECTION": -float(sign)
        for number, sign in enumerate(ROV.thrusters.direction, start=1)
    }
    plain, mirrored = (
        run(motion, table, "bluerov2_heavy", parameters=parameters) for parameters in ({}, turned)
    )
    again = run(motion, rov_table(motion, 3000.0 - pulses(motion)), "bluerov2_heavy").residual
    np.testing.assert_allclose(
        forces(mirrored.residual, "thrusters"), forces(again, "thrusters"), rtol=0.0, atol=1e-10
    )
    assert not np.allclose(
        forces(mirrored.residual, "thrusters"), forces(plain.residual, "thrusters")
    )
    assert "parameters MOT_n_DIRECTION" in mirrored.section["blocks"][0]["text"]
    assert "vehicle file" in plain.section["blocks"][0]["text"]


@pytest.mark.parametrize("fault", ["one missing", "zero"])
def test_half_known_directions_are_not_mixed(motion: Motion, fault: str) -> None:
    parameters = {f"MOT_{number}_DIRECTION": -1.0 for number in range(1, 9)}
    parameters |= {"MOT_3_DIRECTION": 0.0} if fault == "zero" else {}
    if fault == "one missing":
        del parameters["MOT_3_DIRECTION"]
    table = rov_table(motion, pulses(motion))
    mixed = run(motion, table, "bluerov2_heavy", parameters=parameters).residual
    np.testing.assert_array_equal(
        forces(mixed, "thrusters"),
        forces(run(motion, table, "bluerov2_heavy").residual, "thrusters"),
    )


def test_direction_is_that_of_the_motor_that_the_output_drives() -> None:
    directions = {f"MOT_{number}_DIRECTION": 1.0 for number in range(1, 9)} | {
        "MOT_2_DIRECTION": -1.0
    }
    functions = {"SERVO1_FUNCTION": 34.0, "SERVO2_FUNCTION": 33.0}
    turned, _ = residual.with_logged_directions(ROV, directions | functions)
    assert turned.thrusters is not None
    assert turned.thrusters.direction.tolist() == [-1.0, *[1.0] * 7]


def test_voltage_scales_the_thrust_and_its_absence_is_told(motion: Motion) -> None:
    pwm, n = pulses(motion), motion.t_s.size
    without = run(motion, rov_table(motion, pwm), "bluerov2_heavy")
    never = run(motion, rov_table(motion, pwm, voltage=np.full(n, np.nan)), "bluerov2_heavy")
    full = run(motion, rov_table(motion, pwm, voltage=np.full(n, 14.0)), "bluerov2_heavy")
    factor = (14.0 / 16.0) ** 1.1
    np.testing.assert_allclose(
        forces(full.residual, "thrusters"),
        factor * forces(without.residual, "thrusters"),
        rtol=1e-12,
        atol=1e-12,
    )
    np.testing.assert_array_equal(
        forces(never.residual, "thrusters"), forces(without.residual, "thrusters")
    )
    assert warnings(full) == []
    for outputs in (without, never):
        assert "16 V" in warnings(outputs)[0]


def test_thrust_follows_the_voltage_over_time(motion: Motion) -> None:
    """A battery that sags from 16 to 12 V along the segment, its commands the same: each
    sample of the thrust is scaled by its own voltage.
    """
    pwm, voltage = pulses(motion), np.linspace(16.0, 12.0, motion.t_s.size)
    sagging, nominal = (
        forces(
            run(motion, rov_table(motion, pwm, voltage=v), "bluerov2_heavy").residual, "thrusters"
        )
        for v in (voltage, np.full_like(voltage, 16.0))
    )
    factor = (voltage / 16.0) ** 1.1
    np.testing.assert_allclose(sagging, factor[:, None] * nominal, rtol=1e-12, atol=1e-12)


def test_partly_missing_voltage_is_counted_and_the_nearest_stands_in(motion: Motion) -> None:
    """The battery reports once a second and so often later than the leg begins: that
    must not change the scale of the thrust.
    """
    pwm, voltage = pulses(motion), np.full(motion.t_s.size, 14.0)
    full = run(motion, rov_table(motion, pwm, voltage=voltage), "bluerov2_heavy")
    voltage[:50] = np.nan
    partly = run(motion, rov_table(motion, pwm, voltage=voltage), "bluerov2_heavy")
    np.testing.assert_array_equal(
        forces(partly.residual, "thrusters"), forces(full.residual, "thrusters")
    )
    assert "missing in 5.0 % of the segment" in warnings(partly)[0]


@pytest.mark.parametrize("vehicle", ["vt690", "bluerov2_heavy"])
def test_no_actuator_activity_is_refused_unless_allowed(motion: Motion, vehicle: str) -> None:
    still = Motion(
        motion.t_s,
        motion.eta,
        motion.nu,
        motion.nu_dot,
        np.zeros_like(motion.rev_s),
        np.zeros_like(motion.fins),
    )
    neutral = np.full((motion.t_s.size, 8), 1510.0)  # inside the dead band
    table = resampled_table(still) if vehicle == "vt690" else rov_table(motion, neutral)
    with pytest.raises(DataError, match=r"no actuator acts in segment 'one'.*allow_no_actuation"):
        run(still, table, vehicle)
    assert run(still, table, vehicle, allow_no_actuation=True).residual.num_rows == motion.t_s.size


def test_missing_columns_are_all_named(motion: Motion) -> None:
    table = rov_table(motion, pulses(motion), without=("pwm_3_us", "pwm_8_us"))
    with pytest.raises(
        DataError,
        match=(
            r"stage residual needs the stream 'actuators' with pwm_3_us, pwm_8_us .*can come from"
        ),
    ):
        run(motion, table, "bluerov2_heavy")
    with pytest.raises(DataError, match="propeller_rev_s"):
        run(motion, resampled_table(motion, without=("propeller_rev_s",)))
    with pytest.raises(DataError, match=r"fin_s_rad, fin_b_rad"):
        run(motion, resampled_table(motion, without=(FINS[0], FINS[2])))


def test_commands_that_end_before_the_segment_are_refused(motion: Motion) -> None:
    pwm = pulses(motion)
    pwm[-10:, 2] = np.nan
    with pytest.raises(DataError, match="does not cover segment 'one'"):
        run(motion, rov_table(motion, pwm), "bluerov2_heavy")


def test_propeller_speed_beyond_the_level_speeds_is_refused(motion: Motion) -> None:
    rpm = Motion(motion.t_s, motion.eta, motion.nu, motion.nu_dot, 60.0 * motion.rev_s, motion.fins)
    with pytest.raises(DataError, match=r"propeller_rev_s.*level speeds.*revolutions per second"):
        run(rpm, resampled_table(rpm))


def test_inputs_are_not_written_to(motion: Motion) -> None:
    table = resampled_table(motion)
    before = table.to_pydict()
    run(motion, table, fusion={"cutoff_hz": 2.0})
    assert table.to_pydict() == before
