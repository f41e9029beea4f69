"""The stage refine: known models recovered from sensors, and failures said in words."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pyarrow as pa
import pytest

from auvid.data_schemas.documents import check_document
from auvid.data_schemas.documents.campaign import LegEntry
from auvid.data_schemas.documents.model import parse
from auvid.data_schemas.documents.plans.dive_plan import DivePlanDocument
from auvid.data_schemas.errors import CampaignError
from auvid.data_schemas.records.likelihood import LagFit
from auvid.data_schemas.records.models import MeasuredPriorCard, TermCard
from auvid.data_schemas.records.motion import (
    CurrentRecord,
    InstallationEstimate,
    InstallationRecord,
)
from auvid.data_schemas.tables import column, make_table, matrix
from auvid.hydro.arrays import AXES, VELOCITIES
from auvid.hydro.dynamics.mechanics.kinematics import rotation_body_to_ned
from auvid.hydro.dynamics.simulation.rov.sensors import START_US, dive_in_memory
from auvid.hydro.dynamics.simulation.rov.truth import truth_of_model
from auvid.hydro.dynamics.viscous.models import IdentifiedModel
from auvid.hydro.identification.constrained.equations import Unknown
from auvid.hydro.identification.constrained.estimates import EstimateStatus
from auvid.hydro.identification.maximum_likelihood.agreement import Agreement
from auvid.hydro.identification.maximum_likelihood.estimate import LikelihoodEstimate
from auvid.hydro.identification.maximum_likelihood.output_error import fit_output_error
from auvid.stages import fuse, refine, resample, residual, synthesise
from auvid.stages.base import collection
from auvid.stages.columns import ACCELEROMETER, ATTITUDE, VELOCITY, forces
from auvid.stages.refine import fitting
from auvid.stages.refine.fitting import CardUnknowns, SensorFit
from auvid.stages.refine.presentation import stated_lag_blocks
from auvid.stages.refine.refined_card import _term as refined_term
from auvid.stages.sensor_motion import VelocityLogPlacement
from auvid.stages.validate import Predictor
from tests.support.constrained import drawn_as_printed
from tests.support.example_run import example_run
from tests.support.motions import log_document, shipped_vehicle

VEHICLE = shipped_vehicle("bluerov2_heavy")
TRUTH = {
    "X": {"u": -40.0},
    "Y": {"v": -60.0},
    "Z": {"w": -80.0},
    "K": {"p": -3.0},
    "M": {"q": -4.0},
    "N": {"r": -3.0},
}
LEG = {
    "id": "a",
    "duration_s": 20,
    "use": "training",
    "modes": [{"at_s": 0, "mode": "alt_hold"}],
    "sticks": {
        axis: {"kind": kind, "amplitude": 0.6}
        for axis, kind in (
            ("forward", "random"),
            ("lateral", "random"),
            ("heave", "multisine"),
            ("yaw", "random"),
            ("roll", "multisine"),
            ("pitch", "multisine"),
        )
    },
}
NOISE = {
    "imu": {"gyro_sd_rad_s": 0.002, "gyro_bias_sd_rad_s": 0.002, "accel_sd_m_s2": 0.02},
    "attitude": {"tilt_sd_deg": 0.05, "heading_sd_deg": 0.05},
    "dvl": {"sd_m_s": 0.005},
    "depth": {"sd_m": 0.004},
}


def chain(model: str, *, duration_s: float = 20.0, seed: int = 1, **params: Any) -> refine.Inputs:
    """What refine reads of one training leg of a twin, made by the stages before it."""
    document = {
        "kind": "dives",
        "title": "a dive",
        "settle_s": 5,
        "legs": [LEG | {"duration_s": duration_s}],
        "sensors": NOISE,
    }
    flown = parse(DivePlanDocument, document)
    truth = truth_of_model(VEHICLE, IdentifiedModel("truth", TRUTH))
    _, record = dive_in_memory(truth, flown, "a", seed=seed)
    names = ("imu", "attitude", "velocity", "depth", "actuators", "battery")
    tables = {name: make_table(name, record.streams[name]) for name in names}
    end_us = max(int(columns["time_us"][-1]) for columns in record.streams.values())
    log = log_document(log="log", start_us=START_US, end_us=end_us)
    leg = {"id": "a", "log": "log", "start_s": 0.0, "end_s": duration_s, "use": "training"}
    cut = resample.run(
        resample.Inputs(leg=LegEntry(**leg), log_info=log, vehicle=VEHICLE, **tables),
        resample.Params(),
    )
    (key,) = cut.segment
    fused = fuse.run(
        fuse.Inputs(cut.segment[key], cut.resampled[key], VEHICLE, log),
        fuse.Params(cutoff_hz=2.0),
    )
    force = residual.run(
        residual.Inputs(
            cut.segment[key], fused.fused, fused.fusion, cut.resampled[key], VEHICLE, log
        ),
        residual.Params(),
    )
    fitted = synthesise.run(
        synthesise.Inputs(
            collection({key: force.residual}),
            collection(cut.segment),
            VEHICLE,
            collection({key: fused.fused}),
        ),
        synthesise.Params(models=(model,), **params),
    )
    return refine.Inputs(
        model_card=collection(fitted.model_card),
        segment=collection(cut.segment),
        fusion=collection({key: fused.fusion}),
        log_info=collection({"log": log}),
        resampled=collection(cut.resampled),
        samples_attitude=collection(cut.samples_attitude),
        residual=collection({key: force.residual}),
        fused=collection({key: fused.fused}),
        vehicle=VEHICLE,
        samples_imu=collection(cut.samples_imu or {}),
        samples_velocity=collection(cut.samples_velocity or {}),
        samples_depth=collection(cut.samples_depth or {}),
    )


LAG_S = truth_of_model(VEHICLE, IdentifiedModel("truth", TRUTH)).loss.lag_s


def outputs(inputs: refine.Inputs, **params: Any) -> refine.Outputs:
    refined = refine.run(
        inputs, refine.Params(**{"models": ("symmetric",), "estimator": "filter_error", **params})
    )
    for card in refined.model_card.values():
        check_document(card, "model_card")
    check_document(refined.section, "section")
    return refined


def warned(refined: refine.Outputs) -> str:
    assert refined.section is not None
    blocks = [block for block in refined.section["blocks"] if block["kind"] == "remark"]
    return "\n".join(block["text"] for block in blocks if block["level"] == "warning")


@pytest.fixture(scope="module")
def twin() -> refine.Inputs:
    return chain("symmetric", duration_s=20.0)


@pytest.fixture(scope="module")
def limited() -> refine.Inputs:
    """With constants, published damping as a prior, and yaw inertia fitted."""
    return chain("symmetric", duration_s=20.0, trim=True, prior="vehicle", inertia=("N_rdot",))


@pytest.mark.compiles("hydro/identification/maximum_likelihood/window_loop/loop.py")
@pytest.mark.parametrize("estimator", ["output_error", "filter_error"])
def test_a_known_model_is_recovered_from_the_sensors(twin: refine.Inputs, estimator: str) -> None:
    refined = outputs(twin, estimator=estimator)
    (name,), (card,) = refined.model_card, refined.model_card.values()
    assert name == card.name == f"symmetric_{estimator}"
    assert card.title == f"Symmetric ({estimator.replace('_', ' ')})"
    first = twin.model_card["symmetric"]
    # Too few of filter error's intervals held the truth of twins.
    word = {"output_error": "identified", "filter_error": "weak"}[estimator]
    for axis, row in TRUTH.items():
        for term, true in row.items():
            # Least squares pays for the lag of the thrusters, up to a third in roll.
            assert card.predictor[axis][term] == pytest.approx(true, rel=0.06)
            error = abs(card.predictor[axis][term] - true)
            assert error < max(abs(first.predictor[axis][term] - true), 0.01 * abs(true))
            entry = next(item for item in card.axes[axis].terms if item.term == term)
            assert entry.verdict == word
    fit = card.likelihood
    assert fit is not None
    assert card.lag is not None
    # 10 Hz of pulses, linear between them, count some of a tick as lag.
    assert card.lag.value_s == pytest.approx(LAG_S, abs=0.015)
    assert card.lag.verdict == "identified"
    assert fit.weighted_residual == pytest.approx(1.0, abs=0.05)
    noise = {item.channel: item.noise_sd for item in fit.channels}
    assert noise["velocity x"] == pytest.approx(0.005, rel=0.2)
    assert noise["depth"] == pytest.approx(0.004, rel=0.2)
    assert (fit.force_time_s is None) == (estimator == "output_error")
    # Pulses at 10 Hz are no straight lines: one window's parts say so to output error.
    assert fit.windows_agree == (None if estimator == "filter_error" else False)
    assert warned(refined) == ""
    assert refined.section is not None
    words = str(refined.section["blocks"])
    assert card.coverage_on_twins == ({} if estimator == "output_error" else {"linear": 0.9})
    assert ("held the truth in 90 % where the truth is" in words) == bool(card.coverage_on_twins)
    assert ("Windows differ by" in words) == (estimator == "output_error")
    assert ("filter error calls none identified" in words) == (estimator == "filter_error")


def test_draws_of_a_refined_card_have_its_printed_errors(twin: refine.Inputs) -> None:
    """With what a thrust curve moves the least-squares coefficients by, a tenth of each."""
    card = twin.model_card["symmetric"]
    axes = {}
    for axis, part in card.axes.items():
        shifts = {item.term: 0.1 * (item.value or 0.0) for item in part.terms}
        rows = {"thrust": [[shifts[term] for term in part.covariance.terms]]}
        terms = [
            item.model_copy(update={"assumed_shifts": {"thrust": abs(shifts[item.term])}})
            for item in part.terms
        ]
        covariance = part.covariance.model_copy(update={"shifts": rows})
        axes[axis] = part.model_copy(update={"terms": terms, "covariance": covariance})
    spread = replace(
        twin, model_card=collection({"symmetric": card.model_copy(update={"axes": axes})})
    )
    (refined,) = outputs(spread, estimator="output_error").model_card.values()
    assert drawn_as_printed(refined) > 12
    assert any(item.assumed_shifts for item in refined.axes["X"].terms)


def test_a_lag_of_the_card_is_held_where_none_is_fitted(twin: refine.Inputs) -> None:
    """Held at the true lag the roll damping is right, without one a third is missing."""
    first, true = twin.model_card["symmetric"], TRUTH["K"]["p"]
    errors = []
    for lag in (LagFit(value_s=LAG_S, standard_error_s=None, verdict="stated"), None):
        start = collection({"symmetric": first.model_copy(update={"lag": lag})})
        refined = outputs(
            replace(twin, model_card=start), estimator="output_error", thrust_lag=False
        )
        (card,) = refined.model_card.values()
        assert card.lag == lag
        assert card.likelihood is not None
        errors.append(abs(card.predictor["K"]["p"] - true))
        if lag is not None:
            assert card.likelihood.weighted_residual == pytest.approx(1.0, abs=0.05)
            assert f"{LAG_S:g} s, stated" in str(refined.section)
    assert errors[0] < 0.06 * abs(true)
    assert errors[1] > 2.0 * errors[0]


def test_a_lag_that_may_be_the_velocity_logs_stays_inseparable(twin: refine.Inputs) -> None:
    lag = LagFit(value_s=LAG_S, standard_error_s=0.01, verdict="inseparable")
    start = twin.model_card["symmetric"].model_copy(update={"lag": lag})
    inputs = replace(twin, model_card=collection({"symmetric": start}))
    (card,) = outputs(inputs, estimator="output_error").model_card.values()
    assert card.lag is not None
    assert card.lag.verdict == "inseparable"
    assert card.lag.value_s == pytest.approx(LAG_S, abs=0.015)


def test_the_force_error_of_a_card_is_that_of_its_predictor(limited: refine.Inputs) -> None:
    (card,) = outputs(limited, estimator="output_error").model_card.values()
    residual_of, fused = limited.residual["a"], limited.fused["a"]
    model = Predictor.of(card)
    error = forces(residual_of, "tau_bar") - model.force(residual_of, fused)
    rms = np.sqrt(np.mean(error**2, axis=0))
    np.testing.assert_allclose([card.axes[axis].j for axis in AXES], rms, rtol=1e-9)


def test_limits_prior_and_inertia_of_the_card_hold(limited: refine.Inputs) -> None:
    (card,) = outputs(limited, estimator="output_error").model_card.values()
    K = np.array([[card.predictor[a].get(v, 0.0) for v in VELOCITIES] for a in AXES])
    assert np.linalg.eigvalsh(K + K.T).max() < 1e-6 * np.abs(K).max()
    (inertia,) = card.inertia
    true = float(VEHICLE.mass_matrix[5, 5])
    assert inertia.value == pytest.approx(true, abs=4.0 * inertia.standard_error + 0.02)
    assert inertia.in_vehicle_file - inertia.change == pytest.approx(inertia.value)
    assert card.likelihood is not None
    assert card.lag is not None
    assert inertia.lag_s == card.lag.value_s
    assert inertia.correlation == card.lag.correlations["N_rdot"]
    assert card.prior == limited.model_card["symmetric"].prior


def test_priors_of_other_measurements_weigh_with_their_covariance(limited: refine.Inputs) -> None:
    """Beside the vehicle file's: precisions add up, the mean is the weighted one."""
    card = limited.model_card["symmetric"]
    measured = MeasuredPriorCard(
        source="bench",
        file="bench.json",
        means={"K": {"p": -3.0}, "Y": {"v": -90.0}},
        lower=[[0.04], [0.1, 9.0]],
    )
    own = CardUnknowns(card, VEHICLE, lag=True)
    both = CardUnknowns(card.model_copy(update={"measured_priors": [measured]}), VEHICLE, lag=True)
    assert own.prior is not None
    assert both.prior is not None
    places = [own.unknowns.index(Unknown(axis, term)) for axis, term in (("K", "p"), ("Y", "v"))]
    cell = np.ix_(places, places)
    added = np.linalg.inv([[0.04, 0.1], [0.1, 9.0]])
    precision = own.prior.precision[cell] + added
    np.testing.assert_allclose(both.prior.precision[cell], precision, rtol=1e-9)
    right = own.prior.precision[cell] @ own.prior.mean[places] + added @ [-3.0, -90.0]
    np.testing.assert_allclose(both.prior.mean[places], np.linalg.solve(precision, right))


