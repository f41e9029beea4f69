"""The report section of the fitted models: excitation and coefficients."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from auvid.data_schemas.records.models import MeasuredPriorCard, ModelCard, PriorCard, TermCard
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.identification.constrained.actuator_lag import ActuatorLag
from auvid.hydro.identification.constrained.equations import Unknown
from auvid.hydro.identification.constrained.statuses import moved_far
from auvid.hydro.identification.constrained.steady_current import MATTERS_M_S, SteadyCurrent
from auvid.hydro.identification.regression.assumed_figures import CURRENT, UNSTEADY, total_error
from auvid.hydro.identification.regression.excitation import VelocityExcitation
from auvid.hydro.identification.regression.least_squares import CONSTANT
from auvid.hydro.identification.regression.separability import breaks_symmetry
from auvid.hydro.identification.regression.verdicts import IDENTIFIED, WEAK, clear_of_zero
from auvid.hydro.identification.selection.axis_terms import SPARSE
from auvid.stages.model_use import clear_in_its_form, coverage_words, listed, weak_only_by
from auvid.stages.presentation import (
    NOISE_95,
    Block,
    equation,
    fold,
    half_95,
    remark,
    section,
    shift_words,
    table,
    text,
)
from auvid.stages.synthesise.error_choice import MOST_SAMPLES
from auvid.stages.synthesise.model_card import excitation_word

PRIOR_TEXT = {
    "strip_theory": "strip theory of the vehicle's geometry",
    "vehicle": "coefficients published in the vehicle file",
    "bench": "results of a bench",
    "campaign": "the model of another campaign",
    "shelf": "a published set",
}
ERROR_TEXT = {
    "squares": "the sum of squares",
    "absolute": "the sum of moduli",
    "median": "the median of moduli",
    "huber": "Huber's function",
}

SPARSE_WORDS = (
    "its terms were chosen on the legs that they are fitted to. On twins of the VT 690 its"
    " intervals held .91 of the true values of Linear and .29 of Gertler & Hagen, so none of its"
    " coefficients is called identified."
)


def synthesise_section(
    cards: Mapping[str, ModelCard],
    motion: Mapping[str, VelocityExcitation],
    warnings: Sequence[Block] = (),
) -> dict[str, Any]:
    """Return the section: warnings, excitation of every velocity, a part per model."""
    rows = [
        [
            name,
            "m/s" if name in "uvw" else "rad/s",
            item.rms,
            item.low,
            item.high,
            item.threshold,
            excitation_word(item),
            "yes" if item.changes_sign else "no",
        ]
        for name, item in motion.items()
    ]
    note = (
        "Not excited: RMS below the threshold, three times the standard deviation of the fused"
        " velocity's error, or 0.03 where that is not used. Products count"
        " as excited from 0.03 m/s or rad/s of each factor on."
        " Weak: moves, but hardly varies."
    )
    heads = ["velocity", "unit", "RMS", "lowest", "highest", "threshold", "excitation"]
    title = "Excitation in the training legs"
    blocks = [
        *warnings,
        *too_few_samples(cards),
        table(title, [*heads, "both directions"], rows, note=note),
    ]
    blocks.append(
        equation(
            r"\bar{\tau} = K \xi(\nu)",
            "Every model is a choice of terms of the viscous basis xi (McCarter 3.12).",
        )
    )
    methods: dict[str, list[str]] = {}
    for card in cards.values():
        methods.setdefault(_method(card), []).append(card.title)
    words = [f"{'; '.join(titles)}: {note}" for note, titles in methods.items()]
    blocks += fold("How the numbers and their intervals came about", list(map(text, words)))
    for card in cards.values():
        blocks += _model_blocks(card)
    return section(
        "Models and coefficients",
        blocks,
        order=50,
        look_for="A coefficient without a number is one that these data do not determine.",
    )


def _model_blocks(card: ModelCard) -> list[dict[str, Any]]:
    """Return a fold with a model's coefficients, and one with remarks on them."""
    rows, kept = [], []
    shifted = any(item.assumed_shifts for part in card.axes.values() for item in part.terms)
    budget = ["± 95 % by assumed figures"] if shifted else []
    for axis, part in card.axes.items():
        for item in part.terms:
            partners = item.inseparable_from
            verdict = f"inseparable from {', '.join(partners)}" if partners else item.verdict
            if item.turns_without:
                verdict += f"; its sign turns without {', '.join(item.turns_without)}"
            if clear_in_its_form(item):
                lacking = listed([str(Unknown(axis, term)) for term in part.lacking])
                verdict += f"; clear as a mean over the flown motion, but the form lacks {lacking}"
            elif item.verdict == WEAK and limited_far(item):
                verdict += "; limits moved it by more than two of its errors"
            elif weak_only_by(item, UNSTEADY):
                verdict += "; clear by noise, but a force that no term has moves the vehicle"
            elif sign_by_figures(item):
                verdict += "; clear by noise, but its sign rests on assumed figures"
            row = [axis, item.term, item.value, half_95(item.standard_error), item.unit]
            if budget:
                row.append(shift_words(item.assumed_shifts, item.standard_error or 0.0))
            rows.append([*row, verdict])
            kept.append(item.verdict == IDENTIFIED)
    heads = ["axis", "term", "value", NOISE_95, "unit", *budget, "verdict"]
    title = f"{card.title}: {card.n_bar} terms, {card.identified} identified" + (
        ", with a prior" if card.prior is not None else ""
    )
    coefficients = table(title, heads, rows, kept=kept)
    coefficients["coefficients_of"] = card.name
    blocks = fold(title, [coefficients])
    return blocks + fold(f"{card.title}: what stands behind it", _remarks(card))


