"""Bad logs through the command line, `auvid run` and `auvid check` alike: a clear error
or a counted loss, never a traceback.
"""

from __future__ import annotations

import json
import signal
import struct
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from auvid.pipeline import cli
from auvid.pipeline.execution import task_inputs as sources
from auvid.stages import ingest
from tests.support import ulog_file
from tests.support.dataflash_writer import BAR, HEADER_RECORDS, dive, fmt, record
from tests.support.tlog_records import attitude, frame, heartbeat, log

ROOT = Path(__file__).parents[2]
DATA = ROOT / "tests" / "data"
COLUMN_MAP = """
time: {column: t, unit: s}
columns:
  - {column: d, stream: depth, field: depth_m, unit: m}
"""
FINE, REFUSED = 0, 1
CSV_ROWS = b"".join(b"%d,%d\n" % (second, 5) for second in range(100))
TEXT_HEAD = (
    b"FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format\nFMT, 12, 19, BARO, Qff, TimeUS,Alt,Press\n"
)
TEXT_ROWS = b"".join(b"BARO, %d, -1.0, 1e5\n" % (100_000 * number) for number in range(1, 51))
TURN = "vehicle_attitude"
ULOG_START = (
    ulog_file.HEADER
    + ulog_file.declare(f"{TURN}:uint64_t timestamp;float[4] q;")
    + ulog_file.subscribe(0, TURN)
)
LONG = fmt(99, "LONG", "ZZZ", "A,B,C") + b"\xa3\x95\x63" + bytes(20)
HUGE = fmt(98, "HUGE", "ZZZ", "A,B,C", 255)
CUT = [sys.executable, "-c", "import os, sys; os.truncate(sys.argv[1], int(sys.argv[2]))"]
NO_UTF8 = b"\xff\xfe\x80"
NOTE = fmt(71, "MSG", "QZ", "TimeUS,Message") + record(71, "QZ", 900_000, NO_UTF8)


def turned(number: int) -> bytes:
    return ulog_file.data(0, struct.pack("<Q4f", 1_000_000 + 20_000 * number, 1.0, 0.0, 0.0, 0.0))


def barometer(time_us: int) -> bytes:
    return record(BAR[0], BAR[2], time_us, -1.0, 1e5)


def two_vehicles() -> bytes:
    """One sends twice as much as the other."""
    frames = [heartbeat(), heartbeat(system=7)]
    for number in range(300):
        frames += [attitude(20 * number, roll=0.1), attitude(20 * number + 10, roll=0.1)]
        frames += [attitude(20 * number, roll=0.9, system=7)]
    return log(frames)


