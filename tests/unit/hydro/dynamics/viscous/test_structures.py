"""Structures from symmetry: parity against mirrored forces, and refused names."""

from itertools import product

import numpy as np
import pytest

from auvid.data_schemas.errors import PipelineError
from auvid.hydro.arrays import AXES
from auvid.hydro.dynamics.viscous.basis import BASIS_TERMS, basis
from auvid.hydro.dynamics.viscous.structures import (
    diagonal,
    lift_and_drag,
    masked,
    symmetric,
)
from auvid.hydro.dynamics.viscous.symmetry import MIRRORS, allowed_terms, allows
from tests.support.dynamics_oracles import model_force

# Signs of (u v w p q r), and so of (X Y Z K M N), behind a mirror: a polar vector turns
# along the normal, an axial one across it.
MIRRORED = {
    "port_starboard": np.array([1, -1, 1, -1, 1, -1]),
    "fore_aft": np.array([-1, 1, 1, 1, -1, -1]),
    "top_bottom": np.array([1, 1, -1, -1, -1, 1]),
}


@pytest.mark.parametrize("mirror", MIRRORS)
def test_a_term_is_allowed_exactly_where_the_force_mirrors_with_the_motion(mirror):
    signs = MIRRORED[mirror]
    nu = np.random.default_rng(0).normal(size=(20, 6))
    terms = [name for name in BASIS_TERMS if "eta" not in name]
    here, there = basis(nu, terms=terms), basis(nu * signs, terms=terms)
    for i, axis in enumerate(AXES):
        for j, term in enumerate(terms):
            mirrors = np.allclose(there[:, j], signs[i] * here[:, j], atol=1e-12)
            assert allows(axis, term, [mirror]) == mirrors, (axis, term, mirror)


def test_the_symmetric_model_gives_mirrored_forces():
    random = np.random.default_rng(1)
    for mirrors in (("port_starboard",), tuple(MIRRORS)):
        terms = allowed_terms(mirrors)
        values = {axis: {t: random.normal() for t in names} for axis, names in terms.items()}
        nu = random.normal(size=(10, 6))
        for mirror in mirrors:
            signs = MIRRORED[mirror]
            np.testing.assert_allclose(
                model_force(terms, values, nu * signs),
                model_force(terms, values, nu) * signs,
                atol=1e-9,
            )


def test_further_mirrors_leave_fewer_couplings():
    counts = [
        symmetric(mirrors=m).n_bar
        for m in (
            ("port_starboard",),
            ("port_starboard", "top_bottom"),
            ("port_starboard", "fore_aft"),
            tuple(MIRRORS),
        )
    ]
    assert counts == [18, 10, 10, 6]
    assert symmetric(mirrors=tuple(MIRRORS)).terms == diagonal().terms


def test_terms_of_the_propeller_are_not_symmetric_fore_and_aft():
    assert allows("X", "(u*u)*(eta-1)", ["port_starboard"])
    assert not allows("X", "(u*u)*(eta-1)", ["fore_aft"])
    assert "(u*u)*(eta-1)" in allowed_terms(with_propeller=True)["X"]
    assert "(u*u)*(eta-1)" not in allowed_terms()["X"]


def test_lift_and_drag_holds_the_lift_of_hull_and_fins_which_does_no_work():
    """Lift stands across the flow that hull and fins meet, and has a part along the axis."""
    model, random = lift_and_drag(), np.random.default_rng(2)
    assert all(set(names) <= set(allowed_terms()[axis]) for axis, names in model.terms.items())
    nu = np.column_stack([random.uniform(0.5, 2.0, 400), 0.2 * random.normal(size=(400, 5))])
    u, v, w, _, q, r = nu.T
    force = np.zeros_like(nu)
    for x, (across, turning, sign) in product((-0.9, 0.2), ((1, 5, 1.0), (2, 4, -1.0))):
        flow = (v, w)[across - 1] + sign * x * (r, q)[across - 1]
        force[:, across] -= u * flow
        force[:, turning] -= sign * x * u * flow
        force[:, 0] += flow**2
    np.testing.assert_allclose(np.sum(force * nu, axis=1), 0.0, atol=1e-12)
    for i, axis in enumerate(AXES):
        rows = basis(nu, terms=model.terms[axis])
        fitted = rows @ np.linalg.lstsq(rows, force[:, i], rcond=None)[0]
        np.testing.assert_allclose(fitted, force[:, i], atol=1e-9, err_msg=axis)


def test_a_mask_takes_both_spellings_and_keeps_the_order_of_the_basis():
    model = masked({"Y": ["v|v|", "uv", "r"], "N": ["r*V"]}, name="mine")
    assert model.terms["Y"] == ("r", "u*v", "v*|v|")
    assert model.terms["N"] == ("r*V",)
    assert model.terms["X"] == ()
    assert model.n_bar == 4


@pytest.mark.parametrize(
    ("mask", "words"),
    [
        ({"Y": ["v*|w"]}, "v*|w|"),
        ({"Y": ["v|x|"]}, "v*"),
        ({"V": ["v"]}, "unknown axis"),
        ({"Y": ["v", "v*|v|", "v|v|"]}, "twice"),
    ],
)
def test_a_mask_with_a_wrong_name_is_refused(mask, words):
    with pytest.raises(PipelineError, match=words.replace("*", r"\*").replace("|", r"\|")):
        masked(mask)


def test_an_unknown_mirror_is_refused_with_the_nearest():
    with pytest.raises(PipelineError, match="Did you mean 'fore_aft'"):
        allowed_terms(("foreaft",))
