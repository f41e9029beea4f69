"""The stage synthesise: the literal Kronecker-and-mask form as oracle, and what the
model cards say of what data cannot determine.
"""

from __future__ import annotations

import tracemalloc
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pyarrow as pa
import pytest
from scipy.signal import lfilter

from auvid.data_schemas.documents import check_document
from auvid.data_schemas.errors import CampaignError, DataError
from auvid.data_schemas.records.models import ModelCard, TermCard
from auvid.data_schemas.records.motion import CurrentRecord
from auvid.data_schemas.records.priors import PriorSourcesRecord
from auvid.data_schemas.schemas import schema
from auvid.data_schemas.tables import matrix
from auvid.hydro.arrays import AXES, Array
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.dynamics.equations_of_motion import Control, residual_force
from auvid.hydro.dynamics.mechanics.rigid_body import coriolis_force
from auvid.hydro.dynamics.viscous.basis import basis, basis_rows, basis_term_names, coefficient_unit
from auvid.hydro.dynamics.viscous.models import (
    MODELS,
    ViscousModel,
    model_named,
    without_propeller_terms,
)
from auvid.hydro.identification.constrained.fit import ConstrainedFit
from auvid.hydro.identification.constrained.statuses import CoefficientStatus
from auvid.hydro.identification.constrained.steady_current import SteadyCurrent
from auvid.hydro.identification.regression.assumed_figures import (
    MeasuredLeg,
    through_water,
    total_error,
)
from auvid.hydro.identification.regression.error_functions import (
    deviation_weights,
    huber,
    least_moduli,
)
from auvid.hydro.identification.regression.excitation import axis_excitation
from auvid.hydro.identification.regression.least_squares import TriangularFactor, solve_axis
from auvid.hydro.identification.regression.normal_changes import NormalChange, TrueEquations
from auvid.hydro.identification.regression.separability import breaks_symmetry, one_sided_groups
from auvid.hydro.identification.selection import folds
from auvid.hydro.identification.signals.filters import zero_phase_lowpass
from auvid.stages import synthesise
from auvid.stages.base import Collection, collection
from auvid.stages.columns import (
    ACCELERATION,
    POSE,
    VELOCITY,
    VELOCITY_SD,
    force_columns,
    named,
)
from auvid.stages.model_use import clear_in_its_form, damping_of
from auvid.stages.report.summary.coefficient_table import coefficient_rows
from auvid.stages.synthesise import error_choice, training
from auvid.stages.synthesise.legs import moving_water
from auvid.stages.synthesise.model_card import about_the_truth
from auvid.stages.synthesise.presentation import limited_far, sign_by_figures, too_few_samples
from auvid.stages.synthesise.within_limits import _term as term_within_limits
from auvid.stages.validate.flight import draw_models
from tests.support.constrained import drawn_as_printed
from tests.support.motions import (
    fusion_document,
    ratio_of,
    residual_table,
    rich_motion,
    segment_document,
    shipped_vehicle,
)

Leg = tuple[Array, Array, Array | None]
"""Velocities (n, 6), forces (n, 6), eta ratio (n,) or None."""


def run(
    legs: Mapping[str, Leg],
    *,
    use: Mapping[str, str] | None = None,
    vehicle: str = "vt690",
    **params: Any,
) -> synthesise.Outputs:
    tables = {name: residual_table(nu, force, ratio) for name, (nu, force, ratio) in legs.items()}
    segments = {name: segment_document(name, (use or {}).get(name, "training")) for name in legs}
    inputs = synthesise.Inputs(collection(tables), collection(segments), shipped_vehicle(vehicle))
    outputs = synthesise.run(inputs, synthesise.Params(**params))
    for card in outputs.model_card.values():
        check_document(card, "model_card")
    return outputs


def noisy_legs(
    *, ahead: bool = True, with_ratio: bool = True, noise: float = 5.0
) -> dict[str, Leg]:
    """Two legs whose force no model spans."""
    rng = np.random.default_rng(9)
    legs: dict[str, Leg] = {}
    for seed, name in enumerate(("one", "two"), start=1):
        motion = rich_motion(12.0, seed=seed, ahead=ahead)
        force = 30.0 * np.tanh(motion.nu @ rng.normal(size=(6, 6))) + noise * rng.normal(
            size=motion.nu.shape
        )
        legs[name] = (motion.nu, force, ratio_of(motion) if with_ratio else None)
    return legs


def kronecker(model: ViscousModel, legs: Mapping[str, Leg]) -> dict[str, dict[str, float]]:
    """(4.14)-(4.21) as printed: sigma = Xi kappa with Xi = (I_6 kron xi^T) M^T, and K =
    vec^-1(M^T kappa)^T.
    """
    nu, force = (np.concatenate([leg[index] for leg in legs.values()]) for index in (0, 1))
    ratios = [leg[2] for leg in legs.values()]
    xi = basis(
        nu,
        np.concatenate([r for r in ratios if r is not None]) if ratios[0] is not None else None,
        model.distinct_terms,
    ).T
    K_mask = np.array(
        [[term in model.terms[axis] for term in model.distinct_terms] for axis in AXES]
    )
    mask = np.eye(K_mask.size)[K_mask.reshape(-1)]
    Xi = np.kron(np.eye(6), xi.T) @ mask.T
    sigma = force.T.reshape(-1)
    kappa = np.linalg.lstsq(Xi, sigma, rcond=None)[0]
    K = (mask.T @ kappa).reshape(6, -1)
    return {
        axis: {term: K[i, model.distinct_terms.index(term)] for term in model.terms[axis]}
        for i, axis in enumerate(AXES)
    }


@pytest.mark.parametrize("name", [model.name for model in MODELS])
def test_equals_the_literal_kronecker_and_mask_form(name: str) -> None:
    model = model_named(name)
    legs = {
        key: (nu[::5], force[::5], None if ratio is None else ratio[::5])
        for key, (nu, force, ratio) in noisy_legs().items()
    }
    if (
        name == "uncoupled"
    ):  # ahead, two pairs of its columns are one: least squares has no single solution
        legs = {
            key: (np.where(np.arange(6) == 0, nu - 1.5, nu), force, ratio)
            for key, (nu, force, ratio) in legs.items()
        }
    solution = run(legs, models=(name,)).model_card[name].predictor
    expected = kronecker(model, legs)
    for axis in AXES:
        assert list(solution[axis]) == list(expected[axis])
        largest = max((abs(value) for value in expected[axis].values()), default=0.0)
        np.testing.assert_allclose(
            list(solution[axis].values()),
            list(expected[axis].values()),
            rtol=1e-9,
            atol=1e-9 * largest,
        )


def test_validation_legs_have_no_part_in_the_fit() -> None:
    legs = noisy_legs()
    one_leg = run({"one": legs["one"]}, models=("linear",)).model_card["linear"]
    both = run(legs, use={"two": "validation"}, models=("linear",)).model_card["linear"]
    assert both == one_leg


def test_chunks_give_the_factor_of_the_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    legs = noisy_legs()
    at_once = run(legs)
    monkeypatch.setattr(training, "ROWS_AT_ONCE", 77)
    chunked = run(legs)
    gram, again = (
        R.T @ R
        for R in (np.array(outputs.triangular_factor.factor) for outputs in (at_once, chunked))
    )
    # rows of dependent columns (u and |u|) are rounding, so the factors themselves may
    # differ
    np.testing.assert_allclose(again, gram, rtol=0.0, atol=1e-12 * np.abs(gram).max())
    for name, card in at_once.model_card.items():
        assert chunked.model_card[name].rank == card.rank
        for axis in AXES:
            ours, theirs = (
                list(cards[name].predictor[axis].values())
                for cards in (chunked.model_card, at_once.model_card)
            )
            # Cuts leave a curved limit to 1e-11 of an eigenvalue: a coefficient that slides
            # along it moves by the root of that.
            close = 1e-5 if name == "symmetric_quadratic" else 1e-9
            np.testing.assert_allclose(
                # A number at its bound of 0 is 0 up to rounding of the others.
                ours,
                theirs,
                rtol=close,
                atol=close * max(map(abs, theirs), default=0.0) + 1e-12,
            )


def lazy_leg(seed: int, samples: int = 12_000) -> pa.Table:
    """A leg made when it is asked for: waves in all velocities, and a force on them."""
    rng = np.random.default_rng(seed)
    t = np.arange(samples) / 50.0
    phase, pace = rng.uniform(0.0, 6.0, (2, 6))
    nu = 0.5 * np.sin(t[:, None] * (0.3 + 0.1 * pace) + phase)
    force = nu @ rng.normal(size=(6, 6)) + 0.1 * rng.normal(size=nu.shape)
    table = residual_table(nu, force)
    for name, values in named(VELOCITY_SD, np.full(nu.shape, 0.01)).items():
        table = table.append_column(name, pa.array(values))
    return table


def lazy_inputs(legs: int) -> synthesise.Inputs:
    names = [f"leg_{number}" for number in range(legs)]
    return synthesise.Inputs(
        Collection({name: partial(lazy_leg, seed) for seed, name in enumerate(names)}),
        collection({name: segment_document(name) for name in names}),
        shipped_vehicle("bluerov2_heavy"),
    )


