"""Open-loop manoeuvres of section 4.1: what the text says, and the parameter set under
which it holds.
"""

import copy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from auvid.data_schemas.documents.control_cases import ControlCasesDocument
from auvid.data_schemas.documents.model import parse
from auvid.data_schemas.errors import PipelineError
from auvid.data_schemas.yaml_text import read_yaml
from auvid.hydro.control.open_loop import findings, fly_open_loop, open_loop_cases
from auvid.hydro.dynamics.hybrid_vehicle import hybrid_vehicle
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document

ROOT = Path(__file__).parents[4]
HAUV = vehicle_from_document(read_yaml((ROOT / "vehicles/hauv.yaml").read_text()))
CASES = read_yaml((ROOT / "campaigns/hauv/cases.yaml").read_text())
SIMULATED, CORRECTED = hybrid_vehicle(HAUV, "as_simulated"), hybrid_vehicle(HAUV, "corrected")


def cases_of(document):
    return open_loop_cases(parse(ControlCasesDocument, document).open_loop, SIMULATED)


LONG_ENOUGH_S = {"spiral_ascent": 650.0, "spiral_descent": 650.0, "sawtooth": 800.0}
"""Of 1000 s each: two turns, three periods. A release flies them in full."""
IN_FULL = {case.name: case for case in cases_of(CASES)}
BY_NAME = {
    name: replace(case, duration_s=LONG_ENOUGH_S.get(name, case.duration_s))
    for name, case in IN_FULL.items()
}

HOLD_AS_SIMULATED = {
    "straight": {
        "steady_u": True,
        "steady_theta": True,
        "depth": False,
    },  # 0.31 m, not a few centimetres
    "circle_banking": {"steady_u": True, "steady_phi": True, "steady_theta": True},
    "circle_no_banking": {"steady_phi": True, "steady_theta": True},
    "glide_float_up": {"steady_u": True, "steady_w": True, "steady_theta": True},
    "glide_dive": {"steady_u": True, "steady_w": True, "steady_theta": True},
    "spiral_ascent": {"steady_u": True, "steady_w": True, "steady_theta": True},
    "spiral_descent": {"steady_u": True, "steady_w": True, "steady_theta": True},
    "sawtooth": {"peak_u": True, "peak_w": True, "peak_theta": True},
    "float_up": {},
    "dive_down": {},
}


@pytest.fixture(scope="module")
def flown(shared):
    return shared(
        "open_loop_flown",
        lambda: {name: fly_open_loop(SIMULATED, case) for name, case in BY_NAME.items()},
    )


def test_every_case_of_the_section_is_there():
    assert set(BY_NAME) == set(HOLD_AS_SIMULATED)


@pytest.mark.parametrize("name", HOLD_AS_SIMULATED)
def test_statements_of_the_text_under_the_parameters_of_the_simulations(flown, name):
    holds = {item.statement.quantity: item.holds for item in findings(flown[name])}
    assert holds == HOLD_AS_SIMULATED[name], [
        (item.statement.quantity, item.ours) for item in findings(flown[name])
    ]


@pytest.mark.release
@pytest.mark.parametrize("name", LONG_ENOUGH_S)
def test_the_statements_hold_over_the_full_length_of_the_case(flown, name):
    run = fly_open_loop(SIMULATED, IN_FULL[name])
    assert run.stop is None
    assert run.t_s[-1] == IN_FULL[name].duration_s == 1000.0
    assert {item.statement.quantity: item.holds for item in findings(run)} == HOLD_AS_SIMULATED[
        name
    ]
    np.testing.assert_allclose(run.chi[600], flown[name].chi[600], atol=1e-4)


def test_the_manoeuvres_go_where_their_names_say(flown):
    end = {name: run.chi[-1] for name, run in flown.items()}
    assert end["float_up"][8] < -50.0 < 50.0 < end["dive_down"][8]
    assert end["glide_float_up"][8] < -10.0 < 10.0 < end["glide_dive"][8]
    assert end["spiral_ascent"][8] < -50.0
    assert abs(end["spiral_ascent"][11]) > 4.0 * np.pi
    assert abs(end["straight"][7]) < 1e-6
    assert (
        end["circle_banking"][8] > 2.0 > abs(end["circle_no_banking"][8])
    )  # banking makes a helix downwards
    depth = flown["sawtooth"].chi[:, 8]
    assert np.count_nonzero(np.diff(np.sign(np.diff(depth)))) >= 6


def test_corrected_coefficients_do_not_give_the_speeds_of_the_text():
    run = fly_open_loop(CORRECTED, BY_NAME["glide_dive"])
    assert {item.statement.quantity: item.holds for item in findings(run)} == {
        "steady_u": False,
        "steady_w": False,
        "steady_theta": False,
    }
    assert run.quantity("steady_u") == pytest.approx(1.048, abs=1e-3)


def test_a_run_that_pitches_over_ends_and_says_so():
    run = fly_open_loop(CORRECTED, BY_NAME["float_up"])
    assert run.stop is not None
    assert "pitch beyond 1.5 rad" in run.stop
    assert np.isnan(run.quantity("steady_u"))
    assert np.abs(run.chi[:, 10]).max() <= 1.5


def test_the_path_does_not_depend_on_how_often_it_is_sampled(flown):
    fine = fly_open_loop(SIMULATED, BY_NAME["circle_banking"], step_s=0.25)
    np.testing.assert_allclose(fine.chi[::4], flown["circle_banking"].chi, atol=1e-4)


def edited(case, key, value):
    document = copy.deepcopy(CASES)
    document["open_loop"][case][key] = value
    return document


@pytest.mark.parametrize(
    ("case", "key", "value", "message"),
    [
        (
            "glide_dive",
            "mass",
            {"value": 75.0, "unit": "kg", "source": "t"},
            r"open_loop.glide_dive.mass.*71.5 .empty. to 73.5 kg",
        ),
        (
            "sawtooth",
            "mass_swing",
            {"value": 2.0, "unit": "kg", "source": "t"},
            r"open_loop.sawtooth.mass_swing.*buoyancy engine",
        ),
        (
            "straight",
            "thrust",
            {"value": 300.0, "unit": "N", "source": "t"},
            r"open_loop.straight.thrust.*0 to 272 N",
        ),
        ("straight", "thrust", {"value": 300.0, "unit": "kg", "source": "t"}, "wrong unit"),
        ("straight", "duration", {"value": 0.0, "unit": "s", "source": "t"}, "must be positive"),
        (
            "straight",
            "statements",
            {"steady_bank": CASES["open_loop"]["straight"]["statements"]["depth"]},
            r"statements.steady_bank.*unknown quantity",
        ),
        (
            "straight",
            "statements",
            {"steady_u": CASES["open_loop"]["straight"]["statements"]["depth"]},
            r"statements.steady_u.value.unit.*wrong unit.*a unit of m/s",
        ),
    ],
)
def test_cases_that_cannot_be_flown_are_refused(case, key, value, message):
    with pytest.raises(PipelineError, match=message):
        cases_of(edited(case, key, value))
