"""What a model card says of its form: physics, and evidence of training."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from auvid.data_schemas.records.models import ModelCard
from auvid.hydro.arrays import AXES
from auvid.hydro.dynamics.viscous.basis import basis
from auvid.hydro.dynamics.viscous.structures import OWN_VELOCITY
from auvid.hydro.identification.constrained.statuses import AT_BOUND
from auvid.hydro.identification.regression.least_squares import CONSTANT
from auvid.hydro.identification.selection.information import bic


def pushing_axes(card: ModelCard) -> list[str]:
    """Return axes that motion along themselves alone pushes on, in the flown range.

    nu_a (tau_a(nu_a e_a + u) - tau_a(u)) > 0 at the lowest or highest velocity of training:
    damping that gives energy. u: the least speed ahead, 0 where it flew both ways, since
    lift by it damps as well.
    """
    pushing, surge = [], card.conditions["u"]
    ahead = np.zeros(6)
    ahead[0] = np.clip(0.0, surge.low, surge.high)
    for i, axis in enumerate(AXES):
        terms = {t: k for t, k in card.predictor.get(axis, {}).items() if t != CONSTANT}
        reach = card.conditions[OWN_VELOCITY[axis]]
        for speed in (reach.low, reach.high):
            still = ahead if i else np.zeros(6)
            nu = np.where(np.eye(6)[i], speed, still)
            rows = basis(np.stack([nu, still]), np.ones(2), tuple(terms))
            force = float((rows[0] - rows[1]) @ list(terms.values()))
            if force * speed > 0.0 and axis not in pushing:
                pushing.append(axis)
    return pushing


def reference_model(cards: Mapping[str, ModelCard]) -> str:
    """Return the model whose residual says how many samples are independent.

    That within limits of most terms, else the one of most terms.
    """
    within = [card for card in cards.values() if card.method == "within limits"]
    return max(within or list(cards.values()), key=lambda card: card.n_bar).name


def counted_by_blocks(cards: Mapping[str, ModelCard]) -> dict[str, float]:
    """Return how many samples count as one, by blocks, of the reference model."""
    if not cards:
        return {}
    parts = cards[reference_model(cards)].axes
    return {axis: part.samples_per_one for axis, part in parts.items() if part.samples_per_one}


def fitted_numbers(card: ModelCard, axis: str) -> int:
    """Return how many numbers of an axis the data set, with constant and inertia."""
    part = card.axes[axis]
    inertia = [item for item in card.inertia if item.name.startswith(axis)]
    verdicts = [*(item.verdict for item in part.terms), *(item.verdict for item in inertia)]
    return part.rank + len(inertia) - verdicts.count(AT_BOUND)


def training_information(cards: Mapping[str, ModelCard]) -> dict[str, float]:
    """Return the BIC of the training force of each card, all axes together, by name."""
    counted = counted_by_blocks(cards)
    return {
        name: sum(
            bic(
                part.samples * (part.j or 0.0) ** 2,
                fitted_numbers(card, axis),
                n_samples=part.samples,
                samples_per_one=counted.get(axis, 1.0),
            )
            for axis, part in card.axes.items()
        )
        for name, card in cards.items()
    }
