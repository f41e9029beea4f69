"""The ingest stage: one log in, streams, rejected samples and log health out."""

from __future__ import annotations

import weakref
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from auvid.data_schemas.documents import check_document
from auvid.data_schemas.errors import CampaignError, DataError, LogError
from auvid.data_schemas.tables import column
from auvid.data_schemas.yaml_text import read_yaml
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.stages import ingest
from auvid.stages.base import RawFile, RawLog
from auvid.stages.ingest.decoded_log import DecodedLog
from auvid.stages.ingest.formats.dataflash.reader import DATAFLASH
from auvid.stages.ingest.streams.mapping import OtherSource
from tests.support.motions import vehicle_document

ROOT = Path(__file__).parents[4]
SMALL = ROOT / "tests/data/bluerov2_ugps_small/small.BIN"
CAMPAIGNS = ROOT / "campaigns"
STREAMS = ("imu", "attitude", "depth", "velocity", "actuators", "battery")


def raw_file(path: Path, name: str | None = None, columns: dict[str, Any] | None = None) -> RawFile:
    return RawFile(name or path.name, np.memmap(path, np.uint8, "r"), columns)


def csv_log(name: str, text: str, columns: list[dict[str, Any]], **time: Any) -> RawFile:
    mapping = {"time": {"column": "t", "unit": "s", **time}, "columns": columns}
    return RawFile(name, np.frombuffer(text.encode(), np.uint8), mapping)


def depth_csv(name: str = "depth.csv", text: str = "t,d\n1,5\n2,6\n3,7\n", **time: Any) -> RawFile:
    return csv_log(
        name, text, [{"column": "d", "stream": "depth", "field": "depth_m", "unit": "m"}], **time
    )


def range_csv(text: str = "t,h\n1.5,2\n2.5,3\n", **time: Any) -> RawFile:
    return csv_log(
        "range.csv",
        text,
        [{"column": "h", "stream": "range", "field": "range_m", "unit": "m"}],
        **time,
    )


def run(
    *files: RawFile,
    sources: dict[str, str] | None = None,
    vehicle: Vehicle | None = None,
    **params: Any,
) -> ingest.Outputs:
    campaign = {"logs": [{"id": "dive", "sources": sources or {}}]}
    return ingest.run(
        ingest.Inputs(RawLog("dive", tuple(files)), campaign, vehicle), ingest.Params(**params)
    )


def campaign_log(name: str) -> ingest.Outputs:
    folder = CAMPAIGNS / name
    manifest = read_yaml((folder / "campaign.yaml").read_text())
    entry = manifest["logs"][0]
    files = []
    for item in entry.get("files", [entry]):
        columns = read_yaml((folder / item["columns"]).read_text()) if "columns" in item else None
        files.append(raw_file(folder / item["file"], item["file"], columns))
    return ingest.run(ingest.Inputs(RawLog("dive", tuple(files)), manifest), ingest.Params())


def test_a_real_log_has_the_streams_that_it_should() -> None:
    outputs = run(raw_file(SMALL))
    info = outputs.log_info
    check_document(info, "log_info")
    check_document(outputs.section, "section")
    check_document(outputs.views, "views")
    assert {name: item.source for name, item in info.streams.items()} == {
        "imu": "IMU",
        "attitude": "ATT",
        "depth": "BARO[1]",
        "actuators": "RCOU",
        "battery": "BAT",
        "sticks": "RCIN",
        "mode": "MODE",
        "events": "MSG",
    }
    assert outputs.imu is not None
    assert outputs.imu.num_rows == 594
    assert info.streams["imu"].rate_hz == pytest.approx(25.0, abs=0.01)
    assert info.vehicle.startswith("ArduSub V4.1.0")
    assert info.parameters["FRAME_CONFIG"] == 1.0
    assert info.accelerometer == "specific_force"
    part = info.files[0]
    assert (
        part.record_bytes + part.definition_bytes + sum(item["bytes"] for item in part.skipped)
        == SMALL.stat().st_size
    )
    # Still on the bench: gravity on the accelerometer, within the bias of a cheap unit.
    gravity = np.linalg.norm([column(outputs.imu, f"accel_{axis}_m_s2") for axis in "xyz"], axis=0)
    assert gravity.mean() == pytest.approx(9.81, abs=0.1)


