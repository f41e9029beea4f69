"""Reproduction: the bounds, the words and tables of the page, true states in place of
fused ones, and documents refused in words.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from auvid.data_schemas.errors import CampaignError, DataError, PipelineError, UsageError
from auvid.data_schemas.records.motion import SegmentRecord
from auvid.data_schemas.tables import make_table, matrix
from auvid.data_schemas.yaml_text import read_yaml
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.pipeline.commands.reproduce.reproduce_command import open_reproduction
from auvid.stages import replace_state
from auvid.stages.base import collection
from auvid.stages.columns import ACCELERATION, POSE, VELOCITY, force_columns, named
from auvid.stages.reference_check import ReferenceCheck
from auvid.stages.reproduce.content import ReproductionContent
from auvid.stages.reproduce.measures import ModelErrors, VariantCheck, VariantMeasures, checks
from auvid.stages.reproduce.tables import check_table, error_tables, print_errors, repeats
from auvid.stages.reproduce.text import campaign_text, sections, summary

ROOT = Path(__file__).parents[3]
TWIN = ROOT / "campaigns/vt690_twin"
VT690 = vehicle_from_document(read_yaml((ROOT / "vehicles/vt690.yaml").read_text(encoding="utf-8")))
RATIOS = {"mcfarland": 0.20, "linear": 0.25, "uncoupled": 0.78, "fossen": 0.79}
N_BAR = {"mcfarland": 216, "linear": 36, "uncoupled": 24, "fossen": 12}


def measures(ratios: dict[str, float], *, j0: float = 12.0, error: float = 8.0) -> VariantMeasures:
    sets = ("training", "validation")
    scores = {
        (use, name): ModelErrors(name.title(), N_BAR[name], N_BAR[name], value * j0, value)
        for use in sets
        for name, value in ratios.items()
    }
    return VariantMeasures(
        scores=scores,
        j0=dict.fromkeys(sets, j0),
        force=np.full(6, 8.0),
        force_error=np.full(6, error),
        velocity_error=np.array([0.01, 0.02, 0.02, 0.0, 0.0, 0.0]),
        gyro_bias=1e-4,
        accel_bias=4e-3,
        sway_gap=0.2,
        turn=139.0,
        turn_added=82.0,
        turn_terms={"mcfarland": ("r*|u|", 138.0)},
        warnings=("sway",),
    )


def document(**change: Any) -> dict[str, Any]:
    value: dict[str, Any] = read_yaml((TWIN / "reproduce.yaml").read_text(encoding="utf-8"))
    return value | change


def with_words(value: dict[str, Any]) -> dict[str, Any]:
    """The document as the page gets it, with its text in place of the file's name."""
    return value | {"text": (TWIN / value["text"]).read_text(encoding="utf-8")}


def bound(**entry: Any) -> dict[str, Any]:
    why = {"evidence": "method", "reason": "it could be missed"}
    return {"plan": "matched", "variant": "as_published", **why, **entry}


@pytest.mark.parametrize(
    ("entry", "met", "least", "most"),
    [
        (bound(figure="j0", low=11.5, high=13.5), True, 12.0, 12.0),
        (bound(figure="j0", low=12.5), False, 12.0, 12.0),
        (
            bound(figure="ratio", models=["uncoupled", "fossen"], low=0.74, high=0.83),
            True,
            0.78,
            0.79,
        ),
        (bound(figure="ratio", high=0.5), False, 0.20, 0.79),
        (bound(figure="ratio", models=["linear"], sets=["training"], high=0.25), True, 0.25, 0.25),
        (
            bound(figure="order", groups=[["mcfarland"], ["linear"], ["uncoupled", "fossen"]]),
            True,
            0.25 / 0.78,
            0.8,
        ),
        (bound(figure="order", groups=[["mcfarland", "fossen"], ["linear"]]), False, 3.16, 3.16),
        (bound(figure="force_error", high=0.9), False, 8.0, 8.0),
        (bound(figure="velocity_error", high=0.0174), True, 0.0003**0.5, 0.0003**0.5),
        (bound(figure="gyro_bias", high=5e-4), True, 1e-4, 1e-4),
        (bound(figure="sway_gap", low=0.1), True, 0.2, 0.2),
    ],
)
def test_bounds_are_held_against_every_value(
    entry: dict[str, Any], met: bool, least: float, most: float
) -> None:
    (check,) = checks(document(expected=[entry]), {"matched/as_published": measures(RATIOS)})
    assert check.check.met is met
    assert (check.check.least, check.check.value) == (pytest.approx(least), pytest.approx(most))


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        (bound(figure="ratio", models=["fosen"]), "Did you mean 'fossen'?"),
        (bound(figure="j0", variant="as_publishd"), "no such variant of a plan was run"),
        (bound(figure="order", groups=[["fossen"]]), "nothing to hold against this bound"),
    ],
)
def test_bounds_on_nothing_are_refused(entry: dict[str, Any], words: str) -> None:
    with pytest.raises(CampaignError) as refused:
        checks(document(expected=[entry]), {"matched/as_published": measures(RATIOS)})
    assert words in str(refused.value)