def test_each_leg_is_predicted_from_the_others(twin: refine.Inputs) -> None:
    """Of two legs with the same samples each is held out, and alone it fits the other."""
    several = {
        name: collection({"a": getattr(twin, name)["a"], "b": getattr(twin, name)["a"]})
        for name in (
            "fusion", "resampled", "samples_attitude", "residual", "fused", "samples_imu",
            "samples_velocity", "samples_depth",
        )
    }  # fmt: skip
    second = twin.segment["a"].model_copy(update={"id": "b", "leg": "b"})
    both = replace(twin, segment=collection({"a": twin.segment["a"], "b": second}), **several)
    card = outputs(both, estimator="output_error").model_card["symmetric_output_error"]
    assert set(card.held_out) == {"a", "b"}
    ratio = card.held_out["a"]["all"]
    assert ratio == pytest.approx(card.held_out["b"]["all"], rel=1e-3)
    force = np.sqrt(np.mean(forces(twin.residual["a"], "tau_bar") ** 2))
    j = np.sqrt(np.mean([card.axes[axis].j ** 2 for axis in AXES]))
    # Nothing new is in a copy, so that leaving it out moves nothing.
    assert ratio == pytest.approx(j / force, rel=0.02)


def test_a_model_that_was_not_fitted_is_named(twin: refine.Inputs) -> None:
    with pytest.raises(CampaignError, match=r"fits no such model.*Did you mean 'symmetric'"):
        refine.run(twin, refine.Params(models=("symetric",)))
    with pytest.raises(CampaignError, match="stands twice"):
        refine.run(twin, refine.Params(models=("symmetric", "symmetric")))


