"""Models by merit, the one to take by the rule of `selection.ranking`, and what for."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from auvid.data_schemas.records.models import (
    AxisMerit,
    MeritRecord,
    ModelCard,
    MotionCheck,
    RankingRecord,
)
from auvid.hydro.arrays import AXES, VELOCITIES
from auvid.hydro.dynamics.steady_motion import TIPPED_RAD
from auvid.hydro.dynamics.viscous.models import MODELS
from auvid.hydro.dynamics.viscous.structures import OWN_VELOCITY
from auvid.hydro.identification.constrained.statuses import AT_BOUND, FROM_PRIOR
from auvid.hydro.identification.regression.least_squares import CONSTANT
from auvid.hydro.identification.regression.verdicts import IDENTIFIED
from auvid.hydro.identification.selection.information import bic
from auvid.hydro.identification.selection.ranking import RankedModel, choose
from auvid.stages.form_evidence import counted_by_blocks, fitted_numbers, pushing_axes
from auvid.stages.free_run import ANGLE_OF, LONG_S, PERSISTENCE, REST
from auvid.stages.model_use import NO_CONSTANT, SMALLER, usable_for
from auvid.stages.validate.tables import ALL

PUBLISHED = frozenset(model.name for model in MODELS)
ANOTHER_FORM = 10.0
"""Difference of the BIC from which on a form is clearly another (Kass & Raftery 1995)."""
RESTS = (AT_BOUND, FROM_PRIOR)
Row = Mapping[str, Any]


def rank(
    cards: Mapping[str, ModelCard],
    errors: Iterable[Row],
    free_run: Iterable[Row],
    samples_per_one: Mapping[str, float],
    check: Callable[[Sequence[str]], Mapping[str, MotionCheck]] = lambda _: {},
    constant: Mapping[str, float] = NO_CONSTANT,
) -> RankingRecord:
    """Return the models by merit, from rows of the error table and of free runs.

    samples_per_one: axis -> how many training samples count as one. check: what models
    without other faults do by themselves, by name. constant: axis -> J/J0 of the mean
    training force.
    """
    of = {(row["use"], row["model"], row["axis"]): row for row in errors if row["leg"] == ALL}
    runs = [row for row in free_run if not row["as_measured"]]
    judge = "validation" if any(use == "validation" for use, *_ in of) else "training"
    horizon, ratios = free_run_ratios(runs)
    counted = {**samples_per_one, **counted_by_blocks(cards)}
    information = {name: _information(card, of, counted) for name, card in cards.items()}
    least = {
        axis: min((values[axis] for values in information.values()), default=math.nan)
        for axis in (ALL, *AXES)
    }
    better = _better_forms(cards, of, information)
    faults_of = {
        name: _faults(card, *_losses(runs, name)) + _tipped(runs, name)
        for name, card in cards.items()
    }
    motions = check([name for name, faults in faults_of.items() if not faults])
    models = []
    for name, card in cards.items():
        count, lost = _losses(runs, name)
        total = of.get((judge, name, ALL), {})
        models.append(
            MeritRecord(
                name=name,
                title=card.title,
                published=name in PUBLISHED,
                terms=int(total.get("n_bar", card.n_bar)),
                rank=int(total.get("rank", card.rank)),
                j=_number(total.get("rms")),
                axes={
                    axis: AxisMerit(
                        validation=_number(of.get(("validation", name, axis), {}).get("ratio")),
                        training=_number(of.get(("training", name, axis), {}).get("ratio")),
                        left_out=_mean(part.get(axis) for part in card.held_out.values()),
                        bic=_number(information[name][axis] - least[axis]),
                        free_run=_number(ratios.get(name, {}).get(axis)),
                        **_counts(card, axis),
                        better_form=better.get((name, axis)),
                        lacking=card.axes[axis].lacking if axis in card.axes else [],
                    )
                    for axis in (ALL, *AXES)
                },
                runs=count,
                lost=lost,
                faults=faults_of[name],
                motion=motions.get(name),
            )
        )
    models.sort(key=lambda item: (math.inf if item.j is None else item.j, item.terms))
    legs = _legs_left_out(cards)
    choice, rule, flown = _choice(models, cards, information, judge, constant)
    chosen = next((item for item in models if item.name == choice), None)
    return RankingRecord(
        models=models,
        choice=choice,
        rule=rule,
        simulate_with=flown,
        legs_left_out=legs,
        horizon_s=horizon,
        usable=None if chosen is None else usable_for(chosen, cards[chosen.name], constant),
        constant=dict(constant),
    )


def free_run_ratios(rows: Iterable[Row]) -> tuple[float | None, dict[str, dict[str, float]]]:
    """Return the horizon, and model -> axis or all -> error over that of a plain guess.

    The guess is the better of no change and no motion: over seconds a velocity that has
    come and gone is guessed better by zero. Of a rotation the larger of rate and angle.
    nan where no run stayed bounded.
    """
    rows = list(rows)
    horizons = sorted({row["horizon_s"] for row in rows})
    if not horizons:
        return None, {}
    horizon = max([h for h in horizons if h <= LONG_S], default=horizons[0])
    names = [f"{v}_rms_{'m_s' if v in 'uvw' else 'rad_s'}" for v in VELOCITIES]
    names += [f"{angle}_rms_rad" for angle in ANGLE_OF.values()]
    squares: dict[str, np.ndarray] = {}
    for row in rows:
        if row["horizon_s"] == horizon:
            kept = row["starts"] - row["diverged"]
            values = [np.nan if row[name] is None else row[name] for name in names]
            sums = squares.setdefault(row["model"], np.zeros(len(names) + 1))
            sums += [*(kept * np.square(values)), kept]
    guesses = [squares.pop(name) for name in (PERSISTENCE, REST)]
    guessed = np.min([sums[:-1] / sums[-1] for sums in guesses], axis=0)
    ratios = {}
    for model, sums in squares.items():
        with np.errstate(divide="ignore", invalid="ignore"):
            each = np.sqrt(sums[:-1] / sums[-1] / guessed)
        each[3:6] = np.maximum(each[3:6], each[6:])
        total = float(np.sqrt(np.mean(each[:6] ** 2)))
        ratios[model] = {ALL: total, **dict(zip(AXES, each[:6].tolist(), strict=True))}
    return horizon, ratios


def resting_velocities(cards: Mapping[str, ModelCard]) -> str:
    """Return the velocities whose damping no model within limits has from the data.

    In all of them it rests on the prior or on its bound: `p q`, empty for none.
    """
    within = [card for card in cards.values() if card.method == "within limits"]
    resting = [
        own
        for axis, own in OWN_VELOCITY.items()
        if within
        and all(
            any(item.term == own and item.verdict in RESTS for item in card.axes[axis].terms)
            for card in within
        )
    ]
    return " ".join(resting) if len(resting) < len(AXES) else ""


def _choice(
    models: list[MeritRecord],
    cards: Mapping[str, ModelCard],
    information: Mapping[str, Mapping[str, float]],
    judge: str,
    constant: Mapping[str, float],
) -> tuple[str | None, str, str | None]:
    """Return the model to take, the rule, and another one to simulate with.

    Of those better than none and the mean.
    """

    def ratio(item: MeritRecord) -> float | None:
        return item.axes[ALL].validation if judge == "validation" else item.axes[ALL].training

    limit = min(1.0, SMALLER * constant.get(ALL, math.inf))
    better = [item for item in models if (value := ratio(item)) is not None and value < limit]
    # A BIC of the force compares fits to the force: one to the sensors has no part in it.
    sensor_fits = () if _legs_left_out(cards) >= 2 else _refined(cards)
    candidates = [
        RankedModel(
            item.name,
            sum(fitted_numbers(cards[item.name], axis) for axis in cards[item.name].axes),
            np.array(
                [v for part in cards[item.name].held_out.values() if (v := part[ALL]) is not None]
            ),
            information[item.name][ALL],
            not item.faults,
        )
        for item in better
        if item.name not in sensor_fits
    ]
    chosen = choose(candidates)
    if chosen is None:
        words = "no model predicts the force better than no force at all, or its mean, does"
        return None, words, None
    words = chosen.rule
    if chosen.name != chosen.best:
        words = words.replace("the best", cards[chosen.best].title, 1)
    passing = sum(item.is_sound for item in candidates)
    if 0 < passing < len(candidates):
        words += f"; of {len(candidates)} models that predict the force"
        words += " it alone passes physics" if passing == 1 else f" {passing} pass physics"
    elif not passing:
        words += "; none of the models that predict the force passes physics"
    name, place = chosen.name, {item.name: item for item in better}
    complete = _complete_form(chosen.name, better, cards, information)
    if complete is not None:
        name = complete
        words += (
            f"; {cards[name].title} replaces it: its windows agree, so that its form misses"
            " nothing that the sensors show"
        )
    for other in _refined(cards):
        fit = cards[other].likelihood
        if complete is not None or fit is None or fit.started_from != chosen.name:
            continue
        if other not in place or other not in sensor_fits:
            continue
        worse = _worse_on_validation(place[other], place[chosen.name])
        if worse:
            words += f"; {cards[other].title} does not replace it: {worse}"
        else:
            name = other
            words += (
                f"; {cards[other].title} replaces it: sound, and nearer to the validation legs in"
                " force and in free runs"
            )
    flown, its_words = _better_flown(place[name], better, cards)
    return name, words + its_words, flown


def _complete_form(
    chosen: str,
    sound: Sequence[MeritRecord],
    cards: Mapping[str, ModelCard],
    information: Mapping[str, Mapping[str, float]],
) -> str | None:
    """Return a fit whose windows agree, of this form or a likelier one.

    Left-out legs do not tell a form with the truth from a simpler one, sensors do. None for
    none, and for one that is chosen already.
    """
    complete = [
        (fit.started_from != chosen, item.terms, item.name)
        for item in sound
        if (fit := cards[item.name].likelihood) is not None
        and fit.windows_agree
        and not item.faults
        and (
            fit.started_from == chosen
            or information[fit.started_from][ALL] <= information[chosen][ALL]
        )
    ]
    name = min(complete, default=(True, 0, chosen))[2]
    return None if name == chosen else name


def _better_flown(
    taken: MeritRecord, others: Sequence[MeritRecord], cards: Mapping[str, ModelCard]
) -> tuple[str | None, str]:
    """Return which model to simulate with, where it is not the one taken, and why.

    Where the free runs of the one taken err more than a plain guess: the sound one
    whose runs err least, and less than that. None and no words for none.
    """
    own = taken.axes[ALL].free_run
    flown = [
        (ratio, item)
        for item in others
        if (ratio := item.axes[ALL].free_run) is not None and not item.faults
    ]
    if own is None or own <= 1.0 or not flown:
        return None, ""
    ratio, best = min(flown, key=lambda pair: pair[0])
    if ratio >= 1.0:
        return None, ""
    return best.name, (
        f"; {cards[best.name].title} is the one to simulate with: its free runs err {ratio:.2f}"
        f" times as much as the guess of no change or no motion, these {own:.2f}"
    )


def _worse_on_validation(other: MeritRecord, taken: MeritRecord) -> str:
    """Return in what a model is no better than the one taken, empty for nothing.

    Physics, the force and the free runs of the validation legs: each must speak for it.
    """
    if other.faults:
        return other.faults[0]
    for name, words in (("validation", "force error"), ("free_run", "free runs")):
        one, two = (getattr(item.axes[ALL], name) for item in (other, taken))
        if one is None or two is None:
            return f"no {words} on validation legs"
        if one >= two:
            return f"{words} on the validation legs {one:.2f} for {two:.2f}"
    return ""


def _legs_left_out(cards: Mapping[str, ModelCard]) -> int:
    return max((len(card.held_out) for card in cards.values()), default=0)


def _refined(cards: Mapping[str, ModelCard]) -> tuple[str, ...]:
    return tuple(name for name, card in cards.items() if card.likelihood is not None)


def _information(
    card: ModelCard, of: Mapping[tuple[str, str, str], Row], samples_per_one: Mapping[str, float]
) -> dict[str, float]:
    """Return the BIC of training, axis by axis, and of all."""
    values = {}
    for axis in AXES:
        row, part = of.get(("training", card.name, axis)), card.axes.get(axis)
        if row is None or part is None:
            values[axis] = math.nan
            continue
        values[axis] = bic(
            row["sse"],
            fitted_numbers(card, axis),
            n_samples=row["samples"],
            samples_per_one=samples_per_one.get(axis, 1.0),
        )
    return {ALL: sum(values.values()), **values}


def _better_forms(
    cards: Mapping[str, ModelCard],
    of: Mapping[tuple[str, str, str], Row],
    information: Mapping[str, Mapping[str, float]],
) -> dict[tuple[str, str], str]:
    """Return (model, axis) -> the model whose form explains the training better.

    It has the smaller error, so that fewer terms are no reason, and a BIC lower by
    `ANOTHER_FORM`. A model fitted to the sensors has the form of the one it started from.
    """
    refined = {
        name: card.likelihood.started_from
        for name, card in cards.items()
        if card.likelihood is not None
    }
    forms = [name for name in cards if name not in refined]
    better: dict[tuple[str, str], str] = {}
    for axis in AXES:
        errors = {name: of.get(("training", name, axis), {}).get("sse", math.nan) for name in forms}
        for name in forms:
            clearly = [
                other
                for other in forms
                if errors[other] < errors[name]
                and information[other][axis] < information[name][axis] - ANOTHER_FORM
            ]
            if clearly:
                best = min(clearly, key=lambda other: information[other][axis])
                better[name, axis] = best
        for name, start in refined.items():
            if (start, axis) in better:
                better[name, axis] = better[start, axis]
    return better


def _counts(card: ModelCard, axis: str) -> dict[str, int]:
    parts = card.axes.values() if axis == ALL else [card.axes[axis]] if axis in card.axes else []
    terms = [item for part in parts for item in part.terms if item.term != CONSTANT]
    return {
        "identified": sum(item.verdict == IDENTIFIED for item in terms),
        "coefficients": sum(item.verdict != "not applicable" for item in terms),
    }


def _faults(card: ModelCard, runs: int, lost: int) -> list[str]:
    faults = [f"{axis} damping gives energy" for axis in pushing_axes(card)]
    return faults + ([f"{lost} of {runs} free runs are lost"] if lost else [])


def _tipped(rows: Iterable[Row], model: str) -> list[str]:
    """Return the fault of free runs that turn over while the vehicle did not."""
    errors = [
        error
        for row in rows
        if row["model"] == model
        for error in (row["phi_rms_rad"], row["theta_rms_rad"])
        if error is not None and error > TIPPED_RAD
    ]
    return [f"free runs tip over (error {np.degrees(max(errors)):.0f} degrees)"] if errors else []


def _losses(rows: Iterable[Row], model: str) -> tuple[int, int]:
    """Return how many free runs of a model there were, and how many were lost."""
    starts: dict[str, tuple[int, int]] = {}
    for row in rows:
        if row["model"] == model:
            count, lost = starts.get(row["segment"], (0, 0))
            starts[row["segment"]] = (max(count, row["starts"]), max(lost, row["diverged"]))
    return sum(count for count, _ in starts.values()), sum(lost for _, lost in starts.values())


def _mean(values: Iterable[float | None]) -> float | None:
    numbers = [value for value in values if value is not None]
    return float(np.mean(numbers)) if numbers else None


def _number(value: float | None) -> float | None:
    return float(value) if value is not None and math.isfinite(value) else None
