"""What a model is usable for, by axis and in words: the rule and its sentences."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from functools import partial

from auvid.data_schemas.records.models import (
    AxisMerit,
    MeritRecord,
    ModelCard,
    MotionCheck,
    RankingRecord,
    SteadyRange,
    TermCard,
    UsableFor,
)
from auvid.data_schemas.records.partial import PartialFigures
from auvid.hydro.arrays import AXES
from auvid.hydro.dynamics.viscous.models import model_named
from auvid.hydro.dynamics.viscous.structures import OWN_VELOCITY
from auvid.hydro.identification.constrained.equations import Unknown
from auvid.hydro.identification.constrained.statuses import FROM_PRIOR
from auvid.hydro.identification.regression.assumed_figures import FORM
from auvid.hydro.identification.regression.verdicts import (
    IDENTIFIED,
    MAY_IDENTIFY,
    NOT_EXCITED,
    SHORT_OF,
    UNDER_UNSTEADY_FORCE,
    WEAK,
    stands_clear,
)
from auvid.stages.number_format import fixed
from auvid.stages.page.first_screen import ALL, AXIS_WORDS, Level

HALF = 0.5
"""J/J0 of an axis from which on a controller is not to be designed on the model."""
GROWS_1_S = 0.05
"""Growth that counts: a disturbance that doubles within 14 s."""
SMALLER = 0.95
"""Ratio of errors below which one of two counts as smaller."""
NO_CONSTANT: Mapping[str, float] = {}
GUESS = "no change or no motion"
"""What a free run has to beat, in words."""
TILTS = ("K", "M")
TILTED = ("roll", "pitch")
ORIGIN = "force at the origin"
UNKNOWN, FITTED = "unknown", "fitted"
TELLING = (
    IDENTIFIED,
    "weak",
    "inseparable",
    "not excited",
    "at its bound",
    FROM_PRIOR,
    "not applicable",
)
"""Verdicts, that which says most first."""
_decimals = partial(fixed, places=2, empty="unknown")


def usable_for(
    model: MeritRecord, card: ModelCard, constant: Mapping[str, float] = NO_CONSTANT
) -> UsableFor:
    """Return what a model is usable for: forces, simulation and control, by axis.

    constant: axis -> J/J0 of the mean training force by itself. An axis counts for forces
    where its error is clearly below that and below the force. It is simulated where the
    training legs excite its damping, its free runs err less than a plain guess
    (`free_run_ratios`) and its own drive does not tip the model over, and under attitude
    hold where it does, but no free run is lost: the autopilot that flew them held roll and
    pitch. These two are simulated where no drive tips it over and their damping rests on
    data or a prior. A controller is designed on no axis of a model whose roll or pitch
    runs are worse than a guess: it would act through tilts that the model gets wrong. Nor
    on an axis on which a disturbance grows by itself (`unstable_axes`); on the axis that is
    driven then a controller stands on what holds the growing one (`growth_words`).
    """

    def below(value: float | None, limit: float) -> bool:
        return value is not None and value < limit

    merits = {axis: model.axes[axis] for axis in AXES}
    forces = [
        axis
        for axis in AXES
        if below(merits[axis].validation, min(1.0, SMALLER * constant.get(axis, math.inf)))
    ]
    holds = model.runs > 0 and not model.faults
    runs = [
        axis for axis in forces if holds and below(merits[axis].free_run, 1.0) and damps(card, axis)
    ]
    simulation = [
        axis
        for axis in runs
        if axis not in tipping_axes(model) and (axis not in TILTS or _keeps_upright(model, card))
    ]
    tipped = (
        set()
        if model.motion is None
        else {item.axis for item in own_drives(model.motion) if item.tips_in in TILTED}
    )
    return UsableFor(
        forces=forces,
        simulation=simulation,
        under_attitude_hold=[axis for axis in runs if axis in tipped and axis not in TILTS],
        control=[
            axis
            for axis in simulation
            if not lost_tilts(model)
            and axis not in unstable_axes(model)
            and below(merits[axis].validation, HALF)
            and damping_of(card, axis) == IDENTIFIED
        ],
        speeds=card.conditions,
    )


def lost_tilts(model: MeritRecord) -> dict[str, float]:
    """Return roll and pitch that run worse than a guess, axis -> how many times."""
    runs = {axis: model.axes[axis].free_run for axis in TILTS}
    return {axis: error for axis, error in runs.items() if error is not None and error > 1.0}


def recommendation(
    ranking: RankingRecord, chosen: MeritRecord | None, judged: bool
) -> tuple[Level, str, str]:
    """Return level, headline and explanation of the model to take, or of none."""
    if not ranking.models:
        return (
            "poor",
            "No model was identified",
            "There is no error table: the chain did not reach validation.",
        )
    best = ranking.models[0]
    if chosen is None or ranking.usable is None:
        merit = best.axes[ALL]
        ratio = merit.validation if judged else merit.training
        where = "on the validation legs" if judged else "on the training legs"
        return (
            "poor",
            "Use none of these models",
            (
                f"The best of them, {best.title}, has J/J0 = {_decimals(ratio)} {where}: predicting"
                " no force at all does as well."
            ),
        )
    validation, training = chosen.axes[ALL].validation, chosen.axes[ALL].training
    if not judged:
        return (
            "poor",
            f"{chosen.title} fits best, but nothing judges it",
            (
                "The campaign has no validation leg."
                f" J/J0 = {_decimals(training)} is on the training legs alone"
                " and says nothing about prediction."
            ),
        )
    words = f"On the validation legs J/J0 = {_decimals(validation)}"
    words += f" (training {_decimals(training)})" if training is not None else ""
    words += f": the error is {100 * (validation or 0):.0f} % of the force itself."
    smaller = (best.axes[ALL].validation or 0) < min(1.0, SMALLER * (validation or 0))
    if best is not chosen and smaller:
        words += f" {best.title} has a smaller error ({_decimals(best.axes[ALL].validation)})"
        words += f" with {best.terms} terms"
        words += f", but {best.faults[-1]}." if best.faults else "."
    failing = failing_axes(chosen)
    level: Level = "good" if (validation or 1) < 0.5 and not failing else "fair"
    use = use_words(ranking.usable, flown=chosen.runs > 0, simulator=simulator(ranking))
    return level, f"{chosen.title}: {use}" + (", with care" if level == "fair" else ""), words


def simulator(ranking: RankingRecord) -> str:
    """Return the title of another model to simulate with; empty for the one to take."""
    titles = {model.name: model.title for model in ranking.models}
    return titles.get(ranking.simulate_with or "", "")


def use_words(usable: UsableFor, *, flown: bool, simulator: str = "") -> str:
    """Return what a model is for, in one line: forces and simulation.

    simulator: title of the model to simulate with, where it is another one.
    """
    if not usable.forces:
        return "use it for nothing"
    part = "" if len(usable.forces) == len(AXES) else f" in {axes_listed(usable.forces)}"
    words = f"use it to predict forces{part}"
    if simulator:
        return f"{words}, and {simulator} to simulate"
    steadied = usable.under_attitude_hold
    if not usable.simulation and not steadied:
        return f"{words}, not to simulate" if flown else words
    lacking = [axis for axis in AXES if axis not in (*usable.simulation, *steadied)]
    if not lacking and not steadied:
        return f"{words} and to simulate all axes"
    parts = [axes_listed(usable.simulation)] if usable.simulation else []
    parts += [f"under attitude hold {axes_listed(steadied)}"] if steadied else []
    simulated = ", ".join(parts)
    return f"{words} and to simulate {simulated}" + (
        f", not {axes_listed(lacking)}" if lacking else ""
    )


def partial_words(part: PartialFigures, usable: UsableFor | None) -> str:
    """Return what a partial model is for, in one line, with the axes that it lacks."""
    if usable is None or not usable.simulation:
        words = "use it for nothing"
    else:
        words = f"use it to simulate {axes_listed(usable.simulation)} only"
    righted = [] if part.righting is None else part.righting.axes
    unjudged = [axis for axis in TILTS if axis not in righted]
    judged = unjudged if usable is None else [*usable.simulation, *unjudged]
    fitted = [axis for axis, item in part.axes.items() if item.source == FITTED]
    weak = [axis for axis in fitted if axis not in judged]
    if weak:
        words += f"; {axes_listed(weak)} {'is' if len(weak) == 1 else 'are'} too weak"
    tilts = [axis for axis in unjudged if axis in fitted]
    if tilts:
        words += f"; {axes_listed(tilts)} with the righting moment of the vehicle file, not judged"
    filled = [axis for axis, item in part.axes.items() if item.source != FITTED]
    if filled:
        words += f"; {axes_listed(filled)} from elsewhere, not judged"
    lacking = [
        f"{axes_listed(axes)} {verdict}"
        for verdict in (
            "not observable",
            "not excited",
            "not commanded",
            "left out",
            "wrong sign",
            "not predicted",
        )
        if (axes := [axis for axis, item in part.lacking.items() if item.verdict == verdict])
    ]
    return f"{words}; {', '.join(lacking)}" if lacking else words


LIFT_WORDS = (
    " They hold for a hull whose moment by u v is that of its added mass alone: lift takes part of"
    " it, and then they are off by more than that."
)
"""On ratios of inertia beside a fitted yaw, which has that moment."""
NO_RATIO_WORDS = (
    " Nothing in these logs tells the ratio of yaw, as its moment by u v does not where lift takes"
    " part of it; it is the vehicle file's, with that interval."
)


def ratio_words(part: PartialFigures) -> str:
    """Return a sentence on ratios of inertia by Coriolis force, empty for none."""
    fitted = [axis for axis, item in part.axes.items() if item.source == FITTED]
    parts = []
    for axis, item in part.inertia_shares.items():
        low, high = item.interval_95
        motion = AXIS_WORDS[axis] + ("" if axis in fitted else ", which is not fitted itself,")
        parts.append(f"{motion} {item.value:.2f} ({low:.2f} to {high:.2f})")
    if not parts:
        return ""
    lift = ""
    if "N" in fitted:
        yaw = part.inertia_shares.get("N")
        beside_lift = yaw is not None and yaw.interval_95[1] - yaw.interval_95[0] > yaw.value
        lift = NO_RATIO_WORDS if beside_lift else LIFT_WORDS
    return (
        "Ratios of inertia are those that Coriolis force tells, times the vehicle file's:"
        f" {listed(parts)}, with 95 % intervals.{lift}"
    )


def coverage_words(shares: Mapping[str, float], method: str) -> str:
    """Return how often a method's intervals held the truth: true model -> share.

    >>> coverage_words({"linear": 0.99}, "least squares")[-87:]
    " large as the manoeuvres' own few are identified (1 of 36), and these held it in 100 %."
    """
    parts = [
        f"{100.0 * share:.0f} % where the truth is {model_named(name).title}"
        for name, share in shares.items()
    ]
    may = method in MAY_IDENTIFY
    which = "identified coefficients" if may else "coefficients of four standard errors and more"
    end = "."
    if method in UNDER_UNSTEADY_FORCE:
        count, share = UNDER_UNSTEADY_FORCE[method]
        end = (
            "; under an unsteady force as large as the manoeuvres' own few are identified"
            f" ({count} of 36), and these held it in {100.0 * share:.0f} %."
        )
    if not may:
        why = f"{SHORT_OF[method]}, so that " if method in SHORT_OF else ""
        end = f"; {why}{method} calls none identified."
    return f"On twins, 95 % intervals of {which} held the truth in {listed(parts)}{end}"


def failing_axes(model: MeritRecord) -> list[str]:
    """Return the axes whose error is larger than the force, in words."""
    return [
        f"{AXIS_WORDS[axis]} ({axis})" for axis in AXES if (model.axes[axis].validation or 0.0) > 1
    ]


def axes_listed(axes: Sequence[str]) -> str:
    """Return axes in words: surge, sway and heave."""
    return listed([AXIS_WORDS[axis] for axis in axes])


def listed(words: Sequence[str]) -> str:
    """Return words as a list in a sentence."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def damping_of(card: ModelCard, axis: str) -> str:
    """Return what damping along an axis is: identified, from the prior or unknown.

    That of a form that lacks terms counts as identified where it is clear as a mean over
    the flown motion: it is what a simulation or a controller goes by.
    """
    verdicts = {
        IDENTIFIED if clear_in_its_form(item) else item.verdict
        for item in _damping_terms(card, axis)
    }
    return next((best for best in (IDENTIFIED, FROM_PRIOR) if best in verdicts), UNKNOWN)


