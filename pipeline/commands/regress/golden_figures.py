"""Golden figures: what every stage gave, and coefficients, free runs, results.

Four CSVs of one layout. A row has a `value` and a `scale`: what its tolerance is a
share of. Numbers that the data do not determine are left empty, their verdict stays.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc

from auvid.data_schemas.errors import CampaignError
from auvid.data_schemas.schemas import schema
from auvid.pipeline.campaigns.yaml_files import load_yaml
from auvid.pipeline.commands.regress.golden_tables import Departure, read_tolerances, six_digits
from auvid.pipeline.execution.runner import Run
from auvid.pipeline.graph import AnyStage, Port
from auvid.pipeline.store.atomic_files import readable
from auvid.stages.number_format import significant
from auvid.stages.reference_check import ReferenceCheck, Tolerance
from auvid.stages.report.summary.figure_summary import DETERMINED

FILES = ("stages", "coefficients", "free_run", "results")
"""Mean, RMS and gaps of each column of each stage's tables; coefficients with verdicts;
RMS errors of free runs; named figures.
"""
HEADER = ("stage", "of", "quantity", "verdict", "value", "scale", "unit")
TOLERANCES = "figure_tolerances.yaml"
LEFT_OUT = "left_out.yaml"
"""Beside golden figures: items that amplify rounding until another processor gives other
numbers, and why: name -> reason.
"""
OWN_FILE = ("error_table", "free_run")
"""Tables with golden content of their own."""
UNDETERMINED = ("simulated_motion", "channel_run", "channel_history", "decay_history")
"""Motions of models that may be unstable, and recursions on their way: what they find
stands in the results.
"""
LAST = "report"
NOT_FINITE = " not finite"
"""Ends the quantity of a row that counts gaps in a column; no row, no gap."""
SPREAD, SPREAD_FACTOR = "_sd_", 20.0
"""Columns of standard deviations and how much further they may move: a spline's own
noise is the minimum of a flat curve, which moved 1.3e-4 without AVX-512.
"""
STAYED = 0.75
"""Share of free runs that must not diverge for the RMS error of these to be kept."""
MOTIONS = {
    "velocity": ("u_rms_m_s", "v_rms_m_s", "w_rms_m_s"),
    "angular rate": ("p_rms_rad_s", "q_rms_rad_s", "r_rms_rad_s"),
    "angles": ("phi_rms_rad", "theta_rms_rad", "psi_rms_rad"),
}
UNITS = {"velocity": "m/s", "angular rate": "rad/s", "angles": "rad"}

Key = tuple[str, str, str]
"""Stage, what the figure is of, and its quantity."""


@dataclass(frozen=True)
class GoldenFigure:
    """One row: `scale` is the RMS of a column, or a standard error; None: the value."""

    value: float | None
    scale: float | None
    unit: str
    verdict: str = ""


Figures = Mapping[str, Mapping[Key, GoldenFigure]]
"""File -> key -> figure, in the order of the chain."""


@dataclass
class ColumnSums:
    """Sums over one column of a table, all items together."""

    unit: str
    count: int = 0
    gaps: int = 0
    total: float = 0.0
    squares: float = 0.0

    def add(self, values: npt.NDArray[np.float64]) -> None:
        finite = values[np.isfinite(values)]
        self.count += finite.size
        self.gaps += values.size - finite.size
        self.total += float(finite.sum())
        self.squares += float(np.square(finite).sum())

    @property
    def figure(self) -> GoldenFigure:
        """Mean and RMS."""
        if not self.count:
            return GoldenFigure(None, None, self.unit, "empty")
        mean, rms = self.total / self.count, math.sqrt(self.squares / self.count)
        return GoldenFigure(six_digits(mean), six_digits(rms), self.unit)


@dataclass
class RunSums:
    """Free runs of one model up to one horizon, all segments together."""

    starts: int = 0
    diverged: int = 0
    squares: dict[str, float] = field(default_factory=dict)

    def add(self, row: Mapping[str, Any]) -> None:
        bounded = row["starts"] - row["diverged"]
        self.starts += row["starts"]
        self.diverged += row["diverged"]
        for name, columns in MOTIONS.items() if bounded else ():
            errors = sum((row[column] or 0.0) ** 2 for column in columns)
            self.squares[name] = self.squares.get(name, 0.0) + bounded * errors

    def figure(self, name: str) -> GoldenFigure:
        """RMS error of runs that did not diverge, where these are `STAYED` of all."""
        bounded = self.starts - self.diverged
        verdict = f"{self.diverged} of {self.starts} diverged" if self.diverged else "bounded"
        if bounded < STAYED * self.starts:
            return GoldenFigure(None, None, UNITS[name], verdict)
        rms = math.sqrt(self.squares.get(name, 0.0) / max(bounded, 1))
        return GoldenFigure(six_digits(rms), None, UNITS[name], verdict)


def stages_of(run: Run) -> list[AnyStage]:
    """Return the stages whose results have golden figures."""
    giving = {port.stage.name for port in run.graph.outputs if _counts(port.schema)}
    return [stage for stage in run.graph.stages if stage.name in giving - {LAST}]


def _counts(schema_name: str) -> bool:
    """Return whether an artefact of a schema gives golden figures."""
    return schema(schema_name).kind == "table" or schema_name in READERS


def left_out(folder: Path) -> tuple[str, ...]:
    """Return the names that golden figures of a folder leave out; mostly none.

    Raises `CampaignError` for a file that is no list of names with their reasons.
    """
    path = folder / LEFT_OUT
    if not path.is_file():
        return ()
    names = load_yaml(path, what="what golden figures leave out").value
    if not isinstance(names, dict) or not all(isinstance(why, str) for why in names.values()):
        raise CampaignError("not names with reasons", file=path, allowed="NAME: reason")
    return tuple(str(name) for name in names)


def figures_of(
    run: Run, stages: Sequence[AnyStage] | None = None, *, without: Sequence[str] = ()
) -> dict[str, dict[Key, GoldenFigure]]:
    """Return the golden figures of what stages of a run left behind, or all of them.

    `without` names items, rows and results that stay out: an item `saw_tooth-undisturbed`,
    rows with the cell `saw_tooth`, results that name it.
    """
    figures: dict[str, dict[Key, GoldenFigure]] = {name: {} for name in FILES}
    for stage in stages_of(run) if stages is None else stages:
        by_port: dict[str, tuple[Port, list[tuple[str, Any]]]] = {}
        for port, item, key, artefact in run.artefacts(stage):
            if _counts(port.schema):
                of = item if key is None else str(key)
                _, loads = by_port.setdefault(port.name, (port, []))
                if of.partition("-")[0] not in without:
                    loads.append((of, artefact))
        for name, (port, artefacts) in by_port.items():
            loaded = ((item, artefact.load()) for item, artefact in artefacts)
            if port.schema in READERS:
                file, read = READERS[port.schema]
                figures[file] |= {
                    (stage.name, *rest): figure
                    for rest, figure in read(loaded)
                    if not any(name in rest[1] for name in without)
                }
            elif port.schema not in (*OWN_FILE, *UNDETERMINED):
                columns = _columns(port.schema, loaded, without)
                figures["stages"] |= {
                    (stage.name, name, column): figure for column, figure in columns
                }
    return figures


Loaded = Iterator[tuple[str, Any]]
Figured = Iterator[tuple[tuple[str, str], GoldenFigure]]


def _columns(
    schema_name: str, loaded: Loaded, without: Sequence[str] = ()
) -> Iterator[tuple[str, GoldenFigure]]:
    """Yield rows and columns; a table with verdicts has its figures in the results."""
    columns = schema(schema_name).columns
    if "verdict" in columns:
        return
    sums: dict[str, ColumnSums] = {}
    rows = 0
    for _, read in loaded:
        table = _rows_without(read, without)
        rows += table.num_rows
        for name in table.column_names:
            kind = table.schema.field(name).type
            if pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_boolean(kind):
                unit = columns[name].unit if name in columns else ""
                values = table.column(name).cast(pa.float64()).to_numpy()
                sums.setdefault(name, ColumnSums(unit)).add(values)
    yield "rows", GoldenFigure(float(rows), None, "1")
    for name, column in sums.items():
        yield name, column.figure
        if column.gaps and column.count:
            yield name + NOT_FINITE, GoldenFigure(float(column.gaps), None, "1")


def _rows_without(table: pa.Table, names: Sequence[str]) -> pa.Table:
    """Return a table without the rows of which a text cell is one of these names."""
    texts = [field.name for field in table.schema if pa.types.is_string(field.type)]
    for name in texts if names else ():
        named = pc.is_in(table.column(name), value_set=pa.array(names, pa.string()))
        table = table.filter(pc.invert(named))
    return table


def _coefficients(loaded: Loaded) -> Figured:
    for model, card in loaded:
        document = card if isinstance(card, dict) else card.model_dump()
        for axis, entry in document["axes"].items():
            for term in entry["terms"]:
                yield (model, f"{axis} {term['term']}"), _estimate(term, term["value"])
        for entry in document["inertia"]:
            yield (model, entry["name"]), _estimate(entry, entry["value"])


def _installation(loaded: Loaded) -> Figured:
    for _, record in loaded:
        document = record if isinstance(record, dict) else record.model_dump()
        for entry in document["figures"]:
            observable = entry["verdict"] != "not observable"
            value, error = entry["departure"], entry["standard_error"]
            yield (
                ("installation", entry["name"]),
                GoldenFigure(
                    six_digits(value) if observable else None,
                    six_digits(error) if observable else None,
                    entry["unit"],
                    entry["verdict"],
                ),
            )


def _results(loaded: Loaded) -> Figured:
    """Yield named figures; errors of a fit with undetermined terms stay out.

    Such a fit is what stands in brackets: `rmse (linear)` beside `Z_w (linear)`.
    """
    for _, record in loaded:
        document = record if isinstance(record, dict) else record.model_dump()
        weak = {_fit(row["quantity"]) for row in document["rows"] if not _determined(row)} - {""}
        for row in document["rows"]:
            left_out = _fit(row["quantity"]) in weak and not row.get("verdict")
            figure = _estimate(row, None if left_out else row["value"])
            yield (document["title"], row["quantity"]), figure


def _fit(quantity: str) -> str:
    return quantity.partition("(")[2].rstrip(")") if quantity.endswith(")") else ""


def _determined(row: Mapping[str, Any]) -> bool:
    return not row.get("verdict") or row["verdict"] in DETERMINED


def _estimate(row: Mapping[str, Any], value: float | None) -> GoldenFigure:
    """Return value and standard error; of what is undetermined the verdict alone."""
    verdict = row.get("verdict") or ""
    error = row.get("standard_error")
    kept = _determined(row) and value is not None
    return GoldenFigure(
        six_digits(value) if kept else None,
        six_digits(error) if kept else None,
        row["unit"],
        verdict,
    )


def _free_runs(loaded: Loaded) -> Figured:
    motions: dict[tuple[str, str], RunSums] = {}
    for _, table in loaded:
        for row in table.to_pylist():
            of = f"{row['model']} with {row['as_measured']}" if row["as_measured"] else row["model"]
            motions.setdefault((of, f"{row['horizon_s']:g} s"), RunSums()).add(row)
    for (of, horizon), motion in motions.items():
        for name in MOTIONS:
            yield (of, f"{name} after {horizon}"), motion.figure(name)


READERS = {
    "model_card": ("coefficients", _coefficients),
    "installation": ("results", _installation),
    "results": ("results", _results),
    "free_run": ("free_run", _free_runs),
}


def to_csv(figures: Mapping[Key, GoldenFigure]) -> bytes:
    """Return the CSV of one file: a header and a row per figure."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(HEADER)
    for key, figure in figures.items():
        numbers = ("" if each is None else f"{each:.6g}" for each in (figure.value, figure.scale))
        writer.writerow((*key, figure.verdict, *numbers, figure.unit))
    return text.getvalue().encode()