def content(**change: Any) -> ReproductionContent:
    """Two variants on the plan of the tables, and the first again with another seed."""
    right = measures(
        {"mcfarland": 0.19, "linear": 0.22, "uncoupled": 0.32, "fossen": 0.34}, j0=8.0, error=1.0
    )
    wrong, again = measures(RATIOS), measures(RATIOS | {"linear": 0.22})
    by_key = {
        "matched/as_published": wrong,
        "matched/corrected": right,
        "matched_seed_1/as_published": again,
    }
    value = document(expected=[bound(figure="j0", low=11.5, high=13.5)])
    setting = open_reproduction(str(TWIN))
    rows = [
        {
            "table": "5.2",
            "set": "training",
            "model": "linear",
            "n_bar_printed": 36,
            "J": 3.625,
            "J0": 13.047,
            "ratio_printed": 0.25,
            "ratio_recomputed": 0.2778,
            "note": "digits swapped",
        },
        {
            "table": "5.1",
            "set": "validation",
            "model": "uncoupled",
            "n_bar_printed": 24,
            "J": 9.408,
            "J0": 12.338,
            "ratio_printed": 0.763,
            "ratio_recomputed": 0.7625,
            "note": "",
        },
    ]
    published = {
        "source": "a.csv",
        "rows": rows,
        "coefficients": {"mcfarland": {"Y": {"r*|u|": 127.5}}},
    }
    plan = read_yaml((TWIN / "plans/matched.yaml").read_text(encoding="utf-8"))
    plans = dict.fromkeys(("matched", "matched_seed_1"), plan)
    assert setting.campaign.name == "vt690_twin"
    arguments = {"document": with_words(value), "checks": tuple(checks(value, by_key))} | change
    return ReproductionContent(
        published=published, vehicle=VT690, plans=plans, measures=by_key, **arguments
    )


def test_transport_term_is_that_of_the_masses() -> None:
    """Errata V17: (m - Y_vdot) + (m - X_udot) = 123.7 kg."""
    assert sum(content().transport) == pytest.approx(123.75, abs=0.06)


def test_tables_put_published_figures_beside_ours() -> None:
    ratio, size, *_ = list(error_tables(content(), "matched", printed=True))
    assert [head["name"] for head in ratio["columns"]][-3:] == [
        "J/J0 thesis",
        "J/J0 (a)",
        "J/J0 (b)",
    ]
    assert ratio["rows"][0] == ["Uncoupled", 24, 24, 24, 0.7625, 0.78, 0.32]
    assert size["rows"][-1][0] == "no model: J0"
    assert size["rows"][-1][-3:] == [12.338, 12.0, 8.0]


def test_inconsistent_row_and_number_of_terms_are_explained() -> None:
    notes = campaign_text(content())["table_notes"].blocks(content())
    words = " ".join(block["text"] for block in (*print_errors(content()), *notes))
    assert "3.625 over J0 = 13.047 is 0.278, but the table prints 0.250" in words
    assert "n-bar 24 in Tables 5.1 and 5.2, but 22 in Figure 5.14" in words


