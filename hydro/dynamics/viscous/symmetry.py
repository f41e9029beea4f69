"""The basis terms that a symmetric hull can have, by parity.

Mirrored in a plane, a polar vector (velocity, force) turns the component along the
plane's normal, an axial one (rates, moments) the two others. Moduli and V stay. A force
of a symmetric hull that does not turn can have only terms that do not turn, one that
turns only terms that do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from auvid.data_schemas.errors import PipelineError, nearest
from auvid.hydro.arrays import AXES, VELOCITIES
from auvid.hydro.dynamics.viscous.basis import BASIS_TERMS, PROPULSION

PORT_STARBOARD, FORE_AFT, TOP_BOTTOM = "port_starboard", "fore_aft", "top_bottom"
MIRRORS: Mapping[str, int] = {PORT_STARBOARD: 1, FORE_AFT: 0, TOP_BOTTOM: 2}
"""Mirror -> body axis (x 0, y 1, z 2) that its plane is normal to."""


def turns(quantity: str, mirror: str) -> bool:
    """Return whether a factor of a term, or a force, changes sign in a mirror.

    quantity: u v w p q r, X Y Z K M N, |u| ... |r|, V, Vv, Vw.

    >>> [name for name in "uvwpqrXYZKMN" if turns(name, "port_starboard")]
    ['v', 'p', 'r', 'Y', 'K', 'N']
    """
    name = quantity[1] if quantity in ("Vv", "Vw") else quantity
    names = VELOCITIES if name in VELOCITIES else AXES
    if name not in names:
        return False
    component = names.index(name)
    along = component % 3 == _normal(mirror)
    return along if component < 3 else not along


def allows(axis: str, term: str, mirrors: Sequence[str]) -> bool:
    """Return whether a hull with these planes of symmetry can have a term on an axis.

    A term with eta - 1 needs a propeller, which sits at one end: it breaks the symmetry
    fore and aft. A term that is not of the basis is a constant, which never turns.

    >>> allows("Y", "u*v", ["port_starboard"]), allows("Z", "u", ["top_bottom"])
    (True, False)
    """
    factors = BASIS_TERMS[term].factors if term in BASIS_TERMS else ()
    if PROPULSION in factors and FORE_AFT in mirrors:
        return False
    return all(
        sum(turns(factor, mirror) for factor in factors) % 2 == turns(axis, mirror)
        for mirror in mirrors
    )


def allowed_terms(
    mirrors: Sequence[str] = (PORT_STARBOARD,), *, with_propeller: bool = False
) -> dict[str, tuple[str, ...]]:
    """Return axis -> all of the 132 terms that the symmetry allows, in their order.

    Terms with eta only `with_propeller`. Raises `PipelineError` for an unknown mirror.

    >>> {axis: len(terms) for axis, terms in allowed_terms().items()}
    {'X': 60, 'Y': 45, 'Z': 60, 'K': 45, 'M': 60, 'N': 45}
    """
    for mirror in mirrors:
        _normal(mirror)
    return {
        axis: tuple(
            name
            for name, term in BASIS_TERMS.items()
            if (with_propeller or PROPULSION not in term.factors) and allows(axis, name, mirrors)
        )
        for axis in AXES
    }


def _normal(mirror: str) -> int:
    if mirror not in MIRRORS:
        raise PipelineError(
            "unknown plane of symmetry",
            value=mirror,
            allowed=tuple(MIRRORS),
            remedy=nearest(mirror, MIRRORS),
        )
    return MIRRORS[mirror]