def test_memory_is_that_of_one_leg_and_the_fit_that_of_one_pass() -> None:
    """Four times the legs need no more memory; the merged factors give the numbers of one
    factor over all samples.
    """
    params = synthesise.Params(models=("linear",))
    synthesise.run(lazy_inputs(1), params)  # imports and caches
    peaks = {}
    for legs in (3, 12):
        tracemalloc.start()
        outputs = synthesise.run(lazy_inputs(legs), params)
        peaks[legs] = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    # One leg is 12,000 rows of 19 columns, 1.8 MB; holding them all would add 16 MB.
    assert peaks[12] < 1.1 * peaks[3]
    tables = [lazy_leg(seed) for seed in range(12)]
    terms = model_named("linear").distinct_terms
    nu, force = (
        np.concatenate([matrix(table, names) for table in tables])
        for names in (VELOCITY, force_columns("tau_bar"))
    )
    factor = TriangularFactor.empty(terms).update(basis_rows(nu.T, None, terms), force)
    card = outputs.model_card["linear"]
    assert card.samples == len(nu)
    for axis in AXES:
        fit = solve_axis(factor, axis, model_named("linear").terms[axis])
        np.testing.assert_allclose(
            list(card.predictor[axis].values()), fit.solution, rtol=1e-9, atol=1e-12
        )
        assert card.axes[axis].j0 == pytest.approx(fit.j0, rel=1e-12)
    conditions = axis_excitation(nu)
    for name, item in card.conditions.items():
        assert item.rms == pytest.approx(conditions[name].rms, rel=1e-12)


def test_columns_that_a_fit_does_not_need_stay_on_disk() -> None:
    """Of the residual force its parts beside the actuators, and the pose rates of the state."""
    column_names: dict[str, None] = {}

    def part_of(key: str, columns: Sequence[str]) -> pa.Table:
        column_names.update(dict.fromkeys(columns))
        table = lazy_leg(0)
        return table.select([name for name in table.column_names if name in {"t_s", *columns}])

    inputs = lazy_inputs(1)
    (key,) = inputs.residual
    part = Collection({key: partial(pytest.fail, "loaded whole")}, part_of)
    params = synthesise.Params(models=("linear",))
    cards = synthesise.run(replace(inputs, residual=part), params).model_card
    assert cards["linear"] == synthesise.run(inputs, params).model_card["linear"]
    assert "restoring_X_N" in schema("residual").columns
    assert not {name for name in column_names if name.startswith(("restoring", "drag", "lift"))}


def test_triangular_factor_holds_the_gram_matrix_of_columns_and_forces() -> None:
    legs = noisy_legs()
    document = run(legs).triangular_factor
    terms = [term for term in document.terms if term in basis_term_names()]
    columns = [
        np.column_stack([basis(nu, ratio, terms), np.ones(len(nu)), force])
        for nu, force, ratio in legs.values()
    ]
    data, R = np.vstack(columns), np.array(document.factor)
    assert document.terms == [*terms, "constant", *AXES]
    assert document.samples == len(data)
    np.testing.assert_allclose(
        R.T @ R, data.T @ data, rtol=1e-9, atol=1e-9 * np.abs(data.T @ data).max()
    )


def test_terms_with_eta_do_not_apply_without_a_propeller_speed() -> None:
    outputs = run(noisy_legs(with_ratio=False), vehicle="bluerov2_heavy")
    for model in MODELS:
        card, short = outputs.model_card[model.name], without_propeller_terms(model)
        assert (card.n_bar, card.n_bar_declared) == (short.n_bar, model.n_bar)
        assert len(card.not_applicable) == model.n_bar - short.n_bar
    card = outputs.model_card["gertler_hagen"]
    assert len(card.not_applicable) == 15
    assert "K (u*u)*(eta-1)" in card.not_applicable
    notes = [
        block["text"]
        for block in outputs.section["blocks"]
        if block["kind"] == "remark" and "propulsion ratio" in block["text"]
    ]
    assert len(notes) == 1
    assert "15 terms" in notes[0]


def test_one_leg_without_the_ratio_takes_it_from_all() -> None:
    legs = noisy_legs()
    legs["two"] = (*legs["two"][:2], None)
    assert run(legs, models=("gertler_hagen",)).model_card["gertler_hagen"].n_bar == 73


def test_rank_deficient_model_names_its_terms_and_gives_the_rest() -> None:
    """Only u and w move: what contains v, p, q or r is not excited, u = |u| is
    inseparable, the rest is there.
    """
    nu, _, _ = noisy_legs()["one"]
    nu = np.where(np.isin(np.arange(6), [0, 2]), nu, 0.0)
    force = np.zeros_like(nu)
    force[:, 0] = -20.0 * nu[:, 0] - 30.0 * nu[:, 0] ** 2
    force[:, 2] = -40.0 * nu[:, 2]
    card = run(
        {"one": (nu, force, None)}, models=("uncoupled",), vehicle="bluerov2_heavy"
    ).model_card["uncoupled"]
    surge, heave, yaw = (
        {item.term: item for item in card.axes[axis].terms} for axis in ("X", "Z", "N")
    )
    assert {item.verdict for item in surge.values()} == {"inseparable"}
    sums = {frozenset(item.weights): item.value for item in card.axes["X"].combinations}
    assert sums == {
        frozenset({"u", "|u|"}): pytest.approx(-20.0),
        frozenset({"u*u", "u*|u|"}): pytest.approx(-30.0),
    }
    assert heave["w"].value == pytest.approx(-40.0)
    assert {item.verdict for item in yaw.values()} == {"not excited"}
    assert all(item.value is None for item in yaw.values())
    assert card.rank == 2 + 4
    assert card.axes["N"].excitation == "not excited"


def test_spikes_do_not_make_a_velocity_excited() -> None:
    """r is at rest but for one short turn: RMS(r*r) lies above its floor, and still no
    term with r is given a number.
    """
    legs = noisy_legs(with_ratio=False)
    nu, force, _ = legs["one"]
    nu = nu.copy()
    nu[:, 5] = 0.0
    nu[300:303, 5] = 0.2, 0.4, 0.3
    force = force.copy()
    force[:, 5] = -50.0 * nu[:, 5] * np.abs(nu[:, 5])
    outputs = run({"one": (nu, force, None)}, vehicle="bluerov2_heavy")
    for card in outputs.model_card.values():
        for axis, part in card.axes.items():
            assert not any("r" in term for item in part.combinations for term in item.weights)
            for item in part.terms:
                if "r" in item.term:
                    assert (card.name, axis, item.term, item.verdict) == (
                        card.name,
                        axis,
                        item.term,
                        "not excited",
                    )
                    assert item.value is None
    assert outputs.model_card["fossen"].predictor["N"]["r*|r|"] == pytest.approx(
        -50.0, rel=1e-6
    )  # what predictions are made with


def test_velocity_that_hardly_reverses_leaves_the_sum_only() -> None:
    """u falls to -0.01 m/s: by rank u and |u| are apart, but what separates them lies
    below the noise.
    """
    nu, force, _ = noisy_legs(with_ratio=False, noise=0.5)["one"]
    nu = nu.copy()
    nu[:, 0] = np.maximum(nu[:, 0] - 1.2, -0.01)
    force = force.copy()
    force[:, 0] = (
        -20.0 * nu[:, 0]
        - 30.0 * nu[:, 0] * np.abs(nu[:, 0])
        + np.random.default_rng(1).normal(0.0, 0.5, len(nu))
    )
    card = run(
        {"one": (nu, force, None)}, models=("uncoupled",), vehicle="bluerov2_heavy"
    ).model_card["uncoupled"]
    assert card.rank == 24
    surge = {item.term: item for item in card.axes["X"].terms}
    assert {term: item.inseparable_from for term, item in surge.items()} == {
        "u": ["|u|"],
        "|u|": ["u"],
        "u*u": ["u*|u|"],
        "u*|u|": ["u*u"],
    }
    assert all(item.value is None for item in surge.values())
    for item, true in zip(card.axes["X"].combinations, (-20.0, -30.0), strict=True):
        assert abs(item.value - true) < 5.0 * item.standard_error
        assert item.standard_error < 5.0
    assert "identified" in {item.verdict for item in card.axes["Z"].terms}


def test_inseparability_is_mutual() -> None:
    """No term may be called inseparable from one that is given a number of its own."""
    rng = np.random.default_rng(2)
    nu = noisy_legs(with_ratio=False)["one"][0].copy()
    nu[:, 0] = 0.3 + 0.02 * nu[:, 0]
    force = np.zeros_like(nu)
    force[:, 0] = -60.0 * nu[:, 0] + rng.normal(0.0, 1.0, len(nu))
    for model, card in run(
        {"one": (nu, force, None)}, vehicle="bluerov2_heavy", trim=True
    ).model_card.items():
        for axis, part in card.axes.items():
            partners = {item.term: item.inseparable_from for item in part.terms}
            for term, others in partners.items():
                for other in others or ():
                    assert term in (partners[other] or ()), (model, axis, term, other)


def test_backward_motion_pairs_with_the_opposite_sign() -> None:
    motion = noisy_legs(with_ratio=False)["one"][0] * np.array([-1.0, 1, 1, 1, 1, 1])
    excitation = axis_excitation(motion)
    terms = model_named("uncoupled").terms["X"]
    assert one_sided_groups(terms, excitation) == (
        {"u": 1.0, "|u|": -1.0},
        {"u*u": 1.0, "u*|u|": -1.0},
    )
    assert one_sided_groups(model_named("uncoupled").terms["Y"], excitation) == ()


