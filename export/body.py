"""One identified model as the arrays and terms that the targets compute with."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from auvid.data_schemas.records.model_file import (
    DynamicsFigures,
    FinFigures,
    ModelFile,
    PropellerFigures,
    ThrustCurveFigures,
    ThrusterFigures,
)
from auvid.data_schemas.records.partial import CommandGain, CrossForce
from auvid.export.text import one_line
from auvid.hydro.arrays import AXES, VELOCITIES, Array
from auvid.hydro.dynamics.mechanics.kinematics import skew
from auvid.hydro.dynamics.viscous.basis import PROPULSION, cross_flow_speed, signed_speed
from auvid.hydro.model_file import axes_of, coriolis_acts, unit_of_mass
from auvid.hydro.partial_model import block_inverse

TO_FLU = np.array([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])
"""Components of nu and tau, forward-starboard-down to forward-port-up and back."""
STANDING = 1e-12

Force = Callable[[Array, Array], Array]
"""nu (n, 6), eta - 1 (n,) -> a force (n, 6) [N, N m]."""


@dataclass(frozen=True)
class Term:
    """One coefficient: value * product(factors) on the component `axis` (0 to 5)."""

    axis: int
    factors: tuple[str, ...]
    value: float
    symbol: str

    @property
    def constant(self) -> bool:
        """Return whether it is a constant force."""
        return not self.factors

    @property
    def velocities(self) -> tuple[int, ...] | None:
        """Return the places of its plain velocities, None where another factor is."""
        places = [VELOCITIES.index(name) for name in self.factors if name in VELOCITIES]
        return tuple(places) if len(places) == len(self.factors) else None

    @property
    def velocity_modulus(self) -> tuple[int, int] | None:
        """Return the places of x and y in x|y|, None for another term."""
        if len(self.factors) != 2 or sum("|" in name for name in self.factors) != 1:
            return None
        plain, modulus = sorted(self.factors, key=lambda name: "|" in name)
        if plain not in VELOCITIES:
            return None
        return VELOCITIES.index(plain), VELOCITIES.index(modulus.strip("|"))


@dataclass(frozen=True)
class Body:
    """A vehicle with its viscous terms; body axes FRD, all about the body origin, SI.

    inertia (3, 3) about the origin; added_mass (6, 6) is M_A <= 0, mass (6, 6) is M_RB -
    M_A. Of a partial model: `axes` that it has, the axis whose apparent inertia is the
    `unit_of_mass` (None for kg), lags of its axes, gains of full commands, forces that
    follow others. coriolis: whether that force acts.
    """

    title: str
    mass_kg: float
    r_G: Array
    inertia: Array
    rigid_body: Array
    added_mass: Array
    mass: Array
    weight: float
    buoyancy: float
    r_B: Array
    water_density: float
    gravity: float
    thrusters: tuple[ThrusterFigures, ...]
    curve: ThrustCurveFigures | None
    fins: FinFigures | None
    propeller: PropellerFigures | None
    lag_s: float
    terms: tuple[Term, ...]
    axes: tuple[str, ...] = AXES
    unit_of_mass: str | None = None
    lags_s: Mapping[str, float] = field(default_factory=dict)
    gains: tuple[CommandGain, ...] = ()
    cross_forces: tuple[CrossForce, ...] = ()
    coriolis: bool = True

    @cached_property
    def inertia_about_G(self) -> Array:
        """I_G = I_0 + m S(r_G) S(r_G) (3, 3) [kg m^2]."""
        arm = skew(self.r_G)
        return np.asarray(self.inertia + self.mass_kg * arm @ arm)

    @cached_property
    def mass_inverse(self) -> Array:
        """M^-1 (6, 6), 0 across axes that a partial model lacks: these are held."""
        return block_inverse(self.mass, self.axes)

    @property
    def volume(self) -> float:
        """Displaced volume B / (rho g) [m^3]."""
        return self.buoyancy / (self.water_density * self.gravity)

    @cached_property
    def box(self) -> Array:
        """Sides (3,) [m] of a box of the displaced volume.

        It has the proportions of the solid box with the inertia about the centre of
        gravity: a^2 = 6 (I_y + I_z - I_x) / m; a cube where no box has that inertia.
        """
        moments = np.diag(self.inertia_about_G)
        squares = moments.sum() - 2.0 * moments
        sides = np.sqrt(squares) if np.all(squares > 0.0) else np.ones(3)
        return np.asarray(sides * np.cbrt(self.volume / np.prod(sides)))

    @cached_property
    def with_propeller_terms(self) -> bool:
        """Return whether a term has the propulsion ratio."""
        return any(PROPULSION in term.factors for term in self.terms)

    @cached_property
    def force_limits(self) -> tuple[float, float] | None:
        """Least and largest force of a thruster [N], None without thrusters."""
        curve = self.curve
        if curve is None:
            return None
        if curve.polynomial is not None:
            top = float(np.polyval(curve.polynomial, 100.0))
            return -top, top
        return min(curve.force_N), max(curve.force_N)

    def keep(self, kept: Callable[[Term], bool]) -> Body:
        """Return the body with only some of its terms."""
        return replace(self, terms=tuple(term for term in self.terms if kept(term)))

    def viscous(self, nu: Array, excess: Array) -> Array:
        """Return tau_viscous: nu (n, 6), eta - 1 (n,) -> (n, 6) [N, N m]."""
        tau = np.zeros(nu.shape)
        factors = _factors(nu, excess)
        for term in self.terms:
            value = np.full(len(nu), term.value)
            for name in term.factors:
                value *= factors[name]
            tau[:, term.axis] += value
        return tau


def _factors(nu: Array, excess: Array) -> dict[str, Array]:
    factors = dict(zip(VELOCITIES, nu.T, strict=True))
    factors |= {f"|{name}|": np.abs(values) for name, values in factors.items()}
    cross = cross_flow_speed(factors["v"], factors["w"])
    return factors | {
        "V": cross,
        "Vv": signed_speed(cross, factors["v"]),
        "Vw": signed_speed(cross, factors["w"]),
        PROPULSION: excess,
    }


def constants_of(body: Body) -> Array:
    """Return the constant force (6,) of a body [N, N m]."""
    total = np.zeros(6)
    for term in body.terms:
        if term.constant:
            total[term.axis] += term.value
    return total


FLOATED = (2, 3, 4)
"""Axes whose constant force buoyancy holds: Z, K, M."""


def floated(body: Body) -> Body:
    """Return the body with its constant Z, K, M as buoyancy and its centre.

    B' = B - Z; x_B' B' = x_B B + M, y_B' B' = y_B B - K, z_B' B' = z_B B: level, the
    restoring force is that of W, B, r_G, r_B and Z, K, M together, and the righting moment
    stays. Of no effect where no buoyancy would be left.
    """
    constant = constants_of(body)
    buoyancy = body.buoyancy - constant[2]
    if buoyancy <= 0.0:
        return body
    moment = body.buoyancy * body.r_B + np.array([constant[4], -constant[3], 0.0])
    kept = body.keep(lambda term: not (term.constant and term.axis in FLOATED))
    return replace(kept, buoyancy=float(buoyancy), r_B=moment / buoyancy)


def floated_words(body: Body) -> str:
    """Return what `floated` puts into the buoyancy, in words; empty for nothing."""
    constant, changed = constants_of(body), floated(body)
    if changed is body or not constant[list(FLOATED)].any():
        return ""
    values = ", ".join(
        f"{AXES[axis]} {constant[axis]:.4g} {'N' if axis < 3 else 'N m'}" for axis in FLOATED
    )
    return (
        f"The constant forces {values} are in the buoyancy: {changed.volume:.6g} m^3 displaced in"
        f" place of {body.volume:.6g}, its centre moved by"
        f" ({', '.join(f'{1000.0 * x:.3g}' for x in changed.r_B - body.r_B)}) mm. So the forces"
        " are the model's where the vehicle is level; tilted, they keep to the vertical as net"
        " buoyancy and a load off the centre do, and the model's own turn with the vehicle: at 10"
        f" degrees {abs(constant[2]) * np.sin(np.radians(10.0)):.2g} N lie across."
    )


def full_title(model: ModelFile) -> str:
    """Return a model's title with its vehicle's; of a published set they are one."""
    vehicle = model.vehicle.title
    titles = dict.fromkeys(
        (model.title, f"a guess ({vehicle})" if model.vehicle.guessed else vehicle)
    )
    return " of ".join(titles)


def body_of(model: ModelFile) -> Body:
    """Return what a model file says of the motion, with every term that is not 0."""
    figures: DynamicsFigures = model.dynamics
    part = model.partial
    return Body(
        title=one_line(full_title(model)),
        mass_kg=figures.mass_kg,
        r_G=np.array(figures.centre_of_gravity_m),
        inertia=np.array(figures.inertia_kg_m2),
        rigid_body=np.array(figures.rigid_body),
        added_mass=np.array(figures.added_mass),
        mass=np.array(figures.mass),
        weight=figures.weight_N,
        buoyancy=figures.buoyancy_N,
        r_B=np.array(figures.centre_of_buoyancy_m),
        water_density=figures.water_density_kg_m3,
        gravity=figures.gravity_m_s2,
        thrusters=tuple(figures.thrusters),
        curve=figures.thrust_curve,
        fins=figures.fins,
        propeller=figures.propeller,
        lag_s=figures.actuator_lag_s,
        terms=tuple(
            Term(AXES.index(item.axis), tuple(item.factors), item.predictor, item.symbol)
            for item in model.coefficients
            if item.predictor
        ),
        axes=axes_of(model),
        unit_of_mass=unit_of_mass(model),
        lags_s={} if part is None else {axis: item.lag_s for axis, item in part.axes.items()},
        gains=() if part is None else tuple(part.gains),
        cross_forces=() if part is None else tuple(part.cross_forces),
        coriolis=coriolis_acts(model),
    )


def names_of(terms: Sequence[Term], most: int = 8) -> str:
    """Return the symbols of terms as text, the first ones and the count of others."""
    symbols = [term.symbol for term in terms]
    more = [f"and {len(symbols) - most} more"] if len(symbols) > most else []
    return ", ".join([*symbols[:most], *more])
