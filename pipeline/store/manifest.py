"""The manifest of a stage's folder: inputs, outputs and code of each item, as hashes.

It is written last. An item that is about to be replaced is taken out first, so that the
manifest never vouches for files that an interrupted run left behind.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from auvid.pipeline.store.artefacts import to_json
from auvid.pipeline.store.atomic_files import write_atomically
from auvid.pipeline.store.file_hashes import hash_value

FILE = "manifest.json"
FORMAT = 2
Hashes = str | dict[str, str]


@dataclass(frozen=True)
class Record:
    """One finished item.

    `outputs`: port -> hash, or key -> hash for a port with several artefacts; a port
    that gave none is left out.
    """

    key: str
    code: str
    params: Mapping[str, Any]
    inputs: Mapping[str, Any]
    outputs: Mapping[str, Hashes]
    packages: Mapping[str, str]
    warnings: Mapping[str, int] = field(default_factory=dict)


class Manifest:
    """The records of one stage of one campaign, in the order of its items.

    One that is not as it was written is `damaged` and has no records.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.path = folder / FILE
        document = _read(self.path) if self.path.is_file() else {}
        self.damaged = document is None
        self.records: dict[str, Record] = document or {}

    def write(self, records: Mapping[str, Record], order: Iterable[str]) -> None:
        """Replace the records; nothing is written if they are the same."""
        ordered = {item: records[item] for item in order if item in records}
        same = list(ordered.items()) == list(self.records.items())
        if same and not self.damaged and (self.path.is_file() or not ordered):
            return
        items = {item: asdict(record) for item, record in ordered.items()}
        document = {"format": FORMAT, "content": hash_value(items), "items": items}
        write_atomically(self.path, (to_json(document) + "\n").encode())
        self.records, self.damaged = ordered, False

    def keys(self, item: str) -> list[str]:
        """Return keys of an item's artefacts over all ports, in the stage's order."""
        record = self.records.get(item)
        keyed = (
            [hashes for hashes in record.outputs.values() if isinstance(hashes, dict)]
            if record
            else []
        )
        return list(dict.fromkeys(key for hashes in keyed for key in hashes))


def _read(path: Path) -> dict[str, Record] | None:
    """Return the records of a manifest file; None if damaged or of another format."""
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
        if document["format"] != FORMAT or document["content"] != hash_value(document["items"]):
            return None
        return {item: Record(**record) for item, record in document["items"].items()}
    except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return None
