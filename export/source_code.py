"""The model in plain Python: what the targets `python`, `pvs` and `mujoco` share."""

from __future__ import annotations

import re

from auvid.export.body import Body, Term
from auvid.export.text import number, numbers, product, python_rows, python_tuple
from auvid.hydro.arrays import AXES, Array

_CONSTANTS = '''\
MASS_KG = {mass_kg}
"""Mass of the rigid body [kg]."""
CENTRE_OF_GRAVITY = {r_G}
"""r_G from the origin [m]."""
INERTIA = {inertia}
"""Inertia about the origin [kg m^2]; off-diagonals are minus the products of inertia."""
RIGID_BODY = {rigid_body}
"""M_RB [kg, kg m, kg m^2]."""
ADDED_MASS = {added_mass}
"""M_A = [X_udot ...], derivatives: 0 or less on the diagonal."""
MASS = {mass}
"""M = RIGID_BODY - ADDED_MASS."""
MASS_INVERSE = {mass_inverse}
WEIGHT = {weight}
"""m g [N]."""
BUOYANCY = {buoyancy}
"""B [N]."""
CENTRE_OF_BUOYANCY = {r_B}
"""r_B from the origin [m]."""
WATER_DENSITY = {water_density}
GRAVITY = {gravity}
ACTUATOR_LAG = {lag}
"""First-order lag between command and force of the actuators [s]; 0 for none."""
THRUSTER_EFFECTS = {effects}
"""Row i: force and moment [N, N m] of 1 N of thruster i."""
THRUSTER_LIMITS = {limits}
"""Least and largest force of a thruster [N]; None without thrusters."""
'''

_MOTION = '''\
def viscous(nu{propeller}):
    """Return the viscous force [X, Y, Z, K, M, N] at nu = [u, v, w, p, q, r]."""
    u, v, w, p, q, r = (float(value) for value in nu)
{preparation}    return [
{sums}    ]


def restoring(eta):
    """Return the force of weight and buoyancy at eta = [x, y, z, phi, theta, psi]."""
    phi, theta = float(eta[3]), float(eta[4])
    sf, cf, st, ct = math.sin(phi), math.cos(phi), math.sin(theta), math.cos(theta)
    net = WEIGHT - BUOYANCY
    a, b, c = (
        g * WEIGHT - m * BUOYANCY
        for g, m in zip(CENTRE_OF_GRAVITY, CENTRE_OF_BUOYANCY)
    )
    return [
        -net * st,
        net * ct * sf,
        net * ct * cf,
        b * ct * cf - c * ct * sf,
        -c * st - a * ct * cf,
        a * ct * sf + b * st,
    ]


def force(nu, eta{propeller}):
    """Return all but tau on the right of MASS nu_dot = force(nu, eta) + tau [N, N m].

    That is viscous force and restoring force less C(nu) nu.
    """
    parts = zip(viscous(nu{argument}), restoring(eta), coriolis(nu))
    return [a + b - c for a, b, c in parts]


def coriolis(nu, matrix={coriolis_mass}):
    """Return C(nu) nu of a symmetric mass matrix [N, N m]."""
    u, v, w, p, q, r = (float(value) for value in nu)
    a1, a2, a3, b1, b2, b3 = product(matrix, (u, v, w, p, q, r))
    return [
        q * a3 - r * a2,
        r * a1 - p * a3,
        p * a2 - q * a1,
        v * a3 - w * a2 + q * b3 - r * b2,
        w * a1 - u * a3 + r * b1 - p * b3,
        u * a2 - v * a1 + p * b2 - q * b1,
    ]


def derivative(nu, eta, tau{propeller}):
    """Return nu_dot [m/s^2, rad/s^2] under a force tau [N, N m] of actuators and all else."""
    total = [a + float(b) for a, b in zip(force(nu, eta{argument}), tau)]
{at_rest}    return product(MASS_INVERSE, total)


def pose_rate(nu, eta):
    """Return eta_dot; no number at a pitch of 90 degrees."""
    u, v, w, p, q, r = (float(value) for value in nu)
    phi, theta, psi = (float(value) for value in eta[3:6])
    sf, cf, st, ct = math.sin(phi), math.cos(phi), math.sin(theta), math.cos(theta)
    sp, cp = math.sin(psi), math.cos(psi)
    return [
        cp * ct * u + (cp * st * sf - sp * cf) * v + (sp * sf + cp * cf * st) * w,
        sp * ct * u + (cp * cf + sf * st * sp) * v + (st * sp * cf - cp * sf) * w,
        -st * u + ct * sf * v + ct * cf * w,
        p + (sf * q + cf * r) * st / ct,
        cf * q - sf * r,
        (sf * q + cf * r) / ct,
    ]


def product(matrix, vector):
    """Return a matrix times a vector, as a list."""
    return [sum(a * b for a, b in zip(row, vector)) for row in matrix]
'''