def too_few_samples(cards: Mapping[str, ModelCard]) -> list[Block]:
    """Return a warning on models with as many terms as samples on an axis, or more."""
    most: dict[str, tuple[int, int]] = {}
    for card in cards.values():
        for part in card.axes.values():
            if (
                len(part.terms) >= part.samples
                and len(part.terms) > most.get(card.title, (0, 0))[0]
            ):
                most[card.title] = len(part.terms), part.samples
    if not most:
        return []
    models = ", ".join(f"{title} ({terms} an axis)" for title, (terms, _) in most.items())
    samples = min(count for _, count in most.values())
    return [
        remark(
            f"The training legs have {samples} samples, and these models as many terms or more:"
            f" {models}. They fit whatever was measured, and their training errors say nothing."
            " Only combinations of their terms have numbers. Train on longer legs, or leave these"
            " models out of stages.synthesise.models.",
            "warning",
        )
    ]


def limited_far(item: TermCard) -> bool:
    """Return whether limits moved a value by more than its error explains."""
    if item.value is None or not item.standard_error:
        return False
    return moved_far(
        item.value, item.free_value, total_error(item.standard_error, item.assumed_shifts)
    )


def sign_by_figures(item: TermCard) -> bool:
    """Return whether a weak term is clear by noise alone."""
    if item.verdict != WEAK or item.value is None or not item.standard_error:
        return False
    noise = item.value, item.standard_error
    return clear_of_zero(*noise) and not clear_of_zero(*noise, item.assumed_shifts.values())


