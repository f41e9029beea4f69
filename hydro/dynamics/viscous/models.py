"""The eight viscous force models of McCarter 2014, chapter 3, tau_nu = K xi(nu) (3.12).

Each is written down by its own rule.

Terms of an axis stand in the order of Appendix C. Where chapter 3 and Appendix D differ
(Coe), the model is the one that was fitted.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from auvid.data_schemas.errors import PipelineError, nearest
from auvid.hydro.arrays import AXES, VELOCITIES, Array
from auvid.hydro.dynamics.viscous.basis import basis, basis_term_names, needs_propeller_speed

Coefficients = Mapping[str, Mapping[str, float]]
"""Axis -> term -> coefficient in SI."""
PIECE = 1 << 14
"""Samples of which all terms of a model are in memory at once."""

_ORDER = {name: index for index, name in enumerate(basis_term_names())}
_ETA = "({})*(eta-1)"


@dataclass(frozen=True)
class ViscousModel:
    """The form of a viscous model.

    For each axis X Y Z K M N the basis terms it contains (none for an axis without
    force).
    """

    name: str
    title: str
    terms: Mapping[str, tuple[str, ...]]
    source: str

    @property
    def n_bar(self) -> int:
        """Number of coefficients, McCarter's model complexity."""
        return sum(len(terms) for terms in self.terms.values())

    @property
    def distinct_terms(self) -> tuple[str, ...]:
        """Every term that occurs in some axis, once, in the order of Appendix C."""
        return _ordered({term for terms in self.terms.values() for term in terms})


def _ordered(terms: Iterable[str]) -> tuple[str, ...]:
    return tuple(sorted(terms, key=_ORDER.__getitem__))


def _model(name: str, title: str, source: str, terms: Mapping[str, Iterable[str]]) -> ViscousModel:
    return ViscousModel(name, title, {axis: _ordered(terms.get(axis, ())) for axis in AXES}, source)


def _products(text: str) -> list[str]:
    """`uv w|w|` -> u*v, w*|w|; a single name stays."""
    return [
        f"{word[0]}*{word[1:]}" if len(word) > 1 and word[0] != "|" else word
        for word in text.split()
    ]


def _gertler_hagen() -> ViscousModel:
    """Return the model of (3.13)-(3.18)."""
    side = [*_products("uu uv up ur vw vq wp wr pq qr"), "v*V"]
    upright = [*_products("uu uw uq vv vp vr pp pr rr u|w|"), "w*V", "|w|*V"]
    steer = [_ETA.format(term) for term in ("u*v", "u*r", "v*V")]
    dive = [_ETA.format(term) for term in ("u*w", "u*q", "w*V")]
    terms = {
        "X": [*_products("uu vv vr ww wq pr qq rr"), _ETA.format("v*v"), _ETA.format("w*w")],
        "Y": [*side, "p*|p|", "|r|*Vv", *steer],
        "Z": [*upright, "|q|*Vw", *dive],
        "K": [*side, "p*|p|", _ETA.format("u*u")],
        "M": [*upright, "q*|q|", "q*V", *dive],
        "N": [*side, "r*|r|", "r*V", *steer],
    }
    return _model("gertler_hagen", "Gertler & Hagen", "McCarter 2014 (3.13)-(3.18)", terms)


def _prestero() -> ViscousModel:
    """Return the model of (3.20)-(3.25)."""
    steer = _products("uv ur wp pq v|v| r|r|")
    dive = _products("uw uq vp pr w|w| q|q|")
    terms = {
        "X": _products("vr wq qq rr u|u|"),
        "Y": steer,
        "Z": dive,
        "K": ["p*|p|"],
        "M": dive,
        "N": steer,
    }
    return _model("prestero", "Prestero", "McCarter 2014 (3.20)-(3.25)", terms)


def _pitch_yaw() -> ViscousModel:
    """Return separate models of the vertical and horizontal planes (3.26)-(3.31).

    Vertical (u, w, q), horizontal (u, v, r); surge takes part in both, roll in none.
    """

    def plane(lateral: str, rate: str) -> list[str]:
        a, b = lateral, rate
        linear = [a, b, "|u|", f"|{a}|", f"|{b}|"]
        signed = _products(f"uu u{a} u{b} {a}{a} {a}{b} {b}{b}")
        moduli = _products(f"u|{a}| u|{b}| {a}|{a}| {a}|{b}| {b}|{a}| {b}|{b}|")
        return [*linear, *signed, *moduli]

    steer, dive = plane("v", "r"), plane("w", "q")
    # (3.26) against the union of both planes: u in place of |u|, q|u| in place of uq.
    surge = {*steer, *dive, "u", "q*|u|"} - {"|u|", "u*q"}
    terms = {"X": surge, "Y": steer, "Z": dive, "M": dive, "N": steer}
    return _model("pitch_yaw", "Pitch & Yaw", "McCarter 2014 (3.26)-(3.31)", terms)