def test_bytes_and_messages_of_a_log_are_gone_when_it_is_checked(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A log of six hours took 1.6 GB, half of it what nobody needed any more."""
    alive: list[weakref.ref[Any]] = []
    check, read = ingest.check_health, DATAFLASH.decode

    def bytes_of_the_file() -> np.ndarray[Any, Any]:
        content = np.fromfile(SMALL, np.uint8)
        alive.append(weakref.ref(content))
        return content

    def decode(file: RawFile, types: frozenset[str] | None) -> DecodedLog:
        log = read(file, types)
        alive.extend(weakref.ref(item) for item in log.messages.values())
        return log

    def check_health(*args: Any, others: list[OtherSource], **named: Any) -> dict[str, Any]:
        assert len(alive) > 10
        assert not [item() for item in alive if item() is not None]
        # The barometer in use is no other source beside itself.
        depths = {item.source for item in others if item.stream == "depth"}
        assert depths == {"BARO[0]", "CTUN", "XKF1"}
        return check(*args, others=others, **named)

    monkeypatch.setattr(ingest, "check_health", check_health)
    monkeypatch.setitem(DATAFLASH.__dict__, "decode", decode)
    outputs = run(RawFile(SMALL.name, bytes_of_the_file))
    assert outputs.log_info == run(raw_file(SMALL)).log_info


def test_legs_count_from_the_first_record_whatever_its_type() -> None:
    # The first time-stamped record of this log is a parameter, 25 ms before the first
    # sample.
    info = run(raw_file(SMALL)).log_info
    assert info.start_us == 265_648_719
    assert info.start_us < min(item.start_us for item in info.streams.values())


def test_the_same_dive_as_csv_gives_the_same_streams() -> None:
    log, csv = campaign_log("bluerov2_dvl"), campaign_log("bluerov2_dvl_csv")
    start = log.log_info.start_us - csv.log_info.start_us
    for stream in STREAMS:
        ours, theirs = getattr(log, stream), getattr(csv, stream)
        assert (column(ours, "time_us") - start == column(theirs, "time_us")).all()
        for name in theirs.column_names[1:]:
            # 1e-12: the CSV has all digits; conversion of units rounds once more.
            assert column(theirs, name) == pytest.approx(column(ours, name), rel=1e-12, abs=1e-12)


def test_the_csv_of_the_dive_is_what_its_script_writes() -> None:
    import importlib.util

    script = CAMPAIGNS / "bluerov2_dvl_csv/make_csv.py"
    spec = importlib.util.spec_from_file_location("make_csv", script)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    outputs = campaign_log("bluerov2_dvl")
    for name, columns in module.FILES.items():
        text = module.csv_text(getattr(outputs, name), columns, outputs.log_info.start_us)
        assert (script.parent / "logs" / f"{name}.csv").read_text() == text


def test_files_of_one_log_are_merged() -> None:
    outputs = run(depth_csv(), range_csv())
    assert outputs.log_info.start_us == 1_000_000
    assert column(outputs.range, "time_us").tolist() == [1.5e6, 2.5e6]
    assert [item.name for item in outputs.log_info.files] == ["depth.csv", "range.csv"]


def test_a_stream_of_two_files_needs_a_choice() -> None:
    other = depth_csv("spare.csv", "t,d\n1,50\n2,60\n")
    with pytest.raises(
        CampaignError,
        match=r"several files .* 'depth'.*depth.csv, spare.csv.*sources: \{depth: depth.csv\}",
    ):
        run(depth_csv(), other)
    assert column(
        run(depth_csv(), other, sources={"depth": "spare.csv"}).depth, "depth_m"
    ).tolist() == [50.0, 60.0]


def test_the_manifest_chooses_sources() -> None:
    assert (
        run(raw_file(SMALL), sources={"depth": "BARO[0]"}).log_info.streams["depth"].source
        == "BARO[0]"
    )
    assert run(raw_file(SMALL), sources={"depth": "none"}).depth is None
    with pytest.raises(
        CampaignError,
        match=(
            r"no such source of stream 'depth'; found 'BARR'; allowed: BARO\[1\], BARO\[0\].*Did"
            r" you mean"
        ),
    ):
        run(raw_file(SMALL), sources={"depth": "BARR"})
    with pytest.raises(CampaignError, match=r"unknown stream; found 'dept'.*Did you mean 'depth'"):
        run(raw_file(SMALL), sources={"dept": "BARO"})
    with pytest.raises(CampaignError, match=r"velocity.*none: nothing in the log"):
        run(raw_file(SMALL), sources={"velocity": "VISO"})


def test_the_vehicle_names_its_barometer() -> None:
    vehicle = vehicle_from_document(
        {**vehicle_document("bluerov2_heavy"), "sensors": {"depth": {"barometer_instance": 0}}}
    )
    assert run(raw_file(SMALL), vehicle=vehicle).log_info.streams["depth"].source == "BARO[0]"
    assert (
        run(raw_file(SMALL), vehicle=vehicle, sources={"depth": "BARO[1]"})
        .log_info.streams["depth"]
        .source
        == "BARO[1]"
    )


def test_declared_start_of_a_csv_log() -> None:
    assert run(depth_csv(start=0)).log_info.start_us == 0
    with pytest.raises(CampaignError, match=r"time.start.*found 'noon'"):
        run(depth_csv(start="noon"))
    with pytest.raises(CampaignError, match=r"time.start.*found nan"):
        run(depth_csv(start=float("nan")))


def test_files_on_different_clocks() -> None:
    unix = range_csv("t,h\n1700000001.5,2\n1700000002.5,3\n", epoch="unix")
    with pytest.raises(LogError, match="not on one clock"):
        run(depth_csv(), unix)
    assert run(unix).log_info.utc_offset_us == 0


def test_nothing_but_definitions() -> None:
    head = SMALL.read_bytes()[:89]
    with pytest.raises(DataError, match="no message that auvid reads"):
        run(RawFile("stub.BIN", np.frombuffer(head, np.uint8)))


def test_sensors_without_a_time_field_are_named() -> None:
    head = "FMT, 1, 19, ATT, cc, Roll,Pitch\nFMT, 2, 19, CTUN, f, Alt\n"
    text = (head + "ATT, 1.5, 2.5\nCTUN, 0.5\n" * 20).encode()
    with pytest.raises(DataError, match="Without a time field of the vehicle's clock: ATT, CTUN"):
        run(RawFile("old.log", np.frombuffer(text, np.uint8)))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "the file is empty"),
        (b"\0" * 64, "the file is empty"),
        (b"hello world\n" * 9, "no reader recognises"),
    ],
)
def test_what_is_no_log(content: bytes, words: str) -> None:
    with pytest.raises(LogError, match=words):
        run(RawFile("x.bin", np.frombuffer(content, np.uint8)))


def test_a_forced_reader_that_does_not_exist() -> None:
    log = RawLog("dive", (raw_file(SMALL),), reader="dataflsh")
    with pytest.raises(
        LogError, match=r"unknown reader; found 'dataflsh'.*Did you mean 'dataflash'"
    ):
        ingest.run(ingest.Inputs(log), ingest.Params())


def test_gyro_without_accelerometer_has_the_columns_all_the_same() -> None:
    columns = [
        {"column": axis, "stream": "imu", "field": f"gyro_{axis}_rad_s", "unit": "rad/s"}
        for axis in "xyz"
    ]
    outputs = run(csv_log("gyro.csv", "t,x,y,z\n0,1,2,3\n1,1,2,3\n", columns))
    assert np.isnan(column(outputs.imu, "accel_x_m_s2")).all()
    assert outputs.log_info.accelerometer is None
