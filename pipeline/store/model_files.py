"""Model files on disk: JSON that is refused in words where it is not one."""

from __future__ import annotations

import json
from pathlib import Path

from auvid.data_schemas.documents.model import parse
from auvid.data_schemas.errors import SchemaError
from auvid.data_schemas.records.model_file import FORMATS, ModelFile
from auvid.pipeline.store.artefacts import encode
from auvid.pipeline.store.atomic_files import readable, write_output

REMEDY = "Name a file of runs/CAMPAIGN/model_file/model_file/."


def read_model(path: Path) -> ModelFile:
    """Read a model file.

    Raises `SchemaError`, all faults together: no JSON, no model file, a format that
    this version does not read, unknown or missing keys, NaN, wrong types, a content that
    its hash does not fit.
    """
    with readable(path, file=path, what="model file"):
        content = path.read_bytes()
    try:
        document = json.loads(content)
    except UnicodeDecodeError:
        raise SchemaError("not a text file, so no model file", file=path, remedy=REMEDY) from None
    except json.JSONDecodeError as fault:
        # Cut off, a text ends in a string, in a word as `false`, or with a bracket open.
        last_word = len(fault.doc.rstrip()) - len("false")
        cut = fault.pos >= last_word or "Unterminated" in fault.msg
        if cut and fault.doc.lstrip().startswith("{"):
            raise SchemaError(
                "the model file ends in the middle: it was cut off",
                file=path,
                row=fault.doc.count("\n") + 1,
                remedy="Copy it anew, or run its campaign again.",
            ) from None
        raise SchemaError(
            f"not JSON, so no model file: {fault.msg}", file=path, row=fault.lineno, remedy=REMEDY
        ) from None
    if not isinstance(document, dict) or document.get("kind") != "auvid model":
        value = document.get("kind") if isinstance(document, dict) else type(document).__name__
        raise SchemaError(
            "not a model file",
            file=path,
            field="kind",
            value=value,
            allowed="auvid model",
            remedy=REMEDY,
        )
    if document.get("format") not in FORMATS:
        number = document.get("format")
        newer = isinstance(number, int) and number > max(FORMATS)
        raise SchemaError(
            "a model file of another format",
            file=path,
            field="format",
            value=number,
            allowed=list(FORMATS),
            remedy=(
                f"It was written by auvid {document.get('auvid')}: "
                + ("install that version, or a newer one." if newer else "run its campaign again.")
            ),
        )
    model = parse(ModelFile, document, file=path)
    if model.content_sha256 not in (None, model.content_hash()):
        raise SchemaError(
            "the model file is not as it was written: it was damaged, or changed by hand",
            file=path,
            field="content_sha256",
            value=model.content_sha256,
            allowed="the hash of the rest",
            remedy="Copy it anew. If you changed it on purpose, delete the line content_sha256.",
        )
    return model


def write_model(model: ModelFile, path: Path) -> None:
    """Write a model file; what `read_model` reads back is equal, and the bytes too."""
    write_output(path, encode(model.sealed(), "model_file", file=path))