def read_figures(folder: Path) -> dict[str, dict[Key, GoldenFigure]]:
    """Read the golden figures of a folder, empty where it holds none.

    Raises `CampaignError` with file and row for what is malformed.
    """
    return {
        name: _read_csv(path) if (path := folder / f"{name}.csv").is_file() else {}
        for name in FILES
    }


def _read_csv(path: Path) -> dict[Key, GoldenFigure]:
    with readable(path, file=path, what="golden figures"):
        text = path.read_text(encoding="utf-8")
    figures: dict[Key, GoldenFigure] = {}
    for line, cells in enumerate(csv.reader(io.StringIO(text, newline="")), start=1):
        if line == 1:
            if tuple(cells) != HEADER:
                raise CampaignError(
                    "not the heading of golden figures", file=path, row=1, allowed=",".join(HEADER)
                )
            continue
        try:
            stage, of, quantity, verdict, value, scale, unit = cells
            figures[stage, of, quantity] = GoldenFigure(
                _number(value), _number(scale), unit, verdict
            )
        except ValueError:
            raise CampaignError(
                "not a row of golden figures",
                file=path,
                row=line,
                value=",".join(cells),
                allowed=",".join(HEADER),
                remedy="Write the file anew with --update.",
            ) from None
    return figures


def _number(cell: str) -> float | None:
    return float(cell) if cell else None


