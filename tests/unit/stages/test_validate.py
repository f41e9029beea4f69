"""The stage validate: every error measure against its formula, the tables that a user
reads, and what they must not hide.
"""

from __future__ import annotations

import tracemalloc
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from auvid.data_schemas.documents import check_document
from auvid.data_schemas.errors import CampaignError, DataError
from auvid.data_schemas.tables import matrix
from auvid.hydro.arrays import AXES, Array
from auvid.hydro.dynamics.viscous.models import IdentifiedModel
from auvid.hydro.long_series import threads
from auvid.stages import synthesise, validate
from auvid.stages.base import Collection, collection
from auvid.stages.columns import VELOCITY, force_columns
from tests.support.motions import residual_table, rich_motion, segment_document, shipped_vehicle

LEGS = {"one": "training", "two": "training", "check": "validation", "far": "validation"}
MODELS = ("linear", "fossen", "pitch_yaw")


def legs(trim: float = 0.0, names: tuple[str, ...] = tuple(LEGS)) -> dict[str, tuple[Array, Array]]:
    """Velocities and forces of legs of different length: linear and quadratic drag,
    sway coupled with yaw, noise.
    """
    rng = np.random.default_rng(11)
    by_leg = {}
    for seed, name in enumerate(LEGS, start=1):
        nu = rich_motion(6.0 + seed, seed=seed, ahead=False).nu * (2.0 if name == "far" else 1.0)
        force = -30.0 * nu - 20.0 * nu * np.abs(nu) + rng.normal(0.0, 2.0, nu.shape) + trim
        force[:, 1] += 15.0 * nu[:, 5] * nu[:, 0]
        if name in names:
            by_leg[name] = (nu, force)
    return by_leg


def run(
    data: Mapping[str, tuple[Array, Array]],
    *,
    trim: bool = False,
    use: Mapping[str, str] = LEGS,
    leg: Mapping[str, str] | None = None,
) -> tuple[dict[str, Any], validate.Outputs]:
    tables = collection({name: residual_table(*values) for name, values in data.items()})
    segments = collection(
        {name: segment_document(name, use[name], leg=(leg or {}).get(name)) for name in data}
    )
    params = synthesise.Params(models=MODELS, trim=trim)
    cards = dict(
        synthesise.run(
            synthesise.Inputs(tables, segments, shipped_vehicle("bluerov2_heavy")), params
        ).model_card
    )
    outputs = validate.run(validate.Inputs(collection(cards), tables, segments), validate.Params())
    check_document(outputs.error_metrics, "error_metrics")
    return cards, outputs


def rows(outputs: validate.Outputs) -> dict[tuple[str, str, str, str], dict[str, Any]]:
    return {
        (row["use"], row["leg"], row["model"], row["axis"]): row
        for row in outputs.error_table.to_pylist()
    }


def remarks(outputs: validate.Outputs, level: str) -> list[str]:
    return [
        block["text"]
        for block in outputs.section["blocks"]
        if block["kind"] == "remark" and block["level"] == level
    ]


@pytest.fixture(scope="module")
def judged() -> tuple[dict[str, Any], validate.Outputs]:
    return run(legs())


@pytest.mark.parametrize(
    "chosen",
    [("training", "all"), ("validation", "all"), ("validation", "far"), ("training", "two")],
)
def test_measures_are_those_of_their_formulas(
    judged: tuple[dict[str, Any], validate.Outputs], chosen: tuple[str, str]
) -> None:
    cards, outputs = judged
    data = {
        name: values
        for name, values in legs().items()
        if LEGS[name] == chosen[0] and chosen[1] in ("all", name)
    }
    nu, measured = (np.concatenate([values[index] for values in data.values()]) for index in (0, 1))
    table = rows(outputs)
    for model in MODELS:
        error = IdentifiedModel(model, cards[model].predictor).force(nu) - measured
        for axis, part in (
            ("all", slice(None)),
            *((axis, [index]) for index, axis in enumerate(AXES)),
        ):
            row, e, f = table[(*chosen, model, axis)], error[:, part], measured[:, part]
            expected = {
                "sse": np.sum(e**2),  # (4.22)
                "mae": np.sum(np.abs(e)) / e.size,  # (4.23)
                "mse": np.sum(e**2) / e.size,  # (4.24)
                "rms": np.sqrt(np.sum(e**2) / e.size),  # (4.25)
                "mad": sum(np.median(np.abs(column)) for column in e.T),  # (4.27)
                "j0": np.sqrt(np.mean(f**2)),
                "ratio": np.sqrt(np.sum(e**2) / np.sum(f**2)),
            }
            assert {name: row[name] for name in expected} == pytest.approx(expected, rel=1e-9)
            assert row["samples"] == len(nu)


