"""Forms of the viscous force that are fitted: as declared, as the legs choose."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from auvid.data_schemas.errors import CampaignError, PipelineError, nearest
from auvid.hydro.arrays import VELOCITIES
from auvid.hydro.dynamics.viscous.basis import basis_term_names
from auvid.hydro.dynamics.viscous.models import MODELS, ViscousModel, without_propeller_terms
from auvid.hydro.dynamics.viscous.structures import diagonal, lift_and_drag, masked, symmetric
from auvid.hydro.dynamics.viscous.symmetry import PORT_STARBOARD
from auvid.hydro.identification.selection.axis_terms import SPARSE
from auvid.stages.synthesise.chosen_terms import REDUCED, ChosenTerms, base_of

PUBLISHED = frozenset(model.name for model in MODELS)
"""Names of the eight published forms."""


@dataclass(frozen=True)
class Forms:
    """The models of one synthesis, in the order of their cards.

    declared: as the campaign asks for them; fitted: without the terms of the propeller
    where a leg knows no propeller speed. to_choose: those of which the legs choose the
    terms. full: name of a reduced structure -> the full one, which it is judged by;
    unrequested: those of them that no card is written of. terms: of all, before any choice.
    """

    declared: tuple[ViscousModel, ...]
    fitted: tuple[ViscousModel, ...]
    to_choose: tuple[ViscousModel, ...]
    full: Mapping[str, ViscousModel]
    unrequested: tuple[ViscousModel, ...]
    terms: tuple[str, ...]
    with_ratio: bool

    @classmethod
    def of(
        cls,
        declared: Sequence[ViscousModel],
        stated: Mapping[str, ViscousModel],
        *,
        with_ratio: bool,
    ) -> Forms:
        """Return the declared models; `stated`: those whose terms are stated."""
        fitted = declared if with_ratio else [without_propeller_terms(m) for m in declared]
        to_choose = tuple(model for model in fitted if model.name not in stated)
        full = {
            model.name: stated[root]
            for model in to_choose
            if (root := model.name.removesuffix(REDUCED)) in stated
        }
        unrequested = {m.name: m for m in full.values() if m not in declared}
        return cls(
            tuple(declared),
            tuple(fitted),
            to_choose,
            full,
            tuple(unrequested.values()),
            in_order_of_basis(fitted),
            with_ratio,
        )

    def with_chosen(self, chosen: Mapping[str, ChosenTerms]) -> Forms:
        """Return the models with the terms that the legs chose, and the full ones."""

        def own(models: Iterable[ViscousModel]) -> list[ViscousModel]:
            return [chosen[m.name].model if m.name in chosen else m for m in models]

        further = list(self.unrequested)
        if not self.with_ratio:
            further = [without_propeller_terms(model) for model in further]
        return replace(
            self,
            declared=(*own(self.declared), *self.unrequested),
            fitted=(*own(self.fitted), *further),
        )

    @property
    def requested(self) -> tuple[ViscousModel, ...]:
        """Return the fitted models of which cards are written."""
        left_out = {model.name for model in self.unrequested}
        return tuple(model for model in self.fitted if model.name not in left_out)

    @property
    def structures(self) -> tuple[ViscousModel, ...]:
        """Return those of them that are fitted within limits: no published form."""
        return tuple(model for model in self.requested if model.name not in PUBLISHED)


def structures(mirrors: Sequence[str]) -> list[ViscousModel]:
    """Return the forms that follow from the symmetry of the hull.

    They stand beside the eight published ones; the last one is fitted where a campaign
    names it.
    """
    return [
        diagonal(),
        symmetric(mirrors=mirrors),
        symmetric(quadratic=True, mirrors=mirrors),
        lift_and_drag(),
    ]


def model_names() -> list[str]:
    """Return the names that `models` may have, but for structures of the campaign."""
    stated = [model.name for model in (*structures((PORT_STARBOARD,)), *MODELS)]
    return [*stated, SPARSE, *(f"{name}{REDUCED}" for name in stated)]


def declared_forms(
    names: Sequence[str],
    structures_of_campaign: Mapping[str, Mapping[str, list[str]]],
    mirrors: Sequence[str],
) -> tuple[list[ViscousModel], dict[str, ViscousModel]]:
    """Return the models to fit: the campaign's own, structures, published forms.

    And all whose terms are stated, by name; a model that is none of them has all terms
    that the training legs may choose.
    """
    field = "stages.synthesise.models"
    own = {name: _own_structure(name, terms) for name, terms in structures_of_campaign.items()}
    stated = {model.name: model for model in (*structures(mirrors), *MODELS)}
    for name in own:
        if name in stated or name == SPARSE:
            raise CampaignError(
                "a structure has the name of a known model",
                field="stages.synthesise.structures",
                value=name,
                remedy="Give it another name.",
            )
    stated |= own
    by_name = dict(stated)
    for name in names:
        base = None if name in by_name else base_of(name, stated, mirrors)
        if base is not None:
            by_name[name] = base
        if name not in by_name or name in own:
            allowed = (*(form for form in stated if form not in own), SPARSE)
            raise CampaignError(
                "unknown model",
                field=field,
                value=name,
                allowed=(*allowed, f"one of them with {REDUCED} behind its name"),
                remedy=nearest(name, [*model_names(), *(f"{form}{REDUCED}" for form in own)]),
            )
    if not (names or own) or len(set(names)) < len(names):
        raise CampaignError(
            "name at least one model, and each once",
            field=field,
            value=list(names),
            allowed=(*stated, SPARSE),
        )
    return [*own.values(), *(by_name[name] for name in names)], stated


def _own_structure(name: str, terms: Mapping[str, list[str]]) -> ViscousModel:
    field = f"stages.synthesise.structures.{name}"
    if not isinstance(terms, Mapping) or not all(isinstance(row, list) for row in terms.values()):
        raise CampaignError(
            "a structure maps axes to lists of terms",
            field=field,
            value=terms,
            remedy='Write {X: [u, "u|u|"], N: [r]}.',
        )
    try:
        model = masked(terms, name=name)
    except PipelineError as wrong:
        raise CampaignError(
            wrong.message, field=f"{field}.{wrong.field}", value=wrong.value, remedy=wrong.remedy
        ) from wrong
    if not model.n_bar:
        raise CampaignError("a structure without a term", field=field)
    return model


def with_terms(model: ViscousModel, more: Mapping[str, Sequence[str]]) -> ViscousModel:
    """Return a model with further terms, by axis."""
    terms = {axis: (*own, *more.get(axis, ())) for axis, own in model.terms.items()}
    return replace(model, terms=terms)


def terms_with_coriolis(models: Iterable[ViscousModel]) -> tuple[str, ...]:
    """Return the terms of models, and the products of the Coriolis force."""
    return in_order_of_basis(models, {f"{a}*{b}" for a in VELOCITIES for b in VELOCITIES})


def in_order_of_basis(models: Iterable[ViscousModel], more: Iterable[str] = ()) -> tuple[str, ...]:
    """Return the terms that some model has, and more, in the order of the basis."""
    used = {term for model in models for terms in model.terms.values() for term in terms}
    used.update(more)
    return tuple(term for term in basis_term_names() if term in used)