def _method(card: ModelCard) -> str:
    """Return how the numbers of a card and their errors came about."""
    note = "Intervals allow for coloured residuals (blocks of time left out in turn)"
    if card.method == "error function":
        note = (
            f"Least is {ERROR_TEXT[card.error_function]}, weights {card.weights}, minimiser"
            f" {card.minimiser}. No interval of it is known here, so nothing is called identified;"
            f" whether terms are excited and can be told apart is that of least squares. At most"
            f" {MOST_SAMPLES} samples have a part in it."
        )
    elif card.velocity_errors:
        note += (
            " and for the effect of velocity errors, of the size that fuse states, on the"
            " coefficients."
        )
    else:
        note += ". Velocities count as exact: fuse gave no standard deviation of them."
    if card.method != "error function":
        note += " They hold a coefficient only if the form of the model does."
    if card.coverage_on_twins:
        note += f" {coverage_words(card.coverage_on_twins, card.method)}"
    if not card.left_out and card.method != "error function":
        note += " There is one training leg: whether signs hold without it is not tested."
    if card.spreads:
        note += (
            " By assumed figures: how far each, within its 95 %, moves the value, beside noise; the"
            " vehicle file states them (spreads), the training legs that of a steady current."
        )
    if any(part.lacking for part in card.axes.values()):
        note += (
            " What the form lacks: terms that are clear when they are added, and how far that moves"
            " the value."
        )
    if any(UNSTEADY in item.assumed_shifts for part in card.axes.values() for item in part.terms):
        note += (
            " By an unsteady force: what the force error of the training legs may lean the value,"
            " as it moves the vehicle and so goes with its velocities."
        )
    if card.assumed and not card.spreads.keys() - {CURRENT}:
        note += f" The {len(card.assumed)} assumed figures of the vehicle count as exact."
    return note


def _remarks(card: ModelCard) -> list[dict[str, Any]]:
    """Return priors, limits, inertia, sums of terms, terms that do not fit."""
    blocks = []
    if card.prior is not None:
        blocks.append(_prior_remark(card, card.prior))
    blocks += [_prior_remark(card, prior) for prior in card.measured_priors]
    blocks += _lag_blocks(card) + _limit_blocks(card)
    budget = ["± 95 % by assumed figures"] if card.spreads else []
    sums = [
        [
            axis,
            item.reading,
            half_95(item.standard_error),
            *([shift_words(item.assumed_shifts, item.standard_error or 0.0)] if budget else []),
        ]
        for axis, part in card.axes.items()
        for item in part.combinations
    ]
    if sums:
        heads = ["axis", "combination of coefficients: value", NOISE_95, *budget]
        blocks.append(
            table(
                f"{card.title}: what the data determine of inseparable terms",
                heads,
                sums,
            )
        )
    if card.not_applicable:
        words = (
            f"{card.title}: {len(card.not_applicable)} terms with the propulsion ratio do not"
            " apply without a propeller speed"
        )
        blocks.append(remark(f"{words}: {', '.join(card.not_applicable)}."))
    if card.name == SPARSE:
        blocks.append(remark(f"{card.title}: {SPARSE_WORDS}"))
    why: dict[str, list[str]] = {}
    for name, reason in card.switched_off.items():
        why.setdefault(reason.partition(" by ")[0], []).append(name)
    blocks += [
        remark(f"{card.title}: {', '.join(names)} left out: {reason}.")
        for reason, names in why.items()
    ]
    lopsided = [
        f"{axis} {item.term}"
        for axis, part in card.axes.items()
        for item in part.terms
        if item.verdict == IDENTIFIED and item.term != CONSTANT and breaks_symmetry(axis, item.term)
    ]
    if lopsided:
        several = len(lopsided) > 1
        words = (
            f"{card.title}: {', '.join(lopsided)} {'are' if several else 'is'} identified, though a"
            f" hull symmetric to port and starboard has no such term{'s' * several}."
        )
        blocks.append(
            remark(
                f"{words} Look at the thrust model, the mounting of the sensors and the load before"
                " the hull."
            )
        )
    return blocks


