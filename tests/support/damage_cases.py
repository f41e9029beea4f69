"""Every damage that a log is tried with, by kind and number, and what counts as failing
it; failures are kept as files.

A flip is one bit, a cut ends the file, a mutation is seeded damage of all classes in
several places; the classes of `mutate.KINDS` are tried by themselves too.
"""

from __future__ import annotations

import base64
import json
import re
import warnings
import zlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from auvid.data_schemas.errors import PipelineError
from auvid.stages import ingest
from auvid.stages.base import RawFile, RawLog
from tests.support.mutate import KINDS as CLASSES
from tests.support.mutate import Edit, Kept, apply_edits, mutations
from tests.support.recovery import Judgement, judge
from tests.support.small_logs import BINARY, BYTES, SHORT, SmallLog, short_log, small_log

FOLDER = Path(__file__).parents[1] / "data" / "fuzz"
WORST_SHARE = 0.01
MEAN_SHARE = 0.001
NEIGHBOURS = 2
"""Records next to damage in two places: without a checksum such a record cannot always
be distinguished from a damaged one. In a short log it is the `SHORT` records of a type: too
few to contradict a damaged definition that took the number of theirs.
"""


def count(source: SmallLog, kind: str, mutated: int) -> int:
    """How many cases of a kind there are; single bits and cuts are tried on binary logs
    only.
    """
    if kind == "mutation":
        return mutated
    if kind in CLASSES:
        return mutated // len(CLASSES)
    if source.name not in BINARY:
        return 0
    return 8 * len(source.data) if kind == "flip" else len(source.data)


def damaged(source: SmallLog, kind: str, number: int) -> tuple[bytes, list[Kept]]:
    """The damaged log of one case, and what stayed whole."""
    if kind == "flip":
        place = number // 8
        return apply_edits(
            source.data, [Edit(place, place + 1, bytes([source.data[place] ^ 1 << number % 8]))]
        )
    if kind == "cut":
        return source.data[:number], [Kept(0, number, 0)] if number else []
    return mutations(source.data, number, (kind,) if kind in CLASSES else tuple(CLASSES))


def failures(source: SmallLog, result: Judgement) -> list[str]:
    """What is wrong with the outcome of one case."""
    reasons = list(result.faults)
    # A hit definition takes the three records of its type; telemetry has none.
    short = len(source.data) < BYTES // 2 and not source.name.endswith("tlog")
    few = SHORT if short else NEIGHBOURS
    if result.lost > max(few, WORST_SHARE * result.expected):
        reasons.append(f"lost {result.lost} of {result.expected} whole records")
    if result.invented:
        reasons.append(f"invented {result.invented} records")
    return reasons


def ingest_fault(source: SmallLog, data: bytes) -> str | None:
    """How the stage that reads logs fails on a damaged log, if not by a clear error."""
    file = RawFile(source.name, np.frombuffer(data, np.uint8), source.columns)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            ingest.run(ingest.Inputs(RawLog("dive", (file,), source.name)), ingest.Params())
    except PipelineError:
        return None
    except Exception as crash:
        return f"ingest: {type(crash).__name__}: {crash}"
    return None


def keep(
    source: SmallLog,
    kind: str,
    number: int,
    data: bytes,
    kept: Sequence[Kept],
    faults: Sequence[str],
) -> Path:
    """Write a failing case to a file that `replay` can try again."""
    FOLDER.mkdir(exist_ok=True)
    short = source.name in BINARY and source is short_log(source.name)
    path = FOLDER / f"{source.name}-{'short-' * short}{kind}-{number}.json"
    case = {
        "reader": source.name,
        "short": short,
        "fault": faults[0][:200],
        "kept": [list(part) for part in kept],
        "data": base64.b85encode(zlib.compress(data)).decode(),
    }
    path.write_text(json.dumps(case) + "\n", encoding="ascii")
    return path


def replay(path: Path) -> list[str]:
    """What is still wrong with a case that failed once."""
    case = json.loads(path.read_text(encoding="ascii"))
    source = (short_log if case.get("short") else small_log)(case["reader"])
    data = zlib.decompress(base64.b85decode(case["data"]))
    kept = [Kept(*part) for part in case["kept"]]
    if any(
        data[part.offset : part.offset + part.stop - part.start]
        != source.data[part.start : part.stop]
        for part in kept
    ):
        return ["the small log is not the one that this case was made from"]
    fault = ingest_fault(source, data)
    return failures(source, judge(source, data, kept)) + ([fault] if fault else [])


def kind_of_fault(fault: str) -> str:
    """A fault without its numbers, to count those of a kind."""
    return re.sub(r"\d+", "#", fault)[:80]
