"""The tables on the page of a reproduction: errors beside the published ones, bounds,
and what is known of force and motion.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from auvid.data_schemas.errors import CampaignError, nearest
from auvid.hydro.arrays import AXES
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.stages.base import Document
from auvid.stages.presentation import Block, remark, table, text
from auvid.stages.reproduce.measures import Check, Found, total

Cells = list[Any]


@dataclass(frozen=True)
class Told:
    """Everything that the words are made of; `found` is keyed `plan/variant`."""

    document: Document
    published: Document
    vehicle: Vehicle
    plans: Mapping[str, Document]
    found: Mapping[str, Found]
    checks: tuple[Check, ...]

    @property
    def plan(self) -> str:
        """The plan that is held against the published tables."""
        return str(self.document["plans"][0]["id"])

    @property
    def repeated(self) -> list[str]:
        """Plans that fly the first one again with other random numbers."""
        first, *others = self.document["plans"]
        return [entry["id"] for entry in others if entry["plan"] == first["plan"]]

    @property
    def flown(self) -> dict[str, Document]:
        """The plans without those that are repeated."""
        return {name: plan for name, plan in self.plans.items() if name not in self.repeated}

    @cached_property
    def variants(self) -> dict[str, Document]:
        return {entry["id"]: entry for entry in self.document["variants"]}

    def of(self, plan: str) -> dict[str, Found]:
        """Variants that were run on a plan, in the order of the document."""
        return {
            name: self.found[f"{plan}/{name}"]
            for name in self.variants
            if f"{plan}/{name}" in self.found
        }

    def label(self, variant: str) -> str:
        return f"({self.variants[variant]['label']})"

    def compared(self, role: str) -> tuple[str, Found]:
        """The label and the findings of a variant that the words speak of, on the first
        plan.
        """
        name = str(self.document["compared"][role])
        found = self.of(self.plan)
        if name not in found:
            raise CampaignError(
                "not a variant of the first plan",
                field=f"compared.{role}",
                value=name,
                remedy=nearest(name, found),
            )
        return self.label(name), found[name]

    @cached_property
    def printed(self) -> dict[tuple[str, str], Document]:
        """Published rows by set and model."""
        return {(row["set"], row["model"]): row for row in self.published["rows"]}

    @cached_property
    def transport(self) -> tuple[float, float]:
        """What omega x v adds to the sway force per u r, m - Y_vdot, and what is there
        rightly, m - X_udot [kg].
        """
        return self.vehicle.mass_kg - float(
            self.vehicle.added_mass[1, 1]
        ), self.vehicle.mass_kg - float(self.vehicle.added_mass[0, 0])

    @property
    def missed(self) -> list[Check]:
        """Bounds that are not met, and of which nothing says why."""
        return [item for item in self.checks if not item.met and not item.known]


def model_title(told: Told, model: str) -> str:
    return next(
        (
            score.title
            for item in told.found.values()
            for (_, name), score in item.scores.items()
            if name == model
        ),
        model,
    )


def variant_words(told: Told) -> Iterator[Block]:
    yield text(
        "; ".join(
            f"{told.label(name)} {entry['title']}"
            for name, entry in told.variants.items()
            if name in told.of(told.plan)
        )
        + "."
    )


def error_tables(told: Told, plan: str, *, printed: bool) -> Iterator[Block]:
    shown = told.of(plan)
    for use, number in (("validation", "5.1"), ("training", "5.2")):
        if not all(use in item.j0 for item in shown.values()):
            continue
        models = _order(told, use, shown)
        thesis = printed and any((use, model) in told.printed for model in models)
        where = f"Table {number} ({use})" if printed else f"{use.capitalize()}"
        names = [*(["thesis"] if thesis else []), *(told.label(name) for name in shown)]
        ratios: list[Cells] = []
        sizes: list[Cells] = []
        for model in models:
            row = told.printed.get((use, model))
            scores = [item.scores[(use, model)] for item in shown.values()]
            head: Cells = [
                scores[0].title,
                *([row["n_bar_printed"] if row else None] if thesis else []),
                scores[0].n_bar,
                scores[0].rank,
            ]
            ratios.append(
                [
                    *head,
                    *([row["ratio_recomputed"] if row else None] if thesis else []),
                    *(score.ratio for score in scores),
                ]
            )
            sizes.append(
                [
                    *head,
                    *([row["J"] if row else None] if thesis else []),
                    *(score.j for score in scores),
                ]
            )
        j0 = [item.j0[use] for item in shown.values()]
        none: Cells = [
            "no model: J0",
            *([0] if thesis else []),
            0,
            0,
            *([printed_j0(told, use)] if thesis else []),
            *j0,
        ]
        heads = ["model", *(["n-bar thesis"] if thesis else []), "n-bar", "rank"]
        note = "J is the RMS error over six axes, N and N m mixed, as the thesis has it."
        yield table(
            f"{where}: J/J0",
            [*heads, *(f"J/J0 {name}" for name in names)],
            ratios,
            note="0 is perfect, 1 explains nothing." * printed,
        )
        yield table(f"{where}: J", [*heads, *names], [*sizes, none], note=note * printed)


def repeats(told: Told) -> Iterator[Block]:
    """The published procedure on the first plan, flown again with other noise and
    unsteady force.
    """
    name = str(told.document["compared"]["published"])
    shown = {
        plan: told.found[f"{plan}/{name}"]
        for plan in (told.plan, *told.repeated)
        if f"{plan}/{name}" in told.found
    }
    if len(shown) < 2:
        return
    seeds = {entry["id"]: entry.get("seed") for entry in told.document["plans"]}
    label = told.label(name)
    heads = [
        "model",
        *(
            f"J/J0 {'seed of the manifest' if seeds[plan] is None else f'seed {seeds[plan]}'}"
            for plan in shown
        ),
    ]
    for use in ("validation", "training"):
        if not all(use in item.j0 for item in shown.values()):
            continue
        rows: list[Cells] = []
        for model in _order(told, use, shown):
            rows.append(
                [
                    model_title(told, model),
                    *(item.scores[(use, model)].ratio for item in shown.values()),
                ]
            )
        j0 = ", ".join(f"{item.j0[use]:.2f}" for item in shown.values())
        note = (
            f"J0: {j0}. Models that differ by less than the draws of noise and unsteady force do"
            " are not told apart by the table."
        )
        yield table(f"{label} with other random numbers, {use}: J/J0", heads, rows, note=note)


def _order(told: Told, use: str, shown: Mapping[str, Found]) -> list[str]:
    """Models in the order of the published table, then those that are not in it."""
    fitted = [model for kind, model in next(iter(shown.values())).scores if kind == use]
    listed = [model for kind, model in told.printed if kind == use]
    return [model for model in listed if model in fitted] + [
        model for model in fitted if model not in listed
    ]


def printed_j0(told: Told, use: str) -> float:
    return float(
        next((row["J0"] for (kind, _), row in told.printed.items() if kind == use), float("nan"))
    )


def row_notes(told: Told) -> Iterator[Block]:
    for row in told.printed.values():
        if abs(row["ratio_printed"] - row["ratio_recomputed"]) > 0.002:
            ours = [
                f"{told.label(name)} {item.scores[(row['set'], row['model'])].ratio:.3f}"
                for name, item in told.of(told.plan).items()
                if (row["set"], row["model"]) in item.scores
            ]
            yield remark(
                f"Table {row['table']}, {model_title(told, row['model'])}: J = {row['J']:.3f} over"
                f" J0 = {row['J0']:.3f} is {row['ratio_recomputed']:.3f}, but the table prints"
                f" {row['ratio_printed']:.3f}, which belongs to J ="
                f" {row['ratio_printed'] * row['J0']:.2f}. {row['note']}. The twin gives"
                f" {', '.join(ours)}.",
                "note",
            )
    rows = [
        (row, told.of(told.plan))
        for (use, model), row in told.printed.items()
        if model == "uncoupled" and use == "validation"
    ]
    for row, shown in rows:
        score = next(iter(shown.values())).scores.get(("validation", "uncoupled"))
        if score is not None:
            yield remark(
                f"Uncoupled has n-bar {row['n_bar_printed']} in Tables 5.1 and 5.2, but 22 in"
                " Figure 5.14 and Table E.10, where X_u and X_u|u| are missing. The vehicle only"
                f" moves ahead, so u = |u| and u² = u|u|: of the {score.n_bar} terms here the data"
                f" determine {score.rank}, and of each pair only the sum. Both counts are right:"
                " one of terms, one of what can be known.",
                "note",
            )
    yield remark(
        "For the same reason Coe is fitted with 33 of its 36 terms in the thesis: X, Z and M have"
        " no u|u| beside u².",
        "note",
    )


def asked(told: Told) -> Block:
    rows = [
        [
            item.plan,
            f"{told.label(item.variant)} {item.variant}",
            item.asked,
            bounds(item),
            value_range(item),
            "met" if item.met else "missed",
            item.known if not item.met else "",
        ]
        for item in told.checks
    ]
    note = (
        "Measured: from the least to the most of several values. A bound that is missed without a"
        " reason makes the command fail."
    )
    return table(
        "Asked and measured",
        ["plan", "variant", "figure", "asked", "measured", "", "reason"],
        rows,
        note=note,
    )


def bounds(item: Check) -> str:
    if item.low is not None and item.high is not None:
        return f"{item.low:g} to {item.high:g}"
    return (
        f"at least {item.low:g}"
        if item.low is not None
        else f"at most {item.high:g}"
        if item.high is not None
        else "any"
    )


def value_range(item: Check) -> str:
    return (
        f"{item.least:.3g}" if item.least == item.most else f"{item.least:.3g} to {item.most:.3g}"
    )


def force_tables(told: Told) -> Iterator[Block]:
    plans = [
        entry["id"]
        for entry in told.document["plans"]
        if told.of(entry["id"]) and entry["id"] not in told.repeated
    ]
    pairs = [(plan, name, item) for plan in plans for name, item in told.of(plan).items()]
    rows = [
        [
            plan,
            told.label(name),
            total(item.force_error),
            total(item.force),
            *map(float, item.force_error),
        ]
        for plan, name, item in pairs
    ]
    note = (
        "Residual force minus the true viscous and unsteady force, all legs. Not zero for true"
        " states: they are interpolated between the ticks of the simulation, at which the unsteady"
        " force and the fins have kinks."
    )
    yield table(
        "Residual force: RMS error against the truth",
        ["plan", "variant", "error", "true force", *AXES],
        rows,
        note=note,
    )
    heads: list[str | tuple[str, str]] = [
        "plan",
        "variant",
        ("u", "m/s"),
        ("v", "m/s"),
        ("w", "m/s"),
        ("p", "rad/s"),
        ("q", "rad/s"),
        ("r", "rad/s"),
        ("gyro bias", "rad/s"),
        ("accel. bias", "m/s²"),
        ("sway gap", "m/s"),
    ]
    rows = [
        [
            plan,
            told.label(name),
            *map(float, item.velocity_error),
            item.gyro_bias,
            item.accel_bias,
            item.sway_gap,
        ]
        for plan, name, item in pairs
    ]
    note = (
        "Biases: RMS over legs and axes. Sway gap: largest RMS of a leg of found minus measured"
        " sway."
    )
    yield table("Motion and biases: RMS error against the truth", heads, rows, note=note)
