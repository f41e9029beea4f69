"""Write the reference pages of docs/ from the declarations of the code.

docs/model_file.md and docs/reference/: commands, stages with their parameters,
artefacts with their columns, documents with their keys, and force models. Edit the
declarations, not these pages.

    python tools/reference.py [CHECKOUT]
"""

from __future__ import annotations

import argparse
import re
import types
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import typer
from pydantic.fields import FieldInfo

from auvid.data_schemas.documents import MODELS, model_of
from auvid.data_schemas.documents.model import Model, Quantity, Range, Unit, meanings
from auvid.data_schemas.documents.vehicle.vehicle import VehicleDocument
from auvid.data_schemas.records.model_file import FORMAT, PARTIAL_FORMAT, ModelFile
from auvid.data_schemas.schemas import schema, schema_names, schema_text
from auvid.data_schemas.yaml_text import read_yaml
from auvid.hydro.dynamics.viscous.basis import coefficient_unit
from auvid.hydro.dynamics.viscous.models import MODELS as FORCE_MODELS
from auvid.pipeline.cli import app
from auvid.pipeline.execution.generate_dvc import bounds, default_of
from auvid.pipeline.graph import AnyStage
from auvid.pipeline.output import COMMON, EXIT_CODES, PANELS
from auvid.stages.base import ports
from auvid.stages.registry import KINDS, STAGES

WRITTEN = "Written by `make declarations` from {}: edit that, not this page."
DOCUMENTS: Mapping[str, tuple[str, str]] = {
    "campaign": ("campaign.yaml", "`campaigns/NAME/campaign.yaml`"),
    "vehicle": ("Vehicle file", "`vehicle:` of a campaign; also `vehicles/NAME.yaml`"),
    "column_map": ("Column map", "`columns:` of a CSV log"),
    "apparatus": ("Apparatus of a bench", "`apparatus:` of a bench campaign"),
    "plan": ("Plan of a twin", "`simulate: {plan: ...}` of a campaign"),
    "dive_plan": (
        "Plan of dives",
        "`simulate: {plan: ...}` of a campaign, for a vehicle with thrusters",
    ),
    "twin": ("Simulated part of a vehicle", "`twin:` of a vehicle file"),
    "control_cases": ("Cases of a control campaign", "`cases:` of a control campaign"),
    "published_values": ("Published values", "`published:` of a campaign"),
    "reproduction": ("Reproduction", "`reproduce.yaml` beside a campaign"),
    "inertia": ("Measured inertia", "`rigid_body.measured_inertia` of a vehicle file"),
    "tolerances": ("Tolerances", "`tolerances.yaml` beside golden tables"),
}
"""Documents that users write: title, and where a campaign names them."""
PARTS = {"schema", "model_file"}
"""Documents with a page of their own elsewhere."""
SIMPLE = {str: "text", float: "number", int: "integer", bool: "true or false", object: "any"}
NONE = type(None)


def line(words: str) -> str:
    """Return text for a cell of a table."""
    return " ".join(words.split()).replace("|", "\\|").replace("*", "\\*")


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """Return a Markdown table."""
    head = list(head)
    body = [head, ["---"] * len(head), *map(list, rows)]
    return "\n".join("| " + " | ".join(row) + " |" for row in body) + "\n"


def prose(kind: type) -> str:
    """Return the docstring of a class as paragraphs."""
    return "\n".join(part.strip() for part in (kind.__doc__ or "").strip().split("\n"))


def models_in(annotation: object) -> Iterator[type[Model]]:
    """Yield the models that an annotation names, quantities aside."""
    is_model = isinstance(annotation, type) and issubclass(annotation, Model)
    if is_model and annotation is not Quantity:
        yield annotation
    for inner in get_args(annotation):
        yield from models_in(inner)


def parts_of(
    kind: type[Model], elsewhere: tuple[type[Model], ...], kinds: list[type[Model]]
) -> list[type[Model]]:
    """Return a model and all models in it, in the order of the document."""
    if kind not in kinds and kind not in elsewhere:
        kinds.append(kind)
        for item in kind.model_fields.values():
            for inner in models_in(item.annotation):
                parts_of(inner, elsewhere, kinds)
    return kinds