@pytest.mark.parametrize(
    ("stream", "words"),
    [("samples_velocity", "a body velocity"), ("samples_imu", "angular rates")],
)
def test_a_leg_without_a_sensor_is_left_out(twin: refine.Inputs, stream: str, words: str) -> None:
    refined = outputs(replace(twin, **{stream: None}))
    assert refined.model_card == {}
    assert f"leaves out segment 'a' lacks {words}" in warned(refined)
    assert "Symmetric: not fitted to the sensors, the card of synthesise stays" in warned(refined)


def test_a_leg_shorter_than_a_window_is_its_own(twin: refine.Inputs) -> None:
    refined = outputs(twin, estimator="output_error", window_s=60.0)
    (card,) = refined.model_card.values()
    assert card.likelihood is not None
    assert not card.likelihood.left_out


def test_too_few_samples_are_named(twin: refine.Inputs) -> None:
    assert twin.samples_imu is not None
    few = {
        name: collection({"a": getattr(twin, name)["a"].slice(150, 2)})
        for name in ("samples_imu", "samples_velocity", "samples_attitude", "samples_depth")
    }
    refined = outputs(replace(twin, **few))
    assert refined.model_card == {}
    assert "card of synthesise stays" in warned(refined)


def test_a_start_that_diverges_is_named(twin: refine.Inputs) -> None:
    card = twin.model_card["symmetric"]
    pushed = {**card.predictor, "N": {**card.predictor["N"], "r": 500.0}}
    wild = card.model_copy(update={"predictor": pushed, "damping": "free"})
    refined = outputs(
        replace(twin, model_card=collection({"symmetric": wild})), estimator="output_error"
    )
    assert refined.model_card == {}
    assert "The motion diverges at the starting values" in warned(refined)
    assert "Set stages.refine.estimator: filter_error" in warned(refined)


