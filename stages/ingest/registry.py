"""The log readers in the order in which they are tried, each with its streams."""

from __future__ import annotations

from auvid.data_schemas.errors import LogError, nearest
from auvid.stages.base import RawFile
from auvid.stages.ingest.decoded_log import LogReader
from auvid.stages.ingest.formats.csv.reader import CSV
from auvid.stages.ingest.formats.dataflash.reader import DATAFLASH
from auvid.stages.ingest.formats.dataflash.text_reader import DATAFLASH_TEXT
from auvid.stages.ingest.formats.tlog.reader import TLOG
from auvid.stages.ingest.formats.ulog.reader import ULOG
from auvid.stages.ingest.streams import dataflash, tlog, ulog
from auvid.stages.ingest.streams.mapping import Rules

FORMATS: tuple[tuple[LogReader, Rules | None], ...] = (
    (DATAFLASH, dataflash.RULES),
    (DATAFLASH_TEXT, dataflash.RULES),
    (ULOG, ulog.RULES),
    (TLOG, tlog.RULES),
    (CSV, None),
)
"""Reader, and the rules that turn its messages into streams. A reader without rules
(CSV) gives streams itself.
"""
READERS = tuple(reader for reader, _ in FORMATS)
RULES = {reader.name: rules for reader, rules in FORMATS}
HEAD_BYTES = 1 << 16


def reader_of(file: RawFile, forced: str | None = None) -> LogReader:
    """Return the reader of a file: by content, or the one the manifest forces.

    Raises `LogError` if there is none.
    """
    names = [reader.name for reader in READERS]
    head = file.buffer[:HEAD_BYTES].tobytes()
    if forced is None and not head.strip(b"\0\r\n\t "):
        raise LogError(
            "the file is empty",
            file=file.name,
            value=f"{file.buffer.size} bytes",
            remedy="Copy the log from the vehicle again.",
        )
    for reader in READERS:
        if reader.recognises(head) if forced is None else reader.name == forced:
            return reader
    if forced is not None:
        raise LogError(
            "unknown reader",
            file=file.name,
            field="reader",
            value=forced,
            allowed=names,
            remedy=nearest(forced, names),
        )
    raise LogError(
        "no reader recognises this file",
        file=file.name,
        value=head[:16],
        allowed=names,
        remedy=(
            "Name the format in the manifest (reader: NAME) if the beginning of the file is"
            " damaged. A CSV log has a comma, a semicolon or a tab between its columns."
        ),
    )
