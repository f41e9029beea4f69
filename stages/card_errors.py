"""Errors of the coefficients of a model card, axis by axis, for draws of them."""

from __future__ import annotations

from collections.abc import Sequence

from auvid.data_schemas.records.models import ModelCard
from auvid.hydro.identification.constrained.draws import AxisErrors
from auvid.hydro.identification.constrained.equations import Unknown


def axis_errors(card: ModelCard, unknowns: Sequence[Unknown]) -> list[AxisErrors]:
    """Return the errors of each axis of a card, at its places among the unknowns."""
    parts = []
    for axis, part in card.axes.items():
        own, errors = part.covariance, {item.term: item.standard_error for item in part.terms}
        places = [unknowns.index(Unknown(axis, term)) for term in own.terms]
        each = [errors.get(term) for term in own.terms]
        parts.append(AxisErrors(places, own.lower, each, own.shifts))
    return parts