@pytest.mark.parametrize(("share", "missed"), [(0.5, False), (8.0, True)])
def test_a_fit_that_does_not_converge_leaves_the_card_of_synthesise(
    twin: refine.Inputs, monkeypatch: pytest.MonkeyPatch, share: float, missed: bool
) -> None:
    def unsettled(*arguments: Any, **options: Any) -> LikelihoodEstimate:
        fit = fit_output_error(*arguments, **options)
        errors = share * fit.channel_residuals
        return replace(fit, word="no convergence", channel_residuals=errors)

    monkeypatch.setattr(fitting, "fit_output_error", unsettled)
    refined = outputs(twin, estimator="output_error", window_s=4.0)
    assert refined.model_card == {}
    words = warned(refined)
    assert "did not converge in" in words
    assert ("Its free runs miss the samples by" in words) == missed
    assert ("Use stages.refine.estimator: filter_error" in words) == missed


def test_without_an_accelerometer_the_rest_is_used(twin: refine.Inputs) -> None:
    assert twin.samples_imu is not None
    table = twin.samples_imu["a"]
    bare = table.drop_columns(list(ACCELEROMETER))
    nothing = {name: np.full(table.num_rows, np.nan) for name in ACCELEROMETER}
    imu = make_table(
        "samples_imu", {**{n: bare[n].to_numpy() for n in bare.column_names}, **nothing}
    )
    refined = outputs(replace(twin, samples_imu=collection({"a": imu})), estimator="output_error")
    (card,) = refined.model_card.values()
    assert card.likelihood is not None
    assert not [c for c in card.likelihood.channels if c.channel.startswith("accel")]
    assert card.likelihood.legs[0].accel_bias_m_s2 is None
    assert card.predictor["X"]["u"] == pytest.approx(-40.0, rel=0.05)


