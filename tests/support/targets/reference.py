"""Force and inertia of a model file, written out from Fossen's equations with numpy only.

Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control, 2nd ed. (2021). Nothing
of auvid computes here: the file's fields are read as docs/model_file.md describes them.
"""

import math

import numpy as np

from auvid.data_schemas.records.model_file import ModelFile
from tests.support.targets.frames import Array, Body

AXES = "XYZKMN"


def factors(nu: Array) -> dict[str, Array]:
    """Return all factors (n,) of the terms of coefficients at velocities nu (n, 6)."""
    values = dict(zip("uvwpqr", nu.T, strict=True))
    values |= {f"|{name}|": np.abs(row) for name, row in values.items()}
    across = np.sqrt(nu[:, 1] ** 2 + nu[:, 2] ** 2)
    more = {"V": across, "Vv": across * np.sign(nu[:, 1]), "Vw": across * np.sign(nu[:, 2])}
    return values | more


def reference(model: ModelFile) -> Body:
    """Return the body of a model file: M nu_dot = tau - C(nu) nu + viscous - g(eta)."""
    d = model.dynamics
    m, (xg, yg, zg) = d.mass_kg, d.centre_of_gravity_m
    inertia_o = np.array(d.inertia_kg_m2)
    # M_RB, Fossen (3.49), entry by entry
    rigid = np.array(
        [
            [m, 0, 0, 0, m * zg, -m * yg],
            [0, m, 0, -m * zg, 0, m * xg],
            [0, 0, m, m * yg, -m * xg, 0],
            [0, -m * zg, m * yg, *inertia_o[0]],
            [m * zg, 0, -m * xg, *inertia_o[1]],
            [-m * yg, m * xg, 0, *inertia_o[2]],
        ]
    )
    mass = rigid - np.array(d.added_mass)

    weight, buoyancy = d.weight_N, d.buoyancy_N
    a, b, c = np.array(d.centre_of_gravity_m) * weight - np.array(d.centre_of_buoyancy_m) * buoyancy

    rows = [(AXES.index(e.axis), e.predictor, tuple(e.factors)) for e in model.coefficients]

    def force(nu: Array, eta: Array) -> Array:
        u, v, w, p, q, r = nu.T
        # C(nu) nu with the momenta of M nu, Fossen (3.46)
        x, y, z, k, l, n = (nu @ mass.T).T
        total = -np.stack(
            [
                q * z - r * y,
                r * x - p * z,
                p * y - q * x,
                v * z - w * y + q * n - r * l,
                w * x - u * z + r * k - p * n,
                u * y - v * x + p * l - q * k,
            ],
            1,
        )
        values = factors(nu)
        for axis, predictor, names in rows:
            total[:, axis] += predictor * math.prod((values[name] for name in names), start=1.0)
        # -g(eta), Fossen (4.6)
        sf, cf = np.sin(eta[:, 3]), np.cos(eta[:, 3])
        st, ct = np.sin(eta[:, 4]), np.cos(eta[:, 4])
        net = weight - buoyancy
        total -= np.stack(
            [
                net * st,
                -net * ct * sf,
                -net * ct * cf,
                -b * ct * cf + c * ct * sf,
                c * st + a * ct * cf,
                -a * ct * sf - b * st,
            ],
            1,
        )
        return total

    return Body(mass, force)
