"""The stage `control`: what it gives for the H-AUV and for an identified vehicle, and
what it refuses.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from auvid.data_schemas.documents import check_document
from auvid.data_schemas.documents.control_cases import ControlCasesDocument
from auvid.data_schemas.documents.model import parse
from auvid.data_schemas.errors import CampaignError, PipelineError
from auvid.data_schemas.records.models import ModelCard
from auvid.data_schemas.tables import column
from auvid.data_schemas.yaml_text import read_yaml
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.stages import control
from auvid.stages.control.cases import trajectories_of

ROOT = Path(__file__).parents[3]


def read(name: str) -> Any:
    return read_yaml((ROOT / name).read_text(encoding="utf-8"))


HAUV, VT690 = read("vehicles/hauv.yaml"), read("vehicles/vt690.yaml")
CARD = ModelCard.model_validate_json((ROOT / "campaigns/vt690_control/linear.json").read_text())


def quantity(value: float, unit: str) -> dict[str, Any]:
    return {"value": value, "unit": unit, "source": "chosen"}


def short_hauv() -> dict[str, Any]:
    """A quarter of the helix of campaign hauv with three flights, and a Monte Carlo of
    a few members.
    """
    cases: dict[str, Any] = copy.deepcopy(read("campaigns/hauv/cases.yaml"))
    helix = cases["trajectories"]["helix"]
    flights = helix["flights"]
    for name in ("undisturbed", "side_force", "side_force_observer"):
        if "force" in flights[name]:
            flights[name]["force"]["start"]["value"] = 3
    helix["flights"] = {
        name: flights[name] for name in ("undisturbed", "side_force", "side_force_observer")
    }
    helix["duration"]["value"], helix["step"]["value"], helix["transient"]["value"] = 12, 0.1, 5
    return {
        **cases,
        "trajectories": {"helix": helix},
        "redesign": ["corrected"],
        "open_loop": {
            name: {
                **cases["open_loop"][name],
                "duration": quantity(40, "s"),
            }
            for name in ("straight", "circle_banking")
        },
        "linear": ["straight", "circle_banking"],
        "monte_carlo": {
            **cases["monte_carlo"],
            "duration": quantity(5, "s"),
        },
    }


def short_vt690() -> dict[str, Any]:
    cases: dict[str, Any] = copy.deepcopy(read("campaigns/vt690_control/cases.yaml"))
    straight = cases["trajectories"]["straight"]
    straight["duration"] = quantity(8, "s")
    straight["step"]["value"] = 0.1
    straight["transient"] = quantity(2, "s")
    monte_carlo = {
        "trajectory": "straight",
        "flight": "undisturbed",
        "duration": quantity(5, "s"),
    }
    return {**cases, "trajectories": {"straight": straight}, "monte_carlo": monte_carlo}


def parsed(cases: Any) -> ControlCasesDocument:
    return parse(ControlCasesDocument, cases, file="the cases")


def run(vehicle: Any, cases: Any, card: Any = None, **params: Any) -> control.Outputs:
    return control.run(
        control.Inputs(
            vehicle_from_document(vehicle), None if cases is None else parsed(cases), card
        ),
        control.Params(**{"members": 20, **params}),
    )


def figure(outputs: control.Outputs, name: str) -> dict[str, Any]:
    return next(row for row in outputs.results["rows"] if row["quantity"] == name)


@pytest.fixture(scope="module")
def hauv(
    shared: Callable[[str, Callable[[], control.Outputs]], control.Outputs],
) -> control.Outputs:
    return shared("control_of_short_hauv", lambda: run(HAUV, short_hauv()))


def test_cases_of_the_campaigns_agree_with_their_schema() -> None:
    for name in ("hauv", "hauv_redesign", "vt690_control"):
        cases = read(f"campaigns/{name}/cases.yaml")
        assert trajectories_of(parsed(cases))


def test_outputs_agree_with_their_schemas_and_name_every_flight(hauv: control.Outputs) -> None:
    assert set(hauv.flights) == {
        "helix-undisturbed",
        "helix-side_force",
        "helix-side_force_observer",
    }
    check_document(hauv.results, "results", file="results")
    check_document(hauv.section, "section", file="section")
    check_document(hauv.views, "views", file="views")
    names = [row["quantity"] for row in hauv.results["rows"]]
    assert len(names) == len(set(names))
    assert hauv.tracking.num_rows == 6 - 1  # the observer's flight is not flown by the redesign
    assert set(hauv.gains["helix"].column("input").to_pylist()) == {
        "X_thrust",
        "delta_r",
        "delta_s_right",
        "delta_s_left",
    }


def test_flight_table_holds_what_the_figures_say(hauv: control.Outputs) -> None:
    table = hauv.flights["helix-side_force"]
    late = column(table, "t_s") >= 5.0
    rms = float(np.sqrt(np.mean(column(table, "cross_track_m")[late] ** 2)))
    assert figure(hauv, "rms cross-track, helix, side_force")["value"] == pytest.approx(
        rms, rel=0.02
    )  # the table has every tenth of a second
    assert column(table, "thrust_N").max() <= 272.0
    assert np.abs(column(table, "rudder_rad")).max() <= np.radians(20.0) + 1e-12
    disturbance = column(hauv.flights["helix-side_force_observer"], "disturbance_Y_N")
    assert np.abs(disturbance[-1]) > 20.0


def test_undisturbed_figures_meet_what_is_asked(hauv: control.Outputs) -> None:
    assert figure(hauv, "steady error, helix, undisturbed")["value"] < 0.1
    assert figure(hauv, "share of fins at limit, helix, undisturbed")["value"] < 0.05
    assert figure(hauv, "slowest closed-loop pole, frozen gains, helix")["value"] < 0.0
    assert figure(hauv, "Monte Carlo, members lost")["value"] == 0.0
    assert (
        figure(hauv, "linear against nonlinear, straight, trimmed, share of the way")["value"]
        < 1e-3
    )


def test_linear_model_follows_the_circle_with_its_bank(hauv: control.Outputs) -> None:
    name = "linear against nonlinear, circle_banking, {}, share of the way"
    assert figure(hauv, name.format("trimmed"))["value"] < 1e-3
    assert (
        0.01 < figure(hauv, name.format("algorithm_1"))["value"] < 0.05
    )  # no sideslip, but what it costs is small


def test_share_of_the_error_that_the_observer_leaves(hauv: control.Outputs) -> None:
    with_, without = (
        figure(hauv, f"rms cross-track, helix, {name}")["value"]
        for name in ("side_force_observer", "side_force")
    )
    share = figure(hauv, "rms cross-track over that without observer, helix, side_force_observer")[
        "value"
    ]
    assert share == pytest.approx(with_ / without)


def test_the_same_seed_draws_the_same_vehicles() -> None:
    once, again, other = (run(VT690, short_vt690(), CARD, seed=seed) for seed in (1, 1, 2))
    name = "Monte Carlo, rms cross-track"
    assert figure(once, name) == figure(again, name)
    assert figure(once, name)["value"] != figure(other, name)["value"]


def test_any_vehicle_flies_its_model_card() -> None:
    outputs = run(VT690, short_vt690(), CARD)
    assert figure(outputs, "steady error, straight, undisturbed")["value"] < 0.1
    assert "propeller_rev_s" in outputs.flights["straight-undisturbed"].column_names
    assert figure(outputs, "Monte Carlo, rms cross-track")["high"] < 1.0
    folded = {block["fold"] for block in outputs.section["blocks"] if "fold" in block}
    (straight,) = short_vt690()["trajectories"].values()
    assert folded == {f"{straight['title']}: attitude"}


def test_an_unstable_model_is_refused_unless_told() -> None:
    card = CARD.model_copy(deep=True)
    card.predictor["N"]["r"] = 60.0
    with pytest.raises(PipelineError, match=r"unstable along the trajectory.*mode of"):
        run(VT690, short_vt690(), card)
    outputs = run(VT690, short_vt690(), card, allow_unstable=True, members=0)
    assert any("grows by" in block.get("text", "") for block in outputs.section["blocks"])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda c: c["trajectories"]["helix"].update(weights="gentle"), "no such weights"),
        (lambda c: c["trajectories"]["helix"]["speed"].update(unit="N"), "wrong unit"),
        (
            lambda c: c["trajectories"]["helix"]["flights"]["undisturbed"].update(
                force={"constant": {"value": [1, 2], "unit": "N", "source": "t"}}
            ),
            r"undisturbed\.force\.constant\.value.*wrong shape.*a list of 3 numbers",
        ),
        (lambda c: c["trajectories"]["helix"]["path"].pop("turns"), r"path\.turns.*missing key"),
        (lambda c: c["trajectories"]["helix"].update(kind="helic"), r"unknown value.*'helix'"),
        (
            lambda c: c["trajectories"]["helix"]["path"]["radius"].update(value=-3),
            "must be positive",
        ),
        (
            lambda c: c["trajectories"]["helix"]["path"]["radius"].update(value=1.5),
            "tightest level turn",
        ),
        (lambda c: c["trajectories"]["helix"]["speed"].update(value=3.0), "cannot hold 3"),
        (
            lambda c: c["trajectories"]["helix"]["path"]["pitch"].update(value=-60),
            "more pitch than allowed",
        ),
        (
            lambda c: c["weights"]["thrust_mode"]["R"].update(value=[1, 1, 1]),
            r"the cases.*weights\.thrust_mode\.R.*weights do not fit",
        ),
        (
            lambda c: c["limits"]["fins"].update(value=-20),
            r"the cases.*limits\.fins.*must be positive",
        ),
        (
            lambda c: c["trajectories"]["helix"]["step"].update(value=0),
            r"helix\.step.*must be positive",
        ),
        (lambda c: c["trajectories"]["helix"]["step"].update(value=1e-7), "too many steps"),
        (
            lambda c: c["trajectories"]["helix"]["waiting"]["lead"].update(value=0),
            r"waiting\.lead.*must be positive",
        ),
        (lambda c: c["trajectories"]["helix"].update(flights={}), "there is no flight"),
        (
            lambda c: c["trajectories"]["helix"]["path"]["turns"].update(value=-1),
            r"trajectories\.helix\.path\.turns.*must be positive",
        ),
        (
            lambda c: c["monte_carlo"]["duration"].update(value="long"),
            r"monte_carlo\.duration\.value.*not numbers",
        ),
        (lambda c: c["monte_carlo"]["duration"].update(value=1e9), "longer than what is flown"),
        (lambda c: c["monte_carlo"].update(flight="calm"), "no such flight"),
        (lambda c: c.update(linear=["loop"]), "no such open-loop case"),
        (
            lambda c: c["open_loop"]["straight"].update(duration=quantity(4, "s")),
            "too short to linearise about",
        ),
        (
            lambda c: c["trajectories"]["helix"]["transient"].update(value=50),
            "longer than the flight",
        ),
        (lambda c: c.update(trajectories={}), "no trajectory to fly"),
        (
            lambda c: c["open_loop"]["straight"].update(mass=quantity(80, "kg")),
            "outside the range of the buoyancy engine",
        ),
    ],
)
def test_bad_cases_are_named(change: Any, words: str) -> None:
    cases = short_hauv()
    cases["trajectories"]["helix"]["flights"] = {
        "undisturbed": cases["trajectories"]["helix"]["flights"]["undisturbed"]
    }
    cases["redesign"] = []
    cases["open_loop"] = {"straight": cases["open_loop"]["straight"]}
    cases["linear"] = ["straight"]
    change(cases)
    with pytest.raises(PipelineError, match=words):
        run(HAUV, cases, members=2)


@pytest.mark.parametrize(
    ("place", "key"),
    [
        (("path",), "radiuss"),
        (("waiting",), "leed"),
        (("flights", "side_force", "force"), "constnt"),
        (("flights", "undisturbed"), "obsever"),
    ],
)
def test_a_misspelt_key_is_not_passed_over(place: tuple[str, ...], key: str) -> None:
    cases = short_hauv()
    part = cases["trajectories"]["helix"]
    for name in place:
        part = part[name]
    part[key] = {"value": 1, "unit": "m"}
    with pytest.raises(PipelineError, match=rf"{key}'.*unknown key"):
        check_document(cases, "control_cases", file="cases.yaml")


def test_what_is_missing_is_asked_for() -> None:
    with pytest.raises(CampaignError, match="needs its cases"):
        run(HAUV, None)
    with pytest.raises(CampaignError, match="needs a model of the vehicle"):
        run(VT690, short_vt690())
