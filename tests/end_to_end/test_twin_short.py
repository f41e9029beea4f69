"""The closed loop of trust: a twin flies a short plan, writes real logs, and the chain
gives back the truth.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml
from typer.testing import CliRunner

from auvid.data_schemas.documents.model import parse
from auvid.data_schemas.documents.twin import TwinDocument
from auvid.data_schemas.tables import column, matrix
from auvid.data_schemas.yaml_text import read_yaml
from auvid.hydro.arrays import Array
from auvid.hydro.dynamics.actuators.propeller import level_speed
from auvid.hydro.dynamics.equations_of_motion import Control
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.hydro.dynamics.viscous.basis import basis_rows, eta_ratio
from auvid.hydro.dynamics.viscous.models import model_named
from auvid.hydro.identification.regression.least_squares import TriangularFactor, solve_axis
from auvid.pipeline import cli
from auvid.pipeline.commands.look.inspect import rerun_viewer
from auvid.pipeline.commands.open_run import open_run
from auvid.stages import simulate
from auvid.stages.columns import ACCELERATION, POSE, VELOCITY, force_columns
from auvid.stages.simulate.flights import refit
from auvid.stages.simulate.plans import plan_from_document
from tests.support.campaign_runs import (
    NO_FREE_RUN,
    TWIN,
    TWIN_PLANS,
    copy_workspace,
    made_once,
    run_campaign,
    write_twin,
)
from tests.support.dynamics_oracles import inverse_dynamics
from tests.support.pictures import assert_pictured

ROOT = Path(__file__).parents[2]
VT690 = vehicle_from_document(read_yaml((ROOT / "vehicles/vt690.yaml").read_text(encoding="utf-8")))
TAU_BAR = force_columns("tau_bar")
FINS = ("fin_s_rad", "fin_p_rad", "fin_b_rad", "fin_t_rad")
INTEGRATED = {"resample": {"smoothing": "none"}, "fuse": {"method": "thesis", "cutoff_hz": None}}


def plan(name: str, **change: object) -> dict[str, Any]:
    """Return a plan of the VT 690 twin with some keys changed."""
    document = read_yaml((TWIN_PLANS / f"{name}.yaml").read_text(encoding="utf-8"))
    return {**document, **change}


@pytest.fixture(scope="session")
def noisy(session_folder: Path) -> Path:
    """Workspace of a flight with the default sensors, run up to validation: read-only."""

    def make(folder: Path) -> None:
        write_twin(folder, plan("short", settle_s=10), NO_FREE_RUN)
        run_campaign(folder, TWIN, "validate")

    return made_once(session_folder / "noisy_twin", make)


def force_error(runs: Path) -> tuple[float, float]:
    """RMS of (residual - true force) and of the true force over all legs and axes [N
    and N m].
    """
    errors, forces = [], []
    for path in sorted((runs / "residual").glob("*/residual.parquet")):
        estimate, truth = (
            pq.read_table(path),
            pq.read_table(runs / "simulate" / "truth" / f"{path.parent.name}.parquet"),
        )
        start = json.loads(
            (runs / "resample" / path.parent.name / "segment.json").read_text(encoding="utf-8")
        )["leg_start_s"]
        t_s, at = column(estimate, "t_s") + start, column(truth, "t_s")
        true = np.column_stack([np.interp(t_s, at, column(truth, name)) for name in TAU_BAR])
        errors.append(matrix(estimate, TAU_BAR) - true)
        forces.append(true)
    return float(np.sqrt(np.mean(np.concatenate(errors) ** 2))), float(
        np.sqrt(np.mean(np.concatenate(forces) ** 2))
    )


def ratios(runs: Path) -> dict[str, float]:
    rows = pq.read_table(runs / "validate" / "error_table.parquet").to_pylist()
    return {
        row["model"]: row["ratio"]
        for row in rows
        if row["axis"] == row["leg"] == "all" and row["use"] == "validation"
    }


def test_exact_sensors_give_back_the_true_force(tmp_path: Path) -> None:
    """Through DataFlash logs in single precision: 0.05 N of some 9 N, the bound for
    sensors without noise.
    """
    write_twin(tmp_path, plan("short", sensors={}, settle_s=10), INTEGRATED)
    run_campaign(tmp_path, TWIN, "residual")
    error, size = force_error(tmp_path / "runs" / TWIN)
    assert size > 5.0
    assert error < 0.05


def test_as_published_finds_another_force(noisy: Path, tmp_path: Path) -> None:
    """The negative control: a physical accelerometer taken for v_dot puts more than 10
    N into the residual, and a warning is given.
    """
    stages = INTEGRATED | {"fuse": {"method": "thesis", "as_published": True, "cutoff_hz": None}}
    copy_workspace(noisy, tmp_path)
    write_twin(tmp_path, plan("short", settle_s=10), stages)
    run_campaign(tmp_path, TWIN, "residual")
    runs = tmp_path / "runs" / TWIN
    assert force_error(runs)[0] > 10.0
    fusion = json.loads((runs / "fuse" / "yaw_2133" / "fusion.json").read_text(encoding="utf-8"))
    assert any("accelerometer does not measure" in words for words in fusion["warnings"])


def test_noisy_sensors_give_models_that_predict(noisy: Path) -> None:
    """Default sensors and method: the force to 0.9, and small models explain the other
    leg to a quarter of its force.
    """
    runs = noisy / "runs" / TWIN
    assert force_error(runs)[0] < 0.9
    by_model = ratios(runs)
    assert by_model["prestero"] < 0.15
    assert by_model["linear"] < 0.25


def test_run_of_a_twin_says_how_far_it_is_from_the_truth(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`auvid run` of a twin prints estimate against truth, ends with 1 where a bound is
    missed, and the report shows both.
    """
    document = plan("short", settle_s=5)
    document["legs"] = document["legs"][:1]
    stages: dict[str, dict[str, object]] = {
        "fuse": {"method": "smoother"},
        **NO_FREE_RUN,
    }
    monkeypatch.chdir(tmp_path)
    runs = tmp_path / "runs" / TWIN
    for bound, status, words in ((0.9, 0, "bounds: 1 of 1 met"), (1e-6, 1, "missed")):
        write_twin(tmp_path, document, stages | {"check_truth": {"force_error": bound}})
        done = CliRunner().invoke(cli.app, ["run", TWIN])
        assert done.exit_code == status, done.output
        assert "estimate against truth (RMS error over all legs)" in done.output
        assert words in done.output
        page = (runs / "report" / "report_html.html").read_text(encoding="utf-8")
        assert "Estimate against truth" in page
        assert ("Against the truth of the twin" in page) == bool(status)
        if not status:
            rerun_viewer.verify(runs / "report" / "recording.rrd")


