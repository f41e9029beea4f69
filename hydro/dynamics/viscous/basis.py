"""The 132 basis terms of quasi-steady viscous force models: McCarter 2014, Appendix C.

A term is a product of at most three factors out of u v w p q r, their moduli, V =
sqrt(v^2 + w^2), V_v = V sign(v), V_w = V sign(w) and eta - 1, where eta = u_c(n) / U is
the propulsion ratio (`eta_ratio` here, because `eta` is the pose).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations_with_replacement, product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import DataError, PipelineError, nearest
from auvid.hydro.arrays import VELOCITIES, Array, Index, components

MODULI = tuple(f"|{name}|" for name in VELOCITIES)
PROPULSION = "eta-1"
FORCE_AXES = ("X", "Y", "Z")
BLOCK = 256
"""Columns of a matrix of terms that are multiplied at once."""


@dataclass(frozen=True)
class BasisTerm:
    """One term of the basis (C.1)-(C.6).

    It has its name as in Appendix C, its factors, the group of (C.1)-(C.6) it belongs
    to, and LaTeX.
    """

    name: str
    factors: tuple[str, ...]
    group: str
    latex: str


def _term(group: str, *factors: str) -> BasisTerm:
    motion = [factor for factor in factors if factor != PROPULSION]
    name = "*".join(motion)
    latex = (
        f"{motion[0]}^2"
        if motion == [motion[0]] * 2
        else "".join(re.sub(r"^V([vw])$", r"V_\1", factor) for factor in motion)
    )
    if PROPULSION in factors:
        name, latex = f"({name})*({PROPULSION})", rf"{latex}(\eta-1)"
    return BasisTerm(name, factors, group, latex)


def _declare() -> Iterator[BasisTerm]:
    yield from (_term("nu", name) for name in VELOCITIES)
    yield from (_term("abs_nu", name) for name in MODULI)
    pairs = list(combinations_with_replacement(VELOCITIES, 2))
    yield from (_term("nu_nu", *pair) for pair in pairs)
    yield from (_term("nu_abs_nu", *pair) for pair in product(VELOCITIES, MODULI))
    yield from (
        _term("nu_V", name, cross) for cross in ("V", "Vv", "Vw") for name in VELOCITIES + MODULI
    )
    yield from (_term("nu_eta", *pair, PROPULSION) for pair in pairs)
    yield from (_term("nu_eta", name, "V", PROPULSION) for name in VELOCITIES)


BASIS_TERMS: Mapping[str, BasisTerm] = {term.name: term for term in _declare()}
"""All terms by name, in the order of (C.7)."""


def coefficient_unit(axis: str, term: str) -> str:
    """Return the SI unit of a coefficient of `axis` (X Y Z in N, K M N in N m).

    `N s^2/m^2` for u*u, `N m s^2/(m rad)` for u*r.

    A term that is not of the basis is the constant force of the axis and has its unit;
    eta - 1 has none.
    """
    factors = (
        [factor.strip("|") for factor in BASIS_TERMS[term].factors if factor != PROPULSION]
        if term in BASIS_TERMS
        else []
    )
    turning = sum(factor in VELOCITIES[3:] for factor in factors)
    below = [
        _power(name, count)
        for name, count in (("m", len(factors) - turning), ("rad", turning))
        if count
    ]
    unit = "N" if axis in FORCE_AXES else "N m"
    if not below:
        return unit
    divisor = below[0] if len(below) == 1 else f"({below[0]} {below[1]})"
    return f"{unit} {_power('s', len(factors))}/{divisor}"


def _power(unit: str, count: int) -> str:
    return unit if count == 1 else f"{unit}^{count}"


def basis_term_names() -> tuple[str, ...]:
    """Return the 132 names in the order of Appendix C."""
    return tuple(BASIS_TERMS)


def needs_propeller_speed(term: str) -> bool:
    """Return whether the term contains eta.

    A vehicle without a propeller speed does not have such a term.
    """
    return PROPULSION in BASIS_TERMS[term].factors


def basis_rows(
    nu_rows: ArrayLike, eta_ratio: ArrayLike | None = None, terms: Sequence[str] | None = None
) -> Array:
    """Return the values of `terms` (default: all 132), one contiguous row per term.

    Shapes: (6, n) -> (n_terms, n).

    `eta_ratio` (n,) is u_c(n) / U. Raises `DataError` when a term needs it and it is
    None, `PipelineError` for an unknown term.
    """
    nu = np.asarray(nu_rows, dtype=np.float64)
    names, places = product_plan(basis_term_names() if terms is None else tuple(terms))
    factor = _factors(np.ascontiguousarray(nu), eta_ratio)
    values = np.ones((len(names) + 1, nu.shape[1]))
    for row, name in zip(values, names, strict=False):
        row[:] = factor(name)
    out = np.empty((places.shape[1], nu.shape[1]))
    # in blocks that stay in the cache; a factor that a term does not have is the row of ones
    for start in range(0, nu.shape[1], BLOCK):
        part, block = values[:, start : start + BLOCK], out[:, start : start + BLOCK]
        np.multiply(part.take(places[0], axis=0), part.take(places[1], axis=0), out=block)
        for others in places[2:]:
            block *= part.take(others, axis=0)
    return out


@lru_cache(maxsize=64)
def product_plan(terms: tuple[str, ...]) -> tuple[tuple[str, ...], Index]:
    """Return the factors in `terms` and the places of each term's factors.

    First, second ... factor of each term; one beyond the last where a term has no such
    factor.
    """
    factors = [_lookup(name).factors for name in terms]
    names = tuple(dict.fromkeys(name for each in factors for name in each))
    depth = max((2, *map(len, factors)))
    places = [
        [names.index(each[k]) if k < len(each) else len(names) for each in factors]
        for k in range(depth)
    ]
    return names, np.array(places, dtype=np.intp)


def basis(
    nu: ArrayLike, eta_ratio: ArrayLike | None = None, terms: Sequence[str] | None = None
) -> Array:
    """Return the values of `terms` (default: all 132) with the term last.

    Shapes: nu (..., 6), eta_ratio (...) -> (..., n_terms). Errors as `basis_rows`.
    """
    nu = np.asarray(nu, dtype=np.float64)
    batch = nu.shape[:-1]
    ratio = (
        None
        if eta_ratio is None
        else np.broadcast_to(np.asarray(eta_ratio, dtype=np.float64), batch).reshape(-1)
    )
    rows = basis_rows(nu.reshape(-1, 6).T, ratio, terms)
    return rows.T.reshape(*batch, rows.shape[0])


def cross_flow_speed(v: Array, w: Array) -> Array:
    """Return V = sqrt(v^2 + w^2) (C.9); arrays, or numbers in the compiled loop."""
    return np.hypot(v, w)


def signed_speed(cross_speed: Array, velocity: Array) -> Array:
    """Return V_v = V sign(v) (C.10), or V_w (C.11); arrays, or numbers in the loop."""
    return cross_speed * np.sign(velocity)


def propulsion_ratio(level_speed: Array, u: Array, v: Array, w: Array, floor: float) -> Array:
    """Return eta = u_c(n) / U (C.12), U = sqrt(u^2 + v^2 + w^2) (C.8) above `floor`.

    Arrays of one shape, or numbers in the compiled loop.
    """
    return level_speed / np.maximum(np.sqrt(u * u + v * v + w * w), floor)


def eta_ratio(level_speed: ArrayLike, nu: ArrayLike, minimum_speed: float = 0.05) -> Array:
    """Return eta = u_c(n) / U (C.12): u_c (...) [m/s], nu (..., 6) -> (...).

    U is bounded below by `minimum_speed` [m/s]: eta grows without bound at rest, where
    terms like p^2 (eta - 1) would too. Below that speed the terms are therefore smaller
    than (C.6) has them; nan speeds stay nan.

    >>> eta_ratio(1.5, [0.6, 0.0, 0.8, 0.0, 0.0, 0.0])
    array(1.5)
    """
    u, v, w = components(np.asarray(nu, dtype=np.float64)[..., :3])
    level = np.asarray(level_speed, dtype=np.float64)
    return np.asarray(propulsion_ratio(level, u, v, w, minimum_speed))


def _lookup(name: str) -> BasisTerm:
    try:
        return BASIS_TERMS[name]
    except KeyError:
        raise PipelineError(
            "unknown basis term", value=name, remedy=nearest(name, BASIS_TERMS)
        ) from None


def _factors(nu: Any, ratio: ArrayLike | None) -> Callable[[str], Any]:
    """Return a function that gives each factor's row or number, when needed."""
    rows: dict[str, Any] = dict(zip(VELOCITIES, nu, strict=True))

    def compute(name: str) -> Any:
        if name in MODULI:
            return abs(rows[name.strip("|")])
        if name in ("V", "Vv", "Vw"):
            # Not through `factor`: two functions that hold each other keep their arrays
            # until the garbage collector runs.
            if "V" not in rows:
                rows["V"] = cross_flow_speed(rows["v"], rows["w"])
            return rows["V"] if name == "V" else signed_speed(rows["V"], rows[name[1]])
        if ratio is None:
            raise DataError(
                "a basis term needs the propulsion ratio u_c(n)/U, but there is no propeller speed",
                remedy="Leave the terms with (eta-1) out, or give the log's propeller speed.",
            )
        return np.asarray(ratio, dtype=np.float64) - 1.0

    def factor(name: str) -> Any:
        if name not in rows:
            rows[name] = compute(name)
        return rows[name]

    return factor
