"""A model in Python: its motion, its file, a fit that finds it, and its score."""

from __future__ import annotations

import re
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import auvid
from auvid.data_schemas.errors import PipelineError
from auvid.data_schemas.records.models import VelocityRange
from auvid.export import write
from auvid.pipeline.commands.model.score_command import score as command_score

Array = npt.NDArray[np.float64]
TRUTH = {"X": ["u", "u|u|"], "Y": ["v"], "Z": ["w"], "K": ["p"], "M": ["q"], "N": ["r", "r|r|"]}
STEP_S = 0.05


def wandering(seconds: float, size: Array, *, seed: int) -> tuple[Array, Array]:
    """Return times and a force (n, 6) that moves linearly between random values."""
    rng, t = np.random.default_rng(seed), np.arange(0.0, seconds, STEP_S)
    knots = np.arange(0.0, seconds + 4.0, 3.0)
    values = rng.uniform(-1.0, 1.0, (len(knots), 6)) * size
    return t, np.column_stack([np.interp(t, knots, column) for column in values.T])


@pytest.fixture(scope="module")
def results(short_workspace: Path) -> auvid.RunResults:
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(short_workspace)
        return auvid.open_run("example")


@pytest.fixture(scope="module")
def fossen(results: auvid.RunResults) -> auvid.Model:
    return results.models["fossen"]


@pytest.fixture(scope="module")
def flight(fossen: auvid.Model) -> tuple[Array, Array, Any]:
    """A motion of the model itself under a known force, of 150 s."""
    t, tau = wandering(150.0, np.array([30.0, 30.0, 30.0, 1.0, 1.0, 4.0]), seed=3)
    return t, tau, damped(fossen).simulate(t, tau)


def damped(model: auvid.Model) -> auvid.Model:
    """Return the model with damping that is the same whatever the example's fit gave."""
    values = {"X_u": -12.0, "X_u|u|": -40.0, "Y_v": -30.0, "Z_w": -40.0, "K_p": -2.0,
              "M_q": -2.0, "N_r": -3.0, "N_r|r|": -4.0}  # fmt: skip
    rows = [
        item.model_copy(update={"predictor": values.get(item.symbol, 0.0)})
        for item in model.file.coefficients
    ]
    return auvid.Model(model.file.model_copy(update={"coefficients": rows}))


def test_a_steady_force_ends_at_the_speed_that_the_equation_has(fossen: auvid.Model) -> None:
    """X_u u + X_uu u|u| + X = 0: 52 N against -12 u - 40 u|u| is 1 m/s."""
    motion = damped(fossen).simulate(np.arange(0.0, 60.0, STEP_S), [52.0, 0, 0, 0, 0, 0])
    assert motion["u_m_s"].iloc[-1] == pytest.approx(1.0, abs=1e-9)
    assert motion.attrs["units"]["u_m_s"] == "m/s"
    assert any(words.startswith("u reaches") for words in motion.attrs["warnings"])


def test_force_and_simulation_obey_one_equation(
    flight: tuple[Array, Array, Any], fossen: auvid.Model
) -> None:
    """M nu_dot of the motion is what the forces add up to (error of the difference
    quotient: the third derivative times h^2 / 6, below 1 % of the largest force).
    """
    _, tau, motion = flight
    nu = motion[[f"{name}_m_s" for name in "uvw"] + [f"{name}_rad_s" for name in "pqr"]].to_numpy()
    eta = motion.iloc[:, 7:].to_numpy()
    parts = damped(fossen).force(nu, eta)
    total = parts.viscous + parts.restoring + tau - parts.coriolis
    measured = np.gradient(nu, STEP_S, axis=0) @ fossen.inertia.T
    error = np.abs(measured - total)[2:-2]
    assert np.percentile(error, 95, axis=0) / np.abs(total).max(axis=0) == pytest.approx(
        np.zeros(6), abs=0.02
    )


def test_a_model_comes_back_from_its_file(fossen: auvid.Model, tmp_path: Path) -> None:
    path = fossen.save(tmp_path / "fossen.json")
    again = auvid.Model.load(path)
    assert again.save(tmp_path / "again.json").read_bytes() == path.read_bytes()
    assert repr(again) == repr(fossen)
    table = again.coefficients
    assert list(table.columns[:4]) == ["value", "unit", "low", "high"]
    assert table["value"].isna().sum() == sum(c.value is None for c in fossen.file.coefficients)