def type_words(annotation: Any, limits: Iterable[object], links: Mapping[type[Model], str]) -> str:
    """Return a type in words, with bounds, units and links to the parts of the page."""
    origin, inner = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return type_words(inner[0], [*inner[1:], *limits], links)
    if origin in (Union, types.UnionType):
        return " or ".join(type_words(part, limits, links) for part in inner if part is not NONE)
    if origin is Literal:
        return ", ".join(f"`{value}`" for value in inner)
    if origin in (list, tuple) and inner:
        return "list of " + type_words(inner[0], (), links)
    if origin in (dict, Mapping) and inner:
        return "mapping of " + type_words(inner[1], (), links)
    if annotation is Quantity:
        return "[quantity](#quantity)" + "".join(map(_limit, limits))
    if isinstance(annotation, type) and issubclass(annotation, Model):
        own = links[annotation] == f"#{annotation.__name__.lower()}"
        return f"[{annotation.__name__ if own else 'mapping'}]({links[annotation]})"
    word = SIMPLE.get(annotation, "any")
    return word + "".join(map(_limit, limits))


def _limit(limit: object) -> str:
    if isinstance(limit, Unit):
        shape = " by ".join("n" if size < 0 else str(size) for size in limit.shape)
        sign = ", above 0" if limit.positive else "" if limit.may_be_negative else ", 0 or more"
        return f" [{limit.unit}]" + (f", {shape} numbers" if shape else "") + sign
    if isinstance(limit, Range):
        low, high = limit.low, limit.high
        if low is None:
            return f", at most {high:g}"
        return f", at least {low:g}" if high is None else f", {low:g} to {high:g}"
    return ""


def _default(item: FieldInfo) -> str:
    if item.is_required():
        return "**required**"
    value = item.get_default(call_default_factory=True)
    if value is None:
        return ""
    if isinstance(value, Quantity):
        return f"{value.value:g} {value.unit}" if isinstance(value.value, float) else ""
    return "" if isinstance(value, Model) else f"`{_value(value)}`"


def _value(value: object) -> str:
    """Return a default as YAML writes it."""
    words = {True: "true", False: "false", None: "null"}
    return words[value] if value is None or isinstance(value, bool) else str(value)


def part_of_page(
    kind: type[Model], links: Mapping[type[Model], str], *, written: bool, title: str = ""
) -> str:
    """Return the section of one model: a row per key."""
    rows = []
    meaning = meanings(kind)
    for name, item in kind.model_fields.items():
        words = type_words(item.annotation, item.metadata, links)
        if written:
            cells = [f"`{name}`", words, _default(item), line(meaning.get(name, ""))]
        else:
            null = " or null" if NONE in get_args(item.annotation) else ""
            cells = [f"`{name}`", words + null, line(meaning.get(name, ""))]
        rows.append(cells)
    head = ("key", "type", "default", "meaning") if written else ("field", "type", "meaning")
    words = re.sub(r"\n\s*\n", "\n\n", prose(kind))
    return f"\n## {title or kind.__name__}\n\n{words}\n\n{table(head, rows)}"


def document_page(name: str) -> str:
    """Return the page of a document that users write."""
    title, place = DOCUMENTS[name]
    places = places_of(model_of(name))
    links = {part: "#" + re.sub(r"[^\w-]", "", at.lower()) for part, at in places.items()}
    links[model_of(name)] = "#top-level"
    body = "".join(
        part_of_page(part, links, written=True, title=f"`{at}`" if at else "Top level")
        for part, at in places.items()
    )
    if "(#quantity)" in body:
        body += part_of_page(Quantity, links, written=True)
    source = f"`data_schemas/{MODELS[name].rpartition('.')[0].replace('.', '/')}.py`"
    return (
        f"# {title}\n\nWhere: {place}. `auvid schema {name}` prints the JSON schema.\n{body}"
        f"\n---\n\n{WRITTEN.format(source)}\n"
    )


def places_of(kind: type[Model]) -> dict[type[Model], str]:
    """Return each model in a document with the path of keys at which it first stands."""
    places = {kind: ""}
    todo = [kind]
    while todo:
        outer = todo.pop(0)
        for name, item in outer.model_fields.items():
            for inner in models_in(item.annotation):
                if inner not in places:
                    places[inner] = f"{places[outer]}.{name}".lstrip(".")
                    todo.append(inner)
    return dict(sorted(places.items(), key=lambda entry: _order(kind, entry[1])))