def test_terms_that_a_symmetric_hull_cannot_have() -> None:
    assert breaks_symmetry("Y", "u")
    assert breaks_symmetry("X", "u*v")
    assert breaks_symmetry("N", "|r|")
    assert not breaks_symmetry("Y", "u*v")
    assert not breaks_symmetry("X", "v*r")
    assert not breaks_symmetry("N", "|r|*Vv")
    assert not breaks_symmetry("Z", "|q|*Vw")
    assert not breaks_symmetry("K", "p*|p|")


def test_lopsided_force_is_remarked() -> None:
    nu, force, _ = noisy_legs(with_ratio=False)["one"]
    columns = [
        -30.0 * nu[:, 0],
        8.0 * nu[:, 0] - 40.0 * nu[:, 1],
        *(-10.0 * nu[:, index] for index in range(2, 6)),
    ]
    force = np.column_stack(columns)
    outputs = run({"one": (nu, force, None)}, models=("linear",), vehicle="bluerov2_heavy")
    notes = [
        block["text"]
        for block in outputs.section["blocks"]
        if block["kind"] == "remark" and "symmetric" in block["text"]
    ]
    assert len(notes) == 1
    assert notes[0].startswith("Linear: Y u is identified")
    assert "has no such term." in notes[0]


def test_trim_takes_the_constant_and_does_not_count_as_a_term() -> None:
    nu, _, _ = noisy_legs(with_ratio=False)["one"]
    force = -20.0 * nu + np.array([1.0, 2.0, -4.5, 0.1, 0.2, 0.3])
    card = run(
        {"one": (nu, force, None)}, models=("linear",), vehicle="bluerov2_heavy", trim=True
    ).model_card["linear"]
    assert (card.n_bar, card.rank, card.trim) == (36, 36, True)
    assert [card.predictor[axis]["constant"] for axis in AXES] == pytest.approx(
        [1.0, 2.0, -4.5, 0.1, 0.2, 0.3]
    )
    assert card.axes["Z"].terms[-1].verdict == "identified"


def test_standard_errors_cover_the_truth_with_coloured_noise() -> None:
    """Noise correlated over 1 s: the deviation of Linear's coefficients is of the size
    of their standard errors.
    """
    rng = np.random.default_rng(4)
    nu = rich_motion(120.0, seed=6).nu
    white = rng.normal(size=nu.shape)
    noise = np.zeros_like(white)
    for index in range(1, len(white)):
        noise[index] = 0.98 * noise[index - 1] + white[index]
    card = run(
        {"one": (nu, -20.0 * nu + noise, None)}, models=("linear",), vehicle="bluerov2_heavy"
    ).model_card["linear"]
    score = [
        (item.value - (-20.0 if axis == AXES["uvwpqr".index(item.term)] else 0.0))
        / item.standard_error
        for axis in AXES
        for item in card.axes[axis].terms
    ]
    assert (
        0.5 < np.sqrt(np.mean(np.square(score))) < 2.0
    )  # 36 scores, white errors would give about 7
    for part in card.axes.values():
        assert part.samples_per_one is not None
        assert 15.0 < part.samples_per_one <= len(nu) / 3


def test_errors_of_the_velocities_widen_errors_and_move_no_number() -> None:
    nu = rich_motion(120.0, seed=6).nu
    table = residual_table(nu, -20.0 * nu + 0.1 * np.random.default_rng(4).normal(size=nu.shape))
    with_errors = table
    for name, sd in zip(VELOCITY_SD, (0.01, 0.05, 0.01, 0.002, 0.002, 0.002), strict=True):
        with_errors = with_errors.append_column(name, pa.array(np.full(len(nu), sd)))
    segment, vehicle = {"one": segment_document("one")}, shipped_vehicle("bluerov2_heavy")
    cards = [
        synthesise.run(
            synthesise.Inputs(collection({"one": item}), collection(segment), vehicle),
            synthesise.Params(models=("linear",)),
        )
        for item in (table, with_errors)
    ]
    exact, wide = (item.model_card["linear"] for item in cards)
    assert not exact.velocity_errors
    assert wide.velocity_errors
    assert wide.predictor == exact.predictor
    before, after = (card.axes["Y"].covariance.lower for card in (exact, wide))
    assert all(new[-1] >= old[-1] for old, new in zip(before, after, strict=True))
    assert after[1][1] > 1.5 * before[1][1]  # of v, whose error is the largest
    assert "Velocities count as exact" in str(cards[0].section)
    assert "effect of velocity errors" in str(cards[1].section)


def test_fewer_samples_than_terms_gives_numbers_without_errors() -> None:
    nu, force, _ = noisy_legs(with_ratio=False)["one"]
    outputs = run(
        {"one": (nu[::60], force[::60], None)},
        models=("mcfarland", "fossen"),
        vehicle="bluerov2_heavy",
    )
    assert outputs.model_card["mcfarland"].rank == 6 * 10
    assert outputs.model_card["fossen"].axes["Y"].terms[0].standard_error is not None


def test_no_training_leg_is_refused() -> None:
    legs = noisy_legs()
    with pytest.raises(DataError, match=r"no training leg.*use: training"):
        run(legs, use=dict.fromkeys(legs, "validation"))


def test_unknown_model_names_the_nearest() -> None:
    with pytest.raises(
        CampaignError, match=r"stages\.synthesise\.models.*fosen.*Did you mean 'fossen'"
    ):
        run(noisy_legs(), models=("linear", "fosen"))


@pytest.mark.parametrize("models", [(), ("linear", "linear")])
def test_no_model_or_one_twice_is_refused(models: tuple[str, ...]) -> None:
    with pytest.raises(CampaignError, match=r"stages\.synthesise\.models"):
        run(noisy_legs(), models=models)


def test_unit_of_a_coefficient() -> None:
    assert coefficient_unit("X", "u*|u|") == "N s^2/m^2"
    assert coefficient_unit("N", "|r|*Vv") == "N m s^2/(m rad)"
    assert coefficient_unit("K", "(p*p)*(eta-1)") == "N m s^2/rad^2"
    assert coefficient_unit("M", "constant") == "N m"


def test_section_shows_no_number_that_the_data_do_not_determine() -> None:
    nu, force, _ = noisy_legs(with_ratio=False)["one"]
    nu = np.where(np.arange(6) == 3, 0.001 * nu, nu)
    outputs = run({"one": (nu, force, None)}, vehicle="bluerov2_heavy", trim=True)
    rows = [
        row
        for block in outputs.section["blocks"]
        if block["kind"] == "table" and "verdict" in str(block["columns"])
        for row in block["rows"]
    ]
    quiet = [row for row in rows if row[-1] == "not excited"]
    assert {row[1] for row in quiet} >= {"p", "p*|p|", "v*p"}
    assert all(row[2] is None and row[3] is None for row in quiet)
    assert any(row[2] is not None for row in rows)


def test_a_prior_is_used_only_when_asked_for_and_named_on_the_card() -> None:
    legs = noisy_legs()
    plain = run(legs, models=("prestero",)).model_card["prestero"]
    assert "prior" not in plain
    outputs = run(legs, models=("prestero",), prior="strip_theory", prior_sd=0.2)
    card = outputs.model_card["prestero"]
    means = card.prior.means
    assert (card.prior.source, card.prior.relative_sd) == ("strip_theory", 0.2)
    assert set(means["Y"]) == {
        "u*v",
        "u*r",
        "v*|v|",
        "r*|r|",
    }  # w*p and p*q are not in strip theory
    for axis, terms in means.items():  # as a whole nearer to the prior than the data alone
        near, far = (
            sum((one.predictor[axis][term] / mean - 1.0) ** 2 for term, mean in terms.items())
            for one in (card, plain)
        )
        assert near < far
    for axis in AXES:  # verdicts are those of the data alone
        assert [item.verdict for item in card.axes[axis].terms] == [
            item.verdict for item in plain.axes[axis].terms
        ]
        assert card.axes[axis].j >= plain.axes[axis].j
    assert any(
        "a prior was used" in str(block.get("text", "")) for block in outputs.section["blocks"]
    )


def test_a_prior_needs_a_geometry() -> None:
    with pytest.raises(CampaignError, match=r"no geometry.*block `geometry`"):
        run(
            noisy_legs(with_ratio=False),
            vehicle="bluerov2_heavy",
            models=("fossen",),
            prior="strip_theory",
        )


def test_structures_of_the_campaign_are_fitted_and_named() -> None:
    own = {"steering": {"Y": ["v", "r"], "N": ["v", "r", "r|r|"]}}
    cards = run(noisy_legs(), models=("linear",), structures=own, damping="free").model_card
    assert list(cards) == ["steering", "linear"]
    terms = {axis: list(row) for axis, row in cards["steering"].predictor.items()}
    assert terms == {"X": [], "Y": ["v", "r"], "Z": [], "K": [], "M": [], "N": ["v", "r", "r*|r|"]}