def damps(card: ModelCard, axis: str) -> bool:
    """Return whether the damping of an axis is more than terms that nothing excites."""
    return _damping_verdicts(card, axis) != {NOT_EXCITED}


def damping_verdict(card: ModelCard, axis: str) -> str:
    """Return the strongest verdict on the damping of an axis; empty for no term."""
    verdicts = _damping_verdicts(card, axis)
    return next((verdict for verdict in TELLING if verdict in verdicts), "")


def clear_in_its_form(item: TermCard) -> bool:
    """Return whether a weak term is weak only by what its form lacks."""
    return weak_only_by(item, FORM)


def weak_only_by(item: TermCard, figure: str) -> bool:
    """Return whether a weak term would be clear without one of its assumed shifts."""
    if item.verdict != WEAK or item.value is None or not item.standard_error:
        return False
    others = {name: shift for name, shift in item.assumed_shifts.items() if name != figure}
    without_it, among_all = (
        stands_clear(item.value, item.standard_error, shifts)
        for shifts in (others, item.assumed_shifts)
    )
    return without_it and not among_all and not item.turns_without


def _damping_verdicts(card: ModelCard, axis: str) -> set[str]:
    return {item.verdict for item in _damping_terms(card, axis)}


def _damping_terms(card: ModelCard, axis: str) -> list[TermCard]:
    """Return the damping terms of the own velocity of an axis.

    Those of it alone, and its products with the speed ahead: u*p damps the roll of a
    vehicle that never went astern as K_p does.
    """
    own = OWN_VELOCITY[axis]
    ahead = "u" in card.conditions and card.conditions["u"].low >= 0.0
    damping = [own, own * 2, f"{own}|u|", *([f"u{own}"] if ahead else [])]
    return [
        item
        for item in (card.axes[axis].terms if axis in card.axes else ())
        if (letters := item.term.replace("*", "")) in damping
        or letters.replace("|", "") in damping[:2]
    ]


