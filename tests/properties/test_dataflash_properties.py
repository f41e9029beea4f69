"""Properties of the DataFlash reader: what is written is read; whatever happens to the
bytes, whole records stay and bytes add up.
"""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from auvid.data_schemas.errors import PipelineError
from auvid.stages.base import RawFile
from auvid.stages.ingest.decoded_log import DecodedLog
from auvid.stages.ingest.formats.dataflash.reader import DATAFLASH
from tests.support.dataflash_writer import PACKING, dive, fmt, record
from tests.support.mutate import Kept, mutations

SMALL = (Path(__file__).parents[1] / "data" / "bluerov2_ugps_small" / "small.BIN").read_bytes()

INTEGERS = {"b": 8, "h": 16, "i": 32, "q": 64, "M": 8, "c": 16, "e": 32, "L": 32}
NATURALS = {"B": 8, "H": 16, "I": 32, "Q": 64, "C": 16, "E": 32}
TEXTS = {"n": 4, "N": 16, "Z": 64}
FACTORS = {"c": 100, "C": 100, "e": 100, "E": 100, "L": 10_000_000}


def read(data: bytes) -> DecodedLog:
    log = DATAFLASH.read(RawFile("log.BIN", np.frombuffer(data, np.uint8)))
    account = log.account
    assert (
        account.record_bytes + account.definition_bytes + account.skipped_bytes
        == account.size
        == len(data)
    )
    return log


def stored(char: str) -> st.SearchStrategy[Any]:
    if char in INTEGERS:
        return st.integers(-(2 ** (INTEGERS[char] - 1)), 2 ** (INTEGERS[char] - 1) - 1)
    if char in NATURALS:
        return st.integers(0, 2 ** NATURALS[char] - 1)
    if char in TEXTS:
        return st.binary(max_size=TEXTS[char])
    if char == "a":
        return st.lists(st.integers(-32768, 32767), min_size=32, max_size=32)
    return st.floats(width={"g": 16, "f": 32, "d": 64}[char])  # type: ignore[arg-type]


@st.composite
def tables(draw: st.DrawFn) -> tuple[str, list[list[Any]]]:
    formats = draw(
        st.text(st.sampled_from(sorted(set(PACKING) - {"a", "Z"})), min_size=1, max_size=12)
    ) + draw(st.sampled_from(["", "a", "Z"]))
    rows = draw(st.lists(st.tuples(*map(stored, formats)).map(list), min_size=1, max_size=8))
    return formats, rows


@settings(max_examples=60, deadline=None, derandomize=True)
@given(tables())
def test_what_is_written_is_read(table: tuple[str, list[list[Any]]]) -> None:
    formats, rows = table
    names = [f"F{k}" for k in range(len(formats))]
    log = read(
        fmt(20, "TST", formats, ",".join(names))
        + b"".join(record(20, formats, *row) for row in rows)
    )
    columns = log.messages["TST"].columns
    assert log.counts["TST"] == len(rows)
    for k, char in enumerate(formats):
        values = [row[k] for row in rows]
        if char in TEXTS:
            assert columns[names[k]].tolist() == [value.split(b"\0")[0] for value in values]
        else:
            # Of the column's type at once: numpy makes floats of small and huge naturals.
            expected = (
                np.array(values, np.float64) / FACTORS[char]
                if char in FACTORS
                else np.array(values, columns[names[k]].dtype)
            )
            np.testing.assert_array_equal(
                columns[names[k]], expected.astype(columns[names[k]].dtype)
            )


@settings(max_examples=150, deadline=None, derandomize=True)
@given(st.binary(max_size=400), st.binary(max_size=60), st.integers(0, 12))
def test_any_bytes_give_an_account_or_a_clear_error(noise: bytes, more: bytes, steps: int) -> None:
    for data in (
        noise,
        dive(steps) + noise,
        noise + dive(steps) + b"\xa3\x95" + more,
        dive(steps)[: 100 * steps] + noise,
    ):
        with suppress(PipelineError):
            read(data)


def starts(log: DecodedLog) -> dict[str, np.ndarray[Any, np.dtype[np.int64]]]:
    return {name: table.offset for name, table in log.messages.items()}


def recovery(clean: DecodedLog, log: DecodedLog, kept: list[Kept]) -> tuple[float, int]:
    """The share of the whole records with a whole definition that was recovered, and
    the number of records at places that held none.

    Records in repeated or spliced bytes are not judged: they are where the source has
    none.
    """
    definitions = clean.messages["FMT"]
    names = [name.decode() for name in definitions.columns["Name"].tolist()]
    length = dict(zip(names, definitions.columns["Length"].tolist(), strict=True))
    place = dict(zip(names, definitions.offset.tolist(), strict=True))
    begin, end = np.array([part.start for part in kept]), np.array([part.stop for part in kept])
    shift = np.array([part.offset for part in kept]) - begin

    def undamaged(first: Any, last: Any) -> Any:
        part = np.maximum(np.searchsorted(begin, first, side="right") - 1, 0)
        return (begin[part] <= first) & (last <= end[part]), shift[part]

    expected = recovered = invented = 0
    for name, offset in starts(clean).items():
        there, moved = undamaged(offset, offset + length[name])
        if (
            name != "FMT"
            and not undamaged(np.array([place[name]]), np.array([place[name] + 89]))[0][0]
        ):
            continue
        targets = (offset + moved)[there]
        expected += targets.size
        recovered += (
            int(np.isin(targets, log.messages[name].offset).sum()) if name in log.messages else 0
        )
    sources = np.sort(np.concatenate(list(starts(clean).values())))
    for offset in starts(log).values():
        part = np.searchsorted(begin + shift, offset, side="right") - 1
        source = offset - shift[np.maximum(part, 0)]
        inside = (part >= 0) & (source + 3 <= end[np.maximum(part, 0)])
        invented += int((inside & ~np.isin(source, sources)).sum())
    return recovered / max(expected, 1), invented


@pytest.mark.parametrize(
    "part",
    [
        pytest.param(SMALL[:40_000], id="40 kB, a third of it definitions"),
        pytest.param(SMALL[:150_000], id="150 kB", marks=pytest.mark.release),
    ],
)
def test_whole_records_are_recovered_from_mutated_logs(part: bytes) -> None:
    """Required: 99.9 % on average and 99 % at worst of the records whose bytes and
    definition are whole; nothing invented.
    """
    clean = read(part)
    shares, invented = [], 0
    for seed in range(60):
        data, kept = mutations(part, seed)
        share, more = recovery(clean, read(data), kept)
        shares.append(share)
        invented += more
    assert np.mean(shares) > 0.9999
    assert min(shares) > 0.99
    assert invented == 0


def test_mutations_keep_what_they_say_they_keep() -> None:
    for seed in range(40):
        data, kept = mutations(SMALL, seed)
        assert data == mutations(SMALL, seed)[0]
        for part in kept:
            assert (
                data[part.offset : part.offset + part.stop - part.start]
                == SMALL[part.start : part.stop]
            )
        protected, _ = mutations(SMALL, seed, protect=20_000)
        assert protected[:20_000] == SMALL[:20_000]