def _order(kind: type[Model], path: str) -> tuple[int, str]:
    names = list(kind.model_fields)
    return (names.index(path.partition(".")[0]) if path else -1, path)


MODEL_FILE_HEAD = f"""# The model file

{WRITTEN.format("the docstrings of `data_schemas/records/model_file.py`")}

A run writes each model as `runs/CAMPAIGN/model_file/model_file/MODEL.json`. The file
stands alone: a simulator needs nothing else of auvid. This is format {FORMAT},
or {PARTIAL_FORMAT} where a model lacks axes or newtons ([axes](axes.md)); a file in another
format is refused, and the message names the version that reads it.
`auvid schema model_file` prints the JSON schema. In Python:

```python
from auvid.pipeline.store.model_files import read_model
from auvid.hydro.model_file import forces, inertia, vehicle_of

model = read_model(path)
M = inertia(model)  # (6, 6), rigid body and added mass
parts = forces(model, nu, eta)  # coriolis, viscous, restoring, (n, 6) each
nu_dot = (parts.viscous + parts.restoring + tau - parts.coriolis) @ inv(M).T
```

Before you use a number, read `use`: a model may be usable for some axes, or for
nothing. Before you quote a coefficient, read its `verdict`. A file with `partial` lacks
axes, which `forces` gives as nan, or counts mass in a unit of its own.
"""


def model_file_page() -> str:
    """Return docs/model_file.md: a table for each part, in the order of the file."""
    kinds = parts_of(ModelFile, (VehicleDocument,), [])
    links = {part: f"#{part.__name__.lower()}" for part in kinds}
    links[VehicleDocument] = "reference/vehicle.md"
    return MODEL_FILE_HEAD + "".join(part_of_page(part, links, written=False) for part in kinds)


def commands_page() -> str:
    """Return the page of the command line, from its signatures."""
    group: Any = typer.main.get_command(app)
    commands = command_tree()
    groups: dict[str, list[str]] = {panel: [] for panel in PANELS}
    for name in commands:
        groups[group.commands[name.partition(" ")[0]].rich_help_panel].append(name)
    parts = [
        "# Commands\n",
        WRITTEN.format("`pipeline/command_line/`") + "\n",
        "```text\nauvid [OPTIONS] COMMAND [ARGS]\n```\n",
        table(("option", "meaning"), _options(group)),
        "## Exit codes\n",
        table(
            ("code", "meaning"),
            [(str(code), words) for code, words in EXIT_CODES.items()],
        ),
        "Results go to standard output, faults to standard error. All commands but `inspect`"
        " and `schema` also take\n`--json`, `--quiet` and `--verbose`:"
        " [the command line](../command_line.md).\n",
    ]
    for title, names in groups.items():
        if names:
            parts.append(f"## {title}\n")
            parts += [_command(name, commands[name]) for name in names]
    return "\n".join(parts)


def command_tree() -> dict[str, Any]:
    """Return every command that help lists by its words, as `new campaign`."""
    group: Any = typer.main.get_command(app)
    tree: dict[str, Any] = {}
    for name, command in group.commands.items():
        parts = getattr(command, "commands", None)
        inner = (
            {f"{name} {part}": each for part, each in parts.items()} if parts else {name: command}
        )
        tree |= {words: each for words, each in inner.items() if not each.hidden}
    return tree


def _plain(text: str) -> str:
    """Return help text without the marks of rich and of click."""
    return re.sub(r"\[/?(?:bold|dim|italic)\]", "", text.replace("\b", "")).strip()


