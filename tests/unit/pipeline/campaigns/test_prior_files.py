"""Priors from results of a bench and from model cards of other campaigns."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from auvid.data_schemas.documents import check_document
from auvid.data_schemas.documents.campaign import PriorEntry
from auvid.data_schemas.errors import CampaignError
from auvid.pipeline.campaigns.campaign import Campaign, load_campaign
from auvid.pipeline.campaigns.prior_files import prior_source
from auvid.pipeline.campaigns.vehicle_files import load_published, shelf_files
from auvid.pipeline.campaigns.workspace import SHIPPED_VEHICLES
from auvid.pipeline.commands.open_run import open_run
from tests.support.example_run import example_run
from tests.support.model_files import DAMPED, model_file

BENCH = {
    "title": "roll of leg tank",
    "rows": [
        {"quantity": "K_p", "value": -1.2, "unit": "N m s/rad", "standard_error": 0.1},
        {"quantity": "K_p|p|", "value": -3.0, "unit": "N m s^2/rad^2", "standard_error": 0.5},
        {"quantity": "K_pdot", "value": -0.2, "unit": "kg m^2", "standard_error": 0.02},
        {"quantity": "K_r", "value": None, "unit": "N m s/rad", "standard_error": None},
    ],
}


def source(folder: Path, document: object, **entry: Any) -> dict[str, Any]:
    path = folder / "results.json"
    path.write_text(json.dumps(document), encoding="utf-8")
    prior = prior_source(
        PriorEntry.model_validate(entry), path, named_in=folder / "campaign.yaml", field="priors[0]"
    )
    check_document({"sources": [prior]}, "prior_sources")
    return prior


def test_a_bench_gives_its_damping_with_independent_errors(tmp_path: Path) -> None:
    priors = source(tmp_path, BENCH, bench="results.json")
    assert [(item["axis"], item["term"], item["value"]) for item in priors["terms"]] == [
        ("K", "p", -1.2),
        ("K", "p*|p|", -3.0),
    ]
    assert priors["lower"] == [[pytest.approx(0.01)], [0.0, pytest.approx(0.25)]]
    wider = source(tmp_path, BENCH, bench="results.json", terms=["K_p"], widen=3.0)
    assert wider["lower"] == [[pytest.approx(0.09)]]


def test_a_card_gives_its_posterior_in_the_size_of_its_printed_errors(tmp_path: Path) -> None:
    card = example_run({"train": 4.0, "check": 2.0}).cards["coe"]
    part = card.axes["X"]
    items = [
        item.model_copy(update={"value": value, "standard_error": 2.0, "verdict": verdict})
        for item, value, verdict in zip(
            part.terms[:3],
            (-5.0, -7.0, -9.0),
            ("identified", "weak", "from the prior"),
            strict=True,
        )
    ]
    names = [item.term for item in items]
    covariance = {"terms": names, "lower": [[1.0], [0.5, 4.0], [0.0, 0.0, 1.0]]}
    document = card.model_dump(mode="json")
    document["axes"]["X"]["terms"] = [item.model_dump(mode="json") for item in items]
    document["axes"]["X"]["covariance"] = covariance
    for axis in "YZKMN":
        document["axes"][axis]["covariance"] = {"terms": [], "lower": []}
    priors = source(tmp_path, document, campaign="results.json")
    assert [item["value"] for item in priors["terms"]] == [-5.0, -7.0]
    # Correlation .5 / root(1 * 4), deviations 2 and 2.
    np.testing.assert_allclose(priors["lower"][1], [0.25 * 4.0, 4.0])


@pytest.mark.parametrize(
    ("entry", "words", "remedy"),
    [
        ({"terms": ["K_q"]}, "no such coefficient", "K_p"),
        ({"terms": ["K_pdot"]}, "no such coefficient", "K_p"),
    ],
)
def test_unknown_terms_are_refused_with_the_nearest(
    tmp_path: Path, entry: dict[str, Any], words: str, remedy: str
) -> None:
    with pytest.raises(CampaignError, match=words) as refused:
        source(tmp_path, BENCH, bench="results.json", **entry)
    assert refused.value.field == "priors[0].terms[0]"
    assert remedy in (refused.value.remedy or "")


def test_other_units_and_files_without_a_figure_are_refused(tmp_path: Path) -> None:
    row = {"quantity": "K_p", "value": -1.2, "unit": "1", "standard_error": 0.1}
    with pytest.raises(CampaignError, match="another unit"):
        source(tmp_path, {"title": "roll", "rows": [row]}, bench="results.json")
    with pytest.raises(CampaignError, match="no coefficient of damping"):
        source(tmp_path, {"title": "roll", "rows": []}, bench="results.json")


@pytest.mark.parametrize("entry", [{}, {"bench": "a.json", "campaign": "b.json"}])
def test_an_entry_names_one_source(entry: dict[str, str]) -> None:
    with pytest.raises(ValueError, match="name one source"):
        PriorEntry.model_validate(entry)


def test_a_published_set_gives_its_damping_each_by_itself() -> None:
    path = shelf_files()["bluerov2_wu_2018"]

    def prior(**entry: Any) -> dict[str, Any]:
        return prior_source(
            PriorEntry(shelf="bluerov2_wu_2018", **entry), path, named_in=path, field="priors[0]"
        )

    everything = prior()
    check_document({"sources": [everything]}, "prior_sources")
    assert (everything["kind"], everything["file"]) == ("shelf", "bluerov2_wu_2018")
    published = load_published(path).published
    assert {(item["axis"], item["term"]) for item in everything["terms"]} == {
        (item.axis, item.term) for item in published.values()
    }
    roll = prior(terms=["K_p", "K_p|p|"], prior_sd=0.2, widen=2.0)
    values = [published["K_p"].value, published["K_p|p|"].value]
    assert [item["value"] for item in roll["terms"]] == values
    assert roll["lower"] == [
        [pytest.approx((0.4 * values[0]) ** 2)],
        [0.0, pytest.approx((0.4 * values[1]) ** 2)],
    ]
    with pytest.raises(CampaignError, match="no such coefficient"):
        prior(terms=["K_v"])


def test_only_a_published_set_takes_a_share() -> None:
    with pytest.raises(ValueError, match="only a published set"):
        PriorEntry(bench="a.json", prior_sd=0.3)


def test_a_campaign_names_a_set_of_the_shelf(tmp_path: Path) -> None:
    folder = tmp_path / "dive"
    folder.mkdir()
    manifest = folder / "campaign.yaml"

    def loaded(name: str) -> Campaign:
        text = {
            "kind": "identification",
            "vehicle": "bluerov2",
            "logs": [{"id": "dive", "file": "dive.BIN"}],
            "legs": [{"id": "train", "log": "dive", "start_s": 0, "end_s": 60, "use": "training"}],
            "priors": [{"shelf": name, "terms": ["K_p"]}],
        }
        manifest.write_text(json.dumps(text), encoding="utf-8")
        vehicles = {"bluerov2": SHIPPED_VEHICLES / "bluerov2.yaml"}
        return load_campaign(folder, kinds={"identification": ("synthesise",)}, vehicles=vehicles)

    (prior,) = loaded("bluerov2_wu_2018").documents["prior_sources"]["sources"]
    assert (prior["kind"], [item["term"] for item in prior["terms"]]) == ("shelf", ["p"])
    with pytest.raises(CampaignError, match="not on the shelf") as refused:
        loaded("bluerov2_wu_2019")
    assert refused.value.field == "priors[0].shelf"
    assert "bluerov2_wu_2018" in (refused.value.remedy or "")


def test_a_model_without_newtons_and_a_model_file_are_no_priors(tmp_path: Path) -> None:
    """Damping over mass is not damping, however plausible the number."""
    card = example_run({"train": 4.0, "check": 2.0}).cards["coe"].model_dump(mode="json")
    card["axes"]["X"]["terms"][0] |= {"value": -1.2, "unit": "1/s"}
    with pytest.raises(CampaignError, match=r"X_u.*other units.*'1/s'.*newtons_from"):
        source(tmp_path, card, campaign="results.json")
    with pytest.raises(CampaignError, match=r"a model file is no prior.*model_card/MODEL"):
        source(tmp_path, model_file(DAMPED).model_dump(mode="json"), campaign="results.json")


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ("models: [symetric]", r"row 8.*synthesise\.models.*Did you mean 'symmetric'"),
        ("error_function: huber", r"row 8.*physical limits"),
        ("inertia: [N_rdott]", r"row 8.*synthesise\.inertia.*N_rdott"),
    ],
)
def test_settings_that_cannot_be_are_refused_before_any_stage(
    tmp_path: Path, settings: str, words: str
) -> None:
    """No log is read for that: there is none."""
    (tmp_path / "params.yaml").write_text("{}\n")
    folder = tmp_path / "campaigns" / "dive"
    folder.mkdir(parents=True)
    manifest = f"""kind: identification
vehicle: bluerov2_heavy
logs:
  - {{id: dive, file: dive.BIN}}
legs:
  - {{id: train, log: dive, start_s: 0, end_s: 90, use: training}}
stages:
  synthesise: {{{settings}}}
"""
    (folder / "campaign.yaml").write_text(manifest)
    with pytest.raises(CampaignError, match=words):
        open_run(str(folder))