def form_words(model: MeritRecord, titles: Mapping[str, str]) -> str:
    """Return on which axes the force has another form, and what that means; or nothing.

    titles: model -> name as printed.
    """
    axes: dict[str, list[str]] = {}
    for axis in AXES:
        if why := _lacking_words(axis, model.axes[axis], titles):
            axes.setdefault(why, []).append(axis)
    if not axes:
        return ""
    where = [f"{axes_listed(own)} ({why})" for why, own in axes.items()]
    return (
        f"force of another form in {listed(where)}: there intervals hold for the form, as a mean"
        " over the flown motion, not for the vehicle"
    )


def _lacking_words(axis: str, merit: AxisMerit, titles: Mapping[str, str]) -> str:
    """Return what shows another form of the force of an axis; empty for nothing."""
    if merit.lacking:
        return "lacks " + listed([str(Unknown(axis, term)) for term in merit.lacking])
    return f"{titles[merit.better_form]} fits better" if merit.better_form else ""


def tipping_axes(model: MeritRecord) -> list[str]:
    """Return axes along which its own drive tips a model over at flown speeds."""
    motion = model.motion
    return [] if motion is None else [item.axis for item in own_drives(motion) if item.tips_in]


def unstable_axes(model: MeritRecord) -> list[str]:
    """Return axes on which a disturbance grows at flown speeds of the own drive.

    All where a decay from the flown velocities leaves all bounds, which shows on none.
    """
    if model.motion is None:
        return []
    if model.motion.decays_lost:
        return list(AXES)
    growing = growing_drives(model.motion)
    return [axis for axis in AXES if any(axis == item.grows_on for item in growing)]


