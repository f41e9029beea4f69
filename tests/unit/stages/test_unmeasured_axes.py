"""A dive that measures neither surge nor sway: nothing gives a figure of them."""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Iterator
from functools import cache
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from auvid.data_schemas.errors import PipelineError
from auvid.data_schemas.records.model_file import ModelFile
from auvid.export.targets import TARGETS
from auvid.export.writing import prepare
from auvid.models import VehicleModel
from auvid.pipeline.commands.fleet.run_results import _terms, _verdicts
from auvid.pipeline.commands.history.run_history import _held_out, _recommended
from auvid.stages import fit_axes
from auvid.stages.fit_axes.card import model_card, ranking
from auvid.stages.fit_axes.fitted import AxisFits
from auvid.stages.fit_axes.fitting import fit_all
from auvid.stages.fit_axes.flight import FitOptions
from auvid.stages.fit_axes.presentation import fit_section, fit_views
from auvid.stages.fit_axes.scaling import scaled
from auvid.stages.model_file.contents import model_document, use_entry
from auvid.stages.report.recording.text import markdown
from auvid.stages.report.summary.answer_text import answer_text
from auvid.stages.report.summary.axes_summary import summarise_axes
from tests.support.axis_twin import leg
from tests.support.motions import shipped_vehicle

BODY = shipped_vehicle("bluerov2_heavy")
UNMEASURED = re.compile(r"^(X|Y|u|v|surge|sway)(_|$| )|: (surge|sway)$")
"""Names of keys and columns of what nothing measures."""
FIGURE = re.compile(r"\b(X_u|X_v|Y_v|Y_u|surge|sway)\b[^.:;|]*?(?<![\w.])-?\d")
"""A number in the clause that names it."""


@cache
def fits() -> AxisFits:
    options = FitOptions(lag_s=0.08, fit_lag=False)
    return fit_all({"dive": leg()}, BODY, options)


@cache
def artefacts() -> tuple[Any, Any, ModelFile]:
    card = model_card(fits(), scaled(fits(), BODY, by="pull"), (), BODY)
    ranked = ranking(card, fits())
    file = model_document(
        card,
        BODY,
        use=use_entry(ranked, ranked.models[0], card),
        merit=ranked.models[0],
        free_runs=[],
        title="twin",
        provenance={"logs": {}, "vehicle": "0", "stages": {}, "packages": {}},
        minimum_speed_m_s=0.05,
    )
    return card, ranked, file


def figures_in(document: Any, *, below: bool = False) -> Iterator[object]:
    """Yield the figures at keys of the unmeasured, and in entries whose axis that is."""
    if isinstance(document, dict):
        below = below or document.get("axis") in ("X", "Y")
        for key, value in document.items():
            yield from figures_in(value, below=below or UNMEASURED.search(str(key)) is not None)
    elif isinstance(document, list | tuple):
        for item in document:
            yield from figures_in(item, below=below)
    elif below and isinstance(document, float) and not np.isnan(document):
        yield document


def test_the_twin_measures_heave_and_yaw_alone() -> None:
    assert [item.axis for item in fits().fitted] == ["Z", "N"]
    assert {item.axis for item in fits().lacking} == set("XYKM")


def test_the_card_and_its_ranking_have_none() -> None:
    card, ranked, _ = artefacts()
    assert list(figures_in(card.model_dump())) == []
    assert list(figures_in(ranked.model_dump())) == []
    assert list(figures_in({"Z": {"axis": "X", "value": 0.0}})) == [0.0]


def test_the_model_file_has_none_but_those_of_the_vehicle_file() -> None:
    document = artefacts()[2].model_dump()
    of_vehicle = {key: document.pop(key) for key in ("vehicle", "dynamics")}
    assert of_vehicle["dynamics"]["mass"][0][0] > 0.0
    assert list(figures_in(document)) == []
    assert {item["axis"] for item in document["coefficients"]} == {"Z", "N"}


def test_tables_have_empty_columns() -> None:
    motion = next(
        fit_axes._motion_table(parts, np.arange(len(parts[0].t_s)))
        for parts in [[item.motion[0] for item in fits().fitted]]
    )
    tables = [motion, fit_axes._free_run(fits(), "axes"), fit_axes._fit_table(fits())]
    for table in tables:
        for name in table.column_names:
            if re.search(r"(^|_)[uv]_(m_s|rms|fit)", name):
                assert not np.isfinite(table[name].to_numpy()).any(), name
    assert "Z" in tables[2]["axis"].to_pylist()
    assert not {"X", "Y"} & set(tables[2]["axis"].to_pylist())


def test_pages_texts_and_views_name_them_without_a_number() -> None:
    card, ranked, _ = artefacts()
    summary = summarise_axes(card, ranked, {}, {}, BODY, {})
    assert {item.part for item in summary.figures} == {"heave", "yaw"}
    assert {item.name[0] for item in summary.coefficients} <= set("ZNmI")
    section = json.dumps(fit_section(fits(), card))
    texts = [answer_text(summary), markdown("a dive", summary, {}, {}), summary.explanation]
    for text in texts:
        assert re.search("surge", text, re.IGNORECASE) is not None
        assert FIGURE.search(text) is None, FIGURE.search(text)
    assert re.search(r'"[XY]_', section) is None
    views = fit_views({"dive": [item.motion[0] for item in fits().fitted]}, ["Z", "N"])
    assert re.search("surge|sway|_[uv]_", json.dumps(views)) is None


def test_history_and_fleet_have_none() -> None:
    card, ranked, _ = artefacts()
    kept = {"ranking": [ranked], "model_card": [card]}
    run = cast("Any", SimpleNamespace(documents=lambda name: iter(kept[name])))
    assert list(figures_in([_recommended(run), _held_out(card)])) == []
    assert {item.axis for item in _terms(card, recommended=True)} == {"Z", "N"}
    assert list(figures_in([item.model_dump() for item in _verdicts(ranked, [card])])) == []


def test_python_gives_no_row_and_no_force() -> None:
    model = VehicleModel(artefacts()[2])
    assert set(model.coefficients["axis"]) == {"Z", "N"}
    force = model.force(np.full(6, 0.3))
    for part in (force.viscous, force.coriolis, force.restoring):
        assert np.isnan(part[:2]).all()
    assert np.isfinite(force.viscous[[2, 5]]).all()


@pytest.mark.parametrize("target", sorted(TARGETS))
def test_exports_refuse_or_have_none(target: str) -> None:
    file = artefacts()[2]
    if target not in ("python", "json", "draws"):
        with pytest.raises(PipelineError, match="surge"):
            prepare(file, target, lossy=True, force=True)
        return
    written = prepare(file, target, lossy=True, force=True, draws=3).files
    for name, text in written.items():
        if name.endswith(".json"):
            document = json.loads(text)
            for key in ("vehicle", "dynamics"):
                document.pop(key)
            assert list(figures_in(document)) == []
        elif name.endswith(".csv"):
            heads = next(csv.reader(io.StringIO(text)))
            assert not [head for head in heads if UNMEASURED.search(head)]
        elif name.endswith(".py"):
            space: dict[str, Any] = {}
            exec(text, space)
            assert np.isnan(space["viscous"]((0.3,) * 6)[:2]).all()