_THRUST = '''\


PULSE_US = {pulse}
FORCE_N = {force}
VOLTAGE, VOLTAGE_EXPONENT = {voltage}, {exponent}
POLYNOMIAL = {polynomial}
DIRECTIONS = {directions}


def thrust(pulse_us, thruster, voltage=VOLTAGE):
    """Return the force [N] of thruster 0, 1, ... at a pulse width [us], bollard."""
    if pulse_us < 800.0:
        return 0.0
    pulse = 1500.0 + DIRECTIONS[thruster] * (pulse_us - 1500.0)
    pulse = min(max(pulse, PULSE_US[0]), PULSE_US[-1])
    if POLYNOMIAL is None:
        piece = 0
        while piece < len(PULSE_US) - 2 and pulse > PULSE_US[piece + 1]:
            piece += 1
        share = (pulse - PULSE_US[piece]) / (PULSE_US[piece + 1] - PULSE_US[piece])
        value = FORCE_N[piece] + share * (FORCE_N[piece + 1] - FORCE_N[piece])
    else:
        end = PULSE_US[-1] if pulse > 1500.0 else PULSE_US[0]
        command = 100.0 * abs((pulse - 1500.0) / (end - 1500.0))
        value = 0.0
        for coefficient in POLYNOMIAL:
            value = value * command + coefficient
        value = 0.0 if command == 0.0 else math.copysign(value, pulse - 1500.0)
    return value * (voltage / VOLTAGE) ** VOLTAGE_EXPONENT


def thruster_force(forces):
    """Return tau [N, N m] of the forces [N] of all thrusters."""
    return [sum(f * e[i] for f, e in zip(forces, THRUSTER_EFFECTS)) for i in range(6)]
'''

_FINS = '''\


FINS_LINEAR = {linear}
FINS_QUADRATIC = {quadratic}


def fin_force(nu, deflections):
    """Return tau of fins deflected [rad]: starboard, port, bottom, top."""
    square = float(nu[0]) ** 2
    return [
        square * sum(a * d + b * d * d for a, b, d in zip(line, curve, deflections))
        for line, curve in zip(FINS_LINEAR, FINS_QUADRATIC)
    ]
'''

_PROPELLER = '''\


INFLOW = {inflow}
"""(1 - wake fraction) / diameter [1/m]."""
PROPELLER_THRUST = {thrust}
PROPELLER_TORQUE = {torque}


def propeller_force(nu, rev_s):
    """Return tau of the propeller at a speed [rev/s]."""
    a, n = INFLOW * float(nu[0]), float(rev_s)
    terms = (a * a, a * abs(n), n * abs(n))
    x, k = (
        sum(c * t for c, t in zip(curve, terms))
        for curve in (PROPELLER_THRUST, PROPELLER_TORQUE)
    )
    return [x, 0.0, 0.0, k, 0.0, 0.0]
'''