def test_lift_of_a_vehicle_that_goes_ahead_is_found_within_limits() -> None:
    """Fins astern hold it on course; damping along each axis alone, and linear, does not."""
    nu = rich_motion(30.0, seed=3).nu
    u, v, w, p, q, r = nu.T
    force = np.column_stack(
        [
            -5.0 * u * np.abs(u) + 30.0 * (v * v + w * w),
            -40.0 * u * v + 20.0 * u * r,
            -40.0 * u * w - 20.0 * u * q,
            -1.0 * u * p,
            -20.0 * u * w - 30.0 * u * q,
            20.0 * u * v - 30.0 * u * r,
        ]
    )
    force += 0.5 * np.random.default_rng(6).normal(size=force.shape)
    cards = run({"one": (nu, force, None)}, models=("lift_and_drag", "symmetric_quadratic"))
    lift, linear = (cards.model_card[name] for name in ("lift_and_drag", "symmetric_quadratic"))
    assert lift.method == "within limits"
    (yaw,) = (item for item in lift.axes["N"].terms if item.term == "u*r")
    assert yaw.value == pytest.approx(-30.0, rel=0.02)
    assert yaw.verdict == "identified"
    assert lift.axes["Y"].j < 0.3 * linear.axes["Y"].j


@pytest.mark.parametrize(
    ("structures", "words"),
    [
        ({"own": {"X": ["u", "uu|w|"]}}, r"structures.own.X'.*unknown basis term.*'uu\|w\|'"),
        ({"own": {"Q": ["u"]}}, "unknown axis.*'Q'"),
        ({"own": {"X": ["u", "u"]}}, "named twice"),
        ({"own": {"X": "u"}}, "maps axes to lists of terms"),
        ({"own": {"X": []}}, "without a term"),
        ({"linear": {"X": ["u"]}}, "name of a known model.*'linear'"),
    ],
)
def test_wrong_structures_are_named(structures: Any, words: str) -> None:
    with pytest.raises(CampaignError, match=words):
        run(noisy_legs(), structures=structures)


def test_without_limits_and_prior_a_structure_is_least_squares() -> None:
    legs = noisy_legs()
    card = run(legs, models=("symmetric",), damping="free", trim=True).model_card["symmetric"]
    nu, force = (np.concatenate([leg[i] for leg in legs.values()]) for i in (0, 1))
    for index, axis in enumerate(AXES):
        names = list(card.predictor[axis])
        columns = np.column_stack(
            [
                np.ones(len(nu)) if term == "constant" else nu[:, "uvwpqr".index(term)]
                for term in names
            ]
        )
        expected = np.linalg.lstsq(columns, force[:, index], rcond=None)[0]
        np.testing.assert_allclose(list(card.predictor[axis].values()), expected, rtol=1e-9)
    assert card.limits == []
    assert card.limits_cost == pytest.approx(0.0, abs=1e-12)


def test_damping_takes_energy_out_in_every_direction_and_says_what_that_costs() -> None:
    legs = noisy_legs()
    free = run(legs, models=("symmetric",), damping="free").model_card["symmetric"]
    card = run(legs, models=("symmetric",)).model_card["symmetric"]

    def largest(one: ModelCard) -> float:
        K = np.array(
            [[one.predictor[axis].get(x, 0.0) for x in "uvwpqr"] for axis in AXES], dtype=float
        )
        return float(np.linalg.eigvalsh(0.5 * (K + K.T)).max())

    assert largest(free) > 1.0
    assert largest(card) < 1e-6
    assert card.limits
    assert card.limits_cost > 0.0
    held_back = [item for part in card.axes.values() for item in part.terms if item.free_value]
    assert held_back, "values without limits stand beside those that limits changed"


def test_published_forms_stay_least_squares_whatever_the_limits() -> None:
    legs = noisy_legs()
    one, other = (
        run(legs, models=("linear", "symmetric"), damping=damping).model_card["linear"]
        for damping in ("free", "dissipative")
    )
    assert one == other
    assert one.method == "least squares"


def test_inertia_needs_the_state_and_is_found_beside_the_damping() -> None:
    """A force of linear damping and of 2 kg m2 more yaw inertia, with its acceleration."""
    motion = rich_motion(60.0, seed=3)
    vehicle = shipped_vehicle("bluerov2_heavy")
    damping = -np.diag([40.0, 60.0, 70.0, 2.0, 3.0, 5.0])
    change = np.zeros((6, 6))
    change[5, 5] = -2.0
    force = motion.nu @ damping.T + motion.nu_dot @ change.T + coriolis_force(change, motion.nu)
    force += np.random.default_rng(2).normal(size=force.shape)
    table = residual_table(motion.nu, force, None)
    segments = collection({"one": segment_document("one")})
    params = synthesise.Params(models=("diagonal",), inertia=("N_rdot",))
    with pytest.raises(DataError, match="needs the acceleration"):
        synthesise.run(synthesise.Inputs(collection({"one": table}), segments, vehicle), params)
    fused = pa.table({"t_s": motion.t_s, **named(ACCELERATION, motion.nu_dot)})
    inputs = synthesise.Inputs(
        collection({"one": table}), segments, vehicle, collection({"one": fused})
    )
    card = synthesise.run(inputs, params).model_card["diagonal"]
    (item,) = card.inertia
    assert item.change == pytest.approx(-2.0, abs=4.0 * item.standard_error)
    assert item.standard_error < 0.1
    assert item.value == pytest.approx(vehicle.mass_matrix[5, 5] - item.change, rel=1e-12)
    assert item.verdict == "identified"
    assert card.predictor["N"]["r"] == pytest.approx(-5.0, abs=0.3)
    # Less inertia than the rigid body has: the bound is no measurement, and has no error.
    less = force - 1.25 * (motion.nu_dot @ change.T + coriolis_force(change, motion.nu))
    inputs = replace(inputs, residual=collection({"one": residual_table(motion.nu, less, None)}))
    outputs = synthesise.run(inputs, params)
    (item,) = outputs.model_card["diagonal"].inertia
    assert (item.verdict, item.standard_error) == ("at its bound", None)
    assert item.change == pytest.approx(-vehicle.added_mass[5, 5])
    assert item.free_value == pytest.approx(vehicle.mass_matrix[5, 5] - 0.5, abs=0.1)
    (changed,) = (
        block for block in outputs.section["blocks"]
        if "what the limits changed" in block.get("title", "")
    )  # fmt: skip
    assert changed["rows"][-1][2:4] == [item.free_value, item.value]


def test_a_coefficient_that_one_leg_carries_is_weak_and_the_leg_is_named() -> None:
    """Sway damps in two legs and drives in a third; what holds in all stays identified."""
    rng = np.random.default_rng(11)
    legs: dict[str, Leg] = {}
    for name, sway in (("one", -60.0), ("two", -60.0), ("three", 300.0)):
        motion = rich_motion(30.0, seed=5)
        damping = -np.diag([40.0, -sway, 70.0, 2.0, 3.0, 5.0])
        force = motion.nu @ damping.T + 0.1 * rng.normal(size=motion.nu.shape)
        legs[name] = (motion.nu, force, None)
    card = run(legs, models=("diagonal",), damping="free").model_card["diagonal"]
    (surge,), (across,) = card.axes["X"].terms, card.axes["Y"].terms
    assert card.left_out == ["one", "two", "three"]
    assert (surge.verdict, surge.turns_without) == ("identified", None)
    assert (across.verdict, across.turns_without) == ("weak", ["three"])
    one_leg = run({"one": legs["one"]}, models=("diagonal",)).model_card["diagonal"]
    assert one_leg.left_out == []
    assert one_leg.axes["Y"].terms[0].verdict == "identified"


def test_many_legs_are_left_out_in_groups_and_each_once() -> None:
    legs = [f"leg {i}" for i in range(30) for _ in range(2)]
    parts = folds.parts_of(legs)
    assert len(set(parts)) == folds.MOST_PARTS
    assert parts == sorted(parts, key=parts.index), "neighbours go together"
    assert all(parts[2 * i] == parts[2 * i + 1] for i in range(30)), "a leg stays in one part"
    assert parts[0] == "leg 0 to leg 2"


def driven(
    t_s: np.ndarray,
    nu: np.ndarray,
    nu_dot: np.ndarray,
    force: np.ndarray,
    thrust: np.ndarray,
    component: str = "thrusters",
) -> synthesise.Inputs:
    """Return one leg of a BlueROV2 with its thrust (n, 6), so that assumed figures count."""
    table = residual_table(nu, force, None)
    for name, column in named(force_columns(component), thrust).items():
        table = table.append_column(name, pa.array(column))
    pose = named(POSE, np.zeros_like(nu))
    fused = pa.table({"t_s": t_s, **pose, **named(ACCELERATION, nu_dot), **named(VELOCITY, nu)})
    controls = pa.table(
        {"t_s": t_s, **named([f"thruster_{i}_N" for i in range(1, 9)], np.zeros((len(t_s), 8)))}
    )
    return synthesise.Inputs(
        collection({"one": table}),
        collection({"one": segment_document("one")}),
        shipped_vehicle("bluerov2_heavy"),
        collection({"one": fused}),
        None,
        collection({"one": controls}),
    )


