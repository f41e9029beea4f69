"""What the page of a reproduction says: first screen, explanation, tables, bounds, and
what was chosen.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from auvid.hydro.dynamics.simulation.physical_viscous import physical_viscous
from auvid.stages.base import Document
from auvid.stages.page.first_screen import Fact, Summary
from auvid.stages.presentation import Block, equation, remark, section, table, text
from auvid.stages.reproduce.measures import TURN_TERMS, total
from auvid.stages.reproduce.tables import (
    Cells,
    Told,
    asked,
    bounds,
    error_tables,
    force_tables,
    model_title,
    printed_j0,
    repeats,
    row_notes,
    value_range,
    variant_words,
)

REFERENCE_SPEED_M_S = 2.0
FORCED_ERROR_SHARE = 0.5
"""From this share of the force on, the error of the residual force makes its table one
of the procedure, not of the vehicle.
"""


def summary(told: Told) -> Summary:
    """The first screen."""
    first, published = told.compared("published")
    second, corrected = told.compared("corrected")
    loose = [
        model for model in ("uncoupled", "fossen") if ("validation", model) in published.scores
    ]
    use = "validation" if "validation" in published.j0 else "training"
    mine = [
        check
        for check in told.checks
        if f"{check.plan}/{check.variant}"
        == f"{told.plan}/{told.document['compared']['published']}"
    ]
    agrees = bool(mine) and all(check.met for check in mine)
    words = (
        f"The published procedure {first} on the twin gives J0 = {published.j0[use]:.1f} on {use}"
    )
    words += f" (thesis {printed_j0(told, use):.1f}). " if (use, "fossen") in told.printed else ". "
    for name, item in ((first, published), (second, corrected)):
        figures = ", ".join(
            f"{item.scores[(use, model)].title} {item.scores[(use, model)].ratio:.2f}"
            for model in loose
        )
        words += f"With {name} J/J0 is {figures}. " if figures else ""
    known = sum(not item.met and bool(item.known) for item in told.checks)
    met = sum(item.met for item in told.checks)
    explained = (
        "The published table comes out when the accelerometer is taken for the rate of change of"
        " velocity"
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
        Fact(
            f"wrong force in {first}",
            f"{total(published.force_error):.1f}",
            f"RMS over six axes; the true force has {force:.1f}",
        ),
        Fact(
            f"wrong force in {second}",
            f"{total(corrected.force_error):.2f}",
            "with the transport term taken off",
        ),
        Fact(
            "sway force per u r",
            f"{published.turn:.0f} kg",
            f"{first}; {corrected.turn:.0f} kg with {second}",
        ),
    )
    return Summary(
        level="poor" if told.missed else "good" if agrees else "fair",
        headline=explained,
        explanation=(
            f"{words}A strong hypothesis, not a proof: the thesis's own data would have to be"
            " processed again."
        ),
        take=None,
        judged_on=use,
        facts=facts,
        models=(),
        identified=(),
        missing=tuple(_open_ends(told)),
        warnings=tuple(
            f"{item.asked}: {value_range(item)}, asked {bounds(item)} ({item.plan}, {item.variant})"
            for item in told.missed
        ),
    )


def _open_ends(told: Told) -> Iterator[str]:
    yield (
        "The field data of the thesis are not public; times and angles of its steps, and the noise"
        " of its sensors, are assumed."
    )
    for known in dict.fromkeys(item.known for item in told.checks if item.known and not item.met):
        where = dict.fromkeys(
            f"{told.label(item.variant)} on plan {item.plan}"
            for item in told.checks
            if item.known == known and not item.met
        )
        yield f"Bounds missed by {', '.join(where)}: {known}."


def sections(told: Told) -> dict[str, dict[str, Any]]:
    """The sections before the figures, by name."""
    shown = {
        "why": section("Why the published tables look as they do", list(_why(told)), order=2),
        "tables": section(
            "Tables 5.1 and 5.2 beside the twin's",
            [
                *variant_words(told),
                *error_tables(told, told.plan, printed=True),
                *repeats(told),
                *row_notes(told),
            ],
            order=3,
            look_for=(
                f"Column {told.compared('published')[0]} against the thesis; then the last two"
                " models where the force is right."
            ),
        ),
        "asked": section("What was asked, and what came out", [asked(told)], order=4),
        "force": section(
            "How well the force and the motion are known", list(force_tables(told)), order=5
        ),
        "chosen": section("What was chosen, and what was not", list(_chosen(told)), order=8),
    }
    for index, entry in enumerate(told.document["plans"]):
        if entry["id"] not in (told.plan, *told.repeated) and told.of(entry["id"]):
            words = f"Plan {entry['id']}: {entry['meaning']}."
            blocks = [text(words), *error_tables(told, entry["id"], printed=False)]
            shown[f"plan{index}"] = section(
                f"The same tables on plan {entry['id']}", blocks, order=6
            )
    return shown


def _why(told: Told) -> Iterator[Block]:
    first, published = told.compared("published")
    second, corrected = told.compared("corrected")
    extra, right = told.transport
    yield text(
        "An accelerometer feels how its point accelerates against inertial space. With gravity"
        " taken off it measures the rate of change of body velocity and, in a turn, the transport"
        " term. McCarter 2.5 takes it for the first alone, (2.84)-(2.88)."
    )
    yield equation(
        r"a = \dot{v} + \omega \times v",
        "What an accelerometer measures at the body origin, gravity taken off.",
    )
    yield equation(
        r"Y: \quad (m - Y_{\dot v})\dot v + (m - X_{\dot u}) u r \to (m - Y_{\dot v})(\dot v + u r)"
        r" + (m - X_{\dot u}) u r",
        f"So u r is counted twice in the sway force: {extra:.1f} kg too much beside the {right:.1f}"
        f" kg that belong there, {extra + right:.1f} kg in all.",
    )
    yield text(
        "A force that grows with u r and that no water exerts then stands in the data. Models with"
        " a term in u r can follow it, and their J/J0 looks good because J0 has grown. Uncoupled"
        " and Fossen have no term that couples sway to yaw: they miss almost all of it. The"
        " velocity that is integrated from the same signal leaves the measured one, so that the"
        " moments, above all the Munk moment in N, are wrong too."
    )
    yield _evidence(told, extra, right)
    yield _turn_table(told)
    gap, limit = published.sway_gap, 0.1
    if gap is not None:
        words = f"Integrated and measured sway differ by up to {gap:.2f} m/s RMS with {first}"
        words += (
            f", by {corrected.sway_gap:.2f} m/s with {second}"
            if corrected.sway_gap is not None
            else ""
        )
        words += (
            f". Beyond {limit} m/s the report of a run warns: of {len(published.warnings)} legs"
            f" with {first}, "
        )
        words += (
            f"of {len(corrected.warnings)} with {second}. Section 5.1 of the thesis remarks on such"
            " a mismatch in its own data."
        )
        yield remark(words, "finding")
    share = total(published.force_error) / total(published.force)
    if share > FORCED_ERROR_SHARE:
        yield remark(
            f"With {first} the error of the residual force is {share:.0%} of the true force: the"
            " table is one of the procedure as much as of the vehicle, and the published"
            " coefficients may carry it.",
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
        "Sway force over all training legs, fitted by c u r with the true u r. Expected from the"
        f" masses: {extra:.1f} kg too much with the transport term left in."
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
        term = next(
            item.turn_terms[model][0] for item in shown.values() if model in item.turn_terms
        )
        printed = told.published["coefficients"].get(model, {}).get("Y", {})
        thesis = next((printed[name] for name in TURN_TERMS if name in printed), None)
        rows.append(
            [
                model_title(told, model),
                term,
                thesis,
                *(item.turn_terms.get(model, ("", None))[1] for item in shown.values()),
            ]
        )
    note = (
        f"Coefficient of the transport term in Y [kg]; {sum(told.transport):.1f} if u r were"
        " counted twice and nothing else went with it. In closed loop v follows r, so that single"
        " coefficients trade off against each other: the difference between the columns counts."
    )
    return table("The coefficient that carries it", heads, rows, note=note)


def _chosen(told: Told) -> Iterator[Block]:
    yield text(
        "Two things were chosen so that the forces are as large as those behind the published"
        f" tables: the size of the manoeuvres and the unsteady force of plan {told.plan}. Nothing"
        " else was fitted to the tables: mass, inertia, added mass, fins and propeller are the"
        " published ones, the noise of the sensors is assumed, and the viscous force is flow"
        " physics outside the span of all eight models."
    )
    yield text(
        "Areas and stall angles of the flow physics, gains of the autopilot, and times and angles"
        " of the steps are free choices. Stall angles, induced drag and one gain were changed once,"
        " after the tables of plan default had been seen: before, the fins stalled in its large"
        " manoeuvres. So the ease of that plan for simple models is partly a choice."
    )
    keys = (
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
    rows: list[Cells] = [
        [key, *(_plain(plan.get(key)) for plan in told.flown.values())] for key in keys
    ]
    yield table(
        "What the plans say",
        ["key", *told.flown],
        rows,
        note="Steps are multiplied by their scale.",
    )
    legs = [
        [leg["id"], leg["use"], leg["manoeuvre"], leg["rpm"], leg["duration_s"]]
        for leg in told.plans[told.plan]["legs"]
    ]
    yield table(
        f"Legs of plan {told.plan}",
        ["leg", "use", "manoeuvre", ("speed", "rpm"), ("length", "s")],
        legs,
    )
    if told.vehicle.fins is not None:
        yield _derivatives(told)
    rows = [
        [told.label(name), entry["title"], _settings(entry)]
        for name, entry in told.variants.items()
    ]
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
    note = (
        "Of the flow physics, at 2 m/s straight ahead, per m/s of u. The truth of the twin if the"
        " manifest says physics."
    )
    return table(
        "Effective derivatives of the viscous truth", ["derivative", "value (SI)"], rows, note=note
    )


def _settings(entry: Document) -> str:
    parts = [
        f"{stage}.{key} = {_plain(value)}"
        for stage, values in (entry.get("stages") or {}).items()
        for key, value in values.items()
    ]
    return ", ".join(parts) or "none"


def _plain(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {_plain(item)}" for key, item in value.items())
    if isinstance(value, Sequence) and not isinstance(value, str):
        return " ".join(_plain(item) for item in value)
    return (
        {None: "none", True: "yes", False: "no"}.get(value, str(value))
        if value is None or isinstance(value, bool)
        else str(value)
    )
