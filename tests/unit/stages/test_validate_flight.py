"""The chosen model's flight: draws within limits, a band that covers, its calibration."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from auvid.data_schemas.records.likelihood import LegFit, LikelihoodFit
from auvid.data_schemas.records.models import CovarianceCard, InertiaCard, LimitCard, ModelCard
from auvid.hydro.arrays import AXES, VELOCITIES
from auvid.hydro.dynamics.equations_of_motion import Control
from auvid.hydro.dynamics.simulation.free_run import (
    MeasuredMotion,
    WanderingForce,
    fly_freely,
)
from auvid.hydro.dynamics.viscous.models import IdentifiedModel
from auvid.stages.validate.flight import (
    LEVEL,
    NAMES,
    FreeFlight,
    ModelDraws,
    calibrated,
    draw_models,
    fly,
    force_errors,
    grown_errors,
)
from auvid.stages.validate.flight_presentation import flight_blocks, flight_views
from tests.support.example_run import example_run
from tests.support.motions import segment_document, shipped_vehicle

VEHICLE = shipped_vehicle("bluerov2_heavy")
DAMPING = dict(zip(AXES, (-40.0, -60.0, -80.0, -2.0, -2.0, -3.0), strict=True))
TRUE = {axis: {x: DAMPING[axis]} for axis, x in zip(AXES, VELOCITIES, strict=True)}
FORCE_SD, MEMORY_S = np.array([1.0, 1.0, 1.0, 0.05, 0.05, 0.2]), np.full(6, 0.4)


FIRST_S = 0.64
"""When the fused motion begins, after the start of its segment."""


def card(errors: dict[str, float], *, damping: str = "dissipative", **values: float) -> ModelCard:
    """A card of damping along each axis with these standard errors by axis."""
    made_up = example_run({"train": 4.0, "check": 2.0}).cards["coe"]
    axes, predictor = {}, {}
    for axis, own in zip(AXES, VELOCITIES, strict=True):
        value, error = values.get(axis, DAMPING[axis]), errors.get(axis, 0.0)
        item = (
            made_up.axes[axis]
            .terms[0]
            .model_copy(update={"term": own, "value": value, "standard_error": error})
        )
        # A covariance of other size: the printed error counts.
        covariance = CovarianceCard(terms=[own] if error else [], lower=[[4.0]] if error else [])
        axes[axis] = made_up.axes[axis].model_copy(
            update={"terms": [item], "covariance": covariance, "j": 1.0}
        )
        predictor[axis] = {own: value, "constant": 0.5}
    return made_up.model_copy(update={"axes": axes, "predictor": predictor, "damping": damping})


def drive(seed: int, seconds: float = 14.0) -> MeasuredMotion:
    """A motion of the true model under thrusters and a force that wanders."""
    t = np.arange(0.0, seconds, 0.02)
    thrust = 4.0 * np.sin(np.outer(t, [0.5, 0.7, 0.3, 0.9, 0.2, 0.4, 0.6, 0.8]))
    still = MeasuredMotion(FIRST_S + t, np.zeros((len(t), 12)), Control(thruster_force_N=thrust))

    states, _ = fly_freely(
        VEHICLE,
        [IdentifiedModel("true", TRUE)],
        np.full((1, 6), 0.0),
        still,
        first=np.array([0]),
        steps=np.arange(len(t)),
        disturbance=WanderingForce(FORCE_SD[None], MEMORY_S, seed=seed),
    )
    return replace(still, state=states[0, 0])


def flown(seed: int, *, force_sd: np.ndarray = FORCE_SD, windows: int = 2) -> FreeFlight:
    model = ModelDraws((IdentifiedModel("true", TRUE),), np.zeros((1, 6)), np.zeros((1, 6, 6)))
    draws = ModelDraws(model.models * 300, np.zeros((300, 6)), np.zeros((300, 6, 6)))
    flight = fly(
        VEHICLE,
        model,
        draws,
        drive(seed),
        window_s=8.0,
        errors=(force_sd, MEMORY_S),
        windows=windows,
        minimum_speed=0.05,
    )
    assert flight is not None
    return flight


@cache
def usual(seed: int) -> FreeFlight:
    """Return a flight with the true errors of the force."""
    return flown(seed)


def test_draws_have_the_printed_errors_and_stay_within_the_limits() -> None:
    drawn = draw_models(card({"X": 3.0, "K": 2.0}, K=-0.5), VEHICLE, count=4000, seed=1)
    X = np.array([model.coefficients["X"]["u"] for model in drawn.models])
    K = np.array([model.coefficients["K"]["p"] for model in drawn.models])
    assert X.std() == pytest.approx(3.0, rel=0.05)
    assert K.max() <= 0.0
    # Of a normal of -0.5 +- 2, 40 % lie above 0.
    assert drawn.moved == pytest.approx(1600, abs=120)
    assert len(drawn.models) == 4000
    assert np.sum(K > -1e-9) == drawn.moved, "the nearest point within is the limit"
    assert np.all(drawn.trims == 0.5)
    model = card({"K": 2.0, "Y": 2.0}, damping="free", K=-0.5)
    part = model.axes["Y"]
    (item,) = part.terms
    wide = part.model_copy(
        update={
            "terms": [item.model_copy(update={"assumed_shifts": {"thrust": 3.0, "mass": 6.0}})],
            "covariance": part.covariance.model_copy(
                update={"shifts": {"thrust": [[3.0]], "mass": [[-6.0]]}}
            ),
        }
    )
    model = model.model_copy(update={"axes": {**model.axes, "Y": wide}})
    free = draw_models(model, VEHICLE, count=2000, seed=1)
    assert (free.moved, len(free.models)) == (0, 2000)
    sway = np.std([drawn.coefficients["Y"]["v"] for drawn in free.models])
    assert sway == pytest.approx(7.0, rel=0.05), "of noise and assumed figures, as printed"


def test_where_no_draw_is_within_all_are_moved_onto_the_limits() -> None:
    drawn = draw_models(card({"K": 2.0}, K=19.0), VEHICLE, count=200, seed=1)
    assert drawn.moved == len(drawn.models) == 200
    assert max(model.coefficients["K"]["p"] for model in drawn.models) <= 1e-9


def test_a_drawn_inertia_is_one_that_the_fit_allows() -> None:
    """A normal of 1.9 +- 1 kg m2 has a share below 0; none below the rigid body's stays."""
    inertia = InertiaCard.model_construct(
        name="N_rdot", change=-1.0, standard_error=0.6, assumed_shifts={"thrust": 0.8}
    )
    fitted = card({}).model_copy(update={"inertia": [inertia]})
    drawn = draw_models(fitted, VEHICLE, count=200, seed=1)
    change = drawn.added_mass[:, 5, 5]
    assert change.std() > 0.5
    assert np.max(VEHICLE.added_mass[5, 5] + change) <= 1e-12
    (name,) = drawn.outside
    assert name.startswith("N_rdot <= ")
    assert drawn.moved == drawn.outside[name] > 10