def lag_words(lag: ActuatorLag, spread_s: float | None) -> str:
    """Return how late the actuators are, and where that goes; spread_s: of the file."""
    usual = (
        "" if spread_s is None else f", in place of 0 +- {NORMAL_95 * spread_s:.2g} s of the file"
    )
    axes = ", ".join(
        f"{axis} {value:.2g} +- {NORMAL_95 * sd:.1g}"
        for axis, (value, sd) in lag.by_axis.items()
        if sd < lag.value_s
    )
    beside_velocity = ""
    if not lag.by_gyro:
        beside_velocity = (
            " No axis of rotation shows it, so it is not separable from the lag of the velocity"
            " log: force and motion of the models fit together either way, but a simulator needs it"
            " only if it is of the actuators. State one of the two (actuators.lag, or the lag of"
            " the dvl) in the vehicle file, or drive yaw in training."
        )
    return (
        f"The force follows the record of the actuators by {lag.value_s:.2g} +-"
        f" {NORMAL_95 * lag.sd_s:.1g} s (95 %), as a first-order lag{usual}: {axes} s by axis. All"
        " models go with this lag; without it linear damping comes out too small and quadratic too"
        f" large. stages.synthesise.actuator_lag: none leaves it out.{beside_velocity}"
    )


def stated_lag_words(stated_s: float, spread_s: float | None, measured: ActuatorLag | None) -> str:
    """Return that the lag of the vehicle file counts, and what the legs show."""
    spread = "" if spread_s is None else f" +- {NORMAL_95 * spread_s:.2g}"
    words = (
        f"The force follows the record of the actuators by {stated_s:.2g}{spread} s, as the vehicle"
        " file states (actuators.lag). All models go with this lag."
    )
    if measured is None or not measured.of_thrusters:
        return words
    of_legs = f" The training legs show {measured.value_s:.2g} +- {NORMAL_95 * measured.sd_s:.1g} s"
    if measured.departs_from(stated_s, spread_s or 0.0):
        return (
            f"{words}{of_legs}: look at the figure of the file, or delete it and the measured one"
            " counts."
        )
    return f"{words}{of_legs}."


def current_blocks(currents: Mapping[str, SteadyCurrent], scatter_m_s: float) -> list[Block]:
    """Return a warning on clear currents, a note on those that the legs leave open.

    scatter_m_s: by how much they change within dives.
    """
    blocks = []
    clear = {log: current for log, current in currents.items() if current.clear}
    if clear:
        dives = [
            f"of {log} {current.speed:.2g} m/s towards {current.bearing_deg:.0f} degrees (north"
            f" {current.value[0]:.2f} +- {NORMAL_95 * current.sd[0]:.2f}, east"
            f" {current.value[1]:.2f} +- {NORMAL_95 * current.sd[1]:.2f} m/s, 95 %)"
            for log, current in clear.items()
        ]
        entries = ", ".join(
            f"{log}: [{current.value[0]:.3f}, {current.value[1]:.3f}]"
            for log, current in clear.items()
        )
        changes = (
            f" It changes by {scatter_m_s:.2g} m/s within a dive, which no setting takes off."
            if scatter_m_s >= 0.5 * MATTERS_M_S
            else ""
        )
        words = (
            f"The forces show a steady current, {'; '.join(dives)}, and the velocities are those"
            f" over ground.{changes} It leans drag and constant forces, and their intervals count"
            " it. To take"
            f" it off, write stages.fuse.current_m_s: {{{entries}}}. A tether that pulls one way"
            " looks like one."
        )
        blocks.append(remark(words, "warning"))
    open_logs = [log for log, current in currents.items() if not current.shows]
    if open_logs:
        spread = max(float(currents[log].sd.max()) for log in open_logs)
        words = (
            f"The training legs of {', '.join(open_logs)} go too straight to show a steady current"
            " under a velocity over ground. Intervals count one of up to"
            f" {NORMAL_95 * spread:.2f} m/s (95 %); in still water, as in a tank, set"
            " stages.synthesise.current_m_s: 0. Legs that turn show it."
        )
        blocks.append(remark(words, "note"))
    return blocks


def low_pass_words(cutoff_hz: float, leaning: Mapping[str, Sequence[str]]) -> str:
    """Return that a low-pass is too low; leaning: title of a model -> coefficients."""
    models = "; ".join(f"{title} {', '.join(names)}" for title, names in leaning.items())
    return (
        f"The low-pass of {cutoff_hz:g} Hz is too low for this motion. Drag goes with products of"
        " velocities, which reach twice the band in which the vehicle moves; what the low-pass took"
        f" leans these coefficients by more than their noise and a tenth: {models}. Their"
        " intervals count it. Raise stages.fuse.cutoff_hz as far as the slowest sensor allows, or"
        " name a model in stages.refine.models: it is fitted to the sensors themselves, without a"
        " low-pass."
    )