def test_inertias_and_sums_scale_with_the_thrust_curve_as_coefficients_do() -> None:
    """Thrust makes the whole force: a fifth more of it is a fifth more of every number."""
    motion, vehicle = rich_motion(30.0, seed=5), shipped_vehicle("bluerov2_heavy")
    ahead = motion.nu.copy()
    ahead[:, 0] = 0.3 + np.abs(ahead[:, 0])
    damping, change = -np.diag([40.0, 60.0, 70.0, 2.0, 3.0, 5.0]), np.zeros((6, 6))
    change[5, 5] = -2.0
    force = ahead @ damping.T + motion.nu_dot @ change.T + coriolis_force(change, ahead)
    force += 0.01 * np.random.default_rng(12).normal(size=force.shape)
    inertial = motion.nu_dot @ vehicle.mass_matrix + coriolis_force(vehicle.mass_matrix, ahead)
    inputs = driven(motion.t_s, ahead, motion.nu_dot, force, inertial - force)
    params = synthesise.Params(
        models=(),
        structures={"own": {"X": ["uu", "u|u|"], "N": ["r"]}},
        inertia=("N_rdot",),
        damping="free",
    )
    card = synthesise.run(inputs, params).model_card["own"]
    (total,), (sum_of_u,) = card.inertia, card.axes["X"].combinations
    assert total.value == pytest.approx(2.0 + vehicle.mass_matrix[5, 5], rel=0.01)
    assert total.assumed_shifts["thrust"] == pytest.approx(0.2 * total.value, rel=0.01)
    assert total.assumed_shifts["inertia"] < 0.01, "the total holds whatever the file says"
    assert total.verdict == "identified"
    assert sum_of_u.assumed_shifts["thrust"] > 0.1 * abs(sum_of_u.value)
    half = NORMAL_95 * total_error(total.standard_error, total.assumed_shifts)
    (row,) = (row for row in coefficient_rows(card, vehicle, {}) if "inertia" in row.meaning)
    assert row.high - row.value == pytest.approx(half)
    assert row.assumed


def driven_late(lag_s: float) -> synthesise.Inputs:
    """Return a leg whose thrust acts `lag_s` after its record; Y_v is -60 N s/m."""
    motion, vehicle = rich_motion(60.0, seed=5), shipped_vehicle("bluerov2_heavy")
    damping = motion.nu @ -np.diag([40.0, 60.0, 70.0, 2.0, 3.0, 5.0])
    inertial = motion.nu_dot @ vehicle.mass_matrix + coriolis_force(vehicle.mass_matrix, motion.nu)
    late = inertial - damping
    recorded = late + lag_s * np.gradient(late, motion.t_s, axis=0)
    noise = 0.1 * np.random.default_rng(12).normal(size=damping.shape)
    return driven(motion.t_s, motion.nu, motion.nu_dot, inertial - recorded + noise, recorded)


def test_a_lag_of_the_actuators_goes_with_all_models_and_can_be_left_out() -> None:
    """Thrust that acts .15 s after its record: without the lag damping is a quarter too small."""
    lag_s = 0.15
    inputs = driven_late(lag_s)
    vehicle = inputs.vehicle
    models = ("linear", "diagonal")
    with_lag = synthesise.run(inputs, synthesise.Params(models=models))
    without = synthesise.run(inputs, synthesise.Params(models=models, actuator_lag="none"))
    for name in models:
        card, plain = with_lag.model_card[name], without.model_card[name]
        assert card.lag is not None
        assert card.lag.standard_error_s is not None
        assert card.lag.value_s == pytest.approx(lag_s, abs=0.005)
        assert card.spreads["thrust_lag"] == card.lag.standard_error_s
        assert card.predictor["Y"]["v"] == pytest.approx(-60.0, rel=0.01)
        assert plain.lag is None
        assert plain.spreads["thrust_lag"] == vehicle.spreads["thrust_lag"]
        assert plain.predictor["Y"]["v"] > -50.0
        moved = card.moved_by_lag["Y"]["v"]
        least_squares = plain.predictor["Y"]["v"]
        assert moved == pytest.approx(card.predictor["Y"]["v"] - least_squares, abs=0.5)
        assert not plain.moved_by_lag
        assert f"{card.title}: what the lag of the actuators moved" in str(with_lag.section)
    words = "The force follows the record of the actuators by 0.15"
    assert words in str(with_lag.section)
    assert words not in str(without.section)


@pytest.mark.parametrize(("stated_s", "warns"), [(0.14, False), (0.0, True)])
def test_a_stated_lag_counts_and_is_held_against_that_of_the_legs(
    stated_s: float, warns: bool
) -> None:
    inputs = driven_late(0.15)
    vehicle = inputs.vehicle
    spreads = {**vehicle.spreads, "thrust_lag": 0.01}
    stated = replace(inputs.vehicle, actuator_lag_s=stated_s, spreads=spreads)
    outputs = synthesise.run(
        replace(inputs, vehicle=stated), synthesise.Params(models=("diagonal",))
    )
    card = outputs.model_card["diagonal"]
    assert card.lag is not None
    assert (card.lag.value_s, card.lag.verdict) == (stated_s, "stated")
    assert card.spreads["thrust_lag"] == 0.01
    words = "as the vehicle file states (actuators.lag)"
    (block,) = (b for b in outputs.section["blocks"] if words in str(b.get("text")))
    assert block["level"] == ("warning" if warns else "note")
    assert "The training legs show 0.15" in block["text"]


def passed_leg(cutoff_hz: float) -> synthesise.Inputs:
    """Return a leg with quadratic drag whose channels passed a low-pass."""
    vehicle, step_s = shipped_vehicle("bluerov2_heavy"), 0.02
    nu = np.random.default_rng(4).standard_normal((4000, 6))
    t_s = np.arange(len(nu)) * step_s
    nu = 3.0 * zero_phase_lowpass(t_s, nu, cutoff_hz=0.8)
    drag = nu * (np.abs(nu) * -np.array([60.0, 90.0, 100.0, 1.5, 2.0, 3.0]) - 1.0)
    nu_dot = np.gradient(nu, step_s, axis=0)
    acting = nu_dot @ vehicle.mass_matrix + coriolis_force(vehicle.mass_matrix, nu) - drag
    nu, nu_dot, acting = (
        zero_phase_lowpass(t_s, part, cutoff_hz=cutoff_hz) for part in (nu, nu_dot, acting)
    )
    force = nu_dot @ vehicle.mass_matrix + coriolis_force(vehicle.mass_matrix, nu) - acting
    force += 0.3 * np.random.default_rng(5).standard_normal(force.shape)
    inputs = driven(t_s, nu, nu_dot, force, acting)
    fusion = fusion_document(segment="one", method="kinematic", cutoff_hz=cutoff_hz)
    return replace(inputs, fusion=collection({"one": fusion}))


def test_a_low_pass_that_is_too_low_widens_intervals_and_is_named() -> None:
    """Surge drag at a low-pass of .8 Hz for a motion up to .8, and at 3 Hz."""
    errors, warned = [], []
    for cutoff_hz in (0.8, 3.0):
        outputs = synthesise.run(passed_leg(cutoff_hz), synthesise.Params(models=("fossen",)))
        quadratic = outputs.model_card["fossen"].axes["X"].terms[1]
        assert quadratic.value is not None
        assert quadratic.standard_error is not None
        errors.append(quadratic.standard_error)
        assert abs(quadratic.value + 60.0) < NORMAL_95 * quadratic.standard_error
        warned.append(f"The low-pass of {cutoff_hz:g} Hz is too low" in str(outputs.section))
    assert errors[0] > 5.0 * errors[1]
    assert warned == [True, False]


@pytest.mark.parametrize(("lean", "named"), [(0.07, False), (0.12, True), (-0.12, True)])
def test_a_lean_of_less_than_a_tenth_is_no_warning(lean: float, named: bool) -> None:
    """Beyond noise all the same: it stands in the interval."""
    rows = np.random.default_rng(3).standard_normal((200, 2))
    force = np.zeros((200, 6))
    force[:, 0] = rows @ np.array([-40.0, -60.0])
    factor = TriangularFactor.empty(("u", "u*|u|")).update(rows.T, force)
    fit = solve_axis(factor, axis="X", terms=("u", "u*|u|"))
    target = np.zeros((3, 6))
    target[:2, 0] = rows.T @ rows @ (lean * fit.coefficients)
    change = NormalChange(("u", "u*|u|", "constant"), np.zeros((3, 3)), target)
    np.testing.assert_allclose(change.shift(fit), lean * fit.coefficients)
    coloured = {("fossen", "X"): training.Coloured(np.eye(2), 1.0)}
    terms = training.leaning_terms({("fossen", "X"): fit}, coloured, [change])
    assert terms == ({"fossen": ["X_u", "X_u|u|"]} if named else {})


