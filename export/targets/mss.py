"""A function of MATLAB and Octave as those of the Marine Systems Simulator (MSS)."""

from __future__ import annotations

from auvid.export.exported import Exported, Request, Target
from auvid.export.source_code import octave_sum
from auvid.export.targets.python import late_actuators
from auvid.export.text import commented, number, octave_matrix

CONVENTION = (
    "As in MSS: body axes x forward, y starboard, z down; world NED; x = [nu; eta] with nu = [u v"
    " w p q r]' and eta = [x y z phi theta psi]'; moments about the body origin (CO); SI and"
    " radians. M = MRB + MA with MA positive, the sign of MSS, = minus the derivatives; damping"
    " has negative coefficients on the right-hand side."
)
_USAGE = """\
Put `{name}.m` on the path of MATLAB or Octave; MSS itself is not needed.

```matlab
x = [0.3; 0; 0; 0; 0; 0; 0; 0; 5; 0; 0; 0];   % nu and eta
tau_control = [10; 0; 0; 0; 0; 0];            % N, N m
[xdot, tau] = {name}(x, tau_control);         % M nu_dot = tau + tau_control
```
{more}"""


def export(request: Request) -> Exported:
    """Return `NAME.m`: [xdot, tau] = NAME(x, tau_control).

    (MRB + MA) nu_dot = tau + tau_control, tau = tau_viscous + tau_G - C(nu) nu with C =
    m2c(MRB + MA, nu): cybergalactic/MSS LIBRARY/modeling/m2c.m (736a3d1), Fossen 2021
    Theorem 3.2. Nothing is lost.
    """
    body, name = request.body, request.name
    ratio = body.with_propeller_terms
    used = {item for term in body.terms for item in term.factors}
    lines = [f"function [xdot, tau] = {name}(x, tau_control{', n' if ratio else ''})\n"]
    head = [
        f"[xdot, tau] = {name}(x, tau_control): {body.title}.",
        "",
        *request.head,
        "",
        CONVENTION,
        "",
        "x            nu and eta (12x1)",
        "tau_control  force of actuators and all else (6x1) [N, N m]",
        *(
            [
                "n            propeller speed [rev/s]; without it, level running",
                "             (NaN outside the table of speeds level_n)",
            ]
            if ratio
            else []
        ),
        "xdot         rate of x (12x1)",
        "tau          all forces but tau_control, less C(nu) nu: M nu_dot = tau + tau_control",
    ]
    lines.append(commented(head, "%"))
    lines.append("x = x(:);\nif nargin < 2, tau_control = zeros(6, 1); end\n")
    lines.append("u = x(1); v = x(2); w = x(3); p = x(4); q = x(5); r = x(6);\n")
    lines.append("phi = x(10); theta = x(11); psi = x(12);\n\n")
    lines.append(f"MRB = {octave_matrix(body.rigid_body)};\n")
    lines.append(f"MA = {octave_matrix(-body.added_mass)};\nM = MRB + MA;\n\n")
    if used & {"V", "Vv", "Vw"}:
        lines.append("V = hypot(v, w); Vv = V * sign(v); Vw = V * sign(w);\n")
    if ratio and body.propeller is not None:
        screw = body.propeller
        lines.append(
            "excess = 0;\nif nargin > 2 && ~isempty(n)\n"
            f"  level_n = {octave_matrix(screw.level_speed_rev_s, '    ')};\n"
            f"  level_u = {octave_matrix(screw.level_speed_m_s, '    ')};\n"
            "  level = interp1(level_n, level_u, n, 'linear', NaN);\n"
            "  excess = level / max(sqrt(u^2 + v^2 + w^2),"
            f" {number(screw.minimum_speed_m_s)}) - 1;\nend\n"
        )
    lines.append("% viscous force\ntau_viscous = zeros(6, 1);\n")
    for axis in range(6):
        lines.append(f"tau_viscous({axis + 1}) = {octave_sum(body.terms, axis)};\n")
    lines.append(
        "\n% weight and buoyancy\n"
        f"W = {number(body.weight)}; B = {number(body.buoyancy)};\n"
        f"rg = {octave_matrix(body.r_G)}'; rb = {octave_matrix(body.r_B)}';\n"
        "a = rg * W - rb * B;\n"
        "sf = sin(phi); cf = cos(phi); st = sin(theta); ct = cos(theta);\n"
        "sp = sin(psi); cp = cos(psi);\n"
        "tau_restoring = [-(W - B) * st; (W - B) * ct * sf; (W - B) * ct * cf; ...\n"
        "  a(2) * ct * cf - a(3) * ct * sf; -a(3) * st - a(1) * ct * cf; ...\n"
        "  a(1) * ct * sf + a(2) * st];\n"
        "\n"
        "% Coriolis and centripetal force\n"
        "h = M * x(1:6);\n"
        "coriolis = [cross(x(4:6), h(1:3)); ...\n"
        "  cross(x(1:3), h(1:3)) + cross(x(4:6), h(4:6))];\n\n"
        "tau = tau_viscous + tau_restoring - coriolis;\n"
        "nu_dot = M \\ (tau + tau_control(:));\n"
        "R = [cp * ct, cp * st * sf - sp * cf, sp * sf + cp * cf * st; ...\n"
        "  sp * ct, cp * cf + sf * st * sp, st * sp * cf - cp * sf; ...\n"
        "  -st, ct * sf, ct * cf];\n"
        "T = [1, sf * st / ct, cf * st / ct; 0, cf, -sf; 0, sf / ct, cf / ct];\n"
        "xdot = [nu_dot; R * x(1:3); T * x(4:6)];\nend\n"
    )
    more = (
        "\nA third argument is the propeller speed [rev/s]; NaN comes back outside its table.\n"
        if ratio
        else ""
    )
    return Exported(
        {f"{name}.m": "".join(lines)},
        (),
        CONVENTION,
        _USAGE.format(name=name, more=more),
        (
            "Actuators are the caller's: tau_control is the force of all of them.",
            *late_actuators(request),
        ),
    )


MSS = Target(
    "mss",
    "a function of MATLAB or Octave (MSS)",
    "all but actuators",
    "cybergalactic/MSS 736a3d1",
    export,
)