@pytest.mark.release
def test_recording_of_a_twin_opens_with_a_picture(noisy: Path, tmp_path: Path) -> None:
    copy_workspace(noisy, tmp_path)
    run_campaign(tmp_path, TWIN, "report")
    assert_pictured(tmp_path / "runs" / TWIN / "report" / "recording.rrd", "twin")


def in_span(name: str) -> tuple[dict[str, dict[str, float]], list[pa.Table]]:
    """A refitted truth, and what it flies on the training legs of the default plan."""
    document = plan("default", sensors={})
    document["legs"] = [leg for leg in document["legs"] if leg["use"] == "training"]
    truth = {"kind": "refit", "name": name, "source": "physics"}
    twin = {
        "plan": document,
        "truth": truth,
        "seed": 0,
        "format": "csv",
        "accelerometer": "specific_force",
    }
    outputs = simulate.run(simulate.Inputs(VT690, parse(TwinDocument, twin)), simulate.Params())
    model, _ = refit(name, plan_from_document(document, VT690), VT690)
    assert outputs.simulation["coefficients"] == model.coefficients
    return {axis: dict(terms) for axis, terms in model.coefficients.items()}, list(
        outputs.truth.values()
    )


@pytest.mark.parametrize(
    "name", ["gertler_hagen", pytest.param("linear", marks=pytest.mark.release)]
)
def test_true_states_give_back_the_coefficients_of_a_truth_in_the_span(name: str) -> None:
    """Inverse dynamics of the true motion, then least squares: every coefficient to
    1e-6 of itself, residual force to 1e-9 N.
    """
    truth, flown = in_span(name)
    model = model_named(name)
    factor = TriangularFactor.empty(model.distinct_terms)
    for table in flown:
        nu, n = matrix(table, VELOCITY), column(table, "propeller_rev_s")
        control = Control(propeller_rev_s=n, fins_rad=matrix(table, FINS))
        bar: Array = inverse_dynamics(
            VT690, matrix(table, POSE), nu, matrix(table, ACCELERATION), control
        )
        assert np.max(np.abs(bar - matrix(table, TAU_BAR))) < 1e-9
        assert VT690.propeller is not None
        factor = factor.update(
            basis_rows(nu.T, eta_ratio(level_speed(VT690.propeller, n), nu), model.distinct_terms),
            bar,
        )
    for axis, terms in model.terms.items():
        fit = solve_axis(factor, axis, terms)
        for term, value in zip(terms, fit.solution, strict=True):
            assert value == pytest.approx(truth[axis][term], rel=1e-6), (axis, term)


