"""The log readers in the order in which they are asked, and what each adds to the
mapping of messages to streams.
"""

from __future__ import annotations

from collections.abc import Mapping

from auvid.data_schemas.errors import LogError, nearest
from auvid.stages.base import RawFile
from auvid.stages.ingest.decoded_log import LogReader
from auvid.stages.ingest.formats.csv.reader import CSV
from auvid.stages.ingest.formats.dataflash.reader import DATAFLASH
from auvid.stages.ingest.formats.dataflash.text_reader import DATAFLASH_TEXT
from auvid.stages.ingest.formats.tlog.reader import TLOG
from auvid.stages.ingest.formats.ulog.reader import ULOG
from auvid.stages.ingest.streams import dataflash as streams_dataflash
from auvid.stages.ingest.streams import tlog as streams_tlog
from auvid.stages.ingest.streams import ulog as streams_ulog
from auvid.stages.ingest.streams.mapping import Rules

READERS: tuple[LogReader, ...] = (DATAFLASH, DATAFLASH_TEXT, ULOG, TLOG, CSV)
MAPPINGS: Mapping[str, tuple[str, Rules]] = {
    "dataflash": ("dataflash", streams_dataflash.RULES),
    DATAFLASH_TEXT.name: ("dataflash", streams_dataflash.RULES),
    "ulog": ("ulog", streams_ulog.RULES),
    "tlog": ("tlog", streams_tlog.RULES),
}
"""Reader -> name of its mapping in formats/streams.yaml, and its rules. A reader that
is not here (CSV) gives streams itself.
"""

HEAD_BYTES = 1 << 16


def reader_of(file: RawFile, forced: str | None = None) -> LogReader:
    """The reader for a file: by its content, or the one that the manifest forces.
    Raises `LogError` if there is none.
    """
    names = [reader.name for reader in READERS]
    if forced is not None:
        for reader in READERS:
            if reader.name == forced:
                return reader
        raise LogError(
            "unknown reader",
            file=file.name,
            field="reader",
            value=forced,
            allowed=names,
            remedy=nearest(forced, names),
        )
    head = file.buffer[:HEAD_BYTES].tobytes()
    if not head.strip(b"\0\r\n\t "):
        raise LogError(
            "the file is empty",
            file=file.name,
            value=f"{file.buffer.size} bytes",
            remedy="Copy the log from the vehicle again.",
        )
    for reader in READERS:
        if reader.recognises(head):
            return reader
    raise LogError(
        "no reader recognises this file",
        file=file.name,
        value=head[:16],
        allowed=names,
        remedy=(
            "Name the format in the manifest (reader: NAME) if the beginning of the file is"
            " damaged."
        ),
    )
