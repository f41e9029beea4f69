"""A run stops behind ingest where findings of its logs say so, in one message, and goes
on where the manifest accepts them. On made-up logs and the real stages of a campaign.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from auvid.data_schemas.checks import log_findings, standing_findings
from auvid.data_schemas.errors import CampaignError, DataError, PipelineError
from auvid.pipeline.campaigns.campaign import Campaign, load_campaign
from auvid.pipeline.commands.check.run_gate import refusal
from auvid.stages.fuse import Params as FuseParams
from auvid.stages.registry import KINDS
from auvid.stages.resample import Params as ResampleParams
from tests.support.sound_log import Log, sound

VEHICLES = {"rov": Path(__file__).resolve().parents[5] / "vehicles" / "bluerov2_heavy.yaml"}
MANIFEST = """kind: identification
vehicle: rov
logs:
  - {{id: one, file: one.csv{one}}}
  - {{id: two, file: two.csv}}
legs:
  - {{id: train, log: one, use: training}}
  - {{id: check, log: two, use: validation}}
{more}
"""


@pytest.fixture
def campaign(tmp_path: Path) -> Any:
    def make(*, one: str = "", more: str = "") -> Campaign:
        (tmp_path / "campaign.yaml").write_text(MANIFEST.format(one=one, more=more))
        return load_campaign(tmp_path, kinds=KINDS, vehicles=VEHICLES)

    return make


def fault(
    campaign: Campaign, *logs: Log, method: str = "smoother", until: str = "report"
) -> DataError | None:
    """Return why a run on these logs stops."""
    health = dict(zip(("one", "two"), (log.health() for log in logs), strict=True))
    stages = KINDS["identification"]
    params = {"fuse": FuseParams(method=method)}
    return refusal(campaign, health, stages[: stages.index(until) + 1], params)


def test_validation_on_training_data_stops(campaign: Any, tmp_path: Path) -> None:
    (tmp_path / "one.csv").write_text("the same")
    (tmp_path / "two.csv").write_text("the same")
    text = str(fault(campaign(), sound(), sound()))
    assert "leg 'check' shares" in text
    assert "logs 'two' and 'one' are one file" in text
    (tmp_path / "two.csv").write_text("another")
    assert fault(campaign(), sound(), sound()) is None
    part = "  - {id: part, log: two, use: training, end_s: END}"
    third, most = (f"{share * sound().health()['duration_s']:.0f}" for share in (0.3, 0.7))
    assert fault(campaign(more=part.replace("END", third)), sound(), sound()) is None
    text = str(fault(campaign(more=part.replace("END", most)), sound(), sound()))
    assert f"leg 'check' shares {most} s with training leg 'part'\n" in text


@pytest.mark.parametrize(
    "name", ["bluerov2_no_velocity", "bluerov2_dvl", "blueye_heave", "thaus_twin"]
)
def test_legs_of_bundled_campaigns_are_apart_or_have_no_use(name: str) -> None:
    folder = Path(__file__).resolve().parents[5] / "campaigns" / name
    vehicles = {path.stem: path for path in (folder.parents[1] / "vehicles").glob("*.yaml")}
    assert refusal(load_campaign(folder, kinds=KINDS, vehicles=vehicles), {}, (), {}) is None


def turned(log: Log) -> Log:
    """The gyro's y the other way round."""
    log.streams["imu"]["gyro_y_rad_s"] = -log.streams["imu"]["gyro_y_rad_s"]
    return log


def without(*streams: str) -> Log:
    log = sound()
    for stream in streams:
        del log.streams[stream]
    return log


def test_sound_logs_stop_nothing(campaign: Any) -> None:
    assert fault(campaign(), sound(), sound()) is None


def test_one_message_holds_all_findings_that_stop_and_how_to_accept_them(campaign: Any) -> None:
    log = turned(sound())
    log.info["vehicle"] = "ArduCopter V4.5.0"
    message = fault(campaign(), log, turned(sound()))
    text = str(message)
    assert text.count("Gyro y turns against pitch") == 2
    assert "log 'one'" in text
    assert "log 'two'" in text
    assert "ArduCopter" in text
    assert "accept: [gyro_sign, not_underwater]" in text
    assert "campaign.yaml" in text


def test_who_accepts_a_cause_still_has_what_it_explained() -> None:
    """A wrong sign of surge alone turns its answer to the thrusters as well."""
    cause, other = {"id": "velocity_sign"}, {"id": "response_sign", "by": "velocity_sign"}
    document = {"findings": [cause], "explained": [other]}
    assert standing_findings(document, frozenset()) == [cause]
    assert standing_findings(document, frozenset({"velocity_sign"})) == [cause, other]


def test_the_manifest_accepts_findings_of_a_log_or_of_the_campaign(campaign: Any) -> None:
    logs = turned(sound()), sound()
    assert fault(campaign(one=", accept: [gyro_sign]"), *logs) is None
    assert fault(campaign(more="accept: [gyro_sign]"), *logs) is None
    assert fault(campaign(one=", accept: [gyro_sign]"), *reversed(logs)) is not None
    accepting = campaign(more="accept: [gyro_sign]")
    lines = list(map(str, log_findings(accepting.document, {"one": logs[0].health()})))
    assert len(lines) == 1
    assert lines[0].startswith("log 'one': Gyro y turns against pitch")
    assert lines[0].endswith("(gyro_sign, accepted)")


