"""Coefficients on the first screen: which, with which unit and interval; and training
data that validation shares.
"""

from __future__ import annotations

from typing import Any

import pytest

from auvid.data_schemas.records.models import (
    AxisCard,
    ModelCard,
    TermCard,
    TermCombination,
    VelocityRange,
)
from auvid.data_schemas.records.motion import SegmentRecord
from auvid.data_schemas.records.partial import MassFreeFigure, PartialFigures
from auvid.hydro.dynamics.viscous.basis import coefficient_unit
from auvid.stages.page.campaign_sections import shared_data
from auvid.stages.report.summary.coefficient_table import assumed_most
from auvid.stages.report.summary.coefficient_text import findings


def term(
    name: str, value: float | None, error: float | None, verdict: str = "identified"
) -> TermCard:
    return TermCard.model_validate(
        {"term": name, "unit": "", "value": value, "standard_error": error, "verdict": verdict}
    )


def in_units(axis: str, terms: list[TermCard]) -> list[TermCard]:
    return [item.model_copy(update={"unit": coefficient_unit(axis, item.term)}) for item in terms]


def card(combinations: list[dict[str, Any]] | None = None, **axes: list[TermCard]) -> ModelCard:
    parts = {
        axis: AxisCard.model_construct(
            terms=in_units(axis, axes.get(axis, [])),
            combinations=[
                TermCombination(reading="", **item) for item in combinations or [] if axis == "X"
            ],
        )
        for axis in "XYZKMN"
    }
    reach = VelocityRange(rms=0.1, low=-0.0125, high=0.222, threshold=0.006)
    return ModelCard.model_construct(axes=parts, conditions=dict.fromkeys("uvwpqr", reach))


@pytest.mark.parametrize(
    ("axis", "name", "value", "error", "words"),
    [
        ("X", "u", -57.551, 0.8695, "X_u = −57.6 ± 1.7 N s/m"),
        ("X", "u*|u|", -103.2, 13.6, "X_u|u| = −103 ± 27 N s²/m²"),
        ("N", "r", -0.2, 0.0123, "N_r = −0.200 ± 0.024 N m s/rad"),
        ("N", "r*|r|", 1.5, 0.3, "N_r|r| = 1.50 ± 0.59 N m s²/rad²"),
    ],
)
def test_damping_has_unit_and_interval(
    axis: str, name: str, value: float, error: float, words: str
) -> None:
    (finding,) = findings(card(**{axis: [term(name, value, error)]}))
    assert finding.label == {"X": "surge damping", "N": "yaw damping"}[axis]
    assert finding.figures == (words,)
    assert (
        finding.note
        == f"Between −0.013 and 0.22 {'m/s' if axis == 'X' else 'rad/s'}, the range of the"
        " training legs."
    )


def test_assumed_figures_widen_the_interval_and_stand_beside_noise() -> None:
    """Half of it is 1.96 sqrt(.7^2 + 11.7^2) = 23.0."""
    item = term("u", -57.9, 0.7).model_copy(update={"assumed_shifts": {"thrust": 11.7}})
    (finding,) = findings(card(X=[item]))
    assert finding.figures == ("X_u = −58 ± 23 N s/m (noise ± 1, scale of the thrust curve ± 23)",)


def test_damping_without_newtons_is_that_over_the_inertia_of_its_own_axis() -> None:
    """Yaw in the inertia of surge has a ratio that nobody measured: -0.029 for -0.012 m^2."""
    own = {"axis": "N", "value": -1.55, "unit": "1/rad", "interval_95": [-2.05, -1.05]}
    figures = [
        own | {"quantity": "N_r|r|/M", "verdict": "identified"},
        own | {"quantity": "N_r/M", "verdict": "weak"},
        own | {"quantity": "time constant from rest", "verdict": "identified"},
        own
        | {"quantity": "time constant at 0.3 rad/s", "value": 0.5, "unit": "s"}
        | {"interval_95": [0.4, 0.6], "verdict": "identified"},
    ]
    part = PartialFigures(
        unit_of_mass="X", axes={}, lacking={}, gains=[],
        without_newtons=[MassFreeFigure.model_validate(item) for item in figures],
    )  # fmt: skip
    in_surge = card(N=[term("r*|r|", -0.0293, 0.005)]).model_copy(update={"partial": part})
    (finding,) = findings(in_surge)
    assert finding.figures == (
        "N_r|r|/M = −1.55 ± 0.50 1/rad",
        "time constant at 0.3 rad/s = 0.50 ± 0.10 s",
    )