_RATIO = '''\


LEVEL_REV_S = {rev_s}
LEVEL_M_S = {speed}
MINIMUM_SPEED = {minimum}


def propulsion_excess(nu, rev_s):
    """Return eta - 1, eta = u_c(n) / U; 0 (level running) for rev_s None.

    nan outside the speeds of LEVEL_REV_S.
    """
    if rev_s is None:
        return 0.0
    n = float(rev_s)
    if not LEVEL_REV_S[0] <= n <= LEVEL_REV_S[-1]:
        return math.nan
    piece = 0
    while piece < len(LEVEL_REV_S) - 2 and n > LEVEL_REV_S[piece + 1]:
        piece += 1
    share = (n - LEVEL_REV_S[piece]) / (LEVEL_REV_S[piece + 1] - LEVEL_REV_S[piece])
    level = LEVEL_M_S[piece] + share * (LEVEL_M_S[piece + 1] - LEVEL_M_S[piece])
    speed = math.sqrt(sum(float(value) ** 2 for value in nu[:3]))
    return level / max(speed, MINIMUM_SPEED) - 1.0
'''


_LACKING = "        math.nan,  # {}: lacking\n"
_AT_REST = """\
    total = [item if axis in AXES else 0.0 for axis, item in zip("XYZKMN", total)]
"""
_PARTIAL = '''\


AXES = {axes}
"""Axes that the model has; MASS_INVERSE holds the velocities of the others."""
LAGS = {lags}
"""Axis -> first-order lag between command and force [s]; the caller applies it."""
GAINS = (
{gains})
"""Axis, output channel (None for the whole axis), force of a full command, dead band, curve,
whether these two are those of the four thrusters that give surge, sway and yaw, and by how
much these give more one way."""
{cross}

def command_force(commands):
    """Return tau of shares of full commands (-1 to 1), by axis or output channel."""
    tau = [0.0] * 6
    for axis, output, gain, dead_band, curve, mixed, skew in GAINS:
        command = float(commands.get(axis if output is None else output, 0.0))
        parts = [(-1, command)]
        if mixed:
            y, z = (float(commands.get(name, 0.0)) for name in "XYN".replace(axis, ""))
            parts = [
                (a * b, max(-1.0, min(1.0, command + a * y + b * z)))
                for a in (1, -1)
                for b in (1, -1)
            ]
        for sign, part in parts:
            size = gain * (max(abs(part) - dead_band, 0.0) / (1.0 - dead_band)) ** curve
            tau["XYZKMN".index(axis)] += size * (
                math.copysign(1.0, part) - sign * skew
            ) / len(parts)
    return tau
'''
_NEWTONS = re.compile(r"\[(?:N|kg)\b[^]]*\]")


def without_newtons(text: str, body: Body) -> str:
    """Return text with shares in place of kg and N, of a body that has no kg."""
    if body.unit_of_mass is None:
        return text
    return _NEWTONS.sub("[shares]", text).replace("MASS_KG", "MASS_SHARE")


def partial_text(body: Body) -> str:
    """Return the axes, lags and gains of a partial model; empty for a whole one."""
    if not body.lags_s:
        return ""
    return _PARTIAL.format(
        axes=repr(body.axes),
        lags=repr(dict(body.lags_s)),
        cross=""
        if not body.cross_forces
        else "CROSS_FORCES = "
        + repr(tuple((item.axis, item.of, item.value, item.lag_s) for item in body.cross_forces))
        + """
\"\"\"Axis, axis whose force makes it, its share, lag [s] behind it; the caller applies it.\"\"\"
""",
        gains="".join(
            f"    ({item.axis!r}, {item.output!r}, {number(item.value)},"
            f" {number(item.dead_band)}, {number(item.curve)}, {item.mixed},"
            f" {number(item.skew)}),\n"
            for item in body.gains
        ),
    )


