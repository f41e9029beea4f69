"""`auvid check` on every licensed log: which findings must and must not appear, what
the page says, bad input, campaigns, two clocks.
"""

from __future__ import annotations

import json
import re
import shutil
import sys
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from auvid.data_schemas.checks import checks, documentation
from auvid.data_schemas.documents import check_document
from auvid.data_schemas.errors import PipelineError
from auvid.pipeline import cli, terminal
from auvid.pipeline.commands.check.check_command import check
from auvid.pipeline.commands.check.clock_alignment import align_clocks
from auvid.pipeline.commands.check.log_page import LogPage, log_pages
from auvid.pipeline.output import OUTPUT
from auvid.stages import ingest
from auvid.stages.base import RawFile, RawLog

ROOT = Path(__file__).parents[2]
DATA = ROOT / "tests" / "data"
DIVE = ROOT / "campaigns" / "bluerov2_dvl" / "logs" / "00000029_first130s.BIN"
SMALL = DATA / "bluerov2_ugps_small" / "small.BIN"

AXES = ("Surge", "Sway", "Heave", "Yaw")
COMMANDS = [
    {"column": name, "stream": "actuators", "field": f"command_{name.lower()}", "unit": "1"}
    for name in AXES
]
BLUEYE = {
    "time": {"column": "Time", "unit": "s", "epoch": "unix"},
    "columns": [{"column": "Depth", "stream": "depth", "field": "depth_m", "unit": "m"}, *COMMANDS],
}
GLIDER = {
    "time": {"column": "time_s", "unit": "s", "epoch": "unix"},
    # One bar is ten metres of fresh water within 2 %.
    "columns": [
        {"column": "pressure_bar", "stream": "depth", "field": "depth_m", "unit": "decametre"}
    ],
}


@dataclass(frozen=True)
class Row:
    """One log: what must be found, with words of the sentence or None; what must not;
    the exit code; words of the verdict.
    """

    file: Path
    must: dict[str, str | None]
    must_not: set[str]
    code: int
    verdict: str
    columns: dict[str, Any] | None = field(default=None)


