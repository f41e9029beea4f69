"""Stage glide on the bundled record, and on records that no glider gives."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from auvid.data_schemas.documents.vehicle.vehicle import VehicleDocument
from auvid.data_schemas.errors import CampaignError, DataError
from auvid.data_schemas.tables import column, make_table
from auvid.data_schemas.yaml_text import read_yaml
from auvid.hydro.dynamics.vehicle.from_document import vehicle_from_document
from auvid.stages import glide, ingest
from auvid.stages.base import RawFile, RawLog, collection
from auvid.stages.report.glide_pictures import glide_pictures

ROOT = Path(__file__).resolve().parents[4]
FOLDER = ROOT / "campaigns" / "slocum_glide"
Columns = dict[str, Any]


def document() -> dict[str, Any]:
    loaded: dict[str, Any] = read_yaml((ROOT / "vehicles/slocum.yaml").read_text("utf-8"))
    return loaded


@pytest.fixture(scope="module")
def ingested() -> ingest.Outputs:
    columns = read_yaml((FOLDER / "columns/dive.yaml").read_text("utf-8"))
    data = np.frombuffer((FOLDER / "logs/dive.csv").read_bytes(), np.uint8)
    log = RawLog("dive", (RawFile("dive.csv", data, columns),))
    return ingest.run(ingest.Inputs(log), ingest.Params())


def run(
    ingested: ingest.Outputs,
    change: Callable[[Columns], None] | None = None,
    *,
    vehicle: dict[str, Any] | None = None,
    **params: Any,
) -> glide.Outputs:
    """Run the stage on the bundled record, its columns changed."""
    assert ingested.glider is not None
    columns = {
        name: np.array(column(ingested.glider, name)) for name in ingested.glider.column_names
    }
    columns["time_us"] = columns["time_us"].astype(np.int64)
    if change is not None:
        change(columns)
    inputs = glide.Inputs(
        {"legs": [{"id": "dive", "log": "dive"}]},
        vehicle_from_document(VehicleDocument.model_validate(vehicle or document())),
        collection({"dive": ingested.log_info}),
        collection({"dive": make_table("glider", columns)}),
    )
    return glide.run(inputs, glide.Params(**params))


def figures(outputs: glide.Outputs) -> dict[str, dict[str, Any]]:
    return {row["quantity"]: row for row in outputs.results["rows"]}


def times(**factors: float) -> Callable[[Columns], None]:
    """Return a change that multiplies columns."""

    def change(columns: Columns) -> None:
        for name, factor in factors.items():
            columns[name] = columns[name] * factor

    return change


def without(*names: str) -> Callable[[Columns], None]:
    def change(columns: Columns) -> None:
        for name in names:
            del columns[name]

    return change


def test_a_density_that_is_one_constant_is_no_measurement(ingested: ingest.Outputs) -> None:
    def constant(columns: Columns) -> None:
        columns["density_kg_m3"] = np.full(columns["density_kg_m3"].size, 1006.0)

    outputs = run(ingested, constant)
    assert "the same at every depth: it was not measured" in str(outputs.section)
    assert figures(outputs)["C_D"]["verdict"] == "weak"
    assert "the same at every depth" not in str(run(ingested).section)


def test_the_slocum_record(ingested: ingest.Outputs) -> None:
    """C_D .21 +- .02 and 3 degrees are what others find from this record."""
    outputs = run(ingested)
    rows = figures(outputs)
    assert rows["C_D"]["value"] == pytest.approx(0.21, abs=0.02)
    assert rows["angle of attack"]["value"] == pytest.approx(3.0, abs=0.3)
    assert rows["C_L_alpha"]["verdict"] == "identified"
    assert rows["C_L_alpha (without speed)"]["verdict"] == "from the prior"
    assert rows["C_L (without speed)"]["verdict"] == "from the prior"
    # Every glide has the same pitch: drag without lift rests on the assumed C_D1.
    assert rows["C_D0"]["verdict"] == "from the prior"
    assert "goes with C_D1 of the vehicle file" in rows["C_D0"]["note"]
    assert rows["C_D"]["verdict"] == "identified"
    assert rows["depth rate of other glides predicted"]["value"] > 95.0
    assert isinstance(outputs.glides, pa.Table)


def test_the_first_screen_has_pictures_of_yos_and_fit(ingested: ingest.Outputs) -> None:
    outputs, glider = run(ingested), ingested.glider
    assert glider is not None
    pictures = glide_pictures(
        outputs.glides, {"ingest/dive/glider": glider}, {"dive": ingested.log_info}
    )
    first, second = map(str, pictures)
    for words in ("Settled glides of leg", "depth", "pitch", "depth rate", "speed through"):
        assert words in first
    assert "Fitted (up) against measured (across)" in second
    without_speed = run(ingested, without("speed_m_s"))
    assert "speed" not in str(glide_pictures(without_speed.glides, {}, {})[0])


def test_without_speed_lift_is_named_as_not_observable(ingested: ingest.Outputs) -> None:
    outputs = run(ingested, without("speed_m_s"))
    rows = figures(outputs)
    for name in ("C_L_alpha", "C_D1"):
        assert rows[name]["verdict"] == "from the prior"
        assert "not observable without speed" in rows[name]["note"]
    words = " ".join(block.get("text", "") for block in outputs.section["blocks"])
    assert "lift is not observable" in words
    assert "C_L_alpha (without speed)" not in rows


def test_dives_without_climbs_do_not_tell_drag_from_trim(ingested: ingest.Outputs) -> None:
    def dives(columns: Columns) -> None:
        up = columns["pitch_rad"] > 0.0
        columns["pitch_rad"] = np.where(up, np.nan, columns["pitch_rad"])

    outputs = run(ingested, dives)
    assert figures(outputs)["C_D0"]["verdict"] == "inseparable"
    words = " ".join(block.get("text", "") for block in outputs.section["blocks"])
    assert "Only dives" in words


def test_a_pitch_zero_of_some_degrees_one_way_takes_the_lift_from_the_file(
    ingested: ingest.Outputs,
) -> None:
    """With dives alone, and speed, a zero of the pitch looks like a speed over ground."""

    def change(columns: Columns) -> None:
        up = columns["pitch_rad"] > 0.0
        columns["pitch_rad"] = np.where(up, np.nan, columns["pitch_rad"] - np.radians(6.0))

    outputs = run(ingested, change)
    assert figures(outputs)["C_L_alpha"]["verdict"] == "from the prior"
    assert figures(outputs)["angle of attack"]["verdict"] == "from the prior"
    words = " ".join(block.get("text", "") for block in outputs.section["blocks"])
    assert re.search(r"the path of dives is 3.* flatter than", words)
    assert "speed on climbs as well would tell which" in words


def stuck(columns: Columns) -> None:
    """The drive stays where it is from 4300 s on."""
    t = (columns["time_us"] - columns["time_us"][0]) / 1e6
    columns["buoyancy_drive_m3"] = np.where(t > 4300.0, 2.3e-4, columns["buoyancy_drive_m3"])


def test_glides_against_a_drive_at_its_stop_are_left_out_and_named(
    ingested: ingest.Outputs,
) -> None:
    outputs = run(ingested, stuck)
    words = " ".join(block.get("text", "") for block in outputs.section["blocks"])
    assert "the drive stands on the side of the other direction" in words
    assert "43" in words  # the first of them starts at 4300 s and some
    assert "identified" not in {row["verdict"] for row in outputs.results["rows"]}


def test_ballast_that_is_thrown_under_way_is_named(ingested: ingest.Outputs) -> None:
    """30 cm^3 less in the column than in the hull, from 4300 s on."""

    def thrown(columns: Columns) -> None:
        t = (columns["time_us"] - columns["time_us"][0]) / 1e6
        columns["buoyancy_drive_m3"] = columns["buoyancy_drive_m3"] - np.where(t > 4300, 3e-5, 0.0)

    def words(outputs: glide.Outputs) -> str:
        return " ".join(block.get("text", "") for block in outputs.section["blocks"])

    sound, lighter = run(ingested), run(ingested, thrown)
    assert "ballast" not in words(sound)
    assert figures(sound)["C_D"]["verdict"] == "identified"
    assert "identified" not in {row["verdict"] for row in lighter.results["rows"]}
    named = re.search(
        r"From the glide at 4\d{3} s .* is ([.\d]+) ± [.\d]+ g lighter", words(lighter)
    )
    assert named is not None
    assert float(named[1]) == pytest.approx(30.0, abs=5.0)


@pytest.mark.parametrize("off_deg", [6.0, -6.0])
def test_a_pitch_zero_that_is_off_is_named(ingested: ingest.Outputs, off_deg: float) -> None:
    def words(outputs: glide.Outputs) -> str:
        return " ".join(block.get("text", "") for block in outputs.section["blocks"])

    def turned(columns: Columns) -> None:
        columns["pitch_rad"] = columns["pitch_rad"] + np.radians(off_deg)
        del columns["speed_m_s"]

    sound, off = run(ingested, without("speed_m_s")), run(ingested, turned)
    assert "zero of the pitch sensor off" not in words(sound)
    assert f"deg {'less' if off_deg > 0.0 else 'more'} than logged" in words(off)
    assert figures(sound)["C_D"]["verdict"] == "identified"
    assert figures(off)["C_D"]["verdict"] == "weak"


def interleaved(columns: Columns) -> None:
    """Rows of a second glider, elsewhere in its yo, between those of the first."""
    odd = np.arange(columns["time_us"].size) % 2 == 1
    for name in columns:
        if name != "time_us":
            late = np.roll(columns[name], odd.size // 3)
            columns[name] = np.where(odd, late, columns[name])


def constant(columns: Columns) -> None:
    columns["buoyancy_drive_m3"] = np.full_like(columns["buoyancy_drive_m3"], -2.3e-4)


def restless(columns: Columns) -> None:
    t = (columns["time_us"] - columns["time_us"][0]) / 1e6
    columns["pitch_rad"] = columns["pitch_rad"] + 0.2 * np.sin(t / 5.0)


def clipped(columns: Columns) -> None:
    """The drive stops at a tenth of its stroke, about the middle."""
    drive = columns["buoyancy_drive_m3"]
    low, high = float(np.nanmin(drive)), float(np.nanmax(drive))
    ends = low + np.array([0.45, 0.55]) * (high - low)
    columns["buoyancy_drive_m3"] = np.clip(drive, *ends)


def one_speed(columns: Columns) -> None:
    measured = np.isfinite(columns["speed_m_s"])
    columns["speed_m_s"] = np.where(measured, 0.35, np.nan)


def seldom(columns: Columns) -> None:
    for name, values in columns.items():
        columns[name] = values[::90]


def one_yo(columns: Columns) -> None:
    """A log that ends after its first dive and climb."""
    late = columns["time_us"] - columns["time_us"][0] > 1.2e9
    columns["pitch_rad"] = np.where(late, np.nan, columns["pitch_rad"])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (one_yo, "2 settled glides of at least 4: leg 'dive': .*at the surface.*Fly longer"),
        (clipped, "no drag makes a glide.*at its stop"),
        (interleaved, "goes to and fro from sample to sample; .*two vehicles, or of two sensors"),
        (restless, "no glide settles: leg 'dive'.*pitch moving"),
        (constant, "the buoyancy drive never moves in leg 'dive'.*-230"),
        (times(buoyancy_drive_m3=-1.0), "dives where its drive makes it light.*sign: -1"),
        (times(buoyancy_drive_m3=1e6), "moves more than a hull can.*cm\\^3"),
        (times(buoyancy_drive_m3=1e-6), "the buoyancy drive never moves"),
        (times(pitch_rad=-1.0, buoyancy_drive_m3=-1.0), "turn the sign of the pitch"),
        (times(pressure_pa=-1.0), "turn the sign of the pressure"),
        (times(pressure_pa=1.45), "steeper than any.*in psi where the map says dbar"),
        (seldom, "a sample every 9. s.*raise stages.glide.max_gap_s"),
        (times(pitch_rad=np.pi / 180.0), "steepest pitch is .*is the column in rad"),
        (times(pressure_pa=0.1), "deepest point is .*bar where the map says dbar"),
        (times(speed_m_s=1.944), "flatter than the pitch; found .*over ground.*knots"),
        (times(speed_m_s=1e-12), "depth changes faster"),
        (one_speed, "speed through the water never changes; found '0.35 m/s"),
        (times(pressure_pa=10.0), "depth changes faster than the speed.*dbar where the map says"),
        (without("density_kg_m3"), "has no density of the water.*constant_density"),
        (without("buoyancy_drive_m3"), "lacks buoyancy_drive_m3"),
        (without("pitch_rad"), "has no pitch"),
    ],
)
def test_what_no_glider_records_is_refused(
    ingested: ingest.Outputs, change: Callable[[Columns], None], words: str
) -> None:
    with pytest.raises(DataError, match=f"(?s){words}"):
        run(ingested, change)


def test_a_log_of_another_period_than_a_second_is_taken(ingested: ingest.Outputs) -> None:
    def every(step: int) -> Callable[[Columns], None]:
        def change(columns: Columns) -> None:
            for name, values in columns.items():
                columns[name] = values[::step]

        return change

    assert figures(run(ingested, every(12)))["C_D"]["value"] == pytest.approx(0.2, abs=0.015)


def test_a_speed_that_is_horizontal_makes_an_odd_lift(ingested: ingest.Outputs) -> None:
    def horizontal(columns: Columns) -> None:
        columns["speed_m_s"] = columns["speed_m_s"] * np.cos(columns["pitch_rad"] * 1.15)

    outputs = run(ingested, horizontal)
    words = " ".join(block.get("text", "") for block in outputs.section["blocks"])
    assert "A horizontal speed looks like less lift" in words
    assert figures(outputs)["C_D"]["verdict"] == "weak"


def test_pressure_in_another_unit_shows_in_the_drag(ingested: ingest.Outputs) -> None:
    def change(columns: Columns) -> None:
        times(pressure_pa=10.0)(columns)
        del columns["speed_m_s"]

    with pytest.raises(DataError, match=r"(?s)faster than any body.*C_D.*dbar where the map says"):
        run(ingested, change)


def test_drive_at_stops_of_the_vehicle_file_is_left_out(ingested: ingest.Outputs) -> None:
    vehicle = document()
    stops = {"value": [-230.0, 230.0], "unit": "cm^3", "source": "test"}
    vehicle["glider"] = {**vehicle["glider"], "drive_stops": stops}
    with pytest.raises(DataError, match="drive at its stop"):
        run(ingested, vehicle=vehicle)


def test_a_vehicle_without_part_glider_is_refused(ingested: ingest.Outputs) -> None:
    vehicle = {key: value for key, value in document().items() if key != "glider"}
    with pytest.raises(CampaignError, match="no part 'glider'"):
        run(ingested, vehicle=vehicle)


@pytest.mark.parametrize(("name", "words"), [("density_kg_m3", "density"), ("pitch_rad", "pitch")])
def test_an_empty_column_is_a_missing_one(ingested: ingest.Outputs, name: str, words: str) -> None:
    def empty(columns: Columns) -> None:
        columns[name] = np.full(columns[name].size, np.nan)

    with pytest.raises(DataError, match=f"has no {words}"):
        run(ingested, empty)
