"""Printed tables beside results: errors, bounds, verdicts, errata, and what is refused."""

from __future__ import annotations

from typing import Any

import pytest

from auvid.data_schemas.documents import check_document
from auvid.data_schemas.documents.model import parse
from auvid.data_schemas.documents.published_values import PublishedValuesDocument
from auvid.data_schemas.errors import PipelineError
from auvid.data_schemas.tables import make_table
from auvid.stages import check_published
from auvid.stages.base import collection

RESULTS = {
    "rlse/surge": {
        "title": "surge",
        "rows": [
            {
                "quantity": "m - X_udot",
                "value": 34.0,
                "unit": "kg",
                "standard_error": 0.2,
                "verdict": "identified",
            },
            {
                "quantity": "X_u|u|",
                "value": None,
                "unit": "kg/m",
                "verdict": "not persistently exciting",
            },
        ],
    },
    "pipendulum": {
        "title": "swings",
        "rows": [{"quantity": "tray I", "value": 2.2, "unit": "kg*m^2"}],
    },
}


WHY = {"evidence": "method", "reason": "noise stands between"}


def row(**changes: Any) -> dict[str, Any]:
    entry = {
        "quantity": "X_udot",
        "unit": "kg",
        "printed": -13.3967,
        "truth": -13.5778,
        "ours": "rlse/surge:m - X_udot",
    }
    if changes.keys() & {"most_relative_error", "least", "most", "verdict"}:
        entry |= WHY
    if changes.get("printed", 1.0) is None:
        entry["evidence"] = "unprinted"
    return {**entry, "factor": -1.0, "offset": 20.9, **changes}


def published(*rows: dict[str, Any], errata: tuple[str, ...] = ("A17",)) -> PublishedValuesDocument:
    erratum = {
        "id": "A17",
        "where": "Table 3",
        "printed": "195.70 %",
        "corrected": "198.85 %",
        "confidence": "certain",
    }
    tables = [
        {"id": "Table 4", "title": "varying steps", "errata": list(errata), "rows": list(rows)}
    ]
    document = {"title": "Alberti", "source": "Alberti 2015", "tables": tables, "errata": [erratum]}
    return parse(PublishedValuesDocument, document)


def run(
    document: PublishedValuesDocument | None, tables: dict[str, Any] | None = None
) -> check_published.Outputs:
    return check_published.run(
        check_published.Inputs(collection(RESULTS), collection(tables or {}), document),
        check_published.Params(),
    )


def compared(*rows: dict[str, Any]) -> list[dict[str, Any]]:
    outputs = run(published(*rows))
    assert outputs.comparison is not None
    assert outputs.section is not None
    return outputs.comparison.to_pylist()


def test_errors_of_print_and_ours_are_against_the_same_truth():
    (check,) = compared(row(most_relative_error=0.04))
    assert check["ours"] == pytest.approx(20.9 - 34.0)
    assert check["our_error"] == pytest.approx((-13.1 + 13.5778) / 13.5778)
    assert check["printed_error"] == pytest.approx(0.01334, abs=1e-5)
    assert check["standard_error"] == pytest.approx(0.2)
    assert check["met"] is True


def test_a_bound_can_be_missed_and_nothing_asked_is_neither():
    missed, free, corrected = compared(
        row(most_relative_error=0.03), row(), row(truth=-13.1, most_relative_error=1e-9)
    )
    assert missed["met"] is False
    assert free["met"] is None
    assert corrected["met"] is True


def test_limits_on_the_value_itself():
    exact, low, high, both = compared(
        row(least=-14.0, most=-13.0),
        row(least=-13.0),
        row(most=-13.2),
        row(most=-13.0, most_relative_error=0.03),
    )
    assert [result["met"] for result in (exact, low, high, both)] == [True, False, False, False]
    assert (exact["least"], exact["most"], low["most"]) == (-14.0, -13.0, None)
    (unknown,) = compared(row(ours="rlse/surge:X_u|u|", printed=None, truth=None, most=1.0))
    assert unknown["met"] is False


def test_a_missed_limit_is_told_in_the_unit_of_the_row():
    outputs = run(published(row(most=-13.2), row(least=-13.0)))
    assert outputs.section is not None
    warned = [block["text"] for block in outputs.section["blocks"] if block["kind"] == "remark"]
    assert warned == [
        "Table 4, X_udot: -13.1 kg, required at most -13.2",
        "Table 4, X_udot: -13.1 kg, required at least -13",
    ]