def test_the_message_names_file_and_rows_of_the_column_map(campaign: Any, tmp_path: Path) -> None:
    (tmp_path / "map.yaml").write_text(
        "time: {column: t, unit: s}\n"
        "columns:\n"
        "  - {column: p, stream: imu, field: gyro_x_rad_s, unit: rad/s}\n"
        "  - {column: q, stream: imu, field: gyro_y_rad_s, unit: rad/s}\n"
    )
    text = str(fault(campaign(one=", columns: map.yaml"), turned(sound()), sound()))
    assert "(map.yaml, row 4)" in text


def test_the_same_finding_of_several_logs_is_one_line_and_a_bench_needs_no_velocity(
    campaign: Any,
) -> None:
    health = dict.fromkeys(("one", "two"), without("velocity", "battery").health())
    manifest = campaign().document
    assert any(
        line.startswith("log 'one' and 1 other: ") and line.endswith("(no_velocity)")
        for line in map(str, log_findings(manifest, health))
    )
    assert log_findings({**manifest, "kind": "bench"}, health) == ()


def test_an_unknown_finding_is_refused_with_the_nearest(campaign: Any) -> None:
    with pytest.raises(PipelineError) as caught:
        campaign(one=", accept: [gyro_sing]")
    text = str(caught.value)
    assert isinstance(caught.value, CampaignError)
    assert "row 4" in text
    assert "Did you mean 'gyro_sign'?" in text


def test_an_accelerometer_that_no_stage_takes_does_not_stop(campaign: Any) -> None:
    log = sound()
    for axis in "xyz":
        log.streams["imu"][f"accel_{axis}_m_s2"] /= 9.81
    assert "accelerometer_unit" in str(fault(campaign(), log, sound()))
    assert fault(campaign(), log, sound(), method="kinematic") is None


def test_logs_without_velocity_are_refused_once_with_the_route_that_exists(campaign: Any) -> None:
    text = str(fault(campaign(), without("velocity"), without("velocity")))
    assert text.count("no velocity") == 1
    assert "log 'one', 'two': no velocity" in text
    assert "--until resample" in text
    assert "heave and yaw only" in text
    assert "kind bench" in text
    assert "kind axes" in text
    assert fault(campaign(), without("velocity"), sound(), until="resample") is None
    both = str(fault(campaign(), without("velocity", "actuators"), sound()))
    assert "no velocity; no actuators" in both
    assert "bench" not in both, "without commands no channel can be identified"
    idle = without("velocity")
    for number in range(1, 9):
        idle.streams["actuators"][f"pwm_{number}_us"] = np.full(idle.t_s("actuators").size, 1500.0)
    resting = str(fault(campaign(), idle, idle))
    assert "no velocity; no actuator acts" in resting
    assert "Partial use" not in resting, "without a push no axis can be identified"


def test_a_missing_accelerometer_names_the_method_that_needs_none(campaign: Any) -> None:
    log = sound()
    for axis in "xyz":
        log.streams["imu"][f"accel_{axis}_m_s2"] = np.full(log.t_s("imu").size, np.nan)
    assert "stages.fuse.method: kinematic" in str(fault(campaign(), log, sound()))
    assert fault(campaign(), log, sound(), method="kinematic") is None


def test_rates_may_come_from_the_attitude(campaign: Any) -> None:
    assert fault(campaign(), without("imu"), sound(), method="kinematic") is None


def test_one_idle_log_of_two_stops_nothing_but_two_do(campaign: Any) -> None:
    idle = sound()
    for number in range(1, 9):
        idle.streams["actuators"][f"pwm_{number}_us"] = np.full(idle.t_s("actuators").size, 1500.0)
    assert fault(campaign(), idle, sound()) is None
    assert "no actuator acts" in str(fault(campaign(), idle, idle))


def test_outputs_that_the_vehicle_listens_to_must_be_there(campaign: Any) -> None:
    loaded = campaign()
    log = sound()
    log.vehicle = loaded.vehicle
    del log.streams["actuators"]["pwm_7_us"]
    assert "no pwm_7_us among the actuators" in str(fault(loaded, log, sound()))


def test_legs_outside_their_log_stop_a_run_in_one_message(campaign: Any) -> None:
    legs = campaign().file.path
    text = legs.read_text()
    text = text.replace("log: one, use", "log: one, start_s: 1700000000, use")
    legs.write_text(text.replace("log: two, use", "log: two, start_s: 59000, use"))
    stop = fault(load_campaign(legs.parent, kinds=KINDS, vehicles=VEHICLES), sound(), sound())
    assert stop is not None
    for words in ("leg 'train'", "leg 'check'", "log 'two' has 60.0 s", "since 1970", "Millisec"):
        assert words in str(stop)


def test_legs_in_minutes_stop_a_run(campaign: Any) -> None:
    manifest = campaign().file.path
    text = manifest.read_text().replace("log: one, use", "log: one, end_s: 0.9, use")
    manifest.write_text(text)
    again = load_campaign(manifest.parent, kinds=KINDS, vehicles=VEHICLES)
    health = {"one": sound().health(), "two": sound().health()}
    params = {"fuse": FuseParams(method="smoother"), "resample": ResampleParams()}
    stop = refusal(again, health, KINDS["identification"], params)
    assert stop is not None
    assert "leg 'train' takes 0.9 s; 5 s are needed" in str(stop)


def test_a_leg_that_ends_behind_its_log_goes_on(campaign: Any) -> None:
    manifest = campaign().file.path
    text = manifest.read_text().replace("log: one, use", "log: one, start_s: 10, end_s: 99, use")
    manifest.write_text(text)
    again = load_campaign(manifest.parent, kinds=KINDS, vehicles=VEHICLES)
    assert fault(again, sound(), sound()) is None