def test_an_estimated_installation_moves_the_velocity_log(twin: refine.Inputs) -> None:
    estimate = InstallationEstimate(arm_m=[0.1, 0.2, 0.3], angles_rad=[0.0, 0.0, 0.1], lag_s=0.05)
    record = InstallationRecord(
        figures=[],
        estimate=estimate,
        convention=None,
        convention_found=None,
        innovations={},
        legs=[],
        left_out={},
    )
    key, fusion = next(iter(twin.fusion.items()))
    taken = replace(
        twin,
        installation=record,
        fusion=collection({key: fusion.model_copy(update={"installation": "estimate"})}),
    )
    (leg,), _, _ = refine._legs(taken)
    (plain,), _, _ = refine._legs(replace(twin, installation=record))
    place = leg.geometry.velocity
    np.testing.assert_array_equal(place.arm_m, estimate.arm_m)
    np.testing.assert_allclose(place.rotation @ [1.0, 0.0, 0.0], [np.cos(0.1), np.sin(0.1), 0.0])
    assert twin.samples_velocity is not None
    moved = column(twin.samples_velocity[key], "t_s") - estimate.lag_s
    assert np.isin(leg.sensors["velocity"].t_s, moved).all()
    assert not np.isin(plain.sensors["velocity"].t_s, moved).any()
    np.testing.assert_array_equal(plain.geometry.velocity.arm_m, VEHICLE.dvl.arm_m)