def test_command_makes_a_campaign_that_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """auvid simulate, then auvid run on what it wrote, with a vehicle file of its own."""
    (tmp_path / "params.yaml").write_text("campaigns: []\n", encoding="utf-8")
    (tmp_path / "plan.yaml").write_text(yaml.safe_dump(plan("short", settle_s=5)), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    simulated = CliRunner().invoke(
        cli.app,
        [
            "simulate",
            "vt690",
            "plan.yaml",
            "-o",
            "campaigns/mine",
            "--format",
            "tlog",
            "--seed",
            "2",
        ],
    )
    assert simulated.exit_code == 0, simulated.output
    assert sorted(path.name for path in (tmp_path / "campaigns/mine/logs").iterdir()) == [
        "yaw_2133.tlog",
        "yaw_2350.tlog",
    ]
    assert run_campaign(tmp_path, "campaigns/mine", "residual") > 0
    again = CliRunner().invoke(cli.app, ["simulate", "vt690", "plan.yaml", "-o", "campaigns/mine"])
    assert "nothing is overwritten" in str(again.exception)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["vt691", "plan.yaml"], "Did you mean 'vt690'?"),
        (["vt690", "plans.yaml"], "not there"),
        (["vt690", "plan.yaml", "--truth", "linaer"], "Did you mean 'linear'?"),
        (["vt690", "plan.yaml", "--truth", "refit:linaer"], "Did you mean 'linear'?"),
        (["vt690", "plan.yaml", "--seed", "-1"], "not a seed"),
        (["vt690", "plan.yaml", "--format", "ulog"], "unknown value"),
        (["bluerov2_heavy", "plan.yaml"], "propeller and fins"),
    ],
)
def test_command_refuses_in_words(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], words: str
) -> None:
    (tmp_path / "params.yaml").write_text("campaigns: []\n", encoding="utf-8")
    (tmp_path / "plan.yaml").write_text(yaml.safe_dump(plan("short")), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(cli.app, ["simulate", *arguments, "-o", "out"])
    assert words in str(result.exception)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("manifest", "words"),
    [
        ({"kind": "twin", "vehicle": "vt690"}, "A twin needs the plan that it flies"),
        (
            {"kind": "twin", "vehicle": "vt690", "simulate": {"plan": "plan.yaml"}, "legs": []},
            "has these from its plan",
        ),
        (
            {"kind": "twin", "vehicle": "vt690", "simulate": {"plan": "plan.yaml", "seed": -1}},
            "out of range",
        ),
        (
            {"kind": "twin", "vehicle": "vt690", "simulate": {"plan": "../plan.yaml"}},
            "leaves the campaign folder",
        ),
        (
            {
                "kind": "twin",
                "vehicle": "vt690",
                "simulate": {"plan": "plan.yaml", "truth": "physic"},
            },
            "no such truth",
        ),
    ],
)
def test_manifests_of_twins_are_refused_in_words(
    tmp_path: Path, manifest: dict[str, object], words: str
) -> None:
    folder = tmp_path / "campaigns" / "twin"
    folder.mkdir(parents=True)
    (tmp_path / "params.yaml").write_text("campaigns: [twin]\n", encoding="utf-8")
    (folder / "plan.yaml").write_text(yaml.safe_dump(plan("short")), encoding="utf-8")
    (folder / "campaign.yaml").write_text(yaml.safe_dump(manifest), encoding="utf-8")
    with pytest.raises(Exception, match=words):
        open_run(str(folder))