def tolerances() -> dict[str, Tolerance]:
    """Return the tolerance of each file: `relative` is a share of a row's scale."""
    path = Path(str(resources.files(__package__) / TOLERANCES))
    return read_tolerances(path, FILES)


def compare(old: Figures, new: Figures) -> tuple[int, list[Departure]]:
    """Return how many numbers and verdicts hold, and what does not.

    Departures come in the order of the chain: what the first one names moved first.
    """
    order = {
        stage: place
        for place, stage in enumerate(
            dict.fromkeys(
                stage for side in (new, old) for file in FILES for stage, *_ in side.get(file, {})
            )
        )
    }
    within, departed = 0, []
    allowed = tolerances()
    for file in FILES:
        before, now = old.get(file, {}), new.get(file, {})
        for key in dict.fromkeys((*before, *now)):
            was, is_now = _row(before, key), _row(now, key)
            if was is None or is_now is None:
                kind = "new" if was is None else "missing"
                departed.append(Departure(kind, file, key[1], key[2], stage=key[0]))
                continue
            for check in _checks(key[2], was, is_now, allowed[file]):
                if check.met:
                    within += 1
                else:
                    departed.append(Departure("changed", file, key[1], key[2], check, key[0]))
    return within, sorted(departed, key=lambda item: order[item.stage])


