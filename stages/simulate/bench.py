"""Fly the experiments of a bench plan, and record them.

As the vehicle's sensors or a Pixhawk on the pendulum would.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from auvid.data_schemas.documents.apparatus import (
    ApparatusDocument,
    FreeDecayEntry,
    QuadrifilarEntry,
)
from auvid.data_schemas.documents.plans.plan import (
    DecayFlightEntry,
    SwingFlightEntry,
    TankRunEntry,
)
from auvid.data_schemas.errors import CampaignError, DataError, nearest
from auvid.data_schemas.units import NEUTRAL_US
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.actuators.thrusters import (
    FULL_COMMAND,
    Thrusters,
    thruster_force,
    thruster_forces,
)
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned
from auvid.hydro.dynamics.simplified import DERIVATIVES, LINEAR, QUADRATIC
from auvid.hydro.dynamics.simulation.bench_motion import (
    BenchMotion,
    PhysicalPendulum,
    Quadrifilar,
    drive,
    free_decay,
    swing,
)
from auvid.hydro.dynamics.simulation.rov.orders import random_numbers
from auvid.hydro.dynamics.simulation.rov.sensors import START_US, regular_times
from auvid.hydro.dynamics.simulation.sensor_models import (
    AhrsNoise,
    ahrs,
    pressure_depth,
    velocity_log,
)
from auvid.hydro.dynamics.simulation.simulation import Motion, constant_actuation
from auvid.hydro.dynamics.vehicle.vehicle import MountedSensor, Vehicle
from auvid.stages.columns import GYRO, POSE, VELOCITY, named
from auvid.stages.simulate.bench_plans import OUTPUTS, BenchPlan, Experiment, output_of
from auvid.stages.simulate.flights import DEPTH, IMU
from auvid.stages.simulate.flights import VELOCITY as DVL
from auvid.stages.simulate.sensing import ACCEL, Recorded, wrapped

LOOK_S = 0.1
DOFS = ("surge", "sway", "heave")
E = TypeVar("E")


@dataclass(frozen=True)
class FlownExperiment:
    """A run with its motion, the pulses of a tank run, and its true numbers.

    Times count from the start of its leg.
    """

    experiment: Experiment
    trajectory: BenchMotion
    truth: Mapping[str, float]
    changes_s: Array | None = None
    pulses_us: Array | None = None


def fly_experiment(
    experiment: Experiment, plan: BenchPlan, vehicle: Vehicle, apparatus: ApparatusDocument | None
) -> FlownExperiment:
    """Fly one run.

    Raises `CampaignError` where the apparatus does not have what it names, `DataError`
    where the motion cannot be.
    """
    entry = experiment.entry
    if isinstance(entry, TankRunEntry):
        return _tank(experiment, entry, plan, vehicle)
    pendulum = None if apparatus is None else apparatus.free_decay
    if isinstance(entry, DecayFlightEntry) and pendulum is not None:
        return _decay(experiment, entry, plan, vehicle, pendulum)
    tray = None if apparatus is None else apparatus.quadrifilar
    if isinstance(entry, SwingFlightEntry) and tray is not None:
        return _swing(experiment, entry, vehicle, tray)
    part = {"decays": "free_decay", "swings": "quadrifilar"}[experiment.kind]
    raise CampaignError(
        f"the plan has {experiment.kind}, but there is no apparatus with '{part}'",
        field="apparatus",
        remedy="Name the document of the pendulums in the manifest (apparatus: apparatus.yaml).",
    )


def _tank(
    experiment: Experiment, entry: TankRunEntry, plan: BenchPlan, vehicle: Vehicle
) -> FlownExperiment:
    """Fly a tank run from rest, every command constant until the next.

    Thrust follows the whole pulses that are logged.
    """
    assert vehicle.thrusters is not None
    commands = entry.commands
    changes = np.unique(np.concatenate([[0.0], *(steps.times_s for steps in commands.values())]))
    pulses = np.full((changes.size, len(vehicle.thrusters.outputs)), NEUTRAL_US)
    for channel, steps in commands.items():
        index = output_of(channel, vehicle)
        values = np.concatenate([[0.0], steps.values_percent])
        percent = values[np.searchsorted(steps.times_s, changes + 1e-9, side="right")]
        pulses[:, index] = np.rint(_pulse(vehicle.thrusters, percent))
    tau = thruster_force(vehicle.thrusters, thruster_forces(vehicle.thrusters, pulses))
    start = np.array([0.0, 0.0, plan.depth_m, 0.0, 0.0, 0.0])
    trajectory = drive(plan.model(entry.truth, vehicle), start, changes, tau, experiment.end_s)
    shallowest = float(trajectory(np.arange(0.0, experiment.end_s, LOOK_S))[0][:, 8].min())
    if shallowest < 0.0:
        remedy = "Start deeper (depth_m), or heave less."
        raise DataError(
            f"run '{experiment.id}' leaves the water",
            value=f"{-shallowest:.2g} m above the surface",
            remedy=remedy,
        )
    return FlownExperiment(experiment, trajectory, plan.truths[entry.truth], changes, pulses)


def _pulse(thrusters: Thrusters, percent: Array) -> Array:
    """Pulses [us] of commands of -100 to 100."""
    ends = thrusters.curve.pwm_us
    return np.asarray(
        np.interp(percent, [-FULL_COMMAND, 0.0, FULL_COMMAND], [ends[0], NEUTRAL_US, ends[-1]])
    )


def _decay(
    experiment: Experiment,
    entry: DecayFlightEntry,
    plan: BenchPlan,
    vehicle: Vehicle,
    apparatus: FreeDecayEntry,
) -> FlownExperiment:
    truth = plan.truths[entry.truth]
    decays = {decay.id: decay for decay in apparatus.decays}
    hung = _named(entry.decay, decays, "bench.decays.decay", "decay")
    pendulum = pendulum_of(apparatus, truth, vehicle, dof=hung.loaded_dof)
    angle = float(np.radians(entry.angle_deg))
    return FlownExperiment(experiment, free_decay(pendulum, angle, experiment.end_s), truth)


def pendulum_of(
    apparatus: FreeDecayEntry, truth: Mapping[str, float], vehicle: Vehicle, *, dof: str | None
) -> PhysicalPendulum:
    """Return the pendulum of part `free_decay` of an apparatus.

    Empty (`dof` None) or with the vehicle's axis `dof` along the swing.

    Mass, added mass and drag of the vehicle act at the arm L, as in Alberti (66)-(70):
    its turning with the pole is left out. The parts have their own arms; those of the
    pole's own water (pole_added_mass, pole_linear, pole_quadratic) are given at L.
    """
    arm, gravity = apparatus.arm.si, vehicle.gravity
    inertia = restoring = 0.0
    for part in apparatus.parts:
        mass, at = part.mass.si, part.arm.si
        inertia += mass * at**2 + part.inertia.si
        displaced_arm = (part.displaced_arm or part.arm).si
        restoring += gravity * (mass * at - part.displaced_mass.si * displaced_arm)
    added, linear, quadratic = (
        truth.get(name, 0.0) for name in ("pole_added_mass", "pole_linear", "pole_quadratic")
    )
    if dof is not None:
        axis = DOFS.index(dof)
        hung, water = apparatus.vehicle_mass, apparatus.vehicle_displaced_mass
        mass = truth.get("mass", vehicle.mass_kg if hung is None else hung.si)
        displaced = vehicle.displaced_mass_kg if water is None else water.si
        inertia += mass * arm**2
        restoring += gravity * (mass - displaced) * arm
        added += truth.get(DERIVATIVES[axis], float(vehicle.added_mass[axis, axis]))
        linear += truth.get(LINEAR[axis], 0.0)
        quadratic += truth.get(QUADRATIC[axis], 0.0)
    return PhysicalPendulum(
        inertia - added * arm**2, restoring, linear * arm**2, quadratic * arm**3
    )


def _swing(
    experiment: Experiment, entry: SwingFlightEntry, vehicle: Vehicle, apparatus: QuadrifilarEntry
) -> FlownExperiment:
    swings = {item.id: item for item in apparatus.swings}
    laid = _named(entry.swing, swings, "bench.swings.swing", "swing")
    tray = Quadrifilar(
        inertia=entry.inertia_kg_m2,
        mass=apparatus.tray_mass.si + (0.0 if laid.mass is None else laid.mass.si),
        radius_ceiling=apparatus.radius_ceiling.si,
        radius_tray=apparatus.radius_tray.si,
        line=apparatus.line_length.si,
        damping=entry.damping_N_m_s,
        gravity=vehicle.gravity,
    )
    trajectory = swing(tray, float(np.radians(entry.angle_deg)), experiment.end_s)
    return FlownExperiment(experiment, trajectory, {"inertia": tray.inertia, "mass": tray.mass})


def _named(name: str, entries: Mapping[str, E], field: str, what: str) -> E:
    if name not in entries:
        raise CampaignError(
            f"the apparatus has no such {what}",
            field=field,
            value=name,
            allowed=entries,
            remedy=nearest(name, entries),
        )
    return entries[name]


def record_experiment(
    flown: FlownExperiment, plan: BenchPlan, vehicle: Vehicle, *, seed: int, text: str
) -> Recorded:
    """Return the streams of a run's log.

    It begins `margin_s` before its leg; clocks tick in whole milliseconds.
    """
    noisy = plan.with_noise(flown.experiment.entry.noise)
    return (_record_tank if flown.experiment.kind == "tank" else _record_pendulum)(
        flown, noisy, vehicle, seed, text
    )


def _record_tank(
    flown: FlownExperiment, plan: BenchPlan, vehicle: Vehicle, seed: int, text: str
) -> Recorded:
    assert vehicle.thrusters is not None
    assert flown.changes_s is not None
    assert flown.pulses_us is not None
    name, margin = flown.experiment.id, flown.experiment.margin_s
    times = {
        stream: regular_times(margin + flown.experiment.end_s, stream, rate)
        for stream, rate in plan.rates_hz.items()
    }
    at = {stream: (values - START_US) / 1e6 - margin for stream, values in times.items()}
    motion = {stream: _free(values, flown.trajectory) for stream, values in at.items()}
    unit = ahrs(
        motion["imu"],
        vehicle.imu,
        plan.ahrs,
        random_numbers(seed, name, IMU),
        rate_hz=plan.rates_hz["imu"],
        gravity=vehicle.gravity,
    )
    velocity = velocity_log(
        motion["velocity"],
        vehicle.dvl,
        random_numbers(seed, name, DVL),
        noise_m_s=plan.velocity_sd_m_s,
    )
    depth = pressure_depth(
        motion["depth"],
        vehicle.depth_sensor,
        random_numbers(seed, name, DEPTH),
        noise_m=plan.depth_sd_m,
    )
    logged = np.zeros((at["actuators"].size, OUTPUTS))
    # A command holds from its own time on; before the first sample of the leg the
    # outputs are neutral.
    which = np.searchsorted(flown.changes_s, at["actuators"] + 1e-9, side="right") - 1
    pulses = np.where(which[:, None] < 0, NEUTRAL_US, flown.pulses_us[np.maximum(which, 0)])
    logged[:, [output - 1 for output in vehicle.thrusters.outputs]] = pulses
    streams = {
        "imu": {"time_us": times["imu"], **named(GYRO, unit.gyro), **named(ACCEL, unit.accel)},
        "attitude": {"time_us": times["imu"], **named(POSE[3:], wrapped(unit))},
        "velocity": {"time_us": times["velocity"], **named(VELOCITY[:3], velocity)},
        "depth": {"time_us": times["depth"], "depth_m": depth},
        "actuators": {
            "time_us": times["actuators"],
            **named(tuple(f"pwm_{number}_us" for number in range(1, OUTPUTS + 1)), logged),
        },
    }
    return Recorded(name, streams, unit.biases, text)


def _free(t_s: Array, trajectory: BenchMotion) -> Motion:
    state, rate = trajectory(t_s)
    return _motion(t_s, state[:, 6:], state[:, :6], rate[:, :6])


def _motion(t_s: Array, eta: Array, nu: Array, nu_dot: Array) -> Motion:
    """A motion of which the sensors need pose, velocity and acceleration alone."""
    return Motion(
        t_s,
        eta,
        nu,
        nu_dot,
        constant_actuation(0.0, np.zeros(4), knots=t_s.size),
        np.zeros(nu.shape),
    )


def _record_pendulum(
    flown: FlownExperiment, plan: BenchPlan, vehicle: Vehicle, seed: int, text: str
) -> Recorded:
    """Return the streams of a Pixhawk on a pendulum.

    On the pole, below the pivot, or in the middle of the tray; pole and tray turn it in
    pitch or yaw.
    """
    name, margin, rate = flown.experiment.id, flown.experiment.margin_s, plan.pixhawk_hz
    times = regular_times(margin + flown.experiment.end_s, "imu", rate)
    state, speed = flown.trajectory((times - START_US) / 1e6 - margin)
    axis = 4 if flown.experiment.kind == "decays" else 5
    eta, nu, nu_dot = (np.zeros((times.size, 6)) for _ in range(3))
    eta[:, axis], nu[:, axis], nu_dot[:, axis] = state[:, 0], speed[:, 0], speed[:, 1]
    turn = rotation_body_to_ned(plan.pixhawk_mounting_rad)
    arm = np.array([0.0, 0.0, plan.pixhawk_arm_m if axis == 4 else 0.0])
    noise: AhrsNoise = plan.pixhawk
    motion = turned(_motion((times - START_US) / 1e6, eta, nu, nu_dot), turn)
    sensor = MountedSensor(arm @ turn, np.eye(3), 0.0)
    unit = ahrs(
        motion,
        sensor,
        noise,
        random_numbers(seed, name, IMU),
        rate_hz=rate,
        gravity=vehicle.gravity,
    )
    streams = {
        "imu": {"time_us": times, **named(GYRO, unit.gyro), **named(ACCEL, unit.accel)},
        "attitude": {"time_us": times, **named(POSE[3:], wrapped(unit))},
    }
    return Recorded(name, streams, unit.biases, text)


def turned(motion: Motion, turn: Array) -> Motion:
    """Return the motion in axes turned by `turn` (3, 3), sensor axes -> body axes.

    An autopilot reports all in its own axes.
    """
    rotation = rotation_body_to_ned(motion.eta[:, 3:]) @ turn
    eta = motion.eta.copy()
    eta[:, 3] = np.arctan2(rotation[:, 2, 1], rotation[:, 2, 2])
    eta[:, 4] = np.arcsin(np.clip(-rotation[:, 2, 0], -1.0, 1.0))
    eta[:, 5] = np.arctan2(rotation[:, 1, 0], rotation[:, 0, 0])
    parts = [
        np.concatenate([values[:, :3] @ turn, values[:, 3:] @ turn], axis=1)
        for values in (motion.nu, motion.nu_dot)
    ]
    return _motion(motion.t_s, eta, parts[0], parts[1])