def test_total_is_the_sum_over_axes(judged: tuple[dict[str, Any], validate.Outputs]) -> None:
    table = rows(judged[1])
    for model in MODELS:
        total, parts = (
            table[("validation", "all", model, "all")],
            [table[("validation", "all", model, axis)] for axis in AXES],
        )
        assert total["sse"] == pytest.approx(sum(part["sse"] for part in parts))
        assert total["mad"] == pytest.approx(sum(part["mad"] for part in parts))
        assert total["n_bar"] == sum(part["n_bar"] for part in parts)
        assert total["rank"] == sum(part["rank"] for part in parts)


def test_predictions_are_the_models_at_the_velocities(
    judged: tuple[dict[str, Any], validate.Outputs],
) -> None:
    cards, outputs = judged
    assert list(outputs.predictions) == list(LEGS)
    table = outputs.predictions["check"].to_pandas()
    nu, _ = legs()["check"]
    assert list(table["model"].unique()) == list(MODELS)
    for model in MODELS:
        part = table[table["model"] == model]
        assert set(part["segment"]) == {"check"}
        expected = IdentifiedModel(model, cards[model].predictor).force(nu)
        np.testing.assert_allclose(
            part.filter(like="tau_").to_numpy(), expected, rtol=1e-12, atol=1e-12
        )


def test_metrics_hold_the_figures_of_the_table(
    judged: tuple[dict[str, Any], validate.Outputs],
) -> None:
    _, outputs = judged
    table = rows(outputs)
    for use in ("training", "validation"):
        for model in MODELS:
            figures = outputs.error_metrics[use][model]
            assert figures["J"] == pytest.approx(table[(use, "all", model, "all")]["rms"], rel=1e-5)
            assert figures["ratio"] == pytest.approx(
                table[(use, "all", model, "all")]["ratio"], rel=1e-5
            )
            assert figures["N"] == pytest.approx(table[(use, "all", model, "N")]["ratio"], rel=1e-5)


def test_segments_of_one_leg_count_together() -> None:
    data = {f"check.{number}": values for number, values in enumerate(legs().values(), start=1)}
    use = {
        "check.1": "training",
        "check.2": "training",
        "check.3": "validation",
        "check.4": "validation",
    }
    leg = {"check.1": "a", "check.2": "a", "check.3": "b", "check.4": "b"}
    table = rows(run(data, use=use, leg=leg)[1])
    assert {key[1] for key in table} == {"all", "a", "b"}
    for column in ("sse", "samples", "mad"):
        assert (
            table[("validation", "b", "linear", "X")][column]
            == table[("validation", "all", "linear", "X")][column]
        )


def test_text_is_in_the_layout_of_the_thesis(
    judged: tuple[dict[str, Any], validate.Outputs],
) -> None:
    lines = judged[1].tables_text.decode("utf-8").splitlines()
    table = rows(judged[1])
    starts = [index for index, line in enumerate(lines) if "McCarter Table" in line]
    assert [lines[index].split(" ")[0] for index in starts] == ["Validation", "Training"]
    assert f"J0 = {table[('validation', 'all', 'linear', 'all')]['j0']:.3f}" in lines[starts[0]]
    head = lines[starts[0] + 2]
    assert head.split() == ["model", "n-bar", "identified", "J", "J/J0", *AXES]
    body = lines[starts[0] + 3 : starts[0] + 6]
    assert len({len(line) for line in (head, *body)}) == 1
    linear = table[("validation", "all", "linear", "all")]
    per_axis = [f"{table[('validation', 'all', 'linear', axis)]['ratio']:.3f}" for axis in AXES]
    merits = {item.name: item.axes["all"].identified for item in judged[1].ranking.models}
    assert body[0].split() == [
        "Linear",
        "36",
        str(merits["linear"]),
        f"{linear['rms']:.3f}",
        f"{linear['ratio']:.3f}",
        *per_axis,
    ]
    assert all(line == line.rstrip() for line in lines)


def test_model_that_fails_is_shown_to_fail() -> None:
    """A model whose quadratic terms were fitted to slow motion and then asked at ten
    times the speed.
    """
    data = legs()
    slow = {name: (0.1 * nu, force) for name, (nu, force) in data.items()}
    slow["far"] = (3.0 * data["far"][0], -30.0 * data["far"][0])
    _, outputs = run(slow)
    warnings = remarks(outputs, "warning")
    (failing,) = (
        words
        for words in warnings
        if "fail in some axes on validation, where the error exceeds the force itself: " in words
    )
    assert "Fossen (X " in failing
    assert rows(outputs)[("validation", "all", "fossen", "X")]["ratio"] > 1.0
    assert any(
        "leave the range of the training legs" in words and "every model extrapolates" in words
        for words in warnings
    )