def _row(rows: Mapping[Key, GoldenFigure], key: Key) -> GoldenFigure | None:
    """Return the figure of a key; 0 for the gaps of a column that has none."""
    stage, of, quantity = key
    if quantity.endswith(NOT_FINITE) and (stage, of, quantity.removesuffix(NOT_FINITE)) in rows:
        return rows.get(key, GoldenFigure(0.0, None, "1"))
    return rows.get(key)


def _checks(
    quantity: str, old: GoldenFigure, new: GoldenFigure, tolerance: Tolerance
) -> Iterator[ReferenceCheck]:
    """Yield the checks of verdict and value, and of the scale.

    Counts of gaps are exact. Older files hold no number of runs some of which diverged.
    """
    scale = old.scale if old.scale is not None else old.value
    further = SPREAD_FACTOR if SPREAD in quantity else 1.0
    allowed = further * tolerance.allowed(scale or 0.0)
    near = Tolerance(old.unit, tolerance.reason, absolute=allowed)
    if quantity.endswith(NOT_FINITE):
        near = Tolerance(old.unit, "a value is there or not")
    same = old.verdict == new.verdict
    judged = old.value is not None or not (same and old.verdict.endswith(" diverged"))
    yield ReferenceCheck(
        quantity,
        new.value if judged else None,
        old.unit,
        reference=old.value,
        tolerance=near,
        status=new.verdict,
        required_status=old.verdict if old.verdict or new.verdict else None,
    )
    numbers = sum(each is not None for each in (old.scale, new.scale))
    if numbers == 2 or (numbers and same):
        yield ReferenceCheck(
            f"scale of {quantity}", new.scale, old.unit, reference=old.scale, tolerance=near
        )


def without(figures: Figures, stages: Sequence[str]) -> Figures:
    """Return figures without those of some stages."""
    return {
        file: {key: figure for key, figure in rows.items() if key[0] not in stages}
        for file, rows in figures.items()
    }


def first_change(departures: Sequence[Departure]) -> str:
    """Return which stage's results moved first, and where; empty if none did."""
    if not departures:
        return ""
    first = departures[0]
    words = f"{first.model}: {first.column}"
    if first.check is not None and first.check.change is not None:
        words += f", by {significant(first.check.change, sign='+')} {first.check.unit}".rstrip(" 1")
    return f"stage {first.stage} ({words})"