def _lag_blocks(card: ModelCard) -> list[dict[str, Any]]:
    """Return how far the lag of the actuators moved damping."""
    values = {(axis, item.term): item for axis, part in card.axes.items() for item in part.terms}
    rows = [
        [axis, term, values[axis, term].value, moved, values[axis, term].unit]
        for axis, terms in card.moved_by_lag.items()
        for term, moved in terms.items()
    ]
    if not rows:
        return []
    note = f"By least squares: the value with the lag of {card.lag_s:.2g} s less that without."
    heads = ["axis", "term", "value", "moved by the lag", "unit"]
    return [table(f"{card.title}: what the lag of the actuators moved", heads, rows, note=note)]


def _limit_blocks(card: ModelCard) -> list[dict[str, Any]]:
    """Return what limits changed, and the inertia fitted beside the damping."""
    blocks = []
    if card.limits:
        changed = [
            [axis, item.term, item.free_value, item.value, item.unit]
            for axis, part in card.axes.items()
            for item in part.terms
            if item.free_value is not None
        ]
        changed += [
            [item.name[0], f"inertia {item.name}", item.free_value, item.value, item.unit]
            for item in card.inertia
            if item.free_value is not None
        ]
        note = f"Limits on damping: {card.damping}. They cost {card.limits_cost:.2g} of J/J0 on"
        note += f" training. Active: {'; '.join(dict.fromkeys(i.name for i in card.limits))}."
        heads = ["axis", "term", "without limits", "within limits", "unit"]
        blocks.append(table(f"{card.title}: what the limits changed", heads, changed, note=note))
    if card.inertia:
        rows = [
            [
                item.name,
                item.value,
                half_95(item.standard_error),
                *(
                    [shift_words(item.assumed_shifts, item.standard_error or 0.0)]
                    if card.spreads
                    else []
                ),
                item.in_vehicle_file,
                item.unit,
                item.lag_s,
                item.correlation,
                item.verdict,
            ]
            for item in card.inertia
        ]
        note = (
            "Total inertia, rigid body and added mass. A thrust lag fitted beside it answers to the"
            " same motion: near a correlation of 1 or -1 the two are one. Damping, inertia and"
            " thrust scale together."
        )
        columns: list[str | tuple[str, str]] = [
            "derivative",
            "inertia",
            NOISE_95,
            *(["± 95 % by assumed figures"] if card.spreads else []),
            "in the vehicle file",
            "unit",
            ("lag beside it", "s"),
            "correlation",
            "verdict",
        ]
        blocks.append(table(f"{card.title}: inertia", columns, rows, note=note))
    return blocks


def _prior_remark(card: ModelCard, prior: PriorCard | MeasuredPriorCard) -> dict[str, Any]:
    """Return which coefficients have a prior, and which the data leave to it."""
    means = prior.means
    identified = {
        (axis, item.term)
        for axis, part in card.axes.items()
        for item in part.terms
        if item.verdict == IDENTIFIED
    }
    resting = [
        f"{axis} {term}"
        for axis, terms in means.items()
        for term in terms
        if (axis, term) not in identified
    ]
    spread = (
        f"with a standard deviation of {100.0 * prior.relative_sd:g} % of each value"
        if isinstance(prior, PriorCard)
        else f"({prior.file}), {'each by itself' if prior.source == 'shelf' else 'with covariance'}"
    )
    words = (
        f"{card.title}: a prior was used, {PRIOR_TEXT[prior.source]} {spread}, on"
        f" {sum(map(len, means.values()))} coefficients. Verdicts are those of the data alone."
    )
    return remark(words + (f" On the prior rest: {', '.join(resting)}." if resting else ""))