def growing_drives(motion: MotionCheck) -> list[SteadyRange]:
    """Return the own drives at whose flown speeds a disturbance grows."""
    return [item for item in own_drives(motion) if item.growth_1_s > GROWS_1_S]


def growth_words(model: MeritRecord, axes: Collection[str]) -> str:
    """Return what a controller of some axes stands on: what grows beside them.

    Roll and pitch are what an autopilot holds; empty where nothing else grows.
    """
    if model.motion is None or model.motion.decays_lost:
        return ""
    drives: dict[str, list[str]] = {}
    for item in growing_drives(model.motion):
        if item.axis in axes and item.grows_on != item.axis:
            drives.setdefault(item.grows_on, []).append(item.axis)
    return "; ".join(
        f"at flown speeds of {axes_listed(driven)} a disturbance grows in {AXIS_WORDS[axis]}, which"
        f" {'attitude hold' if axis in TILTS else 'another controller'} has to hold"
        for axis, driven in drives.items()
    )


def own_drives(motion: MotionCheck) -> list[SteadyRange]:
    """Return the ranges under its own actuators; under a force where it has none."""
    return [item for item in motion.ranges if item.drive != ORIGIN] or motion.ranges


def _keeps_upright(model: MeritRecord, card: ModelCard) -> bool:
    if any(damping_of(card, axis) == UNKNOWN for axis in TILTS):
        return False
    return not tipping_axes(model)
