"""Tables of a reproduction: errors, bounds, force and motion, variants and plans."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from auvid.hydro.arrays import AXES
from auvid.hydro.dynamics.simulation.physical_viscous import physical_viscous
from auvid.stages.base import Document
from auvid.stages.presentation import Block, remark, table, text
from auvid.stages.reference_check import EACH, JUDGED, check_rows
from auvid.stages.reproduce.content import ReproductionContent
from auvid.stages.reproduce.measures import TURN_TERMS, VariantMeasures

Cells = list[Any]
REFERENCE_SPEED_M_S = 2.0
PRINTED_DIFFERENCE = 0.002
"""A printed J/J0 further than this from its J over J0 is an error of the print."""
PLAN_KEYS = (
    "yaw_scale",
    "yaw_steps",
    "depth_scale",
    "depth_steps",
    "depth_m",
    "unsteady",
    "settle_s",
    "fins",
    "sensors",
)


def variant_titles(content: ReproductionContent) -> Block:
    return text(
        "; ".join(
            f"{content.label(name)} {content.variants[name]['title']}"
            for name in content.of(content.plan)
        )
        + "."
    )


def error_tables(content: ReproductionContent, plan: str, *, printed: bool) -> Iterator[Block]:
    """J/J0 and J of every variant on a plan, beside the published ones if `printed`."""
    variants = content.of(plan)
    labels = [content.label(name) for name in variants]
    for use, number in (("validation", "5.1"), ("training", "5.2")):
        if not all(use in item.j0 for item in variants.values()):
            continue
        models = _order(content, use, variants)
        thesis = printed and any((use, model) in content.printed for model in models)

        def cells(value: Any, thesis: bool = thesis) -> Cells:
            """Return a published value, where the thesis has a column."""
            return [value] if thesis else []

        ratios: list[Cells] = []
        sizes: list[Cells] = []
        for model in models:
            row: Document = content.printed.get((use, model), {})
            scores = [item.scores[use, model] for item in variants.values()]
            first = scores[0]
            head = [first.title, *cells(row.get("n_bar_printed")), first.n_bar, first.rank]
            ratios.append(
                [*head, *cells(row.get("ratio_recomputed")), *(score.ratio for score in scores)]
            )
            sizes.append([*head, *cells(row.get("J")), *(score.j for score in scores)])
        sizes.append(
            [
                "no model: J0",
                *cells(0),
                0,
                0,
                *cells(content.printed_j0(use)),
                *(item.j0[use] for item in variants.values()),
            ]
        )
        heads = ["model", *cells("n-bar thesis"), "n-bar", "rank"]
        names = [*cells("thesis"), *labels]
        where = f"Table {number} ({use})" if printed else f"{use.capitalize()}"
        note = "J is the RMS error over six axes, N and N m mixed, as in the thesis."
        yield table(
            f"{where}: J/J0",
            [*heads, *(f"J/J0 {name}" for name in names)],
            ratios,
            note="0 is perfect, 1 explains nothing." if printed else "",
        )
        yield table(f"{where}: J", [*heads, *names], sizes, note=note if printed else "")


def repeats(content: ReproductionContent) -> Iterator[Block]:
    """Return the table of repeated runs of the published procedure.

    On the first plan, flown again with other random numbers.
    """
    name = str(content.document["compared"]["published"])
    flights = {
        plan: content.measures[f"{plan}/{name}"]
        for plan in (content.plan, *content.repeated)
        if f"{plan}/{name}" in content.measures
    }
    if len(flights) < 2:
        return
    seeds = {entry["id"]: entry.get("seed") for entry in content.document["plans"]}
    heads = ["model"]
    for plan in flights:
        seed = "seed of the manifest" if seeds[plan] is None else f"seed {seeds[plan]}"
        heads.append(f"J/J0 {seed}")
    for use in ("validation", "training"):
        if not all(use in item.j0 for item in flights.values()):
            continue
        rows = [
            [
                content.model_title(model),
                *(item.scores[use, model].ratio for item in flights.values()),
            ]
            for model in _order(content, use, flights)
        ]
        j0 = ", ".join(f"{item.j0[use]:.2f}" for item in flights.values())
        note = (
            f"J0: {j0}. The table does not distinguish models that differ by less than the draws"
            " of noise and unsteady force."
        )
        title = f"{content.label(name)} with other random numbers, {use}: J/J0"
        yield table(title, heads, rows, note=note)


def _order(
    content: ReproductionContent, use: str, variants: Mapping[str, VariantMeasures]
) -> list[str]:
    """Return models in the order of the published table, then all others."""
    fitted = [model for of, model in next(iter(variants.values())).scores if of == use]
    listed = [model for of, model in content.printed if of == use]
    return [model for model in listed if model in fitted] + [
        model for model in fitted if model not in listed
    ]


def print_errors(content: ReproductionContent) -> Iterator[Block]:
    """A note on each published row whose J/J0 is not its J over its J0."""
    for (use, model), row in content.printed.items():
        if abs(row["ratio_printed"] - row["ratio_recomputed"]) > PRINTED_DIFFERENCE:
            ours = ", ".join(
                f"{content.label(name)} {item.scores[use, model].ratio:.3f}"
                for name, item in content.of(content.plan).items()
                if (use, model) in item.scores
            )
            yield remark(
                f"Table {row['table']}, {content.model_title(model)}: J = {row['J']:.3f} over J0"
                f" = {row['J0']:.3f} is {row['ratio_recomputed']:.3f}, but the table prints"
                f" {row['ratio_printed']:.3f}, which belongs to J ="
                f" {row['ratio_printed'] * row['J0']:.2f}. {row['note']}. The twin gives {ours}."
            )


def check_table(content: ReproductionContent) -> Block:
    checks = [
        ((item.plan, f"{content.label(item.variant)} {item.variant}"), item.check)
        for item in content.checks
    ]
    note = "A bound that is missed without an accepted reason makes the command fail."
    rows = check_rows(("plan", "variant"), checks, JUDGED)
    reasons = dict.fromkeys(
        f"{EACH[item.check.evidence].capitalize()}: {item.check.evidence_reason}."
        for item in content.checks
    )
    return table("Required and measured", *rows, note=" ".join([note, *reasons]))


def force_tables(content: ReproductionContent) -> Iterator[Block]:
    """RMS errors of force, motion and biases of every variant on every plan."""
    items = [
        (entry["id"], content.label(name), item)
        for entry in content.document["plans"]
        if entry["id"] not in content.repeated
        for name, item in content.of(entry["id"]).items()
    ]
    yield table(
        "Residual force: RMS error against the truth",
        ["plan", "variant", "error", "true force", *AXES],
        [
            [plan, label, item.total_force_error, item.total_force, *map(float, item.force_error)]
            for plan, label, item in items
        ],
        note=(
            "Residual force minus the true viscous and unsteady force, all legs. True states are"
            " interpolated between the ticks of the simulation, at which the unsteady force and"
            " the fins have kinks; so their error is not zero."
        ),
    )
    yield table(
        "Motion and biases: RMS error against the truth",
        [
            "plan",
            "variant",
            *((name, "m/s") for name in "uvw"),
            *((name, "rad/s") for name in "pqr"),
            ("gyro bias", "rad/s"),
            ("accel. bias", "m/s²"),
            ("sway gap", "m/s"),
        ],
        [
            [
                plan,
                label,
                *map(float, item.velocity_error),
                item.gyro_bias,
                item.accel_bias,
                item.sway_gap,
            ]
            for plan, label, item in items
        ],
        note=(
            "Biases: RMS over legs and axes. Sway gap: largest RMS, over the legs, of estimated"
            " minus measured sway."
        ),
    )


def turn_force_table(content: ReproductionContent) -> Block:
    """Return the sway force that grows with u r, by procedure."""
    rows = [
        [
            f"{content.label(name)} {content.variants[name]['title']}",
            item.turn,
            item.turn_added,
            item.total_force_error,
            item.j0.get("training"),
            item.j0.get("validation"),
        ]
        for name, item in content.of(content.plan).items()
    ]
    return table(
        "How much of the sway force goes with u r",
        [
            "procedure",
            ("c", "kg"),
            ("error of c", "kg"),
            "RMS error of the force",
            "J0 training",
            "J0 validation",
        ],
        rows,
        note=(
            "Sway force over all training legs, fitted by c u r with the true u r. Expected from"
            f" the masses: {content.transport[0]:.1f} kg too much with the transport term left in."
        ),
    )


def turn_term_table(content: ReproductionContent) -> Block:
    """Return the coefficient of each model that carries the transport term."""
    variants = content.of(content.plan)
    terms = {
        model: term
        for item in reversed(variants.values())
        for model, (term, _) in item.turn_terms.items()
    }
    models = dict.fromkeys(model for item in variants.values() for model in item.turn_terms)
    rows: list[Cells] = []
    for model in models:
        printed = content.published["coefficients"].get(model, {}).get("Y", {})
        thesis = next((printed[name] for name in TURN_TERMS if name in printed), None)
        values = [item.turn_terms.get(model, ("", None))[1] for item in variants.values()]
        rows.append([content.model_title(model), terms[model], thesis, *values])
    return table(
        "The coefficient that carries it",
        ["model", "term", "thesis", *(content.label(name) for name in variants)],
        rows,
        note=(
            f"Coefficient of the transport term in Y [kg]; {sum(content.transport):.1f} if u r were"
            " counted twice and nothing else went with it. In closed loop v follows r, so that"
            " single coefficients trade off against each other: the difference between the columns"
            " counts."
        ),
    )


def plan_tables(content: ReproductionContent) -> Iterator[Block]:
    """The plans, their legs, the viscous force of the twin, and the variants."""
    yield table(
        "The plans",
        ["key", *content.flown],
        [[key, *(_plain(plan.get(key)) for plan in content.flown.values())] for key in PLAN_KEYS],
        note="Steps are multiplied by their scale.",
    )
    legs = [
        [leg["id"], leg["use"], leg["manoeuvre"], leg["rpm"], leg["duration_s"]]
        for leg in content.plans[content.plan]["legs"]
    ]
    yield table(
        f"Legs of plan {content.plan}",
        ["leg", "use", "manoeuvre", ("speed", "rpm"), ("length", "s")],
        legs,
    )
    if content.vehicle.fins is not None:
        yield _derivatives(content)
    rows = [
        [content.label(name), entry["title"], _settings(entry)]
        for name, entry in content.variants.items()
    ]
    yield table("Parameters that differ from the defaults", ["variant", "", "parameters"], rows)


def _derivatives(content: ReproductionContent) -> Block:
    force, step = physical_viscous(content.vehicle), 1e-3
    rows = []
    for name, index in (("v", 1), ("r", 5)):
        nu = np.zeros((2, 6))
        nu[:, 0], nu[:, index] = REFERENCE_SPEED_M_S, (step, -step)
        above, below = force.force(nu)
        slope = (above - below) / (2.0 * step * REFERENCE_SPEED_M_S)
        rows += [[f"Y_{name}", float(slope[1])], [f"N_{name}", float(slope[5])]]
    return table(
        "Effective derivatives of the viscous truth",
        ["derivative", "value (SI)"],
        rows,
        note=(
            "Of the flow physics, at 2 m/s straight ahead, per m/s of u. This is the truth of the"
            " twin if the manifest says physics."
        ),
    )


def _settings(entry: Document) -> str:
    parts = [
        f"{stage}.{key} = {_plain(value)}"
        for stage, values in (entry.get("stages") or {}).items()
        for key, value in values.items()
    ]
    return ", ".join(parts) or "none"


def _plain(value: Any) -> str:
    if value is None:
        return "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {_plain(item)}" for key, item in value.items())
    if isinstance(value, Sequence) and not isinstance(value, str):
        return " ".join(map(_plain, value))
    return str(value)