def test_a_current_under_a_velocity_over_ground_is_in_the_intervals_and_named() -> None:
    """Drag -60 u|u| through water that goes .2 m/s north and .1 west, at a heading of north."""
    motion = rich_motion(60.0, seed=5)
    vehicle = replace(shipped_vehicle("bluerov2_heavy"), spreads={})
    eta, control = np.zeros_like(motion.nu), Control()
    over = MeasuredLeg(eta, motion.nu, motion.nu_dot, control, 0.02)
    moved = through_water(over, np.array([0.2, -0.1, 0.0]))
    drag = moved.nu * (np.abs(moved.nu) * -np.array([60.0, 90.0, 100.0, 1.5, 2.0, 3.0]) - 1.0)
    force, through = (
        residual_force(replace(vehicle, thrusters=None), eta, each.nu, each.nu_dot, control).tau_bar
        for each in (over, moved)
    )
    force += drag - through + 0.3 * np.random.default_rng(5).standard_normal(drag.shape)
    inputs = driven(motion.t_s, motion.nu, motion.nu_dot, force, np.zeros_like(force))
    inputs = replace(inputs, vehicle=vehicle)
    holds, words = [], []
    for usual in (0.15, 0.0):
        outputs = synthesise.run(inputs, synthesise.Params(models=("fossen",), current_m_s=usual))
        card = outputs.model_card["fossen"]
        (item,) = (t for t in card.axes["X"].terms if t.term == "u*|u|")
        assert item.value is not None
        total = total_error(item.standard_error or 0.0, item.assumed_shifts)
        holds.append(abs(item.value + 60.0) < NORMAL_95 * total)
        assert ("current" in item.assumed_shifts) == ("current" in card.spreads) == (usual > 0)
        words.append("write stages.fuse.current_m_s: {log: [0." in str(outputs.section))
        assert [own.clear for own in card.currents.values()] == [True] * (usual > 0)
    assert holds == [True, False]
    assert words == [True, False]
    observed = CurrentRecord(verdict="observable", reason="", ned_m_s=[0.0] * 3, sd_m_s=[0.01] * 3)
    fusion = fusion_document(segment="one", method="smoother", current=observed)
    outputs = synthesise.run(
        replace(inputs, fusion=collection({"one": fusion})), synthesise.Params(models=("fossen",))
    )
    assert "current" not in outputs.model_card["fossen"].spreads


def test_the_card_and_the_page_say_what_assumed_figures_move() -> None:
    """A slow vehicle whose drag balances its thrust: its coefficients scale with it."""
    motion = rich_motion(30.0, seed=5)
    damping = -np.diag([40.0, 60.0, 70.0, 2.0, 3.0, 5.0])
    force = motion.nu @ damping.T + 0.1 * np.random.default_rng(12).normal(size=motion.nu.shape)
    inputs = driven(motion.t_s, motion.nu, np.zeros_like(motion.nu), force, -force)
    outputs = synthesise.run(inputs, synthesise.Params(models=("diagonal",)))
    card = outputs.model_card["diagonal"]
    check_document(card, "model_card")
    (surge,), (yaw,) = card.axes["X"].terms, card.axes["N"].terms
    assert drawn_as_printed(card) == 6
    drawn = draw_models(card, inputs.vehicle, count=4000, seed=1).models
    both = [(m.coefficients["X"]["u"], m.coefficients["N"]["r"]) for m in drawn]
    drawn_figures = surge.assumed_shifts.keys() - {"unsteady"}
    assert card.axes["X"].covariance.shifts.keys() == drawn_figures
    budget = sum(
        one[0] * other[0]
        for figure, rows in card.axes["X"].covariance.shifts.items()
        for one, other in zip(rows, card.axes["N"].covariance.shifts[figure], strict=True)
    )
    for item in (surge, yaw):
        budget /= total_error(item.standard_error or 0.0, item.assumed_shifts)
    assert budget > 0.5, "the scale of the thrust curve is one for both"
    assert np.corrcoef(np.array(both).T)[0, 1] == pytest.approx(budget, abs=0.03)
    models = ("linear", "symmetric")
    with_prior = synthesise.Params(models=models, prior="vehicle", trim=True)
    cards = synthesise.run(inputs, with_prior).model_card
    assert drawn_as_printed(cards["linear"]) > 36
    assert drawn_as_printed(cards["symmetric"]) > 12
    assert card.spreads["thrust"] == 0.2
    assert surge.assumed_shifts["thrust"] == pytest.approx(0.2 * 40.0, rel=0.01)
    assert surge.standard_error is not None
    assert surge.standard_error < 1.0
    assert surge.verdict == "identified", "what no dive makes smaller is no part of the noise"
    rows = next(
        block["rows"]
        for block in outputs.section["blocks"]
        if "verdict" in str(block.get("columns"))
    )
    half = NORMAL_95 * surge.assumed_shifts["thrust"]
    assert rows[0][-2].startswith(f"scale of the thrust curve ± {half:.0f}")


def test_what_a_form_lacks_widens_the_coefficients_that_stand_for_it() -> None:
    """Linear and quadratic drag; Prestero has the quadratic part, Diagonal the linear one."""
    nu = rich_motion(60.0, seed=5, ahead=False).nu
    force = nu * (np.abs(nu) * -np.array([60.0, 90.0, 100.0, 9.0, 9.0, 9.0]) - 5.0)
    force[:, 1] -= 60.0 * nu[:, 0] * nu[:, 1]
    force += 0.5 * np.random.default_rng(5).standard_normal(force.shape)
    outputs = run({"one": (nu, force, None)}, models=("prestero", "diagonal", "fossen"))
    surge = {name: card.axes["X"] for name, card in outputs.model_card.items()}
    assert {name: part.lacking for name, part in surge.items()} == {
        "prestero": ["u"],
        "diagonal": ["u*|u|"],
        "fossen": [],
    }
    sway = outputs.model_card["diagonal"].axes["Y"].lacking
    assert set(sway) == {"v*|v|", "u*v"}, "lift grows with speed"
    (drag,) = (item for item in surge["prestero"].terms if item.term == "u*|u|")
    (slope,) = surge["diagonal"].terms
    assert drag.value is not None
    assert drag.standard_error is not None
    assert drag.assumed_shifts["form"] == pytest.approx(abs(drag.value + 60.0), rel=0.1)
    assert abs(drag.value + 60.0) > 4.0 * drag.standard_error
    assert drag.verdict == "identified", "the interval holds the truth and is clear of zero"
    assert (slope.verdict, clear_in_its_form(slope)) == ("weak", True)
    assert damping_of(outputs.model_card["diagonal"], "X") == "identified"
    assert all("form" not in item.assumed_shifts for item in surge["fossen"].terms)
    assert surge["prestero"].covariance.shifts == {}, "the force of the form is known"
    page = str(outputs.section)
    assert "what the form lacks ±" in page
    assert "clear as a mean over the flown motion, but the form lacks X_u|u|" in page


def test_a_force_that_moves_the_vehicle_makes_what_it_leans_weak_and_says_so() -> None:
    """Drag -40 u, and a force of .4 s as large as the thrust; sway and the others have none."""
    motion, vehicle = rich_motion(90.0, seed=5, ahead=False), shipped_vehicle("bluerov2_heavy")
    damping = np.array([40.0, 60.0, 70.0, 2.0, 3.0, 5.0])
    mass, step_s, rng = vehicle.mass_matrix[0, 0], 0.02, np.random.default_rng(4)
    unsteady = lfilter([5.0], [1.0, -np.exp(-step_s / 0.4)], rng.normal(size=len(motion.t_s)))
    thrust = 12.0 * np.sign(np.sin(0.7 * motion.t_s))
    decay = np.exp(-damping[0] / mass * step_s)
    nu, nu_dot = motion.nu.copy(), motion.nu_dot.copy()
    nu[:, 0] = lfilter([0.0, (1.0 - decay) / damping[0]], [1.0, -decay], thrust + unsteady)
    nu_dot[:, 0] = (thrust + unsteady - damping[0] * nu[:, 0]) / mass
    force = 0.3 * rng.normal(size=nu.shape) - nu * damping
    force[:, 0] += unsteady
    inputs = driven(motion.t_s, nu, nu_dot, force, np.zeros_like(force))
    inputs = replace(inputs, vehicle=replace(vehicle, spreads={}))
    params = synthesise.Params(models=("diagonal",), current_m_s=0.0)
    outputs = synthesise.run(inputs, params)
    card = outputs.model_card["diagonal"]
    (surge,), (sway,) = card.axes["X"].terms, card.axes["Y"].terms
    assert surge.value is not None
    assert surge.standard_error is not None
    lean = surge.value + damping[0]
    assert lean > 4.0 * surge.standard_error, "noise alone says nothing of it"
    assert lean < NORMAL_95 * total_error(surge.standard_error, surge.assumed_shifts)
    assert (surge.verdict, sway.verdict) == ("weak", "identified")
    assert "clear by noise, but a force that no term has moves the vehicle" in str(outputs.section)
    # Errors of the velocities count by themselves: in noise, and not as that force once more.
    table = inputs.residual["one"]
    for name in VELOCITY_SD:
        table = table.append_column(name, pa.array(np.full(len(nu), 0.1)))
    inputs = replace(inputs, residual=collection({"one": table}))
    (unsure,) = synthesise.run(inputs, params).model_card["diagonal"].axes["X"].terms
    assert unsure.standard_error is not None
    by_error = np.sqrt(unsure.standard_error**2 - surge.standard_error**2)
    less = surge.assumed_shifts["unsteady"] - unsure.assumed_shifts["unsteady"]
    assert by_error > 1.0
    assert less == pytest.approx(by_error, rel=0.25), "to first order"
    # A fitted inertia goes with the acceleration, which the force has in it; no Coriolis force.
    push, ahead = thrust + 0.3 * unsteady, np.array([1.0, *[1e-3] * 5])
    nu[:, 0] = lfilter([0.0, (1.0 - decay) / damping[0]], [1.0, -decay], push)
    nu_dot[:, 0] = (push - damping[0] * nu[:, 0]) / mass
    force[:, 0] = 0.3 * unsteady - damping[0] * nu[:, 0]
    straight = driven(motion.t_s, nu * ahead, nu_dot * ahead, force, np.zeros_like(force))
    straight = replace(straight, vehicle=replace(vehicle, spreads={}))
    params = synthesise.Params(
        models=(), structures={"own": {"X": ["u"]}}, current_m_s=0.0, inertia=("X_udot",)
    )
    (inertia,) = synthesise.run(straight, params).model_card["own"].inertia
    assert abs(inertia.change) > 4.0 * inertia.standard_error, "the file's inertia is true"
    total = total_error(inertia.standard_error, inertia.assumed_shifts)
    assert (abs(inertia.change) < NORMAL_95 * total, inertia.verdict) == (True, "weak")
    # Drag that the form lacks counts as that, and not as an unsteady force once more.
    curved = 0.3 * rng.normal(size=nu.shape) - motion.nu * damping * (1.0 + 2.0 * np.abs(motion.nu))
    inputs = driven(motion.t_s, motion.nu, motion.nu_dot, curved, np.zeros_like(curved))
    params = synthesise.Params(models=("diagonal", "fossen"), current_m_s=0.0)
    for axis, part in synthesise.run(inputs, params).model_card["diagonal"].axes.items():
        (own,) = part.terms
        assert own.assumed_shifts["unsteady"] < 0.1 * own.assumed_shifts["form"], axis