def _linear() -> ViscousModel:
    """Return the model of (3.32)-(3.33)."""
    return _model(
        "linear", "Linear", "McCarter 2014 (3.32)-(3.33)", dict.fromkeys(AXES, VELOCITIES)
    )


def _mcfarland() -> ViscousModel:
    """Return the model of (3.34, corrected), K (nu kron |nu|)."""
    kronecker = [f"{left}*|{right}|" for left in VELOCITIES for right in VELOCITIES]
    return _model(
        "mcfarland",
        "McFarland & Whitcomb",
        "McCarter 2014 (3.34), corrected: K (nu kron |nu|)",
        dict.fromkeys(AXES, kronecker),
    )


def _uncoupled() -> ViscousModel:
    """Return the model of (3.35)-(3.40)."""
    terms = {
        axis: [x, f"|{x}|", f"{x}*{x}", f"{x}*|{x}|"]
        for axis, x in zip(AXES, VELOCITIES, strict=True)
    }
    return _model("uncoupled", "Uncoupled", "McCarter 2014 (3.35)-(3.40)", terms)


def _fossen() -> ViscousModel:
    """Return the model of (3.41, corrected), diag(b) diag(|nu|) nu."""
    terms = {axis: [x, f"{x}*|{x}|"] for axis, x in zip(AXES, VELOCITIES, strict=True)}
    return _model(
        "fossen", "Fossen", "McCarter 2014 (3.41), corrected: diag(b) diag(|nu|) nu", terms
    )


def _coe() -> ViscousModel:
    """Return (3.42)-(3.44) without X, Z, M of u|u|, the fitted model (D.6, E.8).

    In ahead motion u|u| equals u^2.
    """
    squares = [f"{x}*{x}" for x in VELOCITIES]
    upright = [*squares, "w*|w|", "q*|q|"]
    side = [f"{x}*|{x}|" for x in "vpr"]
    terms = {"X": [*upright], "Y": side, "Z": upright, "K": side, "M": upright, "N": side}
    return _model("coe", "Coe", "McCarter 2014 (3.42)-(3.44) as fitted in Appendix D", terms)


MODELS: tuple[ViscousModel, ...] = (
    _gertler_hagen(),
    _prestero(),
    _pitch_yaw(),
    _linear(),
    _mcfarland(),
    _uncoupled(),
    _fossen(),
    _coe(),
)


def model_named(name: str) -> ViscousModel:
    """The model of this name. Raises `PipelineError` that names the nearest one."""
    names = [model.name for model in MODELS]
    if name not in names:
        raise PipelineError(
            "unknown viscous model", value=name, allowed=names, remedy=nearest(name, names)
        )
    return MODELS[names.index(name)]


def without_propeller_terms(model: ViscousModel) -> ViscousModel:
    """The model without the terms in eta, for a vehicle that has no propeller speed."""
    kept = {
        axis: tuple(term for term in terms if not needs_propeller_speed(term))
        for axis, terms in model.terms.items()
    }
    return replace(model, terms=kept)


def coefficient_matrix(coefficients: Coefficients, terms: tuple[str, ...]) -> Array:
    """Return K (6, n_terms) of (3.12) for the columns `terms`.

    A term or axis without a coefficient is 0.
    """
    return np.array(
        [[coefficients.get(axis, {}).get(term, 0.0) for term in terms] for axis in AXES],
        dtype=np.float64,
    ).reshape(6, len(terms))


@dataclass(frozen=True)
class IdentifiedModel:
    """A named set of coefficients (published or identified)."""

    name: str
    coefficients: Coefficients

    @cached_property
    def terms(self) -> tuple[str, ...]:
        """Return the distinct terms, the columns of `regressor`."""
        return _ordered({term for axis in self.coefficients.values() for term in axis})

    @cached_property
    def matrix(self) -> Array:
        """K (6, n_terms)."""
        return coefficient_matrix(self.coefficients, self.terms)

    def regressor(self, nu: ArrayLike, eta_ratio: ArrayLike | None = None) -> Array:
        """xi(nu): (..., 6), (...) -> (..., n_terms)."""
        return basis(nu, eta_ratio, self.terms)

    def force(self, nu: ArrayLike, eta_ratio: ArrayLike | None = None) -> Array:
        """tau_nu: (..., 6), (...) -> (..., 6) [N, N m]."""
        nu = np.asarray(nu, dtype=np.float64)
        if nu.ndim != 2 or len(nu) <= PIECE:
            return np.asarray(self.regressor(nu, eta_ratio) @ self.matrix.T)
        ratio = None if eta_ratio is None else np.broadcast_to(eta_ratio, len(nu))
        force = np.empty((len(nu), 6))
        for rows in (slice(start, start + PIECE) for start in range(0, len(nu), PIECE)):
            part = None if ratio is None else ratio[rows]
            np.matmul(self.regressor(nu[rows], part), self.matrix.T, out=force[rows])
        return force