WRONG_SENSORS = {
    "gyro_sign",
    "gyro_axes",
    "gyro_scale",
    "gyro_lag",
    "gyro_disagrees",
    "accelerometer_unit",
    "accelerometer_convention",
}
WRONG_SENSORS |= {
    "attitude_jumps",
    "depth_above_water",
    "accelerometer_direction",
    "gyro_saturated",
    "depth_sign",
    "constant_signal",
    "stuck_sensor",
    "held_samples",
}
LOSSES = {"file_damaged", "file_truncated", "clock_leap", "most_rejected"}
LOGS = (
    Row(
        DIVE,
        {
            "attitude_disagrees": "DCM by 46 degrees and AHR2 by 46 degrees",
            "housing_barometer": (
                "BARO[0] reads 76.64 to 83.22 m while BARO[1] reads 13.29 to 13.78 m"
            ),
            "not_excited": "heave 0.018 m/s, roll 0.75 deg/s and pitch 0.72 deg/s",
            "irregular_rate": "velocity (VISO)",
            "parameters_missing": "FRAME_CONFIG and 8 directions (2 parameters are)",
            "firmware_unknown": None,
            "command_lag": "yaw follows by 0.2",
        },
        WRONG_SENSORS
        | LOSSES
        | {
            "gap",
            "unaided_velocity",
            "no_velocity",
            "low_actuator_rate",
            "no_actuation",
            "simulated",
        },
        0,
        "can be fitted in surge, sway and yaw",
    ),
    Row(
        SMALL,
        {
            "no_actuation": "Outputs 1 to 6 stay within 8 us of 1500 us",
            "unaided_velocity": "XKF1",
            "no_velocity": None,
            "housing_barometer": "BARO[0] reads 9.09 to 10.34 m",
            "battery_current": "-11.2 A",
            "not_excited": "heave",
        },
        WRONG_SENSORS
        | LOSSES
        | {
            "gap",
            "attitude_disagrees",
            "low_actuator_rate",
            "parameters_missing",
            "firmware_unknown",
        },
        3,
        "no velocity; no actuator acts",
    ),
    Row(
        DATA / "bluerov2_ugps_small" / "small.tlog",
        {
            "never_armed": None,
            "low_actuator_rate": "SERVO_OUTPUT_RAW) comes at 2 Hz",
            "low_rate": "LOCAL_POSITION_NED) comes at 3 Hz",
            "estimated_velocity": None,
            "depth_estimated": "GLOBAL_POSITION_INT",
            "accelerometer_missing": None,
            "recut_messages": "4 messages",
        },
        WRONG_SENSORS
        | LOSSES
        | {"unaided_velocity", "no_velocity", "several_vehicles", "housing_barometer"},
        3,
        "no actuator acts",
    ),
    Row(
        DATA / "bluerov2_bad_data" / "bad_data.tlog",
        {
            "never_armed": None,
            "low_actuator_rate": "2 Hz",
            "no_velocity": None,
            "recut_messages": "158 DISTANCE_SENSOR",
            "gap": "battery",
        },
        WRONG_SENSORS | LOSSES | {"estimated_velocity", "wrong_checksum", "depth_estimated"},
        3,
        "no velocity; no actuator acts",
    ),
    Row(
        DATA / "px4_ulog" / "sample_log_small.ulg",
        {
            "unaided_velocity": "v_xy_valid",
            "not_underwater": "MAV_TYPE 22",
            "stray_stamps": "1194",
            "gyro_bias": "Gyro z reads +0.029 rad/s",
            "no_velocity": None,
        },
        (WRONG_SENSORS | LOSSES | {"gap", "low_rate", "firmware_unknown", "no_actuation"}),
        3,
        "not an underwater vehicle",
    ),
    Row(
        DATA / "px4_ulog" / "sample_appended_multiple.ulg",
        {
            "never_armed": None,
            "not_underwater": "MAV_TYPE 2",
            "depth_estimated": "vehicle_local_position",
            "no_battery": None,
        },
        WRONG_SENSORS | LOSSES | {"gap", "stray_stamps", "low_rate"},
        3,
        "not an underwater vehicle",
    ),
    Row(
        DATA / "blueye_sea_trial" / "sea_trial_start.csv",
        {
            "most_rejected": "repeated time stamp: 1314",
            "gap": "128.0 s at 200.0 s",
            "low_actuator_rate": "comes at 0.958 Hz",
            "outputs_saturated": "command surge",
            "no_attitude": None,
            "no_imu": None,
        },
        {
            "file_damaged",
            "file_truncated",
            "clock_leap",
            "no_actuators",
            "firmware_unknown",
            "parameters_missing",
            "depth_above_water",
        },
        3,
        "normalised commands only",
        BLUEYE,
    ),
    Row(
        DATA / "slocum_glider" / "glider_start.csv",
        {
            "no_attitude": None,
            "no_actuators": None,
            "no_imu": None,
            "no_velocity": None,
            "gap": "139.2 s",
        },
        LOSSES
        | {"not_excited", "no_battery", "depth_above_water", "simulated", "rejected_samples"},
        3,
        "no attitude; no actuators",
        GLIDER,
    ),
)


def column_map(folder: Path, columns: dict[str, Any] | None) -> Path | None:
    if columns is None:
        return None
    path = folder / "map.yaml"
    path.write_text(yaml.safe_dump(columns), encoding="utf-8")
    return path


