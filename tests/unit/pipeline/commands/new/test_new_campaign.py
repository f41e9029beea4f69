"""`auvid new campaign` writes what can be run, and refuses with the reason."""

from __future__ import annotations

import errno
import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from auvid.data_schemas.documents.vehicle.actuators import ActuatorsEntry
from auvid.data_schemas.errors import LogError, PipelineError, UsageError
from auvid.data_schemas.yaml_text import read_yaml
from auvid.hydro.identification.selection.leg_proposal import LegProposal
from auvid.pipeline.campaigns.campaign import load_campaign
from auvid.pipeline.commands.check.axes_route import likely_vehicle
from auvid.pipeline.commands.check.check_command import check
from auvid.pipeline.commands.new.campaign_command import _stop, new_campaign
from auvid.pipeline.commands.new.feedable import CampaignFeed, checked, feed_of, proposal
from auvid.pipeline.commands.new.log_survey import apart_words, survey, unused_words
from auvid.pipeline.commands.new.refusal import NoCampaignError
from auvid.pipeline.commands.new.vehicle_choice import VehicleChoice, choose_vehicle
from auvid.pipeline.output import OUTPUT
from auvid.stages.ingest.formats.csv.draft.column_draft import ColumnDraft
from auvid.stages.ingest.health.finding import CheckedLog
from auvid.stages.registry import KINDS
from tests.support.tank_runs import noisy, tank_run, write_csv
from tests.support.tools import ROOT

DIVE = ROOT / "campaigns/bluerov2_dvl/logs/00000029_first130s.BIN"
TLOG = ROOT / "campaigns/bluerov2_dvl_tlog/logs/dive.tlog"
STILL = ROOT / "tests/data/bluerov2_ugps_small/small.BIN"


@pytest.fixture(autouse=True)
def outside_any_workspace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_a_dive_with_velocity_log_gives_a_force_model() -> None:
    result = new_campaign("pier", [DIVE])
    assert result.stop == ""
    campaign = load_campaign(result.folder, kinds=KINDS, vehicles={})
    assert campaign.document["kind"] == "identification"
    assert campaign.vehicle.thrusters is not None
    assert {leg["use"] for leg in campaign.legs.values()} == {"training", "validation"}
    text = (result.folder / "campaign.yaml").read_text()
    assert "# check: bluerov2_heavy, guessed, 8 outputs are driven" in text
    assert "surge and sway move one way only" in text
    # Pitch and roll move up to 1.3 Hz, which an eighth of the velocity log's 7.8 Hz cuts off.
    assert "cutoff_hz: 2.6}  # check: pitch moves up to 1.3 Hz, its drag up to twice that" in text
    vehicle = (result.folder / "vehicle.yaml").read_text()
    assert "  # check: weigh the vehicle" in vehicle
    # Line by line as an editor sees them: short, and the check stands above its figure.
    assert all(len(line) < 89 for line in text.splitlines() if line.startswith("#"))


def written_torpedo(path: Path) -> Path:
    """Write a dive of a torpedo that yaws, pitches and changes speed."""
    t_s = np.arange(0.0, 80.0, 0.1)
    swing = {name: np.sin(2.0 * np.pi * t_s / period) for name, period in (("r", 9.0), ("q", 7.0))}
    columns = {
        "time_s": t_s,
        "rpm": 1800.0 + 300.0 * np.sin(2.0 * np.pi * t_s / 20.0),
        **{f"{fin}_fin_deg": 6.0 * swing["q"] for fin in ("starboard", "port")},
        **{f"{fin}_fin_deg": -6.0 * swing["r"] for fin in ("bottom", "top")},
        "roll_deg": 0.0 * t_s,
        "pitch_deg": 4.0 * swing["q"],
        "yaw_deg": 40.0 + 8.0 * swing["r"],
        **{f"{rate}_deg_s": 5.0 * swing.get(rate, 0.0 * t_s) for rate in "pqr"},
        "depth_m": 5.0 - 0.4 * swing["q"],
        "u_m_s": 1.5 + 0.2 * np.sin(2.0 * np.pi * t_s / 20.0),
        "v_m_s": 0.1 * swing["r"],
        "w_m_s": 0.1 * swing["q"],
    }
    rows = np.column_stack(list(columns.values()))
    np.savetxt(path, rows, "%.4f", ",", header=",".join(columns), comments="")
    return path