REFUSALS: dict[str, tuple[bytes, str]] = {
    "noise": (
        bytes((number * 7919 + number // 251) % 256 for number in range(9000)),
        "no reader recognises",
    ),
    "picture": (b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 20, "no reader recognises"),
    "letter": (b"The dive went well.\nSee you tomorrow.\n", "no reader recognises"),
    "empty": (b"", "the file is empty"),
    "blank": (bytes(5000) + b"\r\n \t", "the file is empty"),
    "one_byte": (b"\xa3", "no reader recognises"),
    "dataflash_definitions": (HEADER_RECORDS, "no message that auvid reads"),
    "dataflash_cut_definition": (HEADER_RECORDS[:50], "no DataFlash record can be read"),
    "text_definitions": (TEXT_HEAD, "no message that auvid reads"),
    "ulog_header": (ulog_file.HEADER, "no message that auvid reads"),
    "ulog_definitions": (ULOG_START, "no message that auvid reads"),
    "tlog_without_samples": (
        log([frame("SYSTEM_TIME", bytes(range(1, 13)))] * 3),
        "no message that auvid reads",
    ),
    "csv_header": (b"t,d\n", "no message that auvid reads"),
    "csv_other_columns": (b"a,b\n" + CSV_ROWS, "the file has no"),
    "csv_no_numbers": (
        b"t,d\n" + b"".join(b"%d,deep\n" % second for second in range(50)),
        "not a number",
    ),
}

LOSSES: dict[str, tuple[bytes, str, int]] = {
    # Bytes, a reason or note that must be told, samples of the stream with most of
    # them.
    "format_beyond_the_end": (dive(50) + LONG, "cut off by the end of the file", 50),
    "length_beyond_the_end": (HUGE + dive(50), "length does not match", 50),
    "ulog_size_beyond_the_end": (
        ULOG_START
        + b"".join(map(turned, range(50)))
        + struct.pack("<HB", 60_000, ord("I"))
        + b"x" * 40,
        "cut off by the end of the file",
        50,
    ),
    "text_is_not_utf8": (HEADER_RECORDS + NOTE + dive(50)[len(HEADER_RECORDS) :], "", 50),
    "tlog_text_is_not_utf8": (
        log(
            [
                heartbeat(),
                frame("STATUSTEXT", b"\x06" + NO_UTF8),
                *(attitude(20 * number) for number in range(50)),
            ]
        ),
        "",
        50,
    ),
    "csv_is_not_utf8": (b"t,d,note\n" + CSV_ROWS.replace(b",5\n", b",5,20\xb0\n"), "", 100),
    "text_log_is_not_utf8": (
        TEXT_HEAD + NO_UTF8 + b"\n" + TEXT_ROWS,
        "line that is not a record",
        50,
    ),
    "time_backwards": (
        HEADER_RECORDS
        + b"".join(
            barometer(1_000_000 + 100_000 * k) for k in (*range(30), *range(10, 30), *range(30, 60))
        ),
        "time stamp out of order",
        60,
    ),
    "csv_time_backwards": (
        b"t,d\n" + CSV_ROWS + b"40,5\n" * 3 + b"100,5\n",
        "time stamp out of order",
        101,
    ),
    "tlog_time_backwards": (
        log([heartbeat(), *(attitude(20 * number) for number in range(200))])
        + log([attitude(4000 + 20 * k) for k in range(200)]),
        "clock goes back",
        400,
    ),
    "two_vehicles": (two_vehicles(), "several vehicles: system 1 component 1", 600),
}


@pytest.fixture(autouse=True)
def _signals() -> Iterator[None]:
    before = signal.getsignal(signal.SIGTERM)
    yield
    signal.signal(signal.SIGTERM, before)


@pytest.fixture
def auvid(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., tuple[int, str]]:
    """Run a command in a workspace with one campaign whose log is `dive.log`; exit code
    and all that is said, in one line.
    """
    folder = tmp_path / "campaigns" / "bad"
    folder.mkdir(parents=True)
    (tmp_path / "params.yaml").write_bytes((ROOT / "params.yaml").read_bytes())
    (folder / "map.yaml").write_text(COLUMN_MAP)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "400")

    def run(*words: str, columns: bool = False) -> tuple[int, str]:
        file = "{file: dive.log, columns: map.yaml}" if columns else "{file: dive.log}"
        lines = [
            "kind: identification",
            "vehicle: bluerov2_heavy",
            f"logs: [{{id: dive, files: [{file}]}}]",
        ]
        lines.append("legs: [{id: one, log: dive, use: training}]")
        (folder / "campaign.yaml").write_text("\n".join(lines) + "\n")
        monkeypatch.setattr(sys, "argv", ["auvid", *words])
        code: Any = 0
        try:
            cli.main()
        except SystemExit as end:
            code = end.code or 0
        printed = capsys.readouterr()
        text = printed.out + printed.err
        assert "Traceback" not in text
        assert "internal fault" not in text
        return int(code), " ".join(text.split())

    return run


def place(content: bytes) -> Path:
    path = Path("campaigns/bad/dive.log")
    path.write_bytes(content)
    return path


def log_info() -> dict[str, Any]:
    info: dict[str, Any] = json.loads(
        Path("runs/bad/ingest/dive/log_info.json").read_text(encoding="utf-8")
    )
    return info


@pytest.mark.parametrize("name", REFUSALS)
def test_no_log_is_refused_with_the_reason(
    name: str, auvid: Callable[..., tuple[int, str]]
) -> None:
    content, reason = REFUSALS[name]
    place(content)
    columns = name.startswith("csv")
    code, printed = auvid("run", "bad", "--until", "ingest", columns=columns)
    assert code == REFUSED
    assert any(word in printed for word in reason.split("|")), printed
    assert "dive" in printed
    words = ["--columns", "campaigns/bad/map.yaml"] if columns else []
    code, printed = auvid("check", "campaigns/bad/dive.log", *words)
    assert code == REFUSED
    assert "refused" in printed


@pytest.mark.parametrize("name", LOSSES)
def test_what_is_wrong_with_a_log_is_told_and_the_rest_is_used(
    name: str, auvid: Callable[..., tuple[int, str]]
) -> None:
    content, words_expected, samples = LOSSES[name]
    place(content)
    columns = name.startswith("csv")
    code, printed = auvid("run", "bad", "--until", "ingest", columns=columns)
    assert code == FINE, printed
    info = log_info()
    dropped = (Path("runs/bad/ingest/dive") / "section.json").read_text(encoding="utf-8")
    words = json.dumps(info, ensure_ascii=False) + dropped
    assert not words_expected or any(word in words for word in words_expected.split("|")), words
    assert max(stream["rows"] for stream in info["streams"].values()) == samples
    code, printed = auvid(
        "check",
        "campaigns/bad/dive.log",
        *(["--columns", "campaigns/bad/map.yaml"] if columns else []),
    )
    assert code in (FINE, 3), printed


def test_a_folder_in_place_of_a_log(auvid: Callable[..., tuple[int, str]]) -> None:
    Path("campaigns/bad/dive.log").mkdir(parents=True)
    code, printed = auvid("run", "bad", "--until", "ingest")
    assert code == REFUSED
    assert "is a folder, not a file" in printed
    assert "campaign.yaml" in printed


def test_a_log_without_permission(
    auvid: Callable[..., tuple[int, str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The refusal is made up: tests may run as a user whom the system refuses nothing."""
    path = place(dive(5)).resolve()
    before = Path.open

    def refuse(self: Path, *args: Any, **keys: Any) -> Any:
        if self.resolve() == path:
            raise PermissionError(13, "Permission denied", str(self))
        return before(self, *args, **keys)

    monkeypatch.setattr(Path, "open", refuse)
    code, printed = auvid("run", "bad", "--until", "ingest")
    assert code == REFUSED
    assert "no permission" in printed


@pytest.mark.parametrize("change", ["grows", "is written anew", "disappears", "is cut short"])
def test_a_log_that_changes_while_it_is_read(
    change: str, auvid: Callable[..., tuple[int, str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = place(dive(50))
    load = sources.Log.load

    def changing(self: sources.Log) -> Any:
        columns = load(self)
        if change == "grows":
            with path.open("ab") as file:
                file.write(dive(1))
        elif change == "is written anew":
            path.with_suffix(".new").write_bytes(dive(40))
            path.with_suffix(".new").replace(path)
        elif change == "is cut short":
            # By another process, as a log on its way to this machine; memory that maps the
            # file would be gone.
            subprocess.run([*CUT, str(path), "100"], check=True)
        else:
            path.unlink()
        return columns

    monkeypatch.setattr(sources.Log, "load", changing)
    code, printed = auvid("run", "bad", "--until", "ingest")
    assert code == REFUSED
    assert ("is not there" if change == "disappears" else "changed while it was read") in printed
    assert not Path("runs/bad/ingest/dive/log_info.json").exists()


def test_the_larger_of_two_vehicles_is_read_and_the_other_named() -> None:
    from auvid.stages.base import RawFile, RawLog

    file = RawFile("two.tlog", np.frombuffer(two_vehicles(), np.uint8))
    outputs = ingest.run(ingest.Inputs(RawLog("two", (file,))), ingest.Params())
    assert outputs.attitude is not None
    assert set(np.round(outputs.attitude["phi_rad"].to_numpy(), 6)) == {0.1}
    assert any("system 7 component 1 (301 messages)" in note for note in outputs.log_info.notes)


@pytest.mark.parametrize(
    ("words", "words_expected"),
    [
        (("--only", "ingesd"), "Did you mean 'ingest'?"),
        (("--until", "ingesd"), "Did you mean 'ingest'?"),
        (("--only", "ingest", "--until", "fuse"), "exclude each other"),
        (("--engine", "threads"), "allowed: serial, processes"),
        (("--engine", "serial", "--jobs", "2"), "does not fit the engine"),
    ],
)
def test_wrong_use_has_an_exit_code_of_its_own(
    words: tuple[str, ...], words_expected: str, auvid: Callable[..., tuple[int, str]]
) -> None:
    place(dive(5))
    code, printed = auvid("run", "bad", *words)
    assert (code, words_expected in printed) == (2, True), printed
