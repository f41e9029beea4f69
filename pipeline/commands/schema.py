"""The command `auvid schema`: the JSON schema of a document, for editors."""

from __future__ import annotations

import json

from auvid.data_schemas.documents import MODELS, model_of
from auvid.data_schemas.errors import UsageError, nearest
from auvid.pipeline.terminal import table

WRITTEN = "documents."
"""Models of this room are those of documents that users write."""


def print_schema(name: str | None) -> None:
    """Print the JSON schema of a document, or the names of those that users write."""
    written = [name for name, place in MODELS.items() if place.startswith(WRITTEN)]
    if name is None:
        rows = [[name, (model_of(name).__doc__ or "").partition(".")[0]] for name in written]
        table(("document", "what it is"), rows)
        return
    if name not in MODELS:
        raise UsageError(
            "no such document", value=name, allowed=written, remedy=nearest(name, MODELS)
        )
    print(json.dumps(model_of(name).model_json_schema(), indent=2, ensure_ascii=False))