def test_without_truth_the_corrected_value_counts_then_the_printed():
    entry = {
        "quantity": "I_P",
        "unit": "kg*m^2",
        "printed": 2.0,
        "ours": "pipendulum:tray I",
        "most_relative_error": 0.0,
        **WHY,
    }
    first, second = compared({**entry, "corrected": 2.2}, entry)
    assert (first["truth"], first["met"]) == (2.2, True)
    assert (second["truth"], second["met"]) == (2.0, False)


def test_a_verdict_is_held_with_or_without_a_value():
    verdict = "not persistently exciting"
    entry = row(ours="rlse/surge:X_u|u|", verdict=verdict)
    equal, other, bounded = compared(
        entry, {**entry, "verdict": "identified"}, {**entry, "most_relative_error": 1.0}
    )
    assert (equal["met"], equal["ours"], equal["verdict"]) == (True, None, verdict)
    assert other["met"] is False
    assert bounded["met"] is False


def test_the_section_has_every_table_every_erratum_and_names_what_is_missed():
    outputs = run(published(row(most_relative_error=0.03)))
    assert outputs.section is not None
    titles = [block["title"] for block in outputs.section["blocks"] if block["kind"] == "table"]
    assert titles == ["What the bounds show", "Table 4: varying steps", "Errata of the source"]
    warned = [
        block["text"]
        for block in outputs.section["blocks"]
        if block["kind"] == "remark" and block["level"] == "warning"
    ]
    assert warned == ["Table 4, X_udot: off by 3.52 %, required within 3 %"]


def test_what_is_met_stands_among_the_results() -> None:
    rows = (row(most_relative_error=0.04), row(most_relative_error=0.03), row())
    outputs = run(published(*rows))
    assert outputs.bounds is not None
    check_document(outputs.bounds, "results")
    (check,) = outputs.bounds["rows"]
    assert (check["quantity"], check["value"], check["verdict"]) == (
        "Table 4: bounds met of 2",
        1.0,
        "missed",
    )
    assert check["note"] == "largest error 3.5 % (X_udot)"
    free = run(published(row()))
    assert free.bounds is None


def test_what_cannot_fail_is_counted_apart() -> None:
    """A row that holds by construction, one that was tuned and one of which nothing is
    printed are no tests, whatever else they are.
    """
    rows = (
        row(most_relative_error=0.04),
        row(most_relative_error=0.03),
        row(most_relative_error=0.05, evidence="construction", reason="the twin flew it"),
        row(most=0.0, evidence="tuned", reason="the mass was set for it"),
        row(most=0.0, printed=None, evidence="unprinted", reason="no number"),
        row(),
    )
    outputs = run(published(*rows))
    assert outputs.comparison is not None
    assert outputs.bounds is not None
    assert outputs.section is not None
    rows_made = outputs.comparison.to_pylist()
    kinds = ["method", "method", "construction", "tuned", "unprinted", ""]
    assert [item["evidence"] for item in rows_made] == kinds
    assert rows_made[2]["reason"] == "the twin flew it"
    check_document(outputs.bounds, "results")
    counted = {item["quantity"]: item["value"] for item in outputs.bounds["rows"]}
    assert counted == {
        "Table 4: bounds met of 2": 1.0,
        "Table 4, holds by construction: bounds met of 1": 1.0,
        "Table 4, follows from an input chosen to match it: bounds met of 1": 1.0,
        "Table 4, has no printed value: bounds met of 1": 1.0,
    }
    counts, _, why = [block for block in outputs.section["blocks"] if block["kind"] == "table"][:3]
    assert counts["rows"][-1] == ["all tables", "2", "1", "1", "1", "5", "4"]
    assert why["fold"] == "Table 4: varying steps"
    assert ["X_udot", "holds by construction", "the twin flew it"] in why["rows"]


def test_a_bound_must_say_what_it_shows() -> None:
    bare = row(most=0.0) | {"evidence": None, "reason": ""}
    with pytest.raises(PipelineError, match=r"rows\[0\]\.evidence.*what meeting it shows"):
        published(bare)
    with pytest.raises(PipelineError, match="evidence needs a reason"):
        published(row(most=0.0, reason=""))
    for wrong in (
        row(most=0.0, printed=None, truth=None, evidence="method"),
        row(most=0.0, evidence="unprinted"),
    ):
        with pytest.raises(PipelineError, match="'unprinted' where nothing is printed"):
            published(wrong)