def test_only_identified_coefficients_stand_there() -> None:
    terms = [
        term("u", None, None, "not excited"),
        term("u*|u|", -3.0, 4.0, "weak"),
        term("u*u", None, None, "inseparable"),
    ]
    assert findings(card(X=terms)) == ()


def test_determined_sum_of_inseparable_terms_counts_as_damping() -> None:
    one = {"weights": {"u": 1.0, "|u|": 1.0}, "value": -88.83, "standard_error": 4.72}
    none = {"weights": {"u*u": 1.0, "u*|u|": 1.0}, "value": 1.0, "standard_error": 4.72}
    mixed = {"weights": {"u": 1.0, "v": 1.0}, "value": -88.83, "standard_error": 4.72}
    leaned = {"weights": {"u": 1.0, "u*|u|": 1.0}, "value": -88.83, "standard_error": 4.72}
    leaned |= {"assumed_shifts": {"unsteady": 31.0}}  # clear of zero, not three times as large
    (finding,) = findings(card([one, none, mixed, leaned]))
    assert finding.figures == ("X_u + X_|u| = −88.8 ± 9.3 N s/m",)


def test_constant_forces_and_couplings_stand_apart() -> None:
    by_kind = findings(
        card(
            Z=[term("constant", -4.477, 0.067), term("u", 13.4, 0.94)],
            Y=[term("u", 5.54, 0.73)],
            K=[term("u", -1.1, 0.1)],
        )
    )
    assert [item.label for item in by_kind] == ["constant force per axis", "couplings"]
    assert by_kind[0].figures == ("Z = −4.48 ± 0.13 N",)
    assert by_kind[1].figures == ("3 identified, in Models and coefficients",)
    assert by_kind[1].note.startswith(
        "2 of them a hull symmetric to port and starboard cannot have"
    )


def test_an_assumed_figure_is_most_of_the_intervals_or_none_is_named() -> None:
    def moved(error: float, **shifts: float) -> TermCard:
        return term("u", -50.0, error).model_copy(update={"assumed_shifts": shifts})

    thrust, arm = moved(1.0, thrust=5.0, lever_arm=1.0), moved(1.0, thrust=1.0, lever_arm=1.2)
    assert assumed_most(card(X=[thrust])) == "scale of the thrust curve"
    assert assumed_most(card(X=[thrust], Y=[arm], Z=[thrust])) == "scale of the thrust curve"
    # The arm moves two of three most, and is half of no interval.
    assert assumed_most(card(X=[arm], Y=[arm], Z=[thrust])) == ""


def segment(use: str, start: float, length: float, log: str = "dive") -> SegmentRecord:
    return SegmentRecord.model_construct(
        use=use, log=log, leg_start_s=start, duration_s=length, rate_hz=50.0
    )


def test_training_data_in_validation_are_named() -> None:
    (words,) = shared_data(
        {"train": segment("training", 0.0, 90.0), "check": segment("validation", 60.0, 70.0)}
    )
    assert words.startswith(
        "Training segment train and validation segment check share 30.0 s of log dive"
    )


def test_legs_apart_or_of_other_logs_share_nothing() -> None:
    legs = {"train": segment("training", 0.0, 90.0), "again": segment("training", 10.0, 20.0)}
    assert (
        shared_data(
            legs
            | {
                "check": segment("validation", 90.0, 40.0),
                "far": segment("validation", 0.0, 90.0, "other"),
            }
        )
        == []
    )