def _command(name: str, command: Any) -> str:
    arguments = [
        item
        for item in command.params
        if item.param_type_name == "argument" and not getattr(item, "hidden", False)
    ]
    words = " ".join(
        (item.metavar or item.name.upper()) if item.required else f"[{item.metavar or item.name}]"
        for item in arguments
    )
    help_text = "\n".join(part.strip() for part in _plain(command.help or "").split("\n"))
    parts = [
        f"### auvid {name}\n",
        f"```text\nauvid {name} [OPTIONS] {words}".rstrip() + "\n```\n",
        help_text + "\n",
    ]
    rows = [
        (f"`{item.metavar or item.name}`".replace("|", "\\|"), line(_plain(item.help or "")))
        for item in arguments
    ]
    if rows:
        parts.append(table(("argument", "meaning"), rows))
    if options := _options(command):
        parts.append(table(("option", "meaning"), options))
    if command.epilog:
        examples = _plain(command.epilog).removeprefix("Example:").split("; auvid ")
        lines = [f"auvid {text.strip().removeprefix('auvid ')}" for text in examples]
        parts.append("```text\n" + "\n".join(lines) + "\n```\n")
    return "\n".join(parts)


def _options(command: Any) -> list[tuple[str, str]]:
    rows = []
    for item in command.params:
        if item.param_type_name != "option" or item.hidden or item.name in ("help", *COMMON):
            continue
        value = "" if item.is_flag else " " + (item.metavar or item.type.name.upper())
        names = ", ".join([*item.opts, *item.secondary_opts])
        rows.append((f"`{names}{value}`".replace("|", "\\|"), line(_plain(item.help or ""))))
    return rows


def stages_page() -> str:
    """Return the page of the stages: what each reads, gives, and takes as parameters."""
    parts = [
        "# Stages and parameters\n",
        WRITTEN.format("the declarations in `stages/`")
        + " `auvid stages NAME` prints\nthe same. A campaign sets parameters under `stages:`;"
        " what it leaves out comes from\n`params.yaml`.\n",
        table(
            ("kind of campaign", "stages"),
            [
                (f"`{kind}`", " → ".join(f"[{n}](#{n})" for n in names))
                for kind, names in KINDS.items()
            ],
        ),
        *map(_stage, STAGES),
    ]
    return "\n".join(parts)


def _stage(stage: AnyStage) -> str:
    item = "the campaign" if stage.maps_over == "campaign" else f"each {stage.maps_over}"
    gives = f", and gives {stage.yields}s" if stage.yields else ""
    reads = ", ".join(_port(spec["port"]) for spec in ports(stage.inputs).values())
    writes = ", ".join(_port(spec["port"]) for spec in ports(stage.outputs).values())
    rows = [
        (
            f"`{item.name}`",
            item.metadata["unit"],
            f"`{_value(default_of(item))}`",
            line(bounds(item.metadata)),
            line(item.metadata["meaning"]),
        )
        for item in fields(stage.params)
    ]
    return (
        f"## {stage.name}\n\n{stage.summary} Runs once for {item}{gives}.\n\n*Reads* {reads}.\n\n"
        f"*Writes* {writes or 'nothing'}.\n\n"
        + (table(("parameter", "unit", "default", "allowed", "meaning"), rows) if rows else "")
    )


def _port(name: str) -> str:
    """Return the name of what a port carries, with a link where a page has it."""
    if name in DOCUMENTS and name not in ("twin", "inertia"):
        return f"[{name}]({name}.md)"
    if name == "model_file":
        return "[model_file](../model_file.md)"
    if name in MODELS and MODELS[name].startswith("records."):
        return f"[{name}](records.md#{model_of(name).__name__.lower()})"
    if name in schema_names() and name not in MODELS:
        return f"[{name}](artefacts.md#{name})"
    return name


def artefacts_page() -> str:
    """Return the page of tables and files that stages write."""
    makers: dict[str, list[str]] = {}
    for stage in STAGES:
        for name, spec in ports(stage.outputs).items():
            item = (
                ""
                if stage.maps_over == "campaign"
                else f"/{(stage.yields or stage.maps_over).upper()}"
            )
            many = "/ITEM" if spec.get("many") else ""
            suffix = schema(spec["port"]).suffix
            makers.setdefault(spec["port"], []).append(
                f"`runs/CAMPAIGN/{stage.name}{item}/{name}{many}{suffix}`"
            )
    names = [name for name in schema_names() if name not in MODELS]
    parts = [
        "# Tables and files of a run\n",
        WRITTEN.format("`data_schemas/artefacts/`"),
        """
Tables are Parquet files. Read one with `pandas.read_parquet`, or in Python as
`auvid.open_run(CAMPAIGN)["fuse/train/fused"]` with units in `attrs["units"]`; each file
carries its units in the metadata of its columns too. A name in braces stands for
several columns: `{u, v, w}_m_s` is `u_m_s`, `v_m_s` and `w_m_s`. JSON documents of a run
are on the page [Documents of a run](records.md).
""",
    ]
    for name in names:
        raw = read_yaml(schema_text(name))
        parts.append(f"## {name}\n\n{raw['meaning']}\n")
        if name in makers:
            parts.append("Files: " + ", ".join(makers[name]) + "\n")
        if raw["kind"] == "table":
            parts.append(
                table(("column", "unit", "frame", "meaning"), map(_column, raw["fields"].items()))
            )
    return "\n".join(parts)