def test_a_torpedo_is_offered_the_structure_with_lift(tmp_path: Path) -> None:
    """One without a bundled vehicle is shown the form of propeller and fins."""
    log = written_torpedo(tmp_path / "torpedo.csv")
    named = new_campaign("fins", [log], vehicle="vt690")
    campaign = load_campaign(named.folder, kinds=KINDS, vehicles={})
    assert campaign.document["stages"]["synthesise"]["models"][:2] == ["lift_and_drag", "diagonal"]
    unknown = new_campaign("unknown", [log])
    assert "propeller and fins" in unknown.stop
    text = (unknown.folder / "vehicle.yaml").read_text()
    example = text[text.index("# actuators:") : text.index("# auvid vehicles")]
    lines = [line[2:] for line in example.splitlines() if "# check" not in line]
    entry = ActuatorsEntry.model_validate(read_yaml("\n".join(lines))["actuators"])
    assert entry.propeller is not None
    assert entry.fins is not None


def test_moving_time_in_no_leg_is_in_the_comments_and_the_lines(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def shortened(feed: CampaignFeed, logs: list[CheckedLog]) -> LegProposal:
        return replace(proposal(feed, logs), dropped_s=12.5)

    monkeypatch.setattr("auvid.pipeline.commands.new.campaign_command.proposal", shortened)
    result = new_campaign("pier", [DIVE])
    words = "12.5 s that move, in stretches shorter than 8 s"
    assert f"in no leg: {words}" in result.lines
    assert f"# In no leg: {words}." in (result.folder / "campaign.yaml").read_text()


def test_a_log_that_feeds_nothing_is_refused_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(NoCampaignError) as refusal:
        new_campaign("still", [STILL])
    words = str(refusal.value)
    assert "\n" not in words
    assert "small.BIN: ArduSub V4.1.0 (89639005), 61 s; thrusters idle:" in words
    assert "Log a dive in which it is armed and driven" in words
    assert "identification" not in words
    (item,) = refusal.value.refusals
    assert "kind: identification: no velocity; no actuator acts" in item.routes
    assert "kind: bench: no actuator acts" in item.routes
    assert list(tmp_path.iterdir()) == []


def test_verbose_gives_the_reason_of_every_route(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(OUTPUT, "verbose", True)
    with pytest.raises(NoCampaignError, match="\n  kind: bench: no actuator acts"):
        new_campaign("still", [STILL])


def test_each_of_several_refused_logs_has_its_line(tmp_path: Path) -> None:
    depth = tmp_path / "depth.csv"
    rows = "".join(f"{0.1 * step},{1 + 0.01 * step}\n" for step in range(200))
    depth.write_text(f"time_s,depth_m\n{rows}")
    damaged = tmp_path / "noise.BIN"
    damaged.write_bytes(bytes(range(7, 250)) * 8)
    with pytest.raises(NoCampaignError) as refusal:
        new_campaign("still", [STILL, depth, damaged])
    _, *lines = str(refusal.value).split("\n")
    assert [line.partition(":")[0] for line in lines] == ["small.BIN", "depth.csv", "noise.BIN"]
    assert "20 s of depth; no actuators: nothing in it tells what drives" in lines[1]
    assert "no column" in lines[2]


@pytest.mark.parametrize(
    ("drive", "words"),
    [
        ({"propeller_rpm": 600.0, "rudder_deg": 9.0}, ["no velocity. Propeller and fins"]),
        ({"tau_surge_N": 60.0}, ["nothing in it tells what drives", "not in newtons"]),
    ],
)
def test_what_drives_a_log_that_feeds_nothing_is_not_denied(
    tmp_path: Path, drive: dict[str, float], words: list[str]
) -> None:
    t_s = np.arange(0.0, 40.0, 0.1)
    columns = {"t_s": t_s, "speed_log": 1.0 + 0.0 * t_s, "depth_m": 4.0 + np.sin(t_s)}
    columns |= {f"{name}_deg": 5.0 * np.sin(t_s) for name in ("roll", "pitch", "heading")}
    columns |= {name: size * (1.2 + np.sin(0.7 * t_s)) for name, size in drive.items()}
    write_csv(tmp_path / "dive.csv", columns)
    with pytest.raises(NoCampaignError) as refusal:
        new_campaign("drive", [tmp_path / "dive.csv"])
    text = str(refusal.value)
    assert all(part in text for part in [*words, "speed_log: speed through the water ahead"])
    assert "drives the vehicle is logged" not in text


@pytest.mark.parametrize(
    ("size", "words"),
    [(1.0, "name them with --commands surge=actuator_1"), (0.0, "never move: closed-loop set")],
)
def test_numbered_commands_that_nothing_answers_are_named_with_what_to_do(
    tmp_path: Path, size: float, words: str
) -> None:
    run = tank_run(1, duration_s=30.0)
    rng = np.random.default_rng(2)
    names = {"t_s", "x_m", "y_m", "z_m", "roll_rad", "pitch_rad", "yaw_rad"}
    columns = {name: run[name] for name in run if name in names}
    columns |= {f"actuator_{n}": rng.uniform(-size, size, run["t_s"].size) for n in (1, 2)}
    write_csv(tmp_path / "run.csv", columns)
    with pytest.raises(NoCampaignError, match=words) as refusal:
        new_campaign("numbered", [tmp_path / "run.csv"])
    assert len(str(refusal.value).split("\n")) == 1
    assert "no actuators" in str(refusal.value)


def test_logs_of_another_kind_are_left_out_and_said() -> None:
    result = new_campaign("two", [STILL, DIVE])
    assert any("small.BIN" in line and "left out" in line for line in result.lines)
    document = read_yaml((result.folder / "campaign.yaml").read_text())
    assert [log["file"] for log in document["logs"]] == [f"logs/{DIVE.name}"]
    assert "Left out: small.BIN" in document["notes"]


def test_nothing_is_overwritten() -> None:
    new_campaign("pier", [DIVE], link=True)
    assert Path("pier/logs", DIVE.name).is_symlink()
    with pytest.raises(PipelineError, match="there is a campaign already"):
        new_campaign("pier", [DIVE])
    with pytest.raises(PipelineError, match="named twice"):
        new_campaign("other", [DIVE, DIVE])


def test_a_folder_in_the_place_of_a_log_leads_to_the_fleet(tmp_path: Path) -> None:
    with pytest.raises(PipelineError, match=r"a folder, not a log.*auvid fleet run"):
        new_campaign("other", [tmp_path])


def test_a_copy_that_the_system_refuses_is_named_by_its_own_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(source: Path, copy: Path) -> None:
        raise OSError(errno.EFBIG, "File too large", str(source))

    monkeypatch.setattr(shutil, "copyfile", refuse)
    with pytest.raises(PipelineError, match="cannot be written: File too large") as refusal:
        new_campaign("pier", [DIVE])
    assert refusal.value.file == Path("pier/logs", DIVE.name)
    assert list(tmp_path.iterdir()) == []


def test_a_named_vehicle_is_taken() -> None:
    result = new_campaign("pier", [DIVE], vehicle="bluerov2_heavy")
    text = (result.folder / "campaign.yaml").read_text()
    assert "named by --vehicle" in text
    title = read_yaml((ROOT / "vehicles/bluerov2_heavy.yaml").read_text())["title"]
    assert read_yaml(text)["title"] == f"{title}, {DIVE.name}"


def test_a_vehicle_without_thrusters_takes_axes_in_full_commands_by_a_frame(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its velocity log would feed a force model, and nothing gives newtons."""
    document = read_yaml((ROOT / "vehicles/bluerov2_heavy.yaml").read_text())
    commands: dict[str, object] = {"frame": "vectored_6dof"}
    document["actuators"] = {"commands": commands}
    path = tmp_path / "own.yaml"
    path.write_text(json.dumps(document))
    result = new_campaign("unturned", [DIVE], vehicle=str(path))
    assert "Nothing states how the motors turn" in result.stop
    assert "outputs 1 and 2 seem to act backward" in result.stop
    commands["direction"] = [-1, -1, 1, 1, -1, 1, 1, -1]
    path.write_text(json.dumps(document))
    result = new_campaign("pier", [DIVE], vehicle=str(path))
    assert result.stop == ""
    assert read_yaml((result.folder / "campaign.yaml").read_text())["kind"] == "axes"
    check([str(result.folder)])
    assert "in full commands, not newtons" in " ".join(capsys.readouterr().out.split())


def test_a_frame_that_no_bundled_vehicle_has_is_driven_in_full_commands() -> None:
    """Unless a vehicle is named, whose file may give newtons."""
    (dive,) = survey([DIVE], {})
    assert dive.page.outputs is not None
    parameters = {"FRAME_CONFIG": 3.0} | {f"MOT_{n}_DIRECTION": 1.0 for n in range(1, 9)}
    info = dive.page.outputs.log_info.model_copy(update={"parameters": parameters})
    page = replace(dive.page, outputs=replace(dive.page.outputs, log_info=info))
    feeds = [feed_of(page, named=named) for named in (False, True)]
    kinds = [feed.kind if isinstance(feed, CampaignFeed) else "none" for feed in feeds]
    assert kinds[0] != "identification"
    assert kinds[1] == "identification"
    choice = choose_vehicle(checked(page), named=None, normalised=True)
    assert "no bundled vehicle has frame vectored_6dof_90deg (FRAME_CONFIG 3)" in choice.why
    assert not choice.lacking
    geometry = dive.page.outputs.log_info.model_copy(update={"parameters": {"CA_ROTOR_COUNT": 8.0}})
    log = checked(replace(page, outputs=replace(dive.page.outputs, log_info=geometry)))
    assert "the geometry of the log (CA_ROTOR_COUNT 8)" in (
        choose_vehicle(log, named=None, normalised=True).why
    )
    assert likely_vehicle(log).thrusters is None


def test_a_custom_frame_has_a_row_to_fill_in_for_each_output_that_moves() -> None:
    (dive,) = survey([DIVE], {})
    assert dive.page.outputs is not None
    info = dive.page.outputs.log_info.model_copy(update={"parameters": {"FRAME_CONFIG": 7.0}})
    page = replace(dive.page, outputs=replace(dive.page.outputs, log_info=info))
    choice = choose_vehicle(checked(page), named=None, normalised=False)
    for number in range(1, 9):
        assert f"        - fill in one [x, y, z] of length 1 for output {number}\n" in choice.text
    stop = _stop(Path("made"), choice)
    assert "(FRAME_CONFIG 7 (custom) of the log has no bundled vehicle)" in stop
    assert "actuators: {commands: {frame: NAME}}; NAME: bluerov1, vectored, " in stop


@pytest.mark.parametrize(
    ("text", "place"),
    [("rigid_body: {mass: 26}", "field 'rigid_body.mass'"), (None, "vehicle is not there")],
)
def test_a_mistake_in_the_named_vehicle_is_told_with_its_place(
    tmp_path: Path, text: str | None, place: str
) -> None:
    path = tmp_path / "mine.yaml"
    if text is not None:
        path.write_text(text)
    with pytest.raises(PipelineError) as fault:
        new_campaign("mine", [DIVE], vehicle=str(path))
    assert place in str(fault.value)
    assert not Path("mine").exists()


def test_a_terminal_is_asked_for_a_vehicle_that_the_log_does_not_name() -> None:
    reasons: list[str] = []

    def answer(choice: VehicleChoice) -> str:
        reasons.append(choice.why)
        return "bluerov2"

    result = new_campaign("asked", [DIVE], ask=answer)
    assert "guessed" in reasons[0]
    assert "\nname: bluerov2\n" in "\n" + (result.folder / "vehicle.yaml").read_text()
    kept = new_campaign("kept", [DIVE], ask=lambda choice: "")
    assert "\nname: bluerov2_heavy\n" in "\n" + (kept.folder / "vehicle.yaml").read_text()
    new_campaign("named", [DIVE], vehicle="bluerov2_heavy", ask=answer)
    assert len(reasons) == 1


def test_one_dive_of_two_recorders_is_taken_once(tmp_path: Path) -> None:
    copy = tmp_path / "copy.tlog"
    copy.write_bytes(TLOG.read_bytes())
    result = new_campaign("twice", [TLOG, copy])
    assert any("copy.tlog: the same dive as dive.tlog: yaw" in line for line in result.lines)
    assert len(read_yaml((result.folder / "campaign.yaml").read_text())["logs"]) == 1


def test_a_forward_left_up_body_under_a_compass_is_one_frame_not_many_signs(
    tmp_path: Path,
) -> None:
    t_s = np.arange(0.0, 60.0, 0.1)
    noise = np.random.default_rng(1)
    waves = [(0.1, 6.0), (0.15, 9.0), (0.8, 14.0), (0.5, 11.0), (0.3, 8.0), (0.3, 10.0)]
    phi, theta, psi, u, v, w = (size * np.sin(2.0 * np.pi * t_s / s) for size, s in waves)
    d_phi, d_theta, d_psi = (np.gradient(angle, t_s) for angle in (phi, theta, psi))
    down = np.array([-np.sin(theta), np.sin(phi) * np.cos(theta), np.cos(phi) * np.cos(theta)])
    rates = np.array([d_phi, d_theta * np.cos(phi), -d_theta * np.sin(phi)]) + d_psi * down
    accelerations = np.gradient(np.array([u, v, w]), t_s, axis=1) - 9.81 * down
    depth = 5.0 + np.cumsum(np.sum(down * [u, v, w], axis=0)) * 0.1
    upward = np.array([[1.0], [-1.0], [-1.0]])
    angles = [np.degrees(each) for each in (phi, -theta, psi)]
    table = np.vstack([angles, upward * rates, upward * accelerations, upward * [u, v, w], [depth]])
    table = np.vstack([t_s, table + noise.normal(0.0, 0.003, table.shape)])
    head = "time_s,roll_deg,pitch_deg,heading_deg,gyro_x,gyro_y,gyro_z,acc_x,acc_y,acc_z,vx,vy,vz,"
    path = tmp_path / "dive.csv"
    np.savetxt(path, table.T, "%.5f", ",", header=f"{head}depth_m", comments="")
    (log,) = survey([path])
    assert log.files[0].draft is not None
    frames = {item.field: (item.frame, item.sign) for item in log.files[0].draft.columns}
    turned = {field for field, frame in frames.items() if frame != ("", 1)}
    assert turned == set(frames) - {"psi_rad", "depth_m"}
    assert {frames[field] for field in turned} == {("flu", 1)}


def test_files_of_two_time_zones_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    t, random = np.arange(0.0, 60.0, 0.2), np.random.default_rng(3)
    heads = ("UTC [s],Roll [deg],Pitch [deg],Heading [deg],Depth [m]", "UTC [s],Prop [rpm]")
    paths = []
    for name, head, zone_s in (("nav", heads[0], 0.0), ("outputs", heads[1], 3600.0)):
        values = random.standard_normal((t.size, head.count(",")))
        table = np.column_stack([1.78e9 + zone_s + t, values])
        paths.append(tmp_path / f"{name}.csv")
        np.savetxt(paths[-1], table, "%.3f", ",", header=head, comments="")
    (words,) = apart_words(survey(paths))
    assert words.startswith("outputs.csv begins 3600 s after nav.csv")
    assert "1 h: another time zone?" in words
    monkeypatch.chdir(tmp_path)
    with pytest.raises(NoCampaignError, match="another time zone"):
        new_campaign("zones", paths)


@pytest.mark.parametrize("commands_first", [False, True])
def test_motion_capture_and_commands_of_two_clocks_are_one_dive(
    tmp_path: Path, commands_first: bool
) -> None:
    step_s, random = 0.1, np.random.default_rng(4)
    t = np.arange(0.0, 80.0, step_s)
    commands = np.repeat(random.uniform(-1.0, 1.0, (t.size // 40, 4)), 40, axis=0)
    rates = np.zeros((t.size, 4))
    for row in range(1, t.size):  # a lag of half a second; surge, sway, heave, yaw
        rates[row] = rates[row - 1] + 0.2 * (commands[row - 1] * 0.5 - rates[row - 1])
    yaw = np.cumsum(rates[:, 3]) * step_s
    c, s = np.cos(yaw), np.sin(yaw)
    north, east, down = (
        np.cumsum(rate) * step_s
        for rate in (
            c * rates[:, 0] - s * rates[:, 1],
            s * rates[:, 0] + c * rates[:, 1],
            rates.T[2],
        )
    )
    level = np.zeros(t.size)
    half = (np.pi / 2.0 - yaw) / 2.0  # counted from east, to the left
    poses = np.column_stack(
        [1.72e9 + t, east, north, -2.0 - down, level, level, np.sin(half), np.cos(half)]
    )
    poses[:, 1:4] += random.normal(0.0, 0.001, (t.size, 3))
    paths = [tmp_path / "poses.csv", tmp_path / "commands.csv"]
    table = poses[75:]  # the tracker starts 7.5 s late
    np.savetxt(paths[0], table, "%.5f", ",", header="stamp,x,y,z,qx,qy,qz,qw", comments="")
    table = np.column_stack([t + 3.4, commands])
    head = "t,cmd_surge,cmd_sway,cmd_heave,cmd_yaw"
    np.savetxt(paths[1], table, "%.4f", ",", header=head, comments="")
    (log,) = survey(paths[::-1] if commands_first else paths)
    (ours,) = [f.draft for f in log.files if f.draft and f.draft.streams == ("actuators",)]
    (other,) = [f.draft for f in log.files if f.draft and "pose" in f.draft.streams]
    assert ours.document()["time"]["shift_s"] == pytest.approx(1.72e9 - 3.4, abs=0.15)
    assert ours.time["epoch"] == other.time["epoch"] == "unix"
    assert "moved to where the motion answers" in ours.text()
    assert {item.frame for item in other.columns} == {"flu"}


def test_files_of_two_clocks_that_both_move_stay_two_logs(tmp_path: Path) -> None:
    t, random = np.arange(0.0, 60.0, 0.2), np.random.default_rng(3)
    heads = ("time,roll_deg,pitch_deg,heading_deg,depth_m", "time,cmd_heave,gyro_x,gyro_y,gyro_z")
    paths = []
    for name, head, start_s in zip(("a", "b"), heads, (1.78e9, 5.0), strict=True):
        table = np.column_stack([start_s + t, random.standard_normal((t.size, head.count(",")))])
        paths.append(tmp_path / f"{name}.csv")
        np.savetxt(paths[-1], table, "%.3f", ",", header=head, comments="")
    assert [len(log.files) for log in survey(paths)] == [1, 1]


def test_a_command_in_newtons_is_named_with_what_to_do(tmp_path: Path) -> None:
    t_s = np.arange(0.0, 40.0, 0.1)
    columns = {"t_s": t_s, "depth_m": 4.0 + np.sin(t_s), "Fz [N]": 50.0 * np.sin(0.7 * t_s)}
    write_csv(tmp_path / "dive.csv", columns)
    with pytest.raises(LogError, match=r"command in newtons.*Divide it by") as refusal:
        new_campaign("drive", [tmp_path / "dive.csv"], commands="heave=Fz [N]")
    assert "Fz [N]" in str(refusal.value)
    assert "full_force" in str(refusal.value)


def test_logs_of_one_stem_have_their_own_column_maps(tmp_path: Path) -> None:
    text = (ROOT / "campaigns/blueye_heave/logs/dive.csv").read_text()
    logs = [tmp_path / "dive.csv", tmp_path / "dive.txt"]
    logs[0].write_text(text)
    head, *rows = [line.partition(",") for line in text.splitlines()]
    # Another dive, of a computer whose clock begins anew: it goes the other way.
    backward = [(a[0], ",", b[2]) for a, b in zip(rows, rows[::-1], strict=True)]
    lines = ["".join(parts) for parts in (head, *backward)]
    logs[1].write_text("\n".join(lines).replace(",", ";") + "\n")
    result = new_campaign("two", logs)
    assert not any("the same dive" in line for line in result.lines)
    first, second = (result.folder / "columns" / name for name in ("dive.yaml", "dive_2.yaml"))
    assert "delimiter" not in read_yaml(first.read_text())
    assert read_yaml(second.read_text())["delimiter"] == ";"
    first.write_text(second.read_text())
    assert "dive.csv" in _stop(result.folder, VehicleChoice("", "", ""))


def tank_files(folder: Path, *, left_out: tuple[str, ...] = ()) -> list[Path]:
    """Write three runs in a tank and return their files."""
    return [
        write_csv(
            folder / f"run_{seed}.csv",
            {
                name: values
                for name, values in noisy(tank_run(seed), seed).items()
                if name not in left_out
            },
        )
        for seed in (1, 2, 3)
    ]


def test_runs_with_the_same_columns_are_logs_with_one_map(tmp_path: Path) -> None:
    written = new_campaign("tank", tank_files(tmp_path))
    document = read_yaml((written.folder / "campaign.yaml").read_text())
    assert [entry["file"] for entry in document["logs"]] == [
        "logs/run_1.csv",
        "logs/run_2.csv",
        "logs/run_3.csv",
    ]
    (columns,) = {entry["columns"] for entry in document["logs"]}
    text = (written.folder / columns).read_text()
    assert "column: cmd2, stream: actuators, field: command_surge" in text
    (line,) = [line for line in written.lines if line.startswith("commands")]
    assert "surge=cmd2" in line
    assert "yaw=cmd0" in line
    assert "--commands" in line
    assert not written.stop


@pytest.mark.parametrize("named", [True, False])
def test_runs_in_other_units_and_frames_have_maps_of_their_own(tmp_path: Path, named: bool) -> None:
    """One in percent and one east-north-up beside one as it should be, under one header."""
    axes = dict(
        zip(("cmd0", "cmd1", "cmd2", "cmd3"), ("yaw", "heave", "surge", "sway"), strict=True)
    )
    files = []
    for seed in (1, 2, 3):
        run = noisy(tank_run(seed), seed)
        run = {key: values for key, values in run.items() if not key.endswith(("mps", "radps"))}
        if seed == 2:
            run |= {key: 100.0 * run[key] for key in axes}
        if seed == 3:  # x east, y north, z up; roll, pitch, yaw of a body forward-left-up
            run["x_m"], run["y_m"] = run["y_m"], run["x_m"]
            run["yaw_rad"] = 0.5 * np.pi - run["yaw_rad"]
            run |= {key: -run[key] for key in ("z_m", "pitch_rad")}
        run = {f"cmd_{axes[key]}" if named and key in axes else key: values
               for key, values in run.items()}  # fmt: skip
        files.append(write_csv(tmp_path / f"run_{seed}.csv", run))
    drafts = [log.files[0].draft for log in survey(files)]
    conventions = []
    for draft in drafts:
        assert draft is not None
        (unit,) = {item.unit for item in draft.columns if item.stream == "actuators"}
        (frame,) = {item.frame for item in draft.columns if item.stream == "pose"}
        signs = {item.sign for item in draft.columns if item.stream == "actuators"}
        conventions.append((unit, frame, signs))
    assert conventions[:2] == [("1", "", {1}), ("percent", "", {1})]
    assert conventions[2][0] == "1"
    assert conventions[2][1:] == ("flu", {1}) or not named


def test_positions_in_mm_are_those_of_their_column_and_run(tmp_path: Path) -> None:
    """One unit for all of them made runs in m stand still to a thousandth, without a word."""
    files = []
    for seed, in_mm in ((1, ""), (2, "x"), (3, "xyz")):
        run = noisy(tank_run(seed), seed)
        run = {key.removesuffix("_m"): values for key, values in run.items()
               if not key.endswith(("mps", "radps"))}  # fmt: skip
        run |= {key: 1000.0 * run[key] for key in in_mm}
        files.append(write_csv(tmp_path / f"run_{seed}.csv", run))
    units = []
    for log in survey(files):
        draft = log.files[0].draft
        assert draft is not None
        by_field = {item.field: item.unit for item in draft.columns}
        units.append(tuple(by_field[name] for name in ("x_m", "y_m", "z_m")))
    assert units == [("m", "m", "m"), ("mm", "m", "m"), ("mm", "mm", "mm")]


def test_commands_that_the_user_names_are_taken_as_named(tmp_path: Path) -> None:
    files = tank_files(tmp_path)
    written = new_campaign("tank", files, commands="surge=cmd2,sway=cmd3,heave=-cmd1")
    document = read_yaml((written.folder / "columns" / "run_1.yaml").read_text())
    commands = {
        item["field"]: (item["column"], item.get("sign", 1))
        for item in document["columns"]
        if item["stream"] == "actuators"
    }
    assert commands == {
        "command_surge": ("cmd2", 1),
        "command_sway": ("cmd3", 1),
        "command_heave": ("cmd1", -1),
    }
    assert not any(line.startswith("commands") for line in written.lines)
    assert "columns not used: cmd0 (run_1.csv)" in written.lines


def test_a_long_list_of_columns_without_a_meaning_says_how_many_follow() -> None:
    draft = ColumnDraft("dive.csv", {}, "", (), unused=tuple("abcdefgh"))
    assert unused_words(draft) == "a, b, c, d, e, f and 2 more"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("surge=cmd9", "no file has such a column.*cmd9.*cmd2"),
        ("forward=cmd2", "no command of an axis.*forward=cmd2.*surge"),
        ("surge=cmd2,sway=cmd2", "each column once"),
    ],
)
def test_commands_that_are_none_are_refused(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        new_campaign("tank", tank_files(tmp_path), commands=text)


@pytest.mark.parametrize("upward", [False, True])
def test_poses_and_commands_alone_give_a_campaign(tmp_path: Path, upward: bool) -> None:
    motion = ("u_mps", "v_mps", "w_mps", "r_radps")
    files = []
    for seed in (1, 2, 3):
        run = noisy(tank_run(seed), seed)
        if upward:
            run |= {name: -run[name] for name in ("y_m", "z_m", "pitch_rad", "yaw_rad")}
        files.append(
            write_csv(
                tmp_path / f"run_{seed}.csv",
                {name: values for name, values in run.items() if name not in motion},
            )
        )
    written = new_campaign("poses", files)
    document = read_yaml((written.folder / "columns" / "run_1.yaml").read_text())
    poses = [item for item in document["columns"] if item["stream"] == "pose"]
    assert {item["field"] for item in poses} == {
        "x_m",
        "y_m",
        "z_m",
        "phi_rad",
        "theta_rad",
        "psi_rad",
    }
    assert {item.get("frame") for item in poses} == ({"flu"} if upward else {None})
    commands = {
        item["column"]: (item["field"], item.get("sign", 1))
        for item in document["columns"]
        if item["stream"] == "actuators"
    }
    assert commands == {
        "cmd0": ("command_yaw", 1),
        "cmd1": ("command_heave", 1),
        "cmd2": ("command_surge", 1),
        "cmd3": ("command_sway", 1),
    }
    assert not written.stop


def test_outputs_of_another_frame_than_the_guessed_one_are_named(tmp_path: Path) -> None:
    runs = []
    for seed in (1, 2, 3):
        run = noisy(tank_run(seed, duration_s=90.0), seed)
        yaw, heave, surge, sway = (run.pop(f"cmd{number}") for number in range(4))
        mixed = (surge - yaw, heave, sway + yaw, surge + yaw, sway - yaw, heave)
        run = {name: run[name] for name in list(run)[:7]}
        run |= {f"motor_{n}": (0.5 * item).clip(-1.0, 1.0) for n, item in enumerate(mixed, 1)}
        runs.append(write_csv(tmp_path / f"run_{seed}.csv", run))
    result = new_campaign("tank", runs)
    assert result.vehicle.guessed
    assert "_m_s in the column map" not in result.stop
    assert "vehicle file" in result.stop
    assert "a guess by the number of outputs" in result.stop