@pytest.mark.parametrize(
    ("word", "thrust", "agree", "verdict", "shifts"),
    [
        ("from the prior", 1.3, True, "from the prior", {}),
        ("at its bound", 1.3, False, "at its bound", {}),
        ("weak", 1.3, True, "weak", {"thrust": 1.3}),
        ("identified", 1.3, True, "weak", {"thrust": 1.3}),
        ("identified", 0.3, True, "identified", {"thrust": 0.3}),
        ("identified", 0.3, False, "weak", {"thrust": 0.3, "form": np.hypot(0.2, 0.7)}),
    ],
)
def test_shifts_of_a_value_are_those_of_free_data_and_of_a_form_that_lacks_something(
    word: str, thrust: float, agree: bool, verdict: str, shifts: dict[str, float]
) -> None:
    """A prior or a bound holds back what figures move; windows that disagree add a distance.

    Where they agree the form lacks nothing, whatever least squares says.

    A value that the form may lean by a third is weak, though its interval keeps the sign.

    An unsteady force leans least squares alone.
    """
    item = TermCard.model_validate(
        {
            "term": "p",
            "unit": "N*m*s/rad",
            "value": -1.0,
            "verdict": "weak",
            "assumed_shifts": {"thrust": thrust, "unsteady": 0.9, "form": 0.2},
        }
    )
    one, unknown = np.array([-1.7]), Unknown("K", "p")
    fit = SimpleNamespace(
        problem=SimpleNamespace(unknowns=[unknown], physical=lambda theta: theta),
        limited=SimpleNamespace(values=one),
        estimate=SimpleNamespace(
            standard_errors=np.array([0.3]),
            theta=one,
            windows_agree=agree,
            agreement=Agreement(1.0, 60, 1.0 if agree else 0.0),
        ),
    )
    fitted = refined_term("K", item, cast(SensorFit, fit), {unknown: EstimateStatus(word)})
    assert fitted.verdict == verdict
    assert fitted.assumed_shifts == pytest.approx(shifts)


@pytest.mark.parametrize(("stated_s", "warns"), [(0.05, True), (0.12, False)])
def test_a_fitted_lag_is_held_against_a_stated_one(stated_s: float, warns: bool) -> None:
    fitted = LagFit(value_s=0.15, standard_error_s=0.01, verdict="identified")
    card = example_run({"train": 4.0, "check": 2.0}).cards["coe"]
    card = card.model_copy(update={"lag": fitted})
    stated = LagFit(value_s=stated_s, standard_error_s=0.01, verdict="stated")
    blocks = stated_lag_blocks(stated, card)
    assert [block["level"] for block in blocks] == (["warning"] if warns else [])
    assert all("states 0.05 s (actuators.lag)" in block["text"] for block in blocks)
    assert stated_lag_blocks(fitted, card) == stated_lag_blocks(None, card) == []


def test_a_current_that_fuse_takes_off_is_off_the_samples_of_the_velocity_log(
    twin: refine.Inputs,
) -> None:
    """Over ground the log reads R' c more, in its own axes; the fit sees none of it."""
    assert twin.samples_velocity is not None
    ((key, table),) = twin.samples_velocity.items()
    (still,), _, _ = refine._legs(twin)
    ned = np.array([0.2, -0.1, 0.0])
    fused, t_s = twin.fused[key], column(table, "t_s")
    euler = np.array(
        [np.interp(t_s, column(fused, "t_s"), np.unwrap(column(fused, n))) for n in ATTITUDE]
    ).T
    over = matrix(table, VELOCITY[:3])
    turn = VelocityLogPlacement.of(VEHICLE, None).turn
    over = over + np.einsum("nji,j->ni", rotation_body_to_ned(euler), ned) @ turn
    for place, name in enumerate(VELOCITY[:3]):
        table = table.set_column(table.column_names.index(name), name, pa.array(over[:, place]))
    current = CurrentRecord(verdict="stated", reason="", ned_m_s=ned.tolist(), sd_m_s=None)
    flowing = replace(
        twin,
        samples_velocity=collection({key: table}),
        fusion=collection({key: twin.fusion[key].model_copy(update={"current": current})}),
    )
    (leg,), _, warnings = refine._legs(flowing)
    assert warnings == []
    difference = leg.sensors["velocity"].values - still.sensors["velocity"].values
    # The attitude here is measured, there smoothed: a milliradian of .2 m/s.
    assert np.sqrt(np.mean(difference**2)) < 5e-4
    assert np.array_equal(leg.sensors["gyro"].values, still.sensors["gyro"].values)