def test_a_fit_finds_the_model_that_made_the_motion(
    flight: tuple[Array, Array, Any], fossen: auvid.Model, tmp_path: Path
) -> None:
    """Without noise each coefficient comes back within 3 % (the low-pass of 3 Hz)."""
    t, tau, motion = flight
    model = auvid.fit(
        t, motion.iloc[:, 1:7], motion.iloc[:, 10:], fossen.vehicle, tau=tau, model=TRUTH,
        validate_from=100.0,
    )  # fmt: skip
    truth = {c.symbol: c.predictor for c in damped(fossen).file.coefficients}
    values = model.coefficients["value"]
    for symbol in ("X_u", "X_u|u|", "Y_v", "Z_w", "K_p", "M_q", "N_r", "N_r|r|"):
        assert values[symbol] == pytest.approx(truth[symbol], rel=0.03), symbol
    assert model.recommended
    assert set(model.file.use.axes.simulation) == set("XYZKMN")  # type: ignore[union-attr]
    assert model.file.dynamics.thrusters == fossen.file.dynamics.thrusters
    assert auvid.Model.load(model.save(tmp_path / "own.json")).name == "own"


def test_without_a_part_to_judge_on_the_model_says_so(
    flight: tuple[Array, Array, Any], fossen: auvid.Model
) -> None:
    t, tau, motion = flight
    rows = slice(0, 600)
    model = auvid.fit(
        t[rows], motion.iloc[rows, 1:7], motion.iloc[rows, 10:], fossen.vehicle,
        tau=tau[rows], model="diagonal",
    )  # fmt: skip
    assert "nothing judges it" in model.use


@pytest.mark.parametrize(("velocity_sd", "excited"), [(None, False), (0.001, True), (0.01, False)])
def test_small_motion_counts_as_excited_only_with_the_callers_errors(
    flight: tuple[Array, Array, Any],
    fossen: auvid.Model,
    velocity_sd: float | None,
    excited: bool,
) -> None:
    """Sway of 0.02 m/s RMS: below the fixed 0.03, above three times 0.001, below of 0.01."""
    t, tau, motion = flight
    rows = slice(0, 1500)
    nu = motion.iloc[rows, 1:7].to_numpy(copy=True)
    nu[:, 1] *= 0.02 / np.sqrt(np.mean(nu[:, 1] ** 2))
    model = auvid.fit(
        t[rows], nu, motion.iloc[rows, 10:], fossen.vehicle, tau=tau[rows], model={"Y": ["v"]},
        velocity_sd=None if velocity_sd is None else [velocity_sd] * 6,
    )  # fmt: skip
    assert (model.coefficients["verdict"]["Y_v"] != "not excited") is excited


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"tau": None}, "the commands are not those of the vehicle's actuators"),
        ({"tau": np.zeros((5, 6))}, r"wrong shape \(field 'tau'\)|field 'tau': wrong shape"),
        ({"pulses": np.zeros((600, 6))}, "give the force of the actuators or their commands"),
        ({"model": "diagnal"}, "unknown model.*Did you mean 'diagonal'"),
        ({"settings": {"fues": {}}}, "no such stage in a fit.*Did you mean 'fuse'"),
        ({"settings": {"fuse": {"cutof_hz": 1.0}}}, "Did you mean 'cutoff_hz'"),
        ({"validate_from": 1e6}, "judged outside the data"),
        ({"vehicle": "nobodys"}, "no such vehicle"),
        ({"nu": np.full((600, 6), np.nan)}, "not finite"),
        ({"velocity_sd": [0.01] * 3}, "no standard deviations of u v w p q r"),
        ({"time": np.zeros(600)}, "times do not ascend"),
        ({"angles": np.full((600, 3), [0.0, 2.0, 0.0])}, "pitch .*degrees.*np.radians"),
        ({"angles": np.full((600, 3), [-4.0, 0.0, 0.0])}, "roll .*degrees.*np.radians"),
        ({"nu": np.full((600, 6), [1.0, 0, 0, 0, 0, 11.0])}, "rate r .*degrees.*np.radians"),
    ],
)
def test_a_fit_refuses_in_words(
    flight: tuple[Array, Array, Any], fossen: auvid.Model, changes: dict[str, Any], message: str
) -> None:
    t, tau, motion = flight
    rows = slice(0, 600)
    arguments = {
        "time": t[rows],
        "nu": motion.iloc[rows, 1:7],
        "angles": motion.iloc[rows, 10:],
        "vehicle": fossen.vehicle,
        "tau": tau[rows],
    }
    with pytest.raises(auvid.PipelineError, match=message):
        auvid.fit(**(arguments | changes))