def test_range_table_compares_training_and_validation(
    judged: tuple[dict[str, Any], validate.Outputs],
) -> None:
    blocks = {block.get("title"): block for block in judged[1].section["blocks"]}
    data = legs()
    fitted = np.concatenate([data[name][0] for name in ("one", "two")])
    used = np.concatenate([data[name][0] for name in ("check", "far")])
    table_rows = blocks["Range of motion: fitted in, judged in"]["rows"]
    assert [row[:2] for row in table_rows] == [
        [name, "m/s" if name in "uvw" else "rad/s"] for name in "uvwpqr"
    ]
    for row, before, after in zip(table_rows, fitted.T, used.T, strict=True):
        outside = 100.0 * np.mean((after < before.min()) | (after > before.max()))
        assert row[2:] == pytest.approx(
            [before.min(), before.max(), after.min(), after.max(), outside]
        )
    assert max(row[-1] for row in table_rows) > 5.0


def test_no_warning_of_range_where_validation_stays_inside() -> None:
    data = legs(names=("one", "two", "check"))
    data["check"] = (data["one"][0][50:200], data["one"][1][50:200])
    assert remarks(run(data)[1], "warning") == []


@pytest.mark.parametrize("trim", [True, False])
def test_constant_alone_is_a_reference_row(trim: bool) -> None:
    data = legs(trim=40.0)
    _, outputs = run(data, trim=trim)
    mean = np.concatenate([data[name][1] for name in ("one", "two")]).mean(axis=0)
    measured = np.concatenate([data[name][1] for name in ("check", "far")])
    j = np.sqrt(np.mean((measured - mean) ** 2, axis=0))
    blocks = {block.get("title"): block for block in outputs.section["blocks"]}
    title = "Validation errors, in the layout of McCarter Table 5.1 and (4.22)-(4.27)"
    last = blocks[title]["rows"][-1]
    assert last[0] == "constant alone"
    assert last[3] == pytest.approx(np.sqrt(np.mean((measured - mean) ** 2)))
    assert last[4:10] == pytest.approx(j)
    ratios = [outputs.ranking.constant[axis] for axis in AXES]
    assert ratios == pytest.approx(j / np.sqrt(np.mean(measured**2, axis=0)))
    assert outputs.tables_text.decode("utf-8").count("constant alone") == 2
    assert "constant alone" not in {row["model"] for row in outputs.error_table.to_pylist()}


def test_model_no_better_than_its_constant_is_remarked() -> None:
    data = legs(trim=40.0)
    check, far = data["check"], data["far"]
    data["check"] = (check[0], np.full_like(check[1], 40.0) + 5.0 * np.sign(check[0]))
    data["far"] = (far[0], np.full_like(far[1], 40.0))
    _, outputs = run(data, trim=True)
    assert any(
        "Linear predicts no better than a constant force alone in" in words
        for words in remarks(outputs, "note")
    )


def test_no_validation_leg_is_a_counted_warning() -> None:
    _, outputs = run(legs(names=("one", "two")))
    (warning,) = remarks(outputs, "warning")
    assert "nothing says how far these models hold outside the data" in warning
    titles = [block.get("title", "") for block in outputs.section["blocks"]]
    assert any("Table 5.2" in title for title in titles)
    assert not any("Table 5.1" in title for title in titles)
    assert outputs.error_metrics["validation"] == {}
    assert set(outputs.error_metrics["training"]) == set(MODELS)
    assert "Validation" not in outputs.tables_text.decode("utf-8")


def test_views_name_what_there_is(judged: tuple[dict[str, Any], validate.Outputs]) -> None:
    for group in judged[1].views["groups"]:
        stage, segment = group["table"].split("/")
        assert stage == "predictions"
        assert set(group["columns"]) <= set(judged[1].predictions[segment].column_names)
        assert group["filter"]["model"] in MODELS


def test_leg_called_all_is_refused() -> None:
    data = {"all": legs()["one"]}
    with pytest.raises(CampaignError, match="may not be called 'all'"):
        run(data, use={"all": "training"})