@pytest.mark.parametrize("row", LOGS, ids=lambda row: row.file.name)
def test_findings_of_every_licensed_log(
    row: Row, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code = check([str(row.file)], columns=column_map(tmp_path, row.columns))
    (page,) = OUTPUT.answer["logs"]
    check_document(page["health"], "health")
    by_id = {item["id"]: item for item in page["health"]["findings"]}
    assert set(by_id) >= set(row.must), sorted(set(row.must) - set(by_id))
    assert not set(by_id) & row.must_not
    for name, words in row.must.items():
        texts = [item["text"] for item in page["health"]["findings"] if item["id"] == name]
        assert words is None or any(words in text for text in texts), texts
    assert row.verdict in page["health"]["verdict"]
    assert code == row.code
    printed = capsys.readouterr().out
    assert all(item["id"] in printed for item in by_id.values())
    assert "\x1b" not in printed  # no colours where the output is no terminal


def test_a_glider_has_no_cross_before_what_can_be_fitted(
    capsys: pytest.CaptureFixture[str],
) -> None:
    folder = ROOT / "campaigns/slocum_glide"
    check([str(folder / "logs/dive.csv")], columns=folder / "columns/dive.yaml")
    printed = capsys.readouterr().out
    assert "✓ Drag, lift and trim can be fitted to settled glides" in printed
    assert "✗" not in printed


def test_the_page_of_the_dive(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "110")
    assert check([str(DIVE)]) == 0
    printed = capsys.readouterr().out
    lines = printed.splitlines()
    assert len(lines) <= 45, "one screen"
    assert re.search(r"velocity +VISO +1011 +0\.0 +129\.9 +7\.78 +65 +0\.41 +XKF1", printed)
    assert "complete" in lines[1]
    assert "cannot run: synthesise heave, roll, pitch: hardly any motion" in printed
    assert "motion RMS: u 0.0984" in printed


def test_on_a_narrow_screen_numbers_stay_whole(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    check([str(DATA / "bluerov2_ugps_small" / "small.tlog")])
    printed = capsys.readouterr().out
    assert "…" not in printed
    assert re.search(
        r"(?m)^actuators +SERVO_OUTPUT_RAW +\d+( +\d+\.\d){2} +2 +[\d.]+ +0\.76", printed
    )
    assert re.search(r"(?m)^velocity +LOCAL_POSITION_\w+ +\d+( +\d+\.\d){2} +3 ", printed)


def test_a_campaign_with_its_legs_and_vehicle(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(ROOT)
    monkeypatch.setenv("COLUMNS", "120")
    assert check(["bluerov2_dvl"]) == 0
    (page,) = OUTPUT.answer["logs"]
    train, validate = page["legs"]
    assert (train["id"], train["start_s"], train["end_s"], train["inside"]) == (
        "train",
        0.0,
        90.0,
        True,
    )
    assert train["covered_s"] == pytest.approx(90.0, abs=0.3)
    assert validate["excited"] == ["surge", "sway", "yaw"]
    assert train["active_share"] > 0.9
    printed = capsys.readouterr().out
    assert "because the vehicle file names it" in " ".join(printed.split())
    assert re.search(r"train +training +0\.0 +90\.0", printed)


def test_a_twin_that_has_not_flown_is_sent_to_its_stage(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    shutil.copytree(ROOT / "campaigns" / "vt690_twin", tmp_path / "campaigns" / "vt690_twin")
    shutil.copy(ROOT / "params.yaml", tmp_path)
    monkeypatch.chdir(tmp_path)
    assert check(["vt690_twin"]) == 1
    assert "auvid run vt690_twin --only simulate" in " ".join(capsys.readouterr().out.split())


def test_damaged_and_cut_logs_say_what_was_lost(tmp_path: Path) -> None:
    data = SMALL.read_bytes()
    (tmp_path / "cut.BIN").write_bytes(data[: len(data) - 9])
    (tmp_path / "damaged.BIN").write_bytes(data[:200_000] + bytes(700) + data[200_500:])
    assert check([str(tmp_path / "cut.BIN"), str(tmp_path / "damaged.BIN")]) == 3
    cut, damaged = (page["health"] for page in OUTPUT.answer["logs"])
    by_id = {item["id"]: item for item in cut["findings"]}
    assert cut["status"] == "truncated"
    assert 0 < by_id["file_truncated"]["value"] < 200
    by_id = {item["id"]: item for item in damaged["findings"]}
    assert damaged["status"] == "damaged"
    assert 500 <= by_id["file_damaged"]["value"] < 1000


def test_html_is_one_file_with_everything_escaped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    original = ingest.run

    def hostile(inputs: Any, params: Any) -> Any:
        outputs = original(inputs, params)
        outputs.health["vehicle"] = (
            "\x1b[31mArduSub\x1b[0m <script>alert(1)</script> \u202eevil\x07"
        )
        outputs.health["findings"][0]["text"] = (
            "\x1b]0;title\x07[bold]x[/bold] <img src=x onerror=y>"
        )
        return outputs

    monkeypatch.setattr(ingest, "run", hostile)
    target = tmp_path / "page.html"
    check([str(SMALL)], html_file=target)
    page = target.read_text(encoding="utf-8")
    assert "<script>" not in page
    assert "<img" not in page
    assert "&lt;script&gt;" in page
    assert not re.search(r"(src|href)=[\"']?(http|//)", page)
    assert "\x1b" not in page
    assert "\u202e" not in page
    printed = capsys.readouterr().out
    assert "\x1b" not in printed
    assert "\u202e" not in printed
    assert "[bold]x[/bold]" in printed
    assert "title" not in printed


def test_json_on_standard_output_is_json_alone(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["auvid", "check", str(SMALL), "--json"])
    with pytest.raises(SystemExit):
        cli.main()
    document = json.loads(capsys.readouterr().out)
    assert document["answer"]["logs"][0]["health"]["log"] == "small"


def test_bad_input_is_refused_in_words_and_the_other_logs_are_checked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """One call for all: exit code 1, a reason for each, and the good log is shown."""
    (tmp_path / "empty.BIN").touch()
    (tmp_path / "zeros.BIN").write_bytes(bytes(5000))
    (tmp_path / "picture.BIN").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 20)
    (tmp_path / "letter.txt").write_text("Dear crew, the dive went well.\n")
    data = SMALL.read_bytes()
    (tmp_path / "headers.BIN").write_bytes(data[:3500])
    (tmp_path / "plain.csv").write_text("a,b\n1,2\n")
    (tmp_path / "folder").mkdir()
    reasons = {
        "empty.BIN": "empty",
        "zeros.BIN": "empty",
        "picture.BIN": "no reader recognises",
        "letter.txt": "no reader recognises|column map",
        "headers.BIN": "no message that auvid reads",
        "plain.csv": "column map",
        "folder": "is a folder",
        "missing.BIN": "is not there",
    }
    names = [str(tmp_path / name) for name in reasons]
    monkeypatch.setattr(sys, "argv", ["auvid", "check", *names, str(SMALL)])
    monkeypatch.setenv("COLUMNS", "400")
    with pytest.raises(SystemExit) as end:
        cli.main()
    assert end.value.code == 1
    printed, faults = capsys.readouterr()
    assert "Traceback" not in printed + faults
    pages = re.split(r"(?m)^.*/([\w.]+) ─+$", printed)[1:]
    printed_by_file = dict(zip(pages[::2], pages[1::2], strict=True))
    for name, reason in reasons.items():
        assert re.search(reason, printed_by_file[name]), printed_by_file[name]
        assert "✗ refused" in printed_by_file[name]
    assert "no_actuation" in printed_by_file["small.BIN"]


def test_no_permission(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: Any, **__: Any) -> Any:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(np, "fromfile", refuse)
    page = log_pages(str(SMALL), None)[0]
    assert page.refused is not None
    assert "no permission" in page.refused


def test_a_file_that_grows_while_it_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = tmp_path / "growing.BIN"
    log.write_bytes(SMALL.read_bytes())
    original = ingest.run

    def growing(inputs: Any, params: Any) -> Any:
        with log.open("ab") as file:
            file.write(b"more")
        return original(inputs, params)

    monkeypatch.setattr(ingest, "run", growing)
    page = log_pages(str(log), None)[0]
    assert page.refused is not None
    assert "changed while it was read" in page.refused


def test_a_device_is_no_log() -> None:
    page = log_pages("/dev/null", None)[0]
    assert page.refused is not None
    assert "no regular file" in page.refused


def test_wrong_calls_are_errors_in_words(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    with pytest.raises(PipelineError, match="no such campaign"):
        check(["bluerov2_dvk"])
    with pytest.raises(PipelineError, match="two logs"):
        check([str(SMALL)], align=True)
    (tmp_path / "map.yaml").write_text("times: 3\n")
    with pytest.raises(PipelineError, match="times"):
        check([str(SMALL)], columns=tmp_path / "map.yaml")


SHIFT_S = 37.25
DEPTH_MAP = {
    "time": {"column": "t", "unit": "s"},
    "columns": [{"column": "d", "stream": "depth", "field": "depth_m", "unit": "m"}],
}


def test_clocks_of_two_logs_of_one_dive(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A part of the dive as CSV with a clock set back: the offset is known to the
    microsecond.
    """
    source = ROOT / "campaigns" / "bluerov2_dvl_csv"
    head, *rows = (source / "logs" / "imu.csv").read_text(encoding="utf-8").splitlines()
    cells = np.array([row.split(",") for row in rows[800:2400]], dtype=np.float64)
    cells[:, 0] += SHIFT_S
    moved = tmp_path / "imu.csv"
    np.savetxt(moved, cells, delimiter=",", header=head, comments="", fmt="%.9g")
    check(
        [str(DIVE), str(moved)],
        columns=source / "columns" / "imu.yaml",
        align=True,
    )
    alignment = OUTPUT.answer["alignment"]
    start_s = OUTPUT.answer["logs"][0]["health"]["duration_s"]
    assert start_s == pytest.approx(130.0, abs=0.1)
    # The CSV counts from the first record of the dive, at 600.014074 s of the boot
    # clock.
    assert alignment["offset_s"] == pytest.approx(600.014074 - SHIFT_S, abs=0.001)
    assert alignment["std_s"] < 0.001
    assert alignment["correlation"] > 0.999
    assert "angular rate" in capsys.readouterr().out


def test_clocks_of_the_autopilot_log_and_the_telemetry_of_one_dive(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The telemetry was written from the log, with its boot clock: milliseconds for
    depth, microseconds for the angular rate.
    """
    tlog = ROOT / "campaigns" / "bluerov2_dvl_tlog" / "logs" / "dive.tlog"
    pages = [log_pages(str(path), None)[0] for path in (DIVE, tlog)]
    alignment = align_clocks(*pages)
    assert (alignment.first, alignment.second) == (str(DIVE), str(tlog))
    assert alignment.signal == "angular rate"
    assert abs(alignment.offset.offset_s) < 3 * alignment.offset.std_s < 1e-3
    by_depth = align_clocks(
        *(
            replace(page, outputs=replace(page.outputs, imu=None))
            for page in pages
            if page.outputs is not None
        )
    )
    assert by_depth.signal == "depth"
    assert abs(by_depth.offset.offset_s) < by_depth.offset.std_s
    assert by_depth.offset.std_s == pytest.approx(
        1e-3 / np.sqrt(12), rel=0.05
    )  # s: time stamps in ms
    assert capsys.readouterr().out == ""


def test_a_common_trend_is_no_alignment() -> None:
    """Two dives go down and up once, each in its own time."""
    t = np.arange(0.0, 300.0, 0.5)
    outputs = []
    for period in (70.0, 45.0):
        depth = 5 * np.sin(np.pi * t / 300.0) ** 2 + 0.4 * np.sin(2 * np.pi * t / period)
        text = "t,d\n" + "".join(f"{a:.3f},{b:.4f}\n" for a, b in zip(t, depth, strict=True))
        outputs.append(text)
    pages = []
    for name, text in zip(("one", "two"), outputs, strict=True):
        log = RawLog(
            name, (RawFile(f"{name}.csv", np.frombuffer(text.encode(), np.uint8), DEPTH_MAP),)
        )
        ingested = ingest.run(ingest.Inputs(log), ingest.Params())
        pages.append(LogPage(name, ingested.health, outputs=ingested))
    with pytest.raises(
        PipelineError, match=r"cannot be aligned.*correlation 0.[89].*standard deviation"
    ):
        align_clocks(*pages)


def test_two_dives_cannot_be_aligned(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(PipelineError, match="cannot be aligned"):
        check([str(DIVE), str(SMALL)], align=True)
    assert "BARO[1]" in capsys.readouterr().out  # the pages are shown all the same


def test_the_documentation_holds_every_finding() -> None:
    text = (ROOT / "docs" / "checks.md").read_text(encoding="utf-8")
    assert text == documentation()
    words = " ".join(text.split())  # lines are wrapped
    for name, entry in checks().items():
        assert f"### `{name}`" in text
        assert entry.remedy in words
        assert entry.reason in words


def test_texts_lose_escapes_and_control_characters() -> None:
    assert (
        terminal.plain("\x1b[1;31mred\x1b[0m\x07 \x9b31m \x1b]8;;http://x\x1b\\link\u2066")
        == "red   31m link "
    )


def test_the_command_is_registered() -> None:
    assert "check" in {
        command.name or command.callback.__name__
        for command in cli.app.registered_commands
        if command.callback
    }