def test_the_band_holds_as_often_as_it_says_where_its_force_error_is_the_true_one() -> None:
    shares = np.mean([usual(seed).coverage() for seed in range(6)], axis=0)
    # Four standard errors of six flights, each of which has one of 0.03.
    assert shares.mean() == pytest.approx(LEVEL, abs=0.05)
    narrow = flown(0, force_sd=FORCE_SD / 10.0).coverage()
    assert narrow.mean() < 0.6


def test_a_run_starts_again_from_the_measured_state() -> None:
    flight = usual(1)
    assert flight.starts_s == (FIRST_S, FIRST_S + 8.0)
    assert flight.t_s[0] == FIRST_S  # on the clock of the segment, beside what was measured
    assert np.all(np.diff(flight.t_s) > 0.0)
    (gap,) = np.flatnonzero(np.isnan(flight.simulated[:, 0]))
    np.testing.assert_allclose(flight.simulated[gap + 1], flight.measured[gap + 1], atol=1e-12)
    assert np.abs(flight.simulated[gap - 1] - flight.measured[gap - 1]).max() > 1e-3
    assert flight.table().num_rows == len(flight.t_s)
    assert flight.flown == 300
    assert flown(1, windows=48).flown == 50, "over many windows fewer draws fly"


@pytest.mark.filterwarnings("error")
def test_lost_draws_leave_the_band_open_above() -> None:
    """A fifth of the draws push ahead without end: the upper edge is infinite, not nan."""
    true = IdentifiedModel("true", TRUE)
    pushing = IdentifiedModel("true", {**TRUE, "X": {**TRUE["X"], "u": 900.0}})
    models = (true,) * 40 + (pushing,) * 10
    none = np.zeros((50, 6)), np.zeros((50, 6, 6))
    flight = fly(
        VEHICLE,
        ModelDraws((true,), np.zeros((1, 6)), np.zeros((1, 6, 6))),
        ModelDraws(models, *none),
        drive(0),
        window_s=8.0,
        errors=(FORCE_SD, MEMORY_S),
        windows=2,
        minimum_speed=0.05,
    )
    assert flight is not None
    assert flight.lost == 10
    assert flight.cause is not None
    assert (flight.cause.axis, flight.cause.cause) == ("X", "X_u")
    note = flight_blocks(
        "coe", card({}), {"a": flight}, {"a": segment_document("a", "validation")},
        ModelDraws(models, *none), window_s=8.0,
    )[-1]["note"]  # fmt: skip
    assert "10 diverged (in the first surge grows at" in note
    assert "mostly by X_u)" in note
    assert np.isinf(flight.high[-1, 0])
    assert np.isfinite(flight.low[-1, 0])