@pytest.mark.parametrize(
    ("time", "tau", "message"),
    [
        ([0.0, 1.0, 3.0], np.zeros(6), "not uniform"),
        ([0.0, 0.1], np.zeros(5), "wrong shape"),
        ([0.0, 0.1], np.full(6, np.inf), "not finite"),
        ([0.0, 0.1], None, "Give pulses"),
    ],
)
def test_a_simulation_refuses_in_words(
    fossen: auvid.Model, time: list[float], tau: Any, message: str
) -> None:
    with pytest.raises(auvid.PipelineError, match=message):
        fossen.simulate(time, tau)


@pytest.mark.parametrize(
    ("commands", "message"),
    [
        ({"tau": np.zeros(6), "pulses": np.full((3, 4), 1500.0)}, "force of the actuators or"),
        ({"tau": np.zeros(6), "fins": np.zeros((3, 4))}, "force of the actuators or"),
        ({"tau": np.zeros(6), "voltage": 15.0}, "force of the actuators or"),
        ({"tau": np.zeros(6), "propeller_rev_s": 15.0}, "force of the actuators or"),
        ({"tau": np.zeros((2, 6))}, r"'tau'.*wrong shape.*\(3, 6\)"),
        ({"tau": np.zeros(6), "nu": np.zeros((3, 6))}, "'nu'.*wrong shape"),
        ({"pulses": np.full((3, 4), np.nan)}, "'pulses'.*not finite"),
        ({"pulses": np.full((3, 3), 1500.0)}, r"'pulses'.*\(3, 4\)"),
        ({"pulses": 1500.0}, "'pulses'.*one row for each time"),
        ({"pulses": np.full((3, 4), 1500.0), "voltage": [15.0]}, "'voltage'.*one row"),
        ({"pulses": np.full((3, 4), 1500.0), "fins": np.zeros((3, 4))}, "no actuator for.*fins"),
        ({"propeller_rev_s": 15.0}, "no actuator for.*propeller_rev_s"),
    ],
)
def test_a_simulation_uses_each_command_or_refuses_it(
    fossen: auvid.Model, commands: dict[str, Any], message: str
) -> None:
    with pytest.raises(auvid.PipelineError, match=message):
        fossen.simulate([0.0, 0.1, 0.2], **commands)


def test_one_voltage_stands_for_each_time(fossen: auvid.Model) -> None:
    pulses = np.full((3, 4), 1600.0)
    one, each = (
        fossen.simulate([0.0, 0.1, 0.2], pulses=pulses, voltage=voltage)
        for voltage in (14.0, np.full(3, 14.0))
    )
    assert one.equals(each)


def test_forces_refuse_poses_that_are_not_one_for_each_velocity(fossen: auvid.Model) -> None:
    for nu, eta in ((np.zeros(6), np.zeros((3, 6))), (np.zeros((4, 6)), np.zeros((3, 6)))):
        with pytest.raises(auvid.PipelineError, match=r"'eta'.*wrong shape"):
            fossen.force(nu, eta)
    with pytest.raises(auvid.PipelineError, match=r"'propeller_rev_s'.*one row"):
        fossen.force(np.zeros((4, 6)), propeller_rev_s=np.zeros(3))
    assert fossen.force(np.zeros((4, 6)), np.zeros(6), propeller_rev_s=9.0).viscous.shape == (4, 6)


def test_a_score_on_its_own_run_is_that_of_the_run(
    results: auvid.RunResults, fossen: auvid.Model
) -> None:
    table = results["validate/error_table"]
    for use in ("training", "validation"):
        rows = table[(table["use"] == use) & (table["leg"] == "all")].set_index("axis")
        score = auvid.score(fossen, results, use=use)
        np.testing.assert_allclose(score["J/J0"], rows["ratio"][score.index], rtol=1e-9)
    assert np.isfinite(score["free_run"]).any()
    with pytest.raises(auvid.PipelineError, match="no leg of this use"):
        auvid.score(fossen, results, use="both")


def test_a_score_takes_inertia_and_restoring_of_the_model(
    results: auvid.RunResults, fossen: auvid.Model
) -> None:
    """A vehicle ten times as stiff in roll and pitch misses these moments."""
    document = fossen.file.vehicle
    lift = document.rigid_body.centre_of_buoyancy
    stiff = lift.model_copy(update={"value": (lift.array - np.array([0.0, 0.0, 0.2])).tolist()})
    body = document.rigid_body.model_dump(exclude_unset=True)
    body["centre_of_buoyancy"] = stiff.model_dump(exclude_unset=True)
    from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
    from auvid.hydro.model_file import dynamics_of

    raw = document.model_dump(exclude_unset=True) | {"rigid_body": body}
    vehicle = vehicle_from_document(raw)
    dynamics = dynamics_of(vehicle, np.zeros((6, 6)), lag_s=0.0, minimum_speed_m_s=0.05)
    changed = fossen.file.model_copy(update={"vehicle": vehicle.document, "dynamics": dynamics})
    before, after = auvid.score(fossen, results), auvid.score(auvid.Model(changed), results)
    assert after["J"]["X"] == pytest.approx(before["J"]["X"], rel=1e-9)
    assert after["J"]["M"] > 2.0 * before["J"]["M"]


