"""The page of a fleet from tables: what its first screen says of changed vehicles."""

from __future__ import annotations

import re

import numpy as np
import pytest

from auvid.pipeline.commands.fleet.fleet_tables import THRUSTERS
from auvid.pipeline.commands.fleet.report.fleet_page import fleet_page
from auvid.pipeline.commands.fleet.report.time_picture import time_picture
from auvid.pipeline.commands.fleet.report.vehicle_figures import vehicle_figures
from tests.support.fleet_rows import Row, as_columns, empty_row

LINEAR, QUADRATIC = 4.0, 30.0
"""Damping of surge [N/(m/s), N/(m/s)^2]."""
SPEED = 0.3
DIVES = 10


def tables(
    fouled_from: int = DIVES, weak: bool = False, newtons: bool = True
) -> dict[str, list[Row]]:
    """Return a fleet whose linear and quadratic drag trade, fouled by half from a dive on."""
    random = np.random.default_rng(3)
    runs, coefficients = [], []
    for dive in range(DIVES):
        head = {
            "log": f"dive{dive}",
            "vehicle": "rov",
            "start_utc": f"2024-05-{dive + 1:02d}T10:00:00Z",
        }
        runs.append(
            empty_row("runs")
            | head
            | {
                "file": f"/disk/dive{dive}.BIN",
                "state": "done",
                "model": "diagonal",
                "ratio": 0.3,
                "surge": "identified",
                "use_surge": "control",
                "speed_surge": SPEED,
                "duration_s": 600.0,
                "warnings": dive % 3,
                "board": "serial number 2" if dive == fouled_from else "serial number 1",
                "firmware": "4.5" if dive == fouled_from else "4.1",
            }
        )
        drag = (LINEAR * SPEED + QUADRATIC * SPEED**2) * (1.5 if dive >= fouled_from else 1.0)
        drag *= 1.0 + 0.02 * random.standard_normal()
        traded = 0.3 * drag * random.standard_normal()
        head |= {"kind": "identification"}
        for term, value, error in (
            ("u", -(0.4 * drag + traded) / SPEED, 0.3 * drag / SPEED),
            ("u*|u|", -(0.6 * drag - traded) / SPEED**2, 0.3 * drag / SPEED**2),
        ):
            coefficients.append(
                empty_row("coefficients")
                | head
                | {
                    "model": "diagonal",
                    "recommended": True,
                    "axis": "X",
                    "term": term,
                    "unit": "N s/m" if newtons else "1/s",
                    "value": value,
                    "standard_error": error,
                    "verdict": "identified",
                    "correlation": -0.998,
                }
            )
        coefficients.append(
            empty_row("coefficients")
            | head
            | {
                "model": THRUSTERS,
                "term": "thruster 3",
                "value": 0.5 if weak and dive == DIVES - 1 else 1.0,
                "standard_error": 0.05,
                "unit": "1",
                "verdict": "weak" if weak and dive == DIVES - 1 else "identified",
            }
        )
    return {"runs": runs, "coefficients": coefficients, "findings": [], "verdicts": []}


def page_of(rows: dict[str, list[Row]]) -> str:
    columns = as_columns(rows["coefficients"])
    return fleet_page("disk", rows["runs"], rows["findings"], columns).decode()


@pytest.mark.parametrize(("newtons", "verdict"), [(False, "identified"), (True, "from the prior")])
def test_no_drag_of_models_without_newtons_nor_of_priors(newtons: bool, verdict: str) -> None:
    rows = tables(newtons=newtons)
    for row in rows["coefficients"]:
        row["verdict"] = verdict
    (rov,) = vehicle_figures(as_columns(rows["coefficients"]), rows["runs"])
    assert not any(name.startswith("drag") for name in rov.pooled)


def test_drag_at_a_common_speed_is_watched_not_its_terms() -> None:
    rows = tables(fouled_from=6)
    (rov,) = vehicle_figures(as_columns(rows["coefficients"]), rows["runs"])
    (alarm,) = rov.alarms
    assert alarm.figure == "drag in surge at 0.3 m/s"
    assert rov.dives[alarm.first_dive] == "dive6"
    assert 0.4 < alarm.share < 0.6
    assert not next(item for item in rov.figures if item.name == "X_u").watched


def test_a_healthy_fleet_raises_nothing_and_gives_the_next_dive() -> None:
    rows = tables()
    (rov,) = vehicle_figures(as_columns(rows["coefficients"]), rows["runs"])
    assert (rov.alarms, rov.outlying, rov.trends, rov.weak) == ((), (), {}, ())
    true = LINEAR * SPEED + QUADRATIC * SPEED**2
    next_dive = rov.pooled["drag in surge at 0.3 m/s"].next_dive
    assert next_dive is not None
    assert next_dive[0] < true < next_dive[1]
    page = page_of(rows)
    assert "surge control 10" in page
    assert "They agree on drag in surge at 0.3 m/s" in page
    # The table of dives has no column for what another one holds, and no text twice.
    assert "<td>dive0.BIN</td>\n<td>rov</td>" in page
    assert '<td data-v="2024-05-01 10:00"' not in page
    assert '<td><span class="day">2024-05-01</span> 10:00</td>' in page
    assert "look at" not in page.partition("</h1>")[0]


