"""What the tables and the text of a reproduction are made of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from auvid.data_schemas.errors import CampaignError, nearest
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.stages.base import Document
from auvid.stages.reproduce.measures import VariantCheck, VariantMeasures


@dataclass(frozen=True)
class ReproductionContent:
    """The documents, and the measures by `PLAN/VARIANT` with their checks."""

    document: Document
    published: Document
    vehicle: Vehicle
    plans: Mapping[str, Document]
    measures: Mapping[str, VariantMeasures]
    checks: tuple[VariantCheck, ...]

    @property
    def plan(self) -> str:
        """Return the plan that is held against the published tables."""
        return str(self.document["plans"][0]["id"])

    @property
    def repeated(self) -> list[str]:
        """Plans that fly the first one again with other random numbers."""
        first, *others = self.document["plans"]
        return [entry["id"] for entry in others if entry["plan"] == first["plan"]]

    @property
    def flown(self) -> dict[str, Document]:
        """Return the plans without those that are repeated."""
        return {name: plan for name, plan in self.plans.items() if name not in self.repeated}

    @cached_property
    def variants(self) -> dict[str, Document]:
        return {entry["id"]: entry for entry in self.document["variants"]}

    def of(self, plan: str) -> dict[str, VariantMeasures]:
        """Return the variants that were run on a plan, in the order of the document."""
        return {
            name: self.measures[f"{plan}/{name}"]
            for name in self.variants
            if f"{plan}/{name}" in self.measures
        }

    def label(self, variant: str) -> str:
        return f"({self.variants[variant]['label']})"

    def compared(self, role: str) -> tuple[str, VariantMeasures]:
        """Return label and measures of a variant that the text names.

        They are those of the first plan.
        """
        name = str(self.document["compared"][role])
        measures = self.of(self.plan)
        if name not in measures:
            raise CampaignError(
                "not a variant of the first plan",
                field=f"compared.{role}",
                value=name,
                remedy=nearest(name, measures),
            )
        return self.label(name), measures[name]

    @cached_property
    def printed(self) -> dict[tuple[str, str], Document]:
        """Published rows by set and model."""
        return {(row["set"], row["model"]): row for row in self.published["rows"]}

    def printed_j0(self, use: str) -> float | None:
        """Return the published J0 of a set."""
        return next((float(row["J0"]) for (of, _), row in self.printed.items() if of == use), None)

    @cached_property
    def transport(self) -> tuple[float, float]:
        """Return what omega x v adds to the sway force per u r, and what belongs there.

        m - Y_vdot is added, m - X_udot belongs there [kg].
        """
        mass, added = self.vehicle.mass_kg, self.vehicle.added_mass
        return mass - float(added[1, 1]), mass - float(added[0, 0])

    @property
    def missed(self) -> list[VariantCheck]:
        """Bounds that are missed without an accepted reason."""
        return [item for item in self.checks if item.check.failed]

    def model_title(self, model: str) -> str:
        return next(
            (
                score.title
                for item in self.measures.values()
                for (_, name), score in item.scores.items()
                if name == model
            ),
            model,
        )
