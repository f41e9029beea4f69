"""One file of plain Python that computes the model and imports `math` alone."""

from __future__ import annotations

from auvid.export.exported import Exported, Request, Target
from auvid.export.source_code import constants, functions, partial_text, without_newtons
from auvid.export.text import docstring

CONVENTION = (
    "Body axes x forward, y starboard, z down; world north, east, down; moments, velocities and"
    " positions about the body origin of the vehicle file; SI and radians. Forces stand on the"
    " right of M nu_dot + C(nu) nu = force(nu, eta) + tau, so that damping has negative"
    " coefficients; ADDED_MASS has derivatives (X_udot <= 0)."
)
_USAGE = """\
```python
import {name} as model

nu = [0.3, 0.0, 0.0, 0.0, 0.0, 0.1]  # u v w [m/s], p q r [rad/s]
eta = [0.0, 0.0, 5.0, 0.0, 0.0, 1.57]  # x y z [m], phi theta psi [rad]
print(model.force(nu, eta))  # viscous and restoring force less C(nu) nu [N, N m]
print(model.derivative(nu, eta, [10.0, 0, 0, 0, 0, 0]))  # nu_dot
print(model.pose_rate(nu, eta))  # eta_dot
```

`viscous`, `restoring` and `coriolis` give the parts{more}.
"""


def export(request: Request) -> Exported:
    """Return `NAME.py` with `force`, `derivative` and the constants.

    Exact: it has every term, so that nothing is lost.
    """
    body = request.body
    head = "\n".join([f"Model {request.name}: {body.title}.", "", *request.head, "", CONVENTION])
    code = without_newtons(f"{constants(body)}\n\n{functions(body)}", body) + partial_text(body)
    text = f'"""{docstring(head)}\n"""\n\nimport math\n\n{code}'
    more = []
    if body.curve is not None:
        more.append(
            "`thrust` the newtons of a thruster, and `thruster_force` that of all from those"
        )
    if body.fins is not None:
        more.append("`fin_force` that of fins")
    if body.propeller is not None:
        more.append("`propeller_force` that of the propeller")
    if body.gains:
        more.append("`command_force` the force of full commands")
    return Exported(
        {f"{request.name}.py": text},
        (),
        CONVENTION,
        _USAGE.format(name=request.name, more="".join(f", {item}" for item in more)),
        late_actuators(request),
    )


def late_actuators(request: Request) -> tuple[str, ...]:
    """Return the note on a lag of the actuators, which is the caller's."""
    if any(request.body.lags_s.values()):
        return ("Each axis follows its command with a lag (LAGS); whoever integrates applies it.",)
    if not request.body.lag_s:
        return ()
    return (
        f"The actuators follow their commands with a lag of {request.body.lag_s:.3g} s"
        " (ACTUATOR_LAG); whoever integrates has to apply it.",
    )


PYTHON = Target(
    "python",
    "one file of plain Python",
    "all",
    "none: the equation of the model file",
    export,
    lacking_axes=True,
    any_unit_of_mass=True,
)