def test_a_score_with_the_constant_of_the_day_is_that_of_the_command(
    results: auvid.RunResults,
    fossen: auvid.Model,
    short_workspace: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """`auvid score` works out M nu_dot + C nu - tau_G - tau_U - tau_nu another way."""
    monkeypatch.chdir(short_workspace)
    other = damped(fossen)
    rows = command_score("example", [str(other.save(tmp_path / "other.json"))]).rows
    for use in ("training", "validation"):
        (row,) = [row for row in rows if (row["set"], row["use"]) == ("other", use)]
        score = auvid.score(other, results, use=use, refit_constant=True)
        expected = [row["ratio" if axis == "all" else f"ratio_{axis}"] for axis in score.index]
        np.testing.assert_allclose(score["J/J0"], expected, rtol=1e-9)


def test_an_export_is_what_the_exporter_writes(fossen: auvid.Model, tmp_path: Path) -> None:
    files = fossen.export("python", tmp_path / "a", name="rov")
    expected = write(fossen.file, "python", tmp_path / "b", name="rov")
    assert [path.name for path in files] == [path.name for path in expected]
    assert [path.read_bytes() for path in files] == [path.read_bytes() for path in expected]
    with pytest.raises(auvid.PipelineError, match="the file exists"):
        fossen.export("python", tmp_path / "a", name="rov")


def test_figures_are_drawn(
    fossen: auvid.Model, results: auvid.RunResults, flight: tuple[Array, Array, Any]
) -> None:
    pytest.importorskip("matplotlib")
    figure = auvid.plots.motion(flight[2], results["fuse/check/fused"], labels=("a", "b"))
    assert [len(axes.lines) for axes in figure.axes] == [2] * 6
    assert len(auvid.plots.coefficients(fossen).axes) == 6
    assert len(auvid.plots.score(auvid.score(fossen, results)).axes[0].patches) == 14


def test_without_matplotlib_a_plot_says_what_to_install(
    flight: tuple[Array, Array, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(auvid.PipelineError, match="pip install matplotlib"):
        auvid.plots.motion(flight[2])


def test_a_vehicle_that_tips_over_is_named(fossen: auvid.Model) -> None:
    t_s = np.arange(0.0, 4.0, 0.02)
    calm = fossen.simulate(t_s, [1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    rolled = fossen.simulate(t_s, [0.0, 0.0, 0.0, 40.0, 0.0, 0.0])
    assert not [words for words in calm.attrs["warnings"] if "tips over" in words]
    assert [words for words in rolled.attrs["warnings"] if "phi reaches" in words]


def test_a_published_set_opens_by_name_and_falls_into_a_simulation() -> None:
    """At the end of a long push along x, drag X_u u + X_u|u| u|u| is the push."""
    model = auvid.open_model("bluerov2_wu_2018")
    assert "no intervals, no range of validity, no actuators" in model.use
    assert set(model.coefficients.verdict) == {"published"}
    assert model.coefficients.value["X_u|u|"] == -18.18
    lift = model.file.dynamics.buoyancy_N - model.file.dynamics.weight_N
    motion = model.simulate(np.arange(0.0, 30.0, 0.02), [10.0, 0.0, lift, 0.0, 0.0, 0.0])
    speed = motion.u_m_s.iloc[-1]
    assert 4.03 * speed + 18.18 * speed**2 == pytest.approx(10.0, rel=1e-3)
    assert motion.attrs["warnings"] == ["nothing says up to which velocities this model holds"]


T = np.arange(0.0, 2.0, 0.1)
BAD: dict[str, tuple[Callable[[auvid.Model], object], str]] = {
    "no force": (lambda m: m.simulate(T), r"what moves the vehicle is missing\. Give tau"),
    "words": (lambda m: m.simulate("abc", np.zeros(6)), "'time': not an array of numbers"),
    "words for a force": (lambda m: m.simulate(T, "abc"), "'tau': not an array of numbers"),
    "a mapping": (lambda m: m.force({"u": 1.0}), "'nu': not an array of numbers"),
    "rows of two lengths": (lambda m: m.force([[1.0], [1.0, 2.0]]), "'nu': not an array"),
    "shape": (lambda m: m.simulate(T, np.zeros((20, 5))), r"found \(20, 5\); allowed: \(6,\)"),
    "nan": (lambda m: m.force([0, 0, np.nan, 0, 0, 0]), "not finite; found 'nan, 1 of 6'"),
}


@pytest.mark.parametrize("case", BAD)
def test_what_is_no_motion_is_refused_by_name(case: str) -> None:
    call, words = BAD[case]
    with pytest.raises(PipelineError, match=words):
        call(auvid.open_model("bluerov2_wu_2018"))


def test_commands_that_are_missing_are_named_with_their_shapes() -> None:
    model = auvid.open_model("vt690_fossen")
    with pytest.raises(PipelineError, match=r"Give fins \(n, 4\), propeller_rev_s \(n,\), or tau"):
        model.simulate(T)
    with pytest.raises(PipelineError, match=r"Give propeller_rev_s \(n,\), or tau"):
        model.simulate(T, fins=np.zeros((20, 4)))


def test_a_model_that_was_fitted_with_the_propulsion_ratio_is_simulated() -> None:
    """Its range of validity has a row of eta - 1, which is no state."""
    file = auvid.open_model("vt690_fossen").file
    flown = VelocityRange(rms=0.5, low=-0.5, high=0.1, threshold=0.03)
    model = auvid.Model(file.model_copy(update={"validity": {"u": flown, "eta-1": flown}}))
    motion = model.simulate(T, fins=np.zeros((20, 4)), propeller_rev_s=20.0, nu=(1, 0, 0, 0, 0, 0))
    (words,) = motion.attrs["warnings"]
    assert words.startswith("u reaches")


WRONG_FITS: dict[str, tuple[dict[str, object], str]] = {
    "model": ({"model": "symetric"}, "'model': unknown model.*Did you mean 'symmetric'"),
    "axis": ({"model": {"Q": ["u"]}}, "'model': unknown axis; found 'Q'"),
    "term": ({"model": {"X": ["uu|"]}}, r"field 'model\.X': unknown basis term"),
    "list": ({"model": ["symmetric"]}, "'model': not a model"),
    "words": ({"nu": "abc"}, "'nu': not an array of numbers"),
    "turned": ({"nu": np.zeros((6, 1200))}, r"allowed: \(1200, 6\), a row.*Turn it: nu\.T"),
    "time": ({"time": np.zeros((1200, 1))}, r"'time': wrong shape; found \(1200, 1\)"),
    "late": ({"validate_from": 59.9}, r'no part of the data from validate_from on.*settings\["re'),
    "still": ({"tau": np.zeros((1200, 6))}, "no actuator acts in the data to fit.*Give data in"),
}


@pytest.mark.parametrize("case", WRONG_FITS)
def test_fit_speaks_of_arrays_not_of_legs(case: str) -> None:
    change, words = WRONG_FITS[case]
    random = np.random.default_rng(0)
    arguments: dict[str, object] = {
        "time": np.arange(0.0, 60.0, 0.05),
        "nu": 0.001 * np.cumsum(random.normal(size=(1200, 6)), axis=0),
        "angles": np.zeros((1200, 3)),
        "vehicle": "bluerov2_heavy",
        "tau": random.normal(size=(1200, 6)),
    }
    with pytest.raises(PipelineError, match=words) as caught:
        auvid.fit(**(arguments | change))  # type: ignore[arg-type]
    assert not re.search(r"\b(leg|segment)s?\b|stages\.|manifest", str(caught.value))


def test_a_campaign_that_has_not_run_opens_with_words(
    short_workspace: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(short_workspace)
    folder = short_workspace / "campaigns/later"
    shutil.copytree(short_workspace / "campaigns/example", folder, symlinks=True)
    with pytest.raises(PipelineError, match="the campaign has not been run; found 'later'"):
        auvid.open_run(folder)
    shutil.rmtree(folder)


@pytest.mark.parametrize("end", [0.3, 0.7, 0.99])
def test_a_model_file_cut_off_is_named_as_that(end: float, tmp_path: Path) -> None:
    path = auvid.open_model("lauv").save(tmp_path / "lauv.json")
    content = path.read_bytes()
    path.write_bytes(content[: int(end * len(content))])
    with pytest.raises(PipelineError, match="ends in the middle: it was cut off"):
        auvid.Model.load(path)
    path.write_bytes(b'{"kind" "auvid model"}')
    with pytest.raises(PipelineError, match="not JSON, so no model file"):
        auvid.Model.load(path)
    path.write_bytes(b"\x80\x81\xff")
    with pytest.raises(PipelineError, match="not a text file"):
        auvid.Model.load(path)