def test_other_seeds_stand_beside_one_another() -> None:
    validation, training = repeats(content())
    for marked, use in ((validation, "validation"), (training, "training")):
        assert marked["title"].endswith(f"with other random numbers, {use}: J/J0")
        linear = next(row for row in marked["rows"] if row[0] == "Linear")
        assert linear[1:3] == [0.25, 0.22]
        assert [head["name"] for head in marked["columns"]][1:3] == [
            "J/J0 seed of the manifest",
            "J/J0 seed 1",
        ]


def test_first_screen_says_whether_the_table_came_out() -> None:
    assert summary(content()).headline.startswith(
        "The published table comes out when the accelerometer"
    )
    missed = VariantCheck("matched", "as_published", ReferenceCheck("J0", 12.0, low=13.0))
    screen = summary(content(checks=(missed,)))
    assert screen.headline == "The published table does not come out"
    assert screen.level == "poor"
    assert screen.warnings == ("J0: 12, required at least 13 (matched, as_published)",)


def test_an_accepted_miss_is_no_warning() -> None:
    check = ReferenceCheck("RMS", 1.0, high=0.9, accepted_reason="the attitude errs slowly")
    accepted = VariantCheck("matched", "corrected", check)
    screen = summary(content(checks=(accepted,)))
    assert screen.warnings == ()
    assert any("the attitude errs slowly" in words for words in screen.missing)
    assert check_table(content(checks=(accepted,)))["rows"][0][-2:] == [
        "missed",
        "the attitude errs slowly",
    ]


def test_sections_name_the_evidence() -> None:
    parts = sections(content())
    evidence, carried = [block for block in parts["why"]["blocks"] if block["kind"] == "table"]
    assert evidence["rows"][0][1:3] == [139.0, 82.0]
    assert carried["rows"] == [["Mcfarland", "r*|u|", 127.5, 138.0, 138.0]]
    assert {"why", "tables", "bounds", "force", "chosen"} <= set(parts)


def truth_table(t_s: np.ndarray[Any, Any]) -> Any:
    """A motion of sines, whose splines are good to 1e-6 at 50 Hz."""
    pose = 0.3 * np.sin(np.outer(t_s, np.arange(1, 7) * 0.5))
    nu, rate = (
        0.3 * np.cos(np.outer(t_s, np.arange(1, 7) * 0.5)),
        -0.1 * np.sin(np.outer(t_s, np.arange(1, 7) * 0.5)),
    )
    columns = {
        "time_us": (t_s * 1e6).astype(np.int64),
        "t_s": t_s,
        **named(POSE, pose),
        **named(VELOCITY, nu),
        **named(ACCELERATION, rate),
    }
    columns |= {
        "propeller_rev_s": np.ones_like(t_s),
        **{f"fin_{name}_rad": np.zeros_like(t_s) for name in "spbt"},
    }
    for part in ("viscous", "unsteady", "tau_bar"):
        columns |= named(force_columns(part), np.zeros((len(t_s), 6)))
    return make_table("truth", columns)


def true_states(*, last_s: float = 20.0, log: str = "a") -> replace_state.Outputs:
    at = np.arange(0.0, 10.0, 0.02)
    zeros = np.zeros_like(at)
    resampled = make_table(
        "resampled",
        {"t_s": at, "z_m": zeros, "z_dot_m_s": zeros}
        | {f"{name}_rad": zeros for name in ("phi", "theta", "psi")}
        | {f"{name}_dot_rad_s": zeros for name in ("phi", "theta", "psi")}
        | {"u_m_s": zeros + 0.5},
    )
    segment = SegmentRecord.model_construct(id="a", log="a", leg_start_s=2.107, duration_s=9.98)
    truth = collection({log: truth_table(np.arange(0.0, last_s, 0.02))})
    return replace_state.run(
        replace_state.Inputs(segment, resampled, truth), replace_state.Params()
    )