def constants(body: Body) -> str:
    """Return the constants of a body as assignments of Python."""
    return _CONSTANTS.format(
        mass_kg=number(body.mass_kg),
        r_G=python_tuple(body.r_G),
        inertia=python_rows(body.inertia),
        rigid_body=python_rows(body.rigid_body),
        added_mass=python_rows(body.added_mass),
        mass=python_rows(body.mass),
        mass_inverse=python_rows(body.mass_inverse),
        weight=number(body.weight),
        buoyancy=number(body.buoyancy),
        r_B=python_tuple(body.r_B),
        water_density=number(body.water_density),
        gravity=number(body.gravity),
        lag=number(body.lag_s),
        effects=python_rows([item.effect for item in body.thrusters]) if body.thrusters else "()",
        limits=None if body.force_limits is None else python_tuple(body.force_limits),
    )


def functions(body: Body) -> str:
    """Return the functions of motion and actuators of a body, in Python.

    With terms in eta they take `propeller_rev_s` too.
    """
    ratio = body.with_propeller_terms
    used = {name for term in body.terms for name in term.factors}
    preparation = ""
    if used & {"V", "Vv", "Vw"}:
        preparation += "    V = math.hypot(v, w)\n"
    for name, along in (("Vv", "v"), ("Vw", "w")):
        if name in used:
            preparation += f"    {name} = V * (({along} > 0.0) - ({along} < 0.0))\n"
    if ratio:
        preparation += "    excess = propulsion_excess(nu, propeller_rev_s)\n"
    text = _MOTION.format(
        propeller=", propeller_rev_s=None" if ratio else "",
        argument=", propeller_rev_s" if ratio else "",
        preparation=preparation,
        coriolis_mass="MASS" if body.coriolis else "((0.0,) * 6,) * 6",
        at_rest="" if set(body.axes) == set(AXES) else _AT_REST,
        sums="".join(
            _sum_of(body.terms, axis) if AXES[axis] in body.axes else _LACKING.format(AXES[axis])
            for axis in range(6)
        ),
    )
    if body.curve is not None:
        curve = body.curve
        text += _THRUST.format(
            pulse=python_tuple(curve.pulse_us),
            force=python_tuple(curve.force_N),
            voltage=number(curve.voltage_V),
            exponent=number(curve.voltage_exponent),
            polynomial=None if curve.polynomial is None else python_tuple(curve.polynomial),
            directions=python_tuple([item.direction for item in body.thrusters]),
        )
    if body.fins is not None:
        text += _FINS.format(
            linear=python_rows(body.fins.linear), quadratic=python_rows(body.fins.quadratic)
        )
    if body.propeller is not None:
        screw = body.propeller
        text += _PROPELLER.format(
            inflow=number(screw.inflow_per_u),
            thrust=python_tuple(screw.thrust),
            torque=python_tuple(screw.torque),
        )
        if ratio:
            text += _RATIO.format(
                rev_s=python_tuple(screw.level_speed_rev_s),
                speed=python_tuple(screw.level_speed_m_s),
                minimum=number(screw.minimum_speed_m_s),
            )
    return text


def _sum_of(terms: tuple[Term, ...], axis: int) -> str:
    """Return the sum of an axis as one entry of a list, a term per line."""
    own = [product(term.value, term.factors) for term in terms if term.axis == axis]
    if not own:
        return f"        0.0,  # {AXES[axis]}\n"
    return f"        # {AXES[axis]}\n        " + "\n        + ".join(own) + ",\n"


def octave_sum(terms: tuple[Term, ...], axis: int) -> str:
    """Return the sum of an axis in Octave and MATLAB."""
    own = [product(term.value, term.factors) for term in terms if term.axis == axis]
    return " ...\n  + ".join(own) if own else "0.0"


def flat(matrix: Array, indent: str) -> str:
    """Return a matrix as text, a row per line, numbers apart by blanks."""
    return "".join(f"{indent}{numbers(row)}\n" for row in matrix)
