"""Write docs/model_file.md: every field of a model file, from the docstrings of its
models.

    python tools/model_file.py [CHECKOUT]
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator
from pathlib import Path
from typing import get_args

from auvid.data_schemas.documents.model import Model
from auvid.data_schemas.documents.vehicle import VehicleDocument
from auvid.data_schemas.records.model_file import FORMAT, ModelFile

PAGE = "docs/model_file.md"
ELSEWHERE = (VehicleDocument,)
"""Models that have a page of their own."""
HEAD = f"""# The model file

Written by `make declarations` from the docstrings of
`data_schemas/records/model_file.py`: edit those, not this page.

A run writes each model as `runs/CAMPAIGN/model_file/model_file/MODEL.json`. The file
stands alone: a simulator needs nothing else of auvid. This is format {FORMAT}; a file
of another is refused with the version that reads it. `auvid schema model_file` prints
the JSON schema. In Python:

    from auvid.pipeline.store.model_files import read_model
    from auvid.hydro.model_file import forces, inertia, vehicle_of

    model = read_model(path)
    M = inertia(model)              # (6, 6), rigid body and added mass
    parts = forces(model, nu, eta)  # coriolis, viscous, restoring, (n, 6) each
    nu_dot = (parts.viscous + parts.restoring + tau - parts.coriolis) @ inv(M).T

Before you use a number, read `use`: a model may be usable for some axes, or for
nothing. Before you quote a coefficient, read its `verdict`.
"""


def page() -> str:
    """Return the page: a table for each part, in the order of the file."""
    return HEAD + "".join(_part(kind) for kind in _parts(ModelFile, []))


def _parts(kind: type[Model], kinds: list[type[Model]]) -> list[type[Model]]:
    if kind not in kinds and kind not in ELSEWHERE:
        kinds.append(kind)
        for field in kind.model_fields.values():
            for inner in _models(field.annotation):
                _parts(inner, kinds)
    return kinds


def _models(annotation: object) -> Iterator[type[Model]]:
    if isinstance(annotation, type) and issubclass(annotation, Model):
        yield annotation
    for inner in get_args(annotation):
        yield from _models(inner)


def _part(kind: type[Model]) -> str:
    rows = [
        f"| `{name}` | {_type(field.annotation)} | {_line(field.description or '')} |"
        for name, field in kind.model_fields.items()
    ]
    words = "\n\n".join(
        "\n".join(paragraph.split("\n")) for paragraph in re.split(r"\n\s*\n", _doc(kind))
    )
    return f"\n## {kind.__name__}\n\n{words}\n\n| field | type | meaning |\n|---|---|---|\n" + (
        "\n".join(rows) + "\n"
    )


def _doc(kind: type[Model]) -> str:
    return "\n".join(line.strip() for line in (kind.__doc__ or "").strip().split("\n"))


def _line(words: str) -> str:
    return " ".join(words.split()).replace("|", "\\|").replace("*", "\\*")


def _type(annotation: object) -> str:
    """Return a type in words, with a link where it is a part of the file."""
    models = list(dict.fromkeys(_models(annotation)))
    text = str(annotation)
    words = []
    for kind in models:
        name = kind.__name__
        words.append(
            "[vehicle](documents.md)" if kind in ELSEWHERE else f"[{name}](#{name.lower()})"
        )
    if "dict" in text:
        words.insert(0, "mapping of" if models else "mapping")
    elif text.startswith(("list", "typing.Annotated[list", "typing.Optional[list")):
        words.insert(0, "list of" if models else "list")
    if not words:
        words = [next((w for w in ("str", "float", "int", "bool", "Literal") if w in text), "any")]
    names = {
        "str": "text",
        "float": "number",
        "int": "integer",
        "bool": "yes or no",
        "Literal": "word",
    }
    null = " or null" if "None" in text else ""
    return " ".join(names.get(word, word) for word in words) + null


def main() -> None:
    """Write the page into a checkout, by default the current folder."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("checkout", type=Path, nargs="?", default=Path())
    (parser.parse_args().checkout / PAGE).write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    main()