def _column(entry: tuple[str, Mapping[str, Any]]) -> tuple[str, str, str, str]:
    name, spec = entry
    notes = [word for word in ("optional", "nullable") if spec.get(word)]
    if spec.get("range"):
        notes.append(f"{spec['range'][0]:g} to {spec['range'][1]:g}")
    unit = str(spec.get("unit", "1")) if spec["dtype"] != "string" else "text"
    meaning = line(str(spec["meaning"]).replace("{}", "…"))
    return (
        f"`{name.replace(',', ', ')}`",
        line(unit),
        str(spec.get("frame", "")),
        meaning + (f" ({', '.join(notes)})" if notes else ""),
    )


def records_page() -> str:
    """Return the page of JSON documents that stages write."""
    kinds: list[type[Model]] = []
    tops: dict[type[Model], str] = {}
    for name, place in MODELS.items():
        if place.startswith("records.") and name not in PARTS:
            tops[model_of(name)] = name
            parts_of(model_of(name), (VehicleDocument, ModelFile), kinds)
    links = {part: f"#{part.__name__.lower()}" for part in kinds}
    links |= {VehicleDocument: "vehicle.md", ModelFile: "../model_file.md"}
    index = table(
        ("document", "meaning"),
        [
            (f"[{name}]({links[kind]})", line(prose(kind).partition("\n\n")[0]))
            for kind, name in tops.items()
        ],
    )
    body = "".join(part_of_page(kind, links, written=False) for kind in kinds)
    return (
        "# Documents of a run\n\n"
        + WRITTEN.format("`data_schemas/records/`")
        + "\n\nStages write these as JSON beside their tables.\n\n"
        + index
        + body
    )


def force_models_page() -> str:
    """Return the page of viscous force models with their terms."""
    parts = [
        "# Force models\n",
        WRITTEN.format("`hydro/dynamics/viscous/models.py`")
        + "\n[Theory](../explanation/theory.md) says what they have in common.\n",
        table(
            ("name", "title", "terms", "source"),
            [(f"[{m.name}](#{m.name})", m.title, str(m.n_bar), m.source) for m in FORCE_MODELS],
        ),
    ]
    for model in FORCE_MODELS:
        rows = []
        for axis, terms in model.terms.items():
            units: dict[str, list[str]] = {}
            for term in terms:
                units.setdefault(coefficient_unit(axis, term), []).append(
                    f"`{term}`".replace("|", "\\|")
                )
            rows += [(axis, unit, ", ".join(names)) for unit, names in units.items()]
        parts.append(f"## {model.name}\n\n{model.title}, {model.n_bar} terms. {model.source}\n")
        parts.append(table(("axis", "unit", "terms"), rows))
    return "\n".join(parts)


PAGES: Mapping[str, Callable[[], str]] = {
    "docs/model_file.md": model_file_page,
    "docs/reference/commands.md": commands_page,
    "docs/reference/stages.md": stages_page,
    "docs/reference/artefacts.md": artefacts_page,
    "docs/reference/records.md": records_page,
    "docs/reference/force_models.md": force_models_page,
    **{f"docs/reference/{name}.md": (lambda name=name: document_page(name)) for name in DOCUMENTS},
}


def main() -> None:
    """Write the pages into a checkout, by default the current folder."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("checkout", type=Path, nargs="?", default=Path())
    checkout = parser.parse_args().checkout
    for path, page in PAGES.items():
        (checkout / path).write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    main()