def lazy_leg(seed: int, samples: int = 12_000) -> pa.Table:
    """A leg made when it is asked for: waves in all velocities, drag and noise."""
    rng = np.random.default_rng(seed)
    nu = 0.5 * np.sin(np.arange(samples)[:, None] * rng.uniform(0.01, 0.02, 6) + seed)
    return residual_table(nu, -30.0 * nu + (1.0 + seed) * rng.normal(size=nu.shape))


def test_memory_is_that_of_one_leg_and_the_errors_those_of_all_samples() -> None:
    """Four times the legs need hardly more memory: sums of errors merge, medians are found
    in a second pass, and predictions are made when they are written.
    """
    solution = {axis: {name: -29.0} for axis, name in zip(AXES, "uvwpqr", strict=True)}
    cards, _ = run(legs(names=("one", "check")))
    card = cards["linear"].model_copy(update={"predictor": solution})
    peaks = {}
    for count in (1, 3, 12):
        names = [f"leg_{number}" for number in range(count)]
        inputs = validate.Inputs(
            collection({"linear": card}),
            Collection({name: partial(lazy_leg, seed) for seed, name in enumerate(names)}),
            collection({name: segment_document(name) for name in names}),
        )
        tracemalloc.start()
        outputs = validate.run(inputs, validate.Params())
        peaks[count] = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    # One leg is 12,000 rows of 13 columns, 1.2 MB, and as much again for its errors.
    assert peaks[12] < 1.15 * peaks[3]
    tables = [lazy_leg(seed) for seed in range(12)]
    nu, measured = (
        np.concatenate([matrix(table, columns) for table in tables])
        for columns in (VELOCITY, force_columns("tau_bar"))
    )
    error = np.abs(-29.0 * nu - measured)
    for axis, size, force in zip(AXES, error.T, measured.T, strict=True):
        row = rows(outputs)[("training", "all", "linear", axis)]
        assert row["mad"] == pytest.approx(np.median(size), rel=1e-12)
        assert row["mae"] == pytest.approx(np.mean(size), rel=1e-12)
        assert row["j0"] == pytest.approx(np.sqrt(np.mean(force**2)), rel=1e-12)
    assert outputs.predictions["leg_7"].num_rows == 12_000


def test_memory_of_a_training_leg_does_not_grow_with_the_models(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Forces of one model a thread are in memory: .6 MB each on this leg of 12,000 rows."""
    monkeypatch.setattr(threads, "THREADS", 2)
    cards, _ = run(legs(names=("one", "check")))
    peaks = {}
    for count in (1, 16):
        some = {f"m{k}": cards["linear"].model_copy(update={"name": f"m{k}"}) for k in range(count)}
        inputs = validate.Inputs(
            collection(some),
            Collection({"leg": partial(lazy_leg, 1)}),
            collection({"leg": segment_document("leg")}),
        )
        tracemalloc.start()
        validate.run(inputs, validate.Params())
        peaks[count] = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert peaks[16] < 1.5 * peaks[1]  # forces of all 16 at once: 2.4


def test_the_residual_force_is_never_read_with_all_its_components() -> None:
    cards, at_once = run(legs(names=("one", "check")))
    tables = {name: residual_table(*legs()[name]) for name in ("one", "check")}

    def part_of(key: str, columns: Sequence[str]) -> pa.Table:
        names = {"t_s", *columns}
        return tables[key].select([name for name in tables[key].column_names if name in names])

    inputs = validate.Inputs(
        collection(cards),
        Collection(dict.fromkeys(tables, lambda: pytest.fail("read as a whole")), part_of),
        collection({name: segment_document(name, LEGS[name]) for name in tables}),
    )
    outputs = validate.run(inputs, validate.Params())
    assert outputs.error_table.equals(at_once.error_table)
    assert outputs.predictions["one"].equals(at_once.predictions["one"])


def test_force_without_motion_has_no_ratio() -> None:
    """An axis without force has J0 = 0: its ratio is missing, not an error or a zero."""
    data = legs(names=("one", "check"))
    for nu, force in data.values():
        nu[:, 3], force[:, 3] = 0.0, 0.0
    _, outputs = run(data)
    assert rows(outputs)[("validation", "all", "fossen", "K")]["j0"] == 0.0
    assert np.isnan(rows(outputs)[("validation", "all", "fossen", "K")]["ratio"])
    assert outputs.error_metrics["validation"]["fossen"]["K"] is None


def test_no_model_is_refused() -> None:
    tables = collection({"one": residual_table(*legs()["one"])})
    segments = collection({"one": segment_document("one")})
    with pytest.raises(DataError, match="no model"):
        validate.run(validate.Inputs(collection({}), tables, segments), validate.Params())