@pytest.mark.parametrize("component", ["thrusters", "fins"])
def test_a_lag_delays_fins_as_it_does_thrusters_and_a_thrust_curve_scales_none(
    component: str,
) -> None:
    """Half of the force follows the acceleration, so that a lag of it looks like damping."""
    motion = rich_motion(30.0, seed=5)
    damping = -np.diag([40.0, 60.0, 70.0, 2.0, 3.0, 5.0])
    force = motion.nu @ damping.T + 0.1 * np.random.default_rng(12).normal(size=motion.nu.shape)
    acting = -force + 4.0 * motion.nu_dot
    inputs = driven(motion.t_s, motion.nu, np.zeros_like(force), force, acting, component)
    params = synthesise.Params(models=("diagonal",), actuator_lag="none")
    (pitch,) = synthesise.run(inputs, params).model_card["diagonal"].axes["M"].terms
    assert pitch.assumed_shifts["thrust_lag"] > 0.1
    assert (pitch.assumed_shifts["thrust"] > 0.1) == (component == "thrusters")


@pytest.mark.parametrize("word", ["from the prior", "at its bound", "weak"])
def test_a_value_that_a_prior_or_a_bound_holds_has_no_shifts_of_the_data_alone(word: str) -> None:
    item = TermCard.model_validate(
        {"term": "p", "unit": "N*m*s/rad", "value": -1.0, "standard_error": 1.0}
        | {"verdict": "weak", "assumed_shifts": {"thrust": 1.3}}
    )
    one = np.array([-1.7])
    fit = SimpleNamespace(
        values=one, free=one, standard_errors=np.array([0.1]), free_covariance=np.array([[0.01]])
    )
    status = CoefficientStatus(word, "weak", 0.9, ())
    fitted = term_within_limits(item, 0, cast(ConstrainedFit, fit), status)
    assert fitted.verdict == word
    assert fitted.assumed_shifts == ({"thrust": 1.3} if word == "weak" else {})


def test_a_weak_term_whose_sign_rests_on_assumed_figures_says_so() -> None:
    item = TermCard.model_validate(
        {"term": "p*|p|", "unit": "N*m*s^2/rad^2", "value": -1.0, "standard_error": 0.2}
        | {"verdict": "identified", "assumed_shifts": {"inertia": 0.6}}
    )
    one = np.array([-1.0])
    fit = SimpleNamespace(
        values=one, free=one, standard_errors=np.array([0.1]), free_covariance=np.array([[0.01]])
    )
    status = CoefficientStatus("identified", "identified", 0.0, ())
    fitted = term_within_limits(item, 0, cast(ConstrainedFit, fit), status)
    assert fitted.verdict == "weak"
    assert sign_by_figures(fitted)
    assert not sign_by_figures(fitted.model_copy(update={"standard_error": 0.3}))


@pytest.mark.parametrize(("free", "verdict"), [(-1.5, "weak"), (-1.3, "identified")])
def test_a_value_that_a_joint_limit_moved_by_two_errors_is_not_identified(
    free: float, verdict: str
) -> None:
    item = TermCard.model_validate(
        {"term": "p", "unit": "N*m*s/rad", "value": free, "standard_error": 0.2}
        | {"verdict": "identified"}
    )
    fit = SimpleNamespace(
        values=np.array([-1.0]),
        free=np.array([free]),
        standard_errors=np.array([0.1]),
        free_covariance=np.array([[0.01]]),
    )
    status = CoefficientStatus("identified", "identified", 0.0, ("power",))
    fitted = term_within_limits(item, 0, cast(ConstrainedFit, fit), status)
    assert (fitted.verdict, fitted.free_value) == (verdict, free)
    assert limited_far(fitted) == (verdict == "weak")


def test_models_with_more_terms_than_samples_are_named() -> None:
    card = run(noisy_legs(), models=("linear",)).model_card["linear"]
    assert too_few_samples({"linear": card}) == []
    axes = {axis: part.model_copy(update={"samples": 6}) for axis, part in card.axes.items()}
    (block,) = too_few_samples({"linear": card.model_copy(update={"axes": axes})})
    assert block["level"] == "warning"
    assert "have 6 samples" in block["text"]
    assert "Linear (6 an axis)" in block["text"]


def test_only_methods_that_were_measured_state_their_coverage() -> None:
    outputs = run(noisy_legs(), models=("linear", "diagonal"))
    assert set(outputs.model_card["linear"].coverage_on_twins) == {"linear", "gertler_hagen"}
    assert not outputs.model_card["diagonal"].coverage_on_twins
    texts = [block["text"] for block in outputs.section["blocks"] if block["kind"] == "text"]
    (measured,) = [words for words in texts if "% where the truth is Linear and" in words]
    assert measured.startswith("Linear: ")


@pytest.mark.parametrize("function", ["absolute", "huber"])
def test_another_error_function_is_that_of_the_samples_and_claims_no_interval(
    function: str,
) -> None:
    legs = noisy_legs(with_ratio=False)
    outputs = run(legs, models=("linear",), error_function=function, trim=True)
    card = outputs.model_card["linear"]
    assert (card.method, card.error_function) == ("error function", function)
    nu, force = (np.concatenate([leg[index] for leg in legs.values()]) for index in (0, 1))
    rows = np.vstack([nu.T, np.ones((1, len(nu)))])
    for i, axis in enumerate(AXES):
        oracle = (
            least_moduli(rows, force[:, i])
            if function == "absolute"
            else huber(rows, force[:, i]).coefficients
        )
        own = np.array(list(card.predictor[axis].values()))
        np.testing.assert_allclose(own, oracle, rtol=1e-7)
        error = force[:, i] - own @ rows
        assert card.axes[axis].j == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-9)
        for item in card.axes[axis].terms:
            assert item.standard_error is None
            assert item.verdict != "identified"
            assert item.value in (None, card.predictor[axis][item.term])
    assert "No interval" in str(outputs.section)


def test_weights_by_deviations_are_those_of_weighted_least_squares() -> None:
    nu, force, _ = noisy_legs(with_ratio=False)["one"]
    sd = 0.02 + 0.2 * np.abs(nu)
    table = residual_table(nu, force)
    for name, values in named(VELOCITY_SD, sd).items():
        table = table.append_column(name, pa.array(values))
    inputs = synthesise.Inputs(
        collection({"one": table}),
        collection({"one": segment_document("one")}),
        shipped_vehicle("bluerov2_heavy"),
    )
    params = synthesise.Params(models=("linear",), weights="deviations")
    card = synthesise.run(inputs, params).model_card["linear"]
    terms = tuple("uvwpqr")
    plain = np.linalg.lstsq(nu, force[:, 1], rcond=None)[0]
    noise = float(np.sqrt(np.mean((force[:, 1] - nu @ plain) ** 2)))
    root = np.sqrt(deviation_weights(terms, plain, nu, sd, noise=noise))
    oracle = np.linalg.lstsq(nu * root[:, None], force[:, 1] * root, rcond=None)[0]
    np.testing.assert_allclose(list(card.predictor["Y"].values()), oracle, rtol=1e-9)
    assert np.abs(oracle / plain - 1.0).max() > 0.01, "the weights do something"


