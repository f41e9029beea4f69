"""What the page of a reproduction says: first screen, explanation, tables, bounds, and what was chosen."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from data_schemas.errors import CampaignError, nearest
from hydro.dynamics.physical_viscous import physical_viscous
from hydro.dynamics.vehicle import Vehicle
from stages.base import Document
from stages.report.reproduction_findings import SETS, TURN_TERMS, Check, Found, total
from stages.report.summary import Fact, Summary
from stages.sections import AXES, Block, equation, remark, section, table, text

REFERENCE_SPEED_M_S = 2.0
FORCED_ERROR_SHARE = 0.5
"""From this share of the force on, the error of the residual force makes its table one of the procedure, not of the vehicle."""
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

    @cached_property
    def variants(self) -> dict[str, Document]:
        return {entry["id"]: entry for entry in self.document["variants"]}

    def of(self, plan: str) -> dict[str, Found]:
        """Variants that were run on a plan, in the order of the document."""
        return {name: self.found[f"{plan}/{name}"] for name in self.variants if f"{plan}/{name}" in self.found}

    def label(self, variant: str) -> str:
        return f"({self.variants[variant]['label']})"

    def compared(self, role: str) -> tuple[str, Found]:
        """The label and the findings of a variant that the words speak of, on the first plan."""
        name = str(self.document["compared"][role])
        found = self.of(self.plan)
        if name not in found:
            raise CampaignError("not a variant of the first plan", field=f"compared.{role}", value=name, remedy=nearest(name, found))
        return self.label(name), found[name]

    @cached_property
    def printed(self) -> dict[tuple[str, str], Document]:
        """Published rows by set and model."""
        return {(row["set"], row["model"]): row for row in self.published["rows"]}

    @cached_property
    def transport(self) -> tuple[float, float]:
        """What omega x v adds to the sway force per u r, m - Y_vdot, and what is there rightly, m - X_udot [kg]."""
        return self.vehicle.mass_kg - float(self.vehicle.added_mass[1, 1]), self.vehicle.mass_kg - float(self.vehicle.added_mass[0, 0])

    @property
    def missed(self) -> list[Check]:
        """Bounds that are not met, and of which nothing says why."""
        return [item for item in self.checks if not item.met and not item.known]


def summary(told: Told) -> Summary:
    """The first screen."""
    first, published = told.compared("published")
    second, corrected = told.compared("corrected")
    loose = [model for model in ("uncoupled", "fossen") if ("validation", model) in published.scores]
    use = "validation" if "validation" in published.j0 else "training"
    mine = [check for check in told.checks if f"{check.plan}/{check.variant}" == f"{told.plan}/{told.document['compared']['published']}"]
    agrees = bool(mine) and all(check.met for check in mine)
    words = f"The published procedure {first} on the twin gives J0 = {published.j0[use]:.1f} on {use}"
    words += f" (thesis {_printed_j0(told, use):.1f}). " if (use, "fossen") in told.printed else ". "
    for name, item in ((first, published), (second, corrected)):
        figures = ", ".join(f"{item.scores[(use, model)].title} {item.scores[(use, model)].ratio:.2f}" for model in loose)
        words += f"With {name} J/J0 is {figures}. " if figures else ""
    known = sum(not item.met and bool(item.known) for item in told.checks)
    met = sum(item.met for item in told.checks)
    explained = (
        "The published table comes out when the accelerometer is taken for the rate of change of velocity"
        if agrees
        else "The published table does not come out"
    )
    force = total(published.force)
    facts = (
        Fact(
            "bounds met",
            f"{met} of {len(told.checks)}",
            f"{known} more are missed for a reason that is named" if known else "none is missed",
        ),
        Fact(f"wrong force in {first}", f"{total(published.force_error):.1f}", f"RMS over six axes; the true force has {force:.1f}"),
        Fact(f"wrong force in {second}", f"{total(corrected.force_error):.2f}", "with the transport term taken off"),
        Fact("sway force per u r", f"{published.turn:.0f} kg", f"{first}; {corrected.turn:.0f} kg with {second}"),
    )
    return Summary(
        level="poor" if told.missed else "good" if agrees else "fair",
        headline=explained,
        explanation=f"{words}A strong hypothesis, not a proof: the thesis's own data would have to be processed again.",
        take=None,
        judged_on=use,
        facts=facts,
        models=(),
        identified=(),
        missing=tuple(_open_ends(told)),
        warnings=tuple(f"{item.asked}: {_range(item)}, asked {_bounds(item)} ({item.plan}, {item.variant})" for item in told.missed),
    )


def _open_ends(told: Told) -> Iterator[str]:
    yield "The field data of the thesis are not public; times and angles of its steps, and the noise of its sensors, are assumed."
    for known in dict.fromkeys(item.known for item in told.checks if item.known and not item.met):
        where = dict.fromkeys(
            f"{told.label(item.variant)} on plan {item.plan}" for item in told.checks if item.known == known and not item.met
        )
        yield f"Bounds missed by {', '.join(where)}: {known}."


def sections(told: Told) -> dict[str, dict[str, Any]]:
    """The sections before the figures, by name."""
    shown = {
        "why": section("Why the published tables look as they do", list(_why(told)), order=2),
        "tables": section(
            "Tables 5.1 and 5.2 beside the twin's",
            [*_variant_words(told), *_tables(told, told.plan, printed=True), *_notes(told)],
            order=3,
            look_for=f"Column {told.compared('published')[0]} against the thesis; then the last two models where the force is right.",
        ),
        "asked": section("What was asked, and what came out", [_asked(told)], order=4),
        "force": section("How well the force and the motion are known", list(_force(told)), order=5),
        "chosen": section("What was chosen, and what was not", list(_chosen(told)), order=8),
    }
    for index, entry in enumerate(told.document["plans"][1:]):
        if told.of(entry["id"]):
            words = f"Plan {entry['id']}: {entry['meaning']}."
            blocks = [text(words), *_tables(told, entry["id"], printed=False)]
            shown[f"plan{index}"] = section(f"The same tables on plan {entry['id']}", blocks, order=6 + index)
    return shown


def _why(told: Told) -> Iterator[Block]:
    first, published = told.compared("published")
    second, corrected = told.compared("corrected")
    extra, right = told.transport
    yield text(
        "An accelerometer feels how its point accelerates against inertial space. With gravity taken off it measures the rate of "
        "change of body velocity and, in a turn, the transport term. McCarter 2.5 takes it for the first alone, (2.84)-(2.88)."
    )
    yield equation(r"a = \dot{v} + \omega \times v", "What an accelerometer measures at the body origin, gravity taken off.")
    yield equation(
        r"Y: \quad (m - Y_{\dot v})\dot v + (m - X_{\dot u}) u r \to (m - Y_{\dot v})(\dot v + u r) + (m - X_{\dot u}) u r",
        f"So u r is counted twice in the sway force: {extra:.1f} kg too much beside the {right:.1f} kg that belong there, "
        f"{extra + right:.1f} kg in all.",
    )
    yield text(
        "A force that grows with u r and that no water exerts then stands in the data. Models with a term in u r can follow it, and their "
        "J/J0 looks good because J0 has grown. Uncoupled and Fossen have no term that couples sway to yaw: they miss almost all of it. The "
        "velocity that is integrated from the same signal leaves the measured one, so that the moments, above all the Munk moment in N, "
        "are wrong too."
    )
    yield _evidence(told, extra, right)
    yield _turn_table(told)
    gap, limit = published.sway_gap, 0.1
    if gap is not None:
        words = f"Integrated and measured sway differ by up to {gap:.2f} m/s RMS with {first}"
        words += f", by {corrected.sway_gap:.2f} m/s with {second}" if corrected.sway_gap is not None else ""
        words += f". Beyond {limit} m/s the report of a run warns: of {len(published.warnings)} legs with {first}, "
        words += f"of {len(corrected.warnings)} with {second}. Section 5.1 of the thesis remarks on such a mismatch in its own data."
        yield remark(words, "finding")
    share = total(published.force_error) / total(published.force)
    if share > FORCED_ERROR_SHARE:
        yield remark(
            f"With {first} the error of the residual force is {share:.0%} of the true force: the table is one of the procedure as much "
            "as of the vehicle, and the published coefficients may carry it.",
            "finding",
        )


def _evidence(told: Told, extra: float, right: float) -> Block:
    rows = [
        [
            f"{told.label(name)} {entry['title']}",
            item.turn,
            item.turn_added,
            total(item.force_error),
            item.j0.get("training"),
            item.j0.get("validation"),
        ]
        for name, item in told.of(told.plan).items()
        for entry in [told.variants[name]]
    ]
    note = (
        f"Sway force over all training legs, fitted by c u r with the true u r. Expected from the masses: {extra:.1f} kg too much with the "
        "transport term left in."
    )
    heads: list[str | tuple[str, str]] = [
        "procedure",
        ("c", "kg"),
        ("of it wrong", "kg"),
        "RMS error of the force",
        "J0 training",
        "J0 validation",
    ]
    return table("How much of the sway force goes with u r", heads, rows, note=note)


def _turn_table(told: Told) -> Block:
    shown = told.of(told.plan)
    heads = ["model", "term", "thesis", *(told.label(name) for name in shown)]
    rows: list[Cells] = []
    models = dict.fromkeys(model for item in shown.values() for model in item.turn_terms)
    for model in models:
        term = next(item.turn_terms[model][0] for item in shown.values() if model in item.turn_terms)
        printed = told.published["coefficients"].get(model, {}).get("Y", {})
        thesis = next((printed[name] for name in TURN_TERMS if name in printed), None)
        rows.append([_model_title(told, model), term, thesis, *(item.turn_terms.get(model, ("", None))[1] for item in shown.values())])
    note = (
        f"Coefficient of the transport term in Y [kg]; {sum(told.transport):.1f} if u r were counted twice and nothing else went with it. "
        "In closed loop v follows r, so that single coefficients trade off against each other: the difference between the columns counts."
    )
    return table("The coefficient that carries it", heads, rows, note=note)


def _model_title(told: Told, model: str) -> str:
    return next((score.title for item in told.found.values() for (_, name), score in item.scores.items() if name == model), model)


def _variant_words(told: Told) -> Iterator[Block]:
    yield text(
        "; ".join(f"{told.label(name)} {entry['title']}" for name, entry in told.variants.items() if name in told.of(told.plan)) + "."
    )


def _tables(told: Told, plan: str, *, printed: bool) -> Iterator[Block]:
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
            head: Cells = [scores[0].title, *([row["n_bar_printed"] if row else None] if thesis else []), scores[0].n_bar, scores[0].rank]
            ratios.append([*head, *([row["ratio_recomputed"] if row else None] if thesis else []), *(score.ratio for score in scores)])
            sizes.append([*head, *([row["J"] if row else None] if thesis else []), *(score.j for score in scores)])
        j0 = [item.j0[use] for item in shown.values()]
        none: Cells = ["no model: J0", *([0] if thesis else []), 0, 0, *([_printed_j0(told, use)] if thesis else []), *j0]
        heads = ["model", *(["n-bar thesis"] if thesis else []), "n-bar", "rank"]
        note = "J is the RMS error over six axes, N and N m mixed, as the thesis has it."
        yield table(
            f"{where}: J/J0", [*heads, *(f"J/J0 {name}" for name in names)], ratios, note="0 is perfect, 1 explains nothing." * printed
        )
        yield table(f"{where}: J", [*heads, *names], [*sizes, none], note=note * printed)


def _order(told: Told, use: str, shown: Mapping[str, Found]) -> list[str]:
    """Models in the order of the published table, then those that are not in it."""
    fitted = [model for kind, model in next(iter(shown.values())).scores if kind == use]
    listed = [model for kind, model in told.printed if kind == use]
    return [model for model in listed if model in fitted] + [model for model in fitted if model not in listed]


def _printed_j0(told: Told, use: str) -> float:
    return float(next((row["J0"] for (kind, _), row in told.printed.items() if kind == use), float("nan")))


def _notes(told: Told) -> Iterator[Block]:
    for row in told.printed.values():
        if abs(row["ratio_printed"] - row["ratio_recomputed"]) > 0.002:
            ours = [
                f"{told.label(name)} {item.scores[(row['set'], row['model'])].ratio:.3f}"
                for name, item in told.of(told.plan).items()
                if (row["set"], row["model"]) in item.scores
            ]
            yield remark(
                f"Table {row['table']}, {_model_title(told, row['model'])}: J = {row['J']:.3f} over J0 = {row['J0']:.3f} is "
                f"{row['ratio_recomputed']:.3f}, but the table prints {row['ratio_printed']:.3f}, which belongs to "
                f"J = {row['ratio_printed'] * row['J0']:.2f}. {row['note']}. The twin gives {', '.join(ours)}.",
                "note",
            )
    rows = [(row, told.of(told.plan)) for (use, model), row in told.printed.items() if model == "uncoupled" and use == "validation"]
    for row, shown in rows:
        score = next(iter(shown.values())).scores.get(("validation", "uncoupled"))
        if score is not None:
            yield remark(
                f"Uncoupled has n-bar {row['n_bar_printed']} in Tables 5.1 and 5.2, but 22 in Figure 5.14 and Table E.10, where X_u and "
                f"X_u|u| are missing. The vehicle only moves ahead, so u = |u| and u² = u|u|: of the {score.n_bar} terms here the data "
                f"determine {score.rank}, and of each pair only the sum. Both counts are right: one of terms, one of what can be known.",
                "note",
            )
    yield remark(
        "For the same reason Coe is fitted with 33 of its 36 terms in the thesis: X, Z and M have no u|u| beside u².",
        "note",
    )


def _asked(told: Told) -> Block:
    rows = [
        [
            item.plan,
            f"{told.label(item.variant)} {item.variant}",
            item.asked,
            _bounds(item),
            _range(item),
            "met" if item.met else "missed",
            item.known if not item.met else "",
        ]
        for item in told.checks
    ]
    note = "Measured: from the least to the most of several values. A bound that is missed without a reason makes the command fail."
    return table("Asked and measured", ["plan", "variant", "figure", "asked", "measured", "", "reason"], rows, note=note)


def _bounds(item: Check) -> str:
    if item.low is not None and item.high is not None:
        return f"{item.low:g} to {item.high:g}"
    return f"at least {item.low:g}" if item.low is not None else f"at most {item.high:g}" if item.high is not None else "any"


def _range(item: Check) -> str:
    return f"{item.least:.3g}" if item.least == item.most else f"{item.least:.3g} to {item.most:.3g}"


def _force(told: Told) -> Iterator[Block]:
    plans = [entry["id"] for entry in told.document["plans"] if told.of(entry["id"])]
    pairs = [(plan, name, item) for plan in plans for name, item in told.of(plan).items()]
    rows = [
        [plan, told.label(name), total(item.force_error), total(item.force), *map(float, item.force_error)] for plan, name, item in pairs
    ]
    note = (
        "Residual force minus the true viscous and unsteady force, all legs. Not zero for true states: they are interpolated between the "
        "ticks of the simulation, at which the unsteady force and the fins have kinks."
    )
    yield table("Residual force: RMS error against the truth", ["plan", "variant", "error", "true force", *AXES], rows, note=note)
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
        ("accelerometer bias", "m/s²"),
        ("sway gap", "m/s"),
    ]
    rows = [
        [plan, told.label(name), *map(float, item.velocity_error), item.gyro_bias, item.accel_bias, item.sway_gap]
        for plan, name, item in pairs
    ]
    note = "Biases: RMS over legs and axes. Sway gap: largest RMS of a leg of found minus measured sway."
    yield table("Motion and biases: RMS error against the truth", heads, rows, note=note)


def _chosen(told: Told) -> Iterator[Block]:
    yield text(
        "Two things were chosen so that the forces are as large as those behind the published tables: the size of the manoeuvres and the "
        f"unsteady force of plan {told.plan}. Nothing else was fitted to the tables: mass, inertia, added mass, fins and propeller are the "
        "published ones, the noise of the sensors is assumed, and the viscous force is flow physics outside the span of all eight models."
    )
    keys = ("yaw_scale", "yaw_steps", "depth_scale", "depth_steps", "depth_m", "unsteady", "settle_s", "fins", "sensors")
    rows: list[Cells] = [[key, *(_plain(plan.get(key)) for plan in told.plans.values())] for key in keys]
    yield table("What the plans say", ["key", *told.plans], rows, note="Steps are multiplied by their scale.")
    legs = [[leg["id"], leg["use"], leg["manoeuvre"], leg["rpm"], leg["duration_s"]] for leg in told.plans[told.plan]["legs"]]
    yield table(f"Legs of plan {told.plan}", ["leg", "use", "manoeuvre", ("speed", "rpm"), ("length", "s")], legs)
    if told.vehicle.fins is not None:
        yield _derivatives(told)
    rows = [[told.label(name), entry["title"], _settings(entry)] for name, entry in told.variants.items()]
    yield table("Parameters that differ from the defaults", ["variant", "", "parameters"], rows)


def _derivatives(told: Told) -> Block:
    force, step = physical_viscous(told.vehicle), 1e-3
    rows = []
    for name, index in (("v", 1), ("r", 5)):
        nu = np.zeros((2, 6))
        nu[:, 0], nu[:, index] = REFERENCE_SPEED_M_S, (step, -step)
        above, below = force.force(nu)
        slope = (above - below) / (2.0 * step * REFERENCE_SPEED_M_S)
        rows += [[f"Y_{name}", float(slope[1])], [f"N_{name}", float(slope[5])]]
    note = "Of the flow physics, at 2 m/s straight ahead, per m/s of u. The truth of the twin if the manifest says physics."
    return table("Effective derivatives of the viscous truth", ["derivative", "value (SI)"], rows, note=note)


def _settings(entry: Document) -> str:
    parts = [f"{stage}.{key} = {_plain(value)}" for stage, values in (entry.get("stages") or {}).items() for key, value in values.items()]
    return ", ".join(parts) or "none"


def _plain(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {_plain(item)}" for key, item in value.items())
    if isinstance(value, Sequence) and not isinstance(value, str):
        return " ".join(_plain(item) for item in value)
    return {None: "none", True: "yes", False: "no"}.get(value, str(value)) if value is None or isinstance(value, bool) else str(value)


__all__ = ["SETS", "Told", "sections", "summary"]
