"""The viscous basis and the eight models against the tables of McCarter's appendices."""

import csv
import re
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from auvid.data_schemas.errors import DataError, PipelineError
from auvid.hydro.arrays import AXES
from auvid.hydro.dynamics.viscous import models
from auvid.hydro.dynamics.viscous.basis import (
    BASIS_TERMS,
    basis,
    basis_rows,
    basis_term_names,
    eta_ratio,
    needs_propeller_speed,
)
from auvid.hydro.dynamics.viscous.models import (
    IdentifiedModel,
    ViscousModel,
    model_named,
    without_propeller_terms,
)
from tests.support.dynamics_oracles import model_force

ROOT = Path(__file__).parents[5]
TABLES = ROOT / "tests/data/vt690"
PUBLISHED = ROOT / "vehicles/vt690/coefficients"

N_BAR = {
    "mcfarland": 216,
    "pitch_yaw": 100,
    "gertler_hagen": 88,
    "linear": 36,
    "coe": 33,
    "prestero": 30,
    "uncoupled": 24,
    "fossen": 12,
}
RANK = N_BAR | {"uncoupled": 22}
THESIS = [model_named(name) for name in N_BAR]
"""The models that the thesis tabulates; others have no published figures to hold."""


def rows(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def published(name):
    coefficients = {}
    for row in rows(PUBLISHED / f"{name}.csv"):
        coefficients.setdefault(row["axis"], {})[row["term"]] = float(row["value"])
    return coefficients


def evaluate(term, nu, ratio):
    """The term's name read as arithmetic: an oracle that shares nothing with the basis."""
    u, v, w, p, q, r = nu
    V = np.sqrt(v**2 + w**2)
    names = {
        "u": u,
        "v": v,
        "w": w,
        "p": p,
        "q": q,
        "r": r,
        "V": V,
        "Vv": V * np.sign(v),
        "Vw": V * np.sign(w),
        "eta": ratio,
        "abs": abs,
    }
    return eval(re.sub(r"\|(\w)\|", r"abs(\1)", term), {"__builtins__": {}}, names)


def sample(n, *, seed=4, ahead=True):
    rng = np.random.default_rng(seed)
    nu = rng.normal(size=(n, 6)) * [0.3, 0.2, 0.2, 0.3, 0.2, 0.2]
    nu[:, 0] = rng.uniform(1.0, 2.2, n) if ahead else nu[:, 0]
    return nu, rng.uniform(0.7, 1.4, n)


def test_basis_is_that_of_appendix_c():
    table = rows(TABLES / "basis_terms.csv")
    assert basis_term_names() == tuple(row["term"] for row in table)
    assert [term.group for term in BASIS_TERMS.values()] == [row["group"] for row in table]
    assert [term.latex for term in BASIS_TERMS.values()] == [row["latex"] for row in table]
    assert len(BASIS_TERMS) == 132


def test_every_term_has_the_value_of_its_name():
    nu, ratio = sample(40, ahead=False)
    values = basis(nu, ratio)
    for index, term in enumerate(basis_term_names()):
        np.testing.assert_allclose(
            values[:, index], evaluate(term, nu.T, ratio), rtol=1e-14, atol=1e-16, err_msg=term
        )


def test_rows_are_contiguous_and_equal_the_columns():
    nu, ratio = sample(50)
    terms = ("r*|r|", "u", "(w*V)*(eta-1)")
    matrix = basis_rows(nu.T, ratio, terms)
    assert matrix.flags.c_contiguous
    np.testing.assert_array_equal(matrix.T, basis(nu, ratio, terms))
    np.testing.assert_array_equal(
        basis(nu.reshape(5, 10, 6), ratio.reshape(5, 10), terms).reshape(50, 3), matrix.T
    )


def test_basis_leaves_the_callers_arrays_alone():
    nu, ratio = sample(10)
    nu.flags.writeable = ratio.flags.writeable = False
    before = nu.copy()
    matrix = basis_rows(nu.T, ratio)
    matrix[:] = 0.0
    np.testing.assert_array_equal(nu, before)


def test_propeller_terms_are_those_of_c6():
    names = [term for term in basis_term_names() if needs_propeller_speed(term)]
    assert names == [
        row["term"] for row in rows(TABLES / "basis_terms.csv") if row["group"] == "nu_eta"
    ]
    nu, _ = sample(5)
    assert np.isfinite(
        basis(nu, None, [name for name in basis_term_names() if name not in names])
    ).all()
    with pytest.raises(DataError, match="propeller speed"):
        basis(nu, None, ["(u*u)*(eta-1)"])


def test_unknown_term_names_the_nearest():
    with pytest.raises(PipelineError, match=re.escape("u*|u|")):
        basis(np.zeros(6), None, ["u*|u"])


def test_eta_ratio_is_bounded_at_rest():
    ratio = eta_ratio(
        1.5, np.array([[1.2, 0.9, 0.0, 0, 0, 0], [0, 0, 0, 1, 1, 1]]), minimum_speed=0.1
    )
    assert ratio == pytest.approx([1.0, 15.0])
    assert np.isnan(eta_ratio(np.nan, np.ones(6)))


@pytest.mark.parametrize("model", THESIS, ids=lambda model: model.name)
def test_models_are_those_of_appendix_d(model):
    table = [row for row in rows(TABLES / "models.csv") if row["model"] == model.name]
    for axis in AXES:
        assert model.terms[axis] == tuple(
            row["term"] for row in table if row["axis"] == axis and row["in_appendix_d"] == "1"
        )
    assert model.n_bar == N_BAR[model.name]
    assert set(model.distinct_terms) <= set(basis_term_names())


def test_chapter_3_differs_from_appendix_d_in_coe_only():
    surplus = [
        (row["model"], row["axis"], row["term"])
        for row in rows(TABLES / "models.csv")
        if row["in_appendix_d"] == "0"
    ]
    assert surplus == [("coe", axis, "u*|u|") for axis in "XZM"]


@pytest.mark.parametrize("model", THESIS, ids=lambda model: model.name)
def test_published_coefficients_fill_their_model(model):
    """Appendix E; Uncoupled lacks the two surge terms that equal others in ahead
    motion.
    """
    coefficients = published(model.name)
    missing = {(axis, term) for axis in AXES for term in model.terms[axis]} - {
        (axis, term) for axis in coefficients for term in coefficients[axis]
    }
    assert missing == ({("X", "u"), ("X", "u*|u|")} if model.name == "uncoupled" else set())
    assert sum(map(len, coefficients.values())) == RANK[model.name]
    assert all(term in model.terms[axis] for axis in coefficients for term in coefficients[axis])


def test_uncoupled_surge_is_fossens_surge():
    assert published("uncoupled")["X"]["|u|"] == published("fossen")["X"]["u"] == -7.690
    assert published("uncoupled")["X"]["u*u"] == published("fossen")["X"]["u*|u|"] == -1.288


def rank(columns):
    singular = np.linalg.svd(columns / np.linalg.norm(columns, axis=0), compute_uv=False)
    return int(np.sum(singular > 1e-10 * singular[0]))


@pytest.mark.parametrize("model", THESIS, ids=lambda model: model.name)
def test_rank_of_ahead_motion(model):
    """On rich data with u > 0 every model but Uncoupled is determined: there u = |u|
    and u^2 = u|u| in surge.
    """
    nu, ratio = sample(1500)
    per_axis = {axis: rank(basis(nu, ratio, terms)) for axis, terms in model.terms.items() if terms}
    assert sum(per_axis.values()) == RANK[model.name]
    if model.name == "uncoupled":
        assert per_axis == dict(zip(AXES, (2, 4, 4, 4, 4, 4), strict=True))


def test_coe_with_the_terms_of_chapter_3_is_short_by_three():
    nu, _ = sample(1500)
    coe = model_named("coe")
    assert sum(rank(basis(nu, None, (*coe.terms[axis], "u*|u|"))) for axis in "XZM") == 3 * 8


def test_without_propeller_terms():
    short = without_propeller_terms(model_named("gertler_hagen"))
    lost = Counter(
        {
            axis: len(model_named("gertler_hagen").terms[axis]) - len(short.terms[axis])
            for axis in AXES
        }
    )
    assert lost == {"X": 2, "Y": 3, "Z": 3, "K": 1, "M": 3, "N": 3}
    assert short.name == "gertler_hagen"
    assert without_propeller_terms(model_named("linear")) == model_named("linear")


def test_force_is_the_sum_of_coefficient_times_term():
    coefficients = published("gertler_hagen")
    nu, ratio = sample(6)
    force = model_force(model_named("gertler_hagen").terms, coefficients, nu, ratio)
    for index, axis in enumerate(AXES):
        expected = sum(
            value * evaluate(term, nu.T, ratio) for term, value in coefficients[axis].items()
        )
        np.testing.assert_allclose(force[:, index], expected, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(
        IdentifiedModel("gertler_hagen", coefficients).force(nu, ratio),
        force,
        rtol=1e-12,
        atol=1e-12,
    )


def test_a_long_series_needs_the_terms_of_a_piece_at_a_time(monkeypatch):
    model, (nu, ratio) = IdentifiedModel("coe", published("coe")), sample(50)
    every_force, still = model.force(nu, ratio), model.force(nu, np.ones(()))
    monkeypatch.setattr(models, "PIECE", 16)
    most = []
    monkeypatch.setattr(models, "basis", lambda nu, *more: most.append(len(nu)) or basis(nu, *more))
    np.testing.assert_allclose(model.force(nu, ratio), every_force, rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(model.force(nu, np.ones(())), still, rtol=1e-12, atol=1e-9)
    assert max(most) == 16


def test_force_counts_only_the_terms_of_the_model():
    form = ViscousModel("one", "One", {"X": ("u",)}, "none")
    force = model_force(form.terms, {"X": {"u": -2.0, "v": 7.0}, "Y": {"v": 7.0}}, np.ones(6))
    np.testing.assert_array_equal(force, [-2.0, 0, 0, 0, 0, 0])


def test_linear_and_mcfarland_are_matrix_products():
    """(3.32) K nu and (3.34) corrected, K (nu kron |nu|)."""
    nu, _ = sample(1, ahead=False)
    for name, vector in (("linear", nu[0]), ("mcfarland", np.kron(nu[0], np.abs(nu[0])))):
        coefficients = published(name)
        matrix = np.array(
            [[coefficients[axis][term] for term in model_named(name).terms[axis]] for axis in AXES]
        )
        np.testing.assert_allclose(
            model_force(model_named(name).terms, coefficients, nu)[0], matrix @ vector, rtol=1e-12
        )


def test_unknown_model_names_the_nearest():
    with pytest.raises(PipelineError, match="fossen"):
        model_named("fosen")