def test_many_samples_are_taken_evenly(monkeypatch: pytest.MonkeyPatch) -> None:
    legs = noisy_legs(with_ratio=False)
    monkeypatch.setattr(error_choice, "MOST_SAMPLES", 500)
    card = run(legs, models=("linear",), error_function="absolute").model_card["linear"]
    step = -(-sum(len(nu) for nu, _, _ in legs.values()) // 500)
    rows = np.concatenate([nu[::step] for nu, _, _ in legs.values()]).T
    force = np.concatenate([force[::step, 2] for _, force, _ in legs.values()])
    oracle = least_moduli(rows, force)
    np.testing.assert_allclose(list(card.predictor["Z"].values()), oracle, rtol=1e-7)


@pytest.mark.parametrize(
    ("params", "words"),
    [
        ({"error_function": "huber", "minimiser": "nelder_mead"}, "scale of Huber"),
        ({"minimiser": "nelder_mead", "models": ("mcfarland",)}, "a simplex crawls"),
        ({"error_function": "absolute", "models": ("symmetric",)}, "need the sum of squares"),
        ({"weights": "deviations", "prior": "strip_theory"}, "a prior weighs"),
        ({"weights": "deviations"}, "fuse gave none"),
    ],
)
def test_error_functions_that_cannot_be_are_refused_in_words(
    params: dict[str, Any], words: str
) -> None:
    with pytest.raises((CampaignError, DataError), match=words) as refused:
        run(noisy_legs(with_ratio=False), **{"models": ("linear",)} | params)
    assert (refused.value.field or "").startswith("stages.synthesise.")


def test_a_minimum_that_is_not_found_names_model_and_axis(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def unsettled(*_: object, **__: object) -> Array:
        raise DataError("Huber's estimate does not settle", value=500, allowed="iterations")

    monkeypatch.setattr(error_choice, "minimise_error", unsettled)
    with pytest.raises(DataError, match="does not settle") as refused:
        run(noisy_legs(with_ratio=False), models=("linear",), error_function="huber")
    assert refused.value.field == "linear, axis X, huber"
    assert "error_function" in (refused.value.remedy or "")


def test_structures_without_limits_take_any_error_function() -> None:
    outputs = run(
        noisy_legs(with_ratio=False),
        vehicle="bluerov2_heavy",
        models=("symmetric",),
        damping="free",
        error_function="absolute",
    )
    assert outputs.model_card["symmetric"].method == "error function"


def with_priors(*sources: dict[str, Any], models: tuple[str, ...] = ("symmetric",)) -> ModelCard:
    """Return the card of the motion of u and w alone, with priors from elsewhere."""
    card: ModelCard = fitted_with_priors(*sources, models=models).model_card[models[0]]
    return card


def fitted_with_priors(
    *sources: dict[str, Any], models: tuple[str, ...] = ("symmetric",)
) -> synthesise.Outputs:
    nu, _, _ = noisy_legs(with_ratio=False)["one"]
    nu = nu * [1.0, 0.0, 1.0, 0.0, 0.0, 0.0]
    force = -20.0 * nu + np.random.default_rng(4).normal(size=nu.shape)
    inputs = synthesise.Inputs(
        collection({"one": residual_table(nu, force)}),
        collection({"one": segment_document("one")}),
        shipped_vehicle("bluerov2_heavy"),
        priors=PriorSourcesRecord.model_validate({"sources": list(sources)}),
    )
    outputs = synthesise.run(inputs, synthesise.Params(models=models))
    check_document(outputs.model_card[models[0]], "model_card")
    return outputs


def a_prior(kind: str, axis: str, term: str, value: float, sd: float) -> dict[str, Any]:
    terms = [{"axis": axis, "term": term, "value": value}]
    return {"kind": kind, "file": f"{kind}.json", "terms": terms, "lower": [[sd**2]]}


@pytest.mark.parametrize("kind", ["bench", "campaign"])
def test_a_prior_of_another_measurement_speaks_where_the_data_are_silent(kind: str) -> None:
    card = with_priors(a_prior(kind, "K", "p", -3.0, 0.2), a_prior(kind, "X", "u", -900.0, 1e4))
    entries = {(axis, item.term): item for axis in AXES for item in card.axes[axis].terms}
    roll, surge = entries["K", "p"], entries["X", "u"]
    assert roll.verdict == "from the prior"
    assert roll.value == pytest.approx(-3.0)
    assert roll.standard_error == pytest.approx(0.2, rel=1e-6)
    assert surge.verdict == "identified"
    assert surge.value == pytest.approx(-20.0, rel=0.05)
    assert [(item.source, item.means) for item in card.measured_priors] == [
        (kind, {"K": {"p": -3.0}}),
        (kind, {"X": {"u": -900.0}}),
    ]


@pytest.mark.parametrize(("value", "sd", "refused"), [(0.5, 0.1, True), (0.5, 0.4, False)])
def test_a_prior_of_damping_that_pushes_contradicts_the_limits(
    value: float, sd: float, refused: bool
) -> None:
    source = a_prior("bench", "K", "p", value, sd)
    if not refused:
        assert with_priors(source).measured_priors[0].lower == [[pytest.approx(sd**2)]]
        return
    with pytest.raises(CampaignError, match="contradict each other") as error:
        with_priors(source)
    assert (error.value.field, error.value.value) == ("priors[0]", "K_p = 0.5 +- 0.2 (95 %)")


@pytest.mark.parametrize(("second", "refused"), [(-5.0, True), (-3.9, False)])
def test_two_priors_that_cannot_both_be_true_are_refused(second: float, refused: bool) -> None:
    # Deviations .3 and .4: 4 of their difference are 2.
    sources = (a_prior("bench", "K", "p", -2.0, 0.3), a_prior("campaign", "K", "p", second, 0.4))
    if not refused:
        assert len(with_priors(*sources).measured_priors) == 2
        return
    with pytest.raises(CampaignError, match="two priors contradict each other") as error:
        with_priors(*sources)
    assert error.value.field == "priors[1]"
    assert error.value.value == "K_p = -5 +- 0.78 (95 %), -2 +- 0.59 by priors[0]"


def test_a_prior_against_clear_data_is_named_with_what_was_kept() -> None:
    def warnings(mean: float) -> list[str]:
        outputs = fitted_with_priors(a_prior("bench", "X", "u", mean, 0.5))
        return [
            block["text"]
            for block in outputs.section["blocks"]
            if block.get("level") == "warning" and "the training legs alone say" in block["text"]
        ]

    assert warnings(-20.5) == []
    (words,) = warnings(-60.0)
    assert words.startswith("Symmetric: the prior (bench: bench.json) of X_u is -60 +- 0.98")
    kept = with_priors(a_prior("bench", "X", "u", -60.0, 0.5)).predictor["X"]["u"]
    assert f"has {kept:.3g}." in words


def test_an_inertia_that_is_no_added_mass_is_named() -> None:
    legs = noisy_legs(with_ratio=False)
    with pytest.raises(CampaignError, match="not an added mass") as refused:
        run({"one": legs["one"]}, models=("symmetric",), inertia=("N_rdot", "N_rdott"))
    assert (refused.value.field, refused.value.value) == (
        "stages.synthesise.inertia[1]",
        "N_rdott",
    )
    assert "Did you mean 'N_rdot'?" in str(refused.value)


def test_a_prior_on_no_fitted_coefficient_is_refused() -> None:
    with pytest.raises(CampaignError, match="no fitted structure") as refused:
        with_priors(a_prior("bench", "K", "q", -3.0, 0.2), models=("diagonal",))
    assert refused.value.field == "priors[0]"
    with pytest.raises(CampaignError, match="no fitted structure") as refused:
        with_priors(a_prior("bench", "K", "p", -3.0, 0.2), models=("linear",))
    assert "published forms take none" in (refused.value.remedy or "")


def test_fewer_samples_than_terms_name_the_axis() -> None:
    nu, force, _ = noisy_legs(with_ratio=False)["one"]
    with pytest.raises(DataError, match="fewer samples than terms") as refused:
        run({"one": (nu[:2], force[:2], None)}, models=("symmetric",), vehicle="bluerov2_heavy")
    assert refused.value.field == "X"
    assert "at least 3" in str(refused.value.allowed)


def test_one_leg_is_left_out_of_nothing_and_the_page_says_so() -> None:
    legs = noisy_legs(with_ratio=False)
    outputs = run({"one": legs["one"]}, models=("linear",))
    assert (outputs.model_card["linear"].left_out, outputs.model_card["linear"].held_out) == (
        [],
        {},
    )
    assert "There is one training leg" in str(outputs.section)
    assert "There is one training leg" not in str(run(legs, models=("linear",)).section)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"inertia": ("N_rdot",)}, r"synthesise\.inertia.*no structure is fitted"),
        ({"prior": "vehicle"}, r"synthesise\.prior.*no structure is fitted"),
    ],
)
def test_settings_of_structures_need_one(settings: dict[str, Any], words: str) -> None:
    with pytest.raises(CampaignError, match=words):
        run(noisy_legs(), models=("fossen",), vehicle="bluerov2_heavy", **settings)


def test_what_errors_of_velocities_and_splines_lean_counts_once_with_its_sign() -> None:
    """One that the other takes back adds nothing; a current has a third of its scatter upward."""
    nu = np.random.default_rng(3).normal(size=(1, 200))
    force = np.zeros((200, 6))
    force[:, 0] = -4.0 * nu[0]
    fit = solve_axis(TriangularFactor.empty(("u",)).update(nu, force), "X", ("u",))
    one = NormalChange(("u",), np.eye(1), np.zeros((1, 6)))
    back = replace(one, moment=-np.eye(1))
    noise = training.Coloured(0.01 * np.eye(1), 1.0)

    def added(*splines: NormalChange) -> float:
        errors = training.DataErrors((one,), splines, (), {})
        covariance = about_the_truth(TrueEquations.of(fit, ()), noise, errors)
        return float(covariance[0, 0]) - 0.01

    assert added(back) == pytest.approx(0.0, abs=1e-12)
    assert added(one) == pytest.approx(4.0 * added())
    current = SteadyCurrent(np.zeros(2), 0.04 * np.eye(2))
    errors = moving_water({"dive": current}, 0.03, "dive").errors
    assert np.abs(errors[:, 2]).max() == pytest.approx(0.01)
