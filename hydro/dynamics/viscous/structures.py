"""Model structures that follow from the hull's symmetry, and those that a user names.

They stand beside the eight published forms of `models`: fewer terms, so that a short
dive determines them, and none that the symmetry of the hull rules out.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from auvid.data_schemas.errors import PipelineError, nearest
from auvid.hydro.arrays import AXES, VELOCITIES
from auvid.hydro.dynamics.viscous.basis import BASIS_TERMS
from auvid.hydro.dynamics.viscous.models import ViscousModel
from auvid.hydro.dynamics.viscous.symmetry import PORT_STARBOARD, allows

OWN_VELOCITY: Mapping[str, str] = dict(zip(AXES, VELOCITIES, strict=True))
"""Axis -> the velocity along it: X u ... N r."""


def diagonal(*, quadratic: bool = False) -> ViscousModel:
    """Return X u, Y v, ... N r, with the term x|x| too if `quadratic`.

    >>> diagonal(quadratic=True).terms["N"]
    ('r', 'r*|r|')
    """
    return _structure(
        "diagonal_quadratic" if quadratic else "diagonal",
        "Diagonal, quadratic" if quadratic else "Diagonal",
        "damping along each axis alone",
        {
            axis: [own, f"{own}*|{own}|"] if quadratic else [own]
            for axis, own in OWN_VELOCITY.items()
        },
    )


def symmetric(
    *, quadratic: bool = False, mirrors: Sequence[str] = (PORT_STARBOARD,)
) -> ViscousModel:
    """Return the linear terms that the symmetry allows, with own x|x| if `quadratic`.

    Port and starboard alike: X, Z, M take u w q, and Y, K, N take v p r. Further
    mirrors remove further couplings. Couplings stay linear: quadratic ones of small
    velocities explode where a free run leaves the flown range.

    >>> symmetric().terms["M"]
    ('u', 'w', 'q')
    >>> symmetric(mirrors=("port_starboard", "fore_aft", "top_bottom")).terms["M"]
    ('q',)
    """
    return _structure(
        "symmetric_quadratic" if quadratic else "symmetric",
        "Symmetric, quadratic" if quadratic else "Symmetric",
        f"linear damping of a hull symmetric {' and '.join(mirrors).replace('_', '-')}",
        {
            axis: [
                *(x for x in VELOCITIES if allows(axis, x, mirrors)),
                *([f"{own}*|{own}|"] if quadratic else []),
            ]
            for axis, own in OWN_VELOCITY.items()
        },
    )


def lift_and_drag() -> ViscousModel:
    """Return lift of hull and fins with cross-flow drag, of streamlined vehicles ahead.

    Incidence v / u and w / u, turned by rates at the fins, gives forces as u*v and u*r. The
    lift stands across the flow, so that surge has v*v, v*r and r*r of it, and a hull has the
    same terms by its added mass (Munk); a mast or a fin above the axis couples them with
    roll. Drag is quadratic along each axis. Port and starboard are alike. Going ahead, these
    forces can take energy out at every incidence; astern they would give it.

    >>> lift_and_drag().terms["N"]
    ('u*v', 'u*p', 'u*r', 'r*|r|')
    """
    sideways, upright = ("u*v", "u*p", "u*r"), ("u*w", "u*q")
    lift = {"Y": sideways, "K": sideways, "N": sideways, "Z": upright, "M": upright}
    terms = {
        axis: [*row, f"{OWN_VELOCITY[axis]}*|{OWN_VELOCITY[axis]}|"] for axis, row in lift.items()
    }
    terms["X"] = ["u*|u|", "v*v", "v*r", "r*r", "w*w", "w*q", "q*q"]
    return _structure(
        "lift_and_drag",
        "Lift and drag",
        "lift of hull and fins that go ahead, cross-flow drag",
        terms,
    )


def masked(terms: Mapping[str, Sequence[str]], *, name: str = "custom") -> ViscousModel:
    """Return the model with the terms that a user names for each axis.

    A term is written as in the basis (`u*|u|`) or as in tables (`u|u|`). Raises
    `PipelineError` for an unknown axis or term and for a term that is named twice.

    >>> masked({"X": ["u", "u|u|"], "N": ["r"]}).terms["X"]
    ('u', 'u*|u|')
    """
    for axis in terms:
        if axis not in AXES:
            raise PipelineError("unknown axis", value=axis, allowed=AXES)
    chosen = {axis: [_term(axis, word) for word in words] for axis, words in terms.items()}
    for axis, words in chosen.items():
        if len(set(words)) < len(words):
            raise PipelineError(
                "a term is named twice", field=f"{name}.{axis}", value=list(terms[axis])
            )
    return _structure(name, name.replace("_", " ").capitalize(), "named by the user", chosen)


def _term(axis: str, word: str) -> str:
    if word in BASIS_TERMS:
        return word
    joined = "*".join(re.findall(r"\|[uvwpqr]\||V[vw]?|[uvwpqr]", word))
    if joined in BASIS_TERMS and joined.replace("*", "") == word:
        return joined
    raise PipelineError(
        "unknown basis term",
        field=axis,
        value=word,
        remedy=nearest(word, BASIS_TERMS) or "Write u, u*v, u*|u|.",
    )


def _structure(
    name: str, title: str, source: str, terms: Mapping[str, Sequence[str]]
) -> ViscousModel:
    ordered = {
        axis: tuple(term for term in BASIS_TERMS if term in terms.get(axis, ())) for axis in AXES
    }
    return ViscousModel(name, title, ordered, source)