def test_the_truth_of_a_twin_is_not_called_printed() -> None:
    entry = row(most_relative_error=0.04, printed=None, truth=-13.0, evidence="method")
    outputs = run(published(entry))
    assert outputs.section is not None
    assert outputs.bounds is not None
    assert outputs.section["title"] == "True values beside ours"
    assert "rinted" not in outputs.section["blocks"][0]["text"]
    assert [item["reference"] for item in outputs.bounds["rows"]] == ["true values"]


def test_a_campaign_without_printed_tables_gives_nothing():
    outputs = run(None)
    assert outputs == check_published.Outputs(None, None, None)


def test_unknown_errata_are_refused_before_any_stage():
    with pytest.raises(PipelineError, match=r"tables\[0\]\.errata.*no such erratum.*A17"):
        published(row(), errata=("A71",))


def test_unknown_figures_are_refused_together():
    document = published(row(ours="rlse/surge:m - X_udo"), row(ours="rlse/sway:Y_v"))
    with pytest.raises(PipelineError) as caught:
        run(document)
    words = str(caught.value)
    assert "rlse/surge:m - X_udot" in words
    assert "tables[0].rows[1].ours" in words


@pytest.mark.parametrize("bound", [{"most_relative_error": 0.1}, {"least": 0.0}, {"most": 3.0}])
def test_a_bound_without_a_figure_is_refused(bound):
    entry = {"quantity": "I_P", "unit": "kg*m^2", "printed": 2.0, **bound}
    with pytest.raises(PipelineError, match="a bound needs a figure"):
        published(entry)


DAMPING = ("linear", "quadratic", "linear_and_quadratic")
DECAYS = make_table(
    "decays",
    {
        "recording": ["one", "one", "two"],
        "t_s": [0.0, 1.0, 0.5],
        "theta_measured_rad": [0.0, 0.1, 0.2],
        "speed_m_s": [0.3, -0.2, 9.0],
        "chosen": ["linear"] * 3,
        **{
            f"theta_{name}_rad": [0.0] * 3
            for name in ("linear", "quadratic", "linear_and_quadratic")
        },
    },
)
LINE = {
    "name": "surge",
    "table": "pipendulum/decays",
    "recording": "one",
    "column": "speed_m_s",
    "factor": -2.0,
}


def with_figure(**line: Any) -> PublishedValuesDocument:
    entry = {
        "id": "Figure 21",
        "title": "velocity",
        "label": "u",
        "unit": "m/s",
        "note": "Ours: the twin's.",
        "printed": {"largest speed": 0.3515},
        "lines": [LINE | line],
    }
    document = published(row()).model_dump(exclude_unset=True) | {"figures": [entry]}
    return parse(PublishedValuesDocument, document)


def test_figures_of_the_source_are_drawn_on_its_axes() -> None:
    outputs = run(with_figure(), {"pipendulum/decays": DECAYS})
    assert outputs.section is not None
    (drawn,) = [block for block in outputs.section["blocks"] if block["kind"] == "plot"]
    assert (drawn["title"], drawn["x"]) == (
        "Figure 21: velocity",
        {"label": "time", "unit": "s"},
    )
    assert drawn["look_for"] == "Ours: the twin's."
    (axis,) = drawn["panels"]
    assert (axis["label"], axis["unit"]) == ("u", "m/s")
    ours, printed = axis["series"]
    assert (ours["name"], ours["x"], ours["y"]) == ("ours: surge", [0.0, 1.0], [-0.6, 0.4])
    assert (printed["name"], printed["y"]) == ("printed: largest speed", [0.3515, 0.3515])


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ({"table": "pipendulum/decay"}, "Did you mean 'pipendulum/decays'"),
        ({"column": "speed"}, "no such column"),
        ({"recording": "three"}, "no such recording"),
    ],
)
def test_lines_of_what_is_not_there_are_refused(line: dict[str, Any], words: str) -> None:
    with pytest.raises(PipelineError, match=words):
        run(with_figure(**line), {"pipendulum/decays": DECAYS})