def test_true_states_stand_at_the_times_of_the_segment() -> None:
    out = true_states()
    t = out.fused["t_s"].to_numpy()
    assert t[0] == pytest.approx(0.5)
    assert t[-1] <= 9.48 + 1e-9
    expected = 0.3 * np.cos(np.outer(t + 2.107, np.arange(1, 7) * 0.5))
    assert np.max(np.abs(matrix(out.fused, VELOCITY) - expected)) < 1e-6
    assert out.fusion.method == "truth"
    assert out.fusion.rms["u_m_s"] == pytest.approx(np.sqrt(np.mean((0.5 - expected[:, 0]) ** 2)))


@pytest.mark.parametrize(
    ("change", "words"),
    [({"log": "b"}, "no truth of log 'a'"), ({"last_s": 11.0}, "does not cover segment 'a'")],
)
def test_true_states_need_the_truth_of_the_segment(change: dict[str, Any], words: str) -> None:
    with pytest.raises(DataError, match=words):
        true_states(**change)


def copy(folder: Path, change: Callable[[dict[str, Any]], None]) -> str:
    """The campaign of the twin in a folder of its own, with a changed document."""
    campaign = folder / "twin"
    (campaign / "published").mkdir(parents=True)
    for name in ("campaign.yaml", "published/error_tables.csv"):
        (campaign / name).write_bytes((TWIN / name).read_bytes())
    (campaign / "plans").symlink_to(TWIN / "plans")
    value = document()
    change(value)
    (campaign / "reproduce.yaml").write_text(yaml.safe_dump(value), encoding="utf-8")
    return str(campaign)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            lambda value: value["compared"].update(published="as_publishd"),
            "Did you mean 'as_published'?",
        ),
        (
            lambda value: value["plans"][2].update(variants=["corected"]),
            "Did you mean 'corrected'?",
        ),
        (lambda value: value["variants"][0].update(id="flight"), "not a name of its own"),
        (lambda value: value["plans"][1].update(id="matched"), "not a name of its own"),
        (lambda value: value["plans"][0].update(id="page"), "not a name of its own"),
        (lambda value: value["variants"][0]["stages"].update(fues={}), "Did you mean 'fuse'?"),
        (
            lambda value: value["variants"][3]["stages"].update(fuse={}),
            "not a stage of this variant",
        ),
        (
            lambda value: value["variants"][0]["stages"].update(simulate={}),
            "not a stage of this variant",
        ),
        (lambda value: value.update(plans=[]), "the list is empty"),
        (
            lambda value: value["expected"][0].update(plan="matchd"),
            "Did you mean 'matched/as_published'?",
        ),
        (
            lambda value: value["expected"][-1].update(variant="as_published"),
            "no such variant of a plan",
        ),
        (lambda value: value.update(plan="x"), "unknown key"),
        (lambda value: value["expected"][0].update(figure="j1"), "unknown value"),
    ],
)
def test_documents_are_refused_in_words(
    tmp_path: Path, change: Callable[[dict[str, Any]], None], words: str
) -> None:
    with pytest.raises(PipelineError) as refused:
        open_reproduction(copy(tmp_path, change))
    assert words in str(refused.value)


def test_a_campaign_without_a_document_is_named() -> None:
    with pytest.raises(UsageError, match=r"reproduces nothing.*vt690_twin"):
        open_reproduction(str(ROOT / "campaigns/bluerov2_dvl"))


@pytest.mark.parametrize(
    ("template", "words"),
    [
        ("# headline\n{{ nothing }}\n", "'nothing' is undefined"),
        ("# headlin\nwords\n", "Did you mean 'headline'?"),
        ("# why: Why\n[[plan_table]]\n", "Did you mean 'plan_tables'?"),
        ("# headline\n{% if %}\n", "the text cannot be filled in"),
        ("# headline\n{{ content.__class__.__mro__ }}\n", "the text cannot be filled in"),
    ],
)
def test_a_template_with_a_fault_is_refused(template: str, words: str) -> None:
    with pytest.raises(CampaignError) as refused:
        sections(content(document=document(text=template), checks=()))
    assert words in str(refused.value)


def test_a_campaign_without_text_has_its_tables() -> None:
    value = {name: item for name, item in document(expected=[]).items() if name != "text"}
    bare = content(document=value, checks=())
    assert summary(bare).headline == "The published table does not come out"
    assert {"tables", "bounds", "force"} <= set(sections(bare))