def test_ten_legs_widen_each_band_to_what_the_others_did() -> None:
    flights = [flown(seed, force_sd=FORCE_SD / 10.0) for seed in range(10)]
    assert calibrated(flights[:9]) == flights[:9]
    before = np.mean([flight.coverage() for flight in flights])
    wide = calibrated(flights)
    assert before < 0.5
    assert np.mean([flight.coverage() for flight in wide]) >= LEVEL
    other = np.array([flight.score() for flight in flights[1:]]).max(axis=0)
    np.testing.assert_allclose(
        (wide[0].high - wide[0].low)[5], other * (flights[0].high - flights[0].low)[5]
    )


def test_force_errors_forget_themselves_as_the_residual_does() -> None:
    size, memory = force_errors(card({}), {"X": 3.0}, 0.02)
    assert size.tolist() == [1.0] * 6
    rho = np.exp(-0.02 / memory[0])
    assert (1.0 + rho) / (1.0 - rho) == pytest.approx(3.0)
    assert memory[1] < 0.02, "white"


def test_a_force_error_grows_with_the_actuators_up_to_their_force() -> None:
    size, usual = np.full(4, 0.5), np.array([2.0, 4.0, 0.1, 0.0])
    grown = grown_errors(size, usual, np.array([6.0, 1.0, 3.0, 9.0]))
    assert grown.tolist() == [1.5, 0.5, 3.0, 0.5]
    np.testing.assert_array_equal(size, 0.5)


def test_a_fit_to_the_sensors_flies_under_its_own_unsteady_force() -> None:
    legs = [LegFit.model_construct(force_sd=dict.fromkeys("XYZKMN", sd)) for sd in (3.0, 4.0)]
    fit = LikelihoodFit.model_construct(legs=legs, force_time_s=dict.fromkeys("XYZKMN", 7.0))
    size, memory = force_errors(card({}).model_copy(update={"likelihood": fit}), {"X": 3.0}, 0.02)
    np.testing.assert_allclose(size, np.sqrt(12.5))
    np.testing.assert_allclose(memory, 7.0)


@pytest.mark.parametrize(
    ("legs", "kind"), [(1, "the model's own"), (10, "split conformal over 10 legs")]
)
def test_page_and_recording_name_the_band_and_count_the_draws(legs: int, kind: str) -> None:
    flight = usual(0)
    names = [f"leg{number}" for number in range(legs)]
    segments = {name: segment_document(name, "validation") for name in names}
    draws = replace(
        draw_models(card({}), VEHICLE, count=1000, seed=1), moved=782, outside={"K_p <= 0": 782}
    )
    limited = card({}).model_copy(
        update={"title": "Coe", "limits": [LimitCard(name="K_p <= 0", unknowns=["K_p"])]}
    )
    blocks = flight_blocks(
        "coe", limited, dict.fromkeys(names, flight), segments, draws, window_s=8.0
    )
    assert [block["kind"] for block in blocks] == ["plot"] * min(legs, 3) + ["table"]
    assert kind in blocks[-1]["note"]
    assert "Of 1000 draws of Coe's coefficients 782 lay outside" in blocks[-1]["note"]
    assert "limits (K_p <= 0: 782) and count at the nearest point within" in blocks[-1]["note"]
    assert "the estimate itself lies on the limit" in blocks[-1]["note"]
    assert "of 300 that flew 8 s each 0 diverged." in blocks[-1]["note"]
    assert blocks[-1]["rows"][0][1] == f"{100 * flight.coverage().mean():.0f} %"
    groups = flight_views("coe", names)
    assert len(groups) == 3 * legs * len(NAMES)
