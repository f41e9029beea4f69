"""The figures of a vehicle over its dives: which dives count in them, and in what order."""

from __future__ import annotations

import numpy as np
import pytest

from auvid.hydro.arrays import Array
from auvid.hydro.identification.fleet.alarms import change_alarms
from auvid.pipeline.commands.fleet.report.vehicle_figures import (
    RISES,
    VehicleFigures,
    alarm_shares,
    alarms_of,
    vehicle_figures,
)
from tests.support.fleet_rows import Row, as_columns, empty_row

IDENTIFIED_AT = 4.0
"""Standard errors from which on a dive calls a coefficient identified."""


def dive(number: int, *, clock: bool = True, speed: float | None = None) -> Row:
    """Return row `runs` of a dive, `number` days after the first."""
    return empty_row("runs") | {
        "log": f"dive{number}",
        "vehicle": "rov",
        "file": f"dive{number:03d}",
        "model": "diagonal",
        "start_utc": f"2024-05-{number + 1:02d}T10:00:00Z" if clock else None,
        "speed_surge": speed,
    }


def coefficient(log: str, term: str, value: float, error: float | None, verdict: str) -> Row:
    return empty_row("coefficients") | {
        "log": log,
        "vehicle": "rov",
        "model": "diagonal",
        "axis": "X",
        "term": term,
        "unit": "N",
        "value": value,
        "standard_error": error,
        "verdict": verdict,
    }


def of_one_term(values: Array, errors: Array, *, term: str = "v*r") -> VehicleFigures:
    """Return the figures of dives that call a term identified from four errors on."""
    clear = np.abs(values) >= IDENTIFIED_AT * errors
    rows = [
        coefficient(f"dive{number}", term, value, error, "identified" if sure else "weak")
        for number, (value, error, sure) in enumerate(zip(values, errors, clear, strict=True))
    ]
    (rov,) = vehicle_figures(as_columns(rows), [dive(number) for number in range(len(values))])
    return rov


def test_dives_that_call_a_figure_weak_count_in_its_mean() -> None:
    random = np.random.default_rng(2)
    errors = np.full(10, 0.25)
    means = [
        rov.pooled["X_v*r"].mean
        for _ in range(12)
        if (rov := of_one_term(1.0 + errors * random.standard_normal(10), errors)).pooled
    ]
    assert len(means) > 8
    # .25 / sqrt(10 * 12), three of them; dives called identified alone give 1.2.
    assert abs(float(np.mean(means)) - 1.0) < 0.07


def test_a_coefficient_that_falls_is_a_change() -> None:
    values = np.array([8.0, 8.1, 7.9, 8.05, 7.95, 2.0, 2.1, 1.9, 2.05, 1.95])
    (alarm,) = of_one_term(values, np.ones(10)).alarms
    assert alarm.first_dive == 5
    assert alarm.share < -0.6


def test_a_figure_that_one_dive_determines_is_not_shown() -> None:
    assert of_one_term(np.array([5.0, 1.0, 1.2, 0.9]), np.ones(4)).figures == ()


def test_names_of_files_are_no_time() -> None:
    values = np.array([8.0, 8.1, 7.9, 8.05, 7.95, 2.0, 2.1, 1.9, 2.05, 1.95])
    rows = [
        coefficient(f"dive{number}", "v*r", value, 1.0, "identified")
        for number, value in enumerate(values)
    ]
    runs = [dive(number, clock=False) for number in range(10)]
    (rov,) = vehicle_figures(as_columns(rows), runs)
    assert (rov.alarms, rov.order_unknown) == ((), 10)
    (rov,) = vehicle_figures(as_columns(rows), runs, by_name=True)
    assert [alarm.first_dive for alarm in rov.alarms] == [5]
    assert rov.order_unknown == 0


def test_a_term_at_its_bound_drops_no_drag() -> None:
    runs = [dive(number, speed=0.5) for number in range(3)]
    rows = [
        coefficient(f"dive{number}", term, value, error, verdict)
        for number in range(3)
        for term, value, error, verdict in (
            ("u", 0.0, None, "at its bound"),
            ("u*|u|", -40.0, 2.0, "identified"),
        )
    ]
    (rov,) = vehicle_figures(as_columns(rows), runs)
    (drag,) = (item for item in rov.figures if item.name.startswith("drag"))
    np.testing.assert_allclose(drag.values, 10.0)
    np.testing.assert_allclose(drag.errors, 0.5)


def test_an_angle_and_its_interval_have_one_unit() -> None:
    """Values, means and intervals of a sensor's angle are in degrees, as the page has them."""
    rows = [
        coefficient(f"dive{number}", "angle x", 0.02, 0.001, "identified") | {"unit": "rad"}
        for number in range(4)
    ]
    (rov,) = vehicle_figures(as_columns(rows), [dive(number) for number in range(4)])
    (figure,) = rov.figures
    assert figure.unit == "deg"
    np.testing.assert_allclose(figure.values, np.degrees(0.02))
    assert rov.pooled[figure.name].mean == pytest.approx(np.degrees(0.02))


def test_false_alarms_are_shared_out_and_drags_have_most() -> None:
    drags = [f"drag in {word} at 0.3 m/s" for word in ("surge", "sway")]
    shares = alarm_shares([*drags, "drag of all axes over its mean", "X_u*v", "thruster 1"])
    assert sum(shares.values()) == pytest.approx(1.0)
    assert shares[drags[0]] == shares[drags[1]] > 2.0 * shares["X_u*v"]
    assert alarm_shares(["X_u*v"]) == {"X_u*v": 1.0}


def test_a_rise_of_drag_is_looked_for_more_than_a_fall() -> None:
    values = np.array([10.0, 10.3, 9.8, 10.1, 9.9, 10.48, 10.58, 10.38, 10.53])
    errors = np.full(9, 0.1)
    others = {f"X_{number}": (np.full(9, 1.0), errors) for number in range(4)}
    drag = "drag in surge at 0.3 m/s"
    (alarm,) = alarms_of({drag: (values, errors), **others})
    assert alarm.figure == drag
    assert alarms_of({drag: (-values, errors), **others}) == ()
    assert alarms_of({"X_u*v": (values, errors), **others}) == ()


def test_axes_tell_each_other_how_much_a_dive_scatters() -> None:
    """A fifth more drag on one axis is clear beside five that scatter as it does."""
    random = np.random.default_rng(13)
    values = 1.0 + 0.05 * random.standard_normal((6, 10))
    values[0, 5:] += 0.2
    errors = np.full(10, 0.015)
    axes = {f"drag in {axis}": (row, errors) for axis, row in zip("abcdef", values, strict=True)}
    others = {str(k): (1.0 + 0.05 * random.standard_normal(10), errors) for k in range(14)}
    figures = axes | others
    (alarm,) = alarms_of(figures)
    assert (alarm.figure, alarm.first_dive) == ("drag in a", 5)
    shares, rises = alarm_shares(list(figures)), dict.fromkeys(axes, RISES)
    assert change_alarms(figures, shares=shares, rises=rises) == (), "each axis by itself"