def test_the_first_screen_names_the_vehicle_the_change_and_the_thruster() -> None:
    page = page_of(tables(fouled_from=6, weak=True))
    assert "look at rov first: drag in surge at 0.3 m/s changed by" in page
    assert "drag in surge at 0.3 m/s changed by" in page
    assert "thruster 3 is weak in dive9.BIN" in page
    assert "Vehicles and findings over time" in page
    assert "They agree on" not in page
    assert "drifts by" not in page


def test_several_weak_thrusters_of_a_dive_stand_in_one_line() -> None:
    rows = tables(weak=True)
    (third,) = (row for row in rows["coefficients"] if row["verdict"] == "weak")
    rows["coefficients"].append(third | {"term": "thruster 5", "value": 0.6})
    page = page_of(rows)
    assert "rov: thrusters 3, 5 are uneven in dive9.BIN" in page


def test_the_next_dive_after_a_change_comes_from_the_dives_since() -> None:
    rows = tables(fouled_from=6)
    (rov,) = vehicle_figures(as_columns(rows["coefficients"]), rows["runs"])
    pooled = rov.pooled["drag in surge at 0.3 m/s"]
    fouled = 1.5 * (LINEAR * SPEED + QUADRATIC * SPEED**2)
    assert (pooled.dives, pooled.earlier) == (4, 6)
    assert pooled.next_dive is not None
    assert 0.9 * fouled < pooled.next_dive[0] < fouled < pooled.next_dive[1] < 1.1 * fouled
    assert rov.since["X_u"] == rov.since["drag in surge at 0.3 m/s"] == 6
    page = page_of(rows)
    assert "Since the last change: drag in surge at 0.3 m/s" in page
    assert "4 dives from dive6.BIN (2024-05-07) on; the next" in page


def test_dives_of_several_autopilots_or_of_no_name_are_not_pooled_without_a_word() -> None:
    rows = tables(fouled_from=6)
    page = page_of(rows)
    assert "its dives are of 2 autopilots, 9 with serial number 1, 1 with serial number 2" in page
    for row in rows["runs"]:
        row["board"], row["vehicle"] = "", "not named (ArduSub)"
    page = page_of(rows)
    assert "autopilots" not in page
    assert f"no log names its vehicle, and {DIVES} dives are taken for those of one" in page


@pytest.mark.parametrize(("measured", "clock"), [(range(6), True), (range(2), False)])
def test_a_term_without_a_dive_since_the_change_has_no_next_dive(
    measured: range, clock: bool
) -> None:
    rows = tables(fouled_from=6)
    for row in rows["coefficients"]:
        if int(row["log"][4:]) in measured:
            continue
        if row["term"] == "u":
            row |= {"verdict": "at its bound", "standard_error": None}
        elif row["term"] == "u*|u|":
            row["standard_error"] *= 0.07
    for row in rows["runs"][: 0 if clock else 2]:
        row["start_utc"] = None
    (rov,) = vehicle_figures(as_columns(rows["coefficients"]), rows["runs"])
    assert [alarm.figure for alarm in rov.alarms] == ["drag in surge at 0.3 m/s"]
    assert rov.pooled["X_u"].dives == len(measured)
    assert rov.pooled["X_u"].next_dive is None
    assert "X_u" not in rov.since
    assert rov.pooled["X_u"].refusal.startswith("changed, and ")
    assert rov.pooled["X_u"].refusal in page_of(rows)


def test_a_thruster_of_which_no_dive_tells_is_named() -> None:
    rows = tables()
    for row in rows["coefficients"]:
        if row["model"] == THRUSTERS:
            row |= {"value": None, "standard_error": None, "verdict": "not excited"}
    (rov,) = vehicle_figures(as_columns(rows["coefficients"]), rows["runs"])
    assert rov.weak == ()
    page = page_of(rows)
    assert "rov: no dive tells the strength of thruster 3 (not excited in 10)." in page


def test_dates_of_the_picture_of_dives_do_not_touch_on_a_phone() -> None:
    rows = [
        {"start_utc": f"20{year}-01-01T00:00:00Z", "vehicle": "rov", "same_as": None}
        | {"errors": 0, "warnings": 1, "state": "done"}
        for year in (14, 25)
    ]
    (picture,) = time_picture(rows)
    dates = re.findall(r">(\d{4}-\d\d-\d\d)<", picture)
    assert len(dates) >= 2
    assert sum(map(len, dates)) * 7 < 300  # px of a letter and of the width beside the labels
