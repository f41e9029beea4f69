"""`auvid simulate`: a plan as logs, truth, and a campaign that is ready to run."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pyarrow.csv as pc
import yaml

from auvid.data_schemas.documents.plans.plan import PlanDocument
from auvid.data_schemas.documents.twin import TwinDocument
from auvid.data_schemas.errors import CampaignError, PipelineError, UsageError, nearest
from auvid.pipeline.campaigns.twin import PHYSICS, entries_of, load_twin
from auvid.pipeline.campaigns.vehicle_files import load_vehicle
from auvid.pipeline.campaigns.workspace import vehicle_file_of
from auvid.pipeline.store.artefacts import encode
from auvid.pipeline.store.atomic_files import write_atomically
from auvid.stages import simulate
from auvid.stages.simulate.csv_writer import column_maps


def write_campaign(
    vehicle: str,
    plan: Path,
    folder: Path,
    *,
    truth: str = PHYSICS,
    format: str = "bin",
    seed: int = 0,
    accelerometer: str = "specific_force",
) -> list[str]:
    """Simulate a plan into a new or empty folder, and return what was cut short.

    Written are `logs/`, `truth/` (Parquet and CSV), `columns/` for CSV logs and
    `campaign.yaml`.

    Returns sentences about legs that the flight did not finish. Raises `PipelineError`
    for whatever is wrong with what the user gave.
    """
    if folder.is_file() or (folder.is_dir() and any(folder.iterdir())):
        raise PipelineError(
            "there is something already, and nothing is overwritten",
            file=folder,
            remedy="Choose a new folder.",
        )
    if seed < 0:
        raise UsageError("not a seed", field="--seed", value=seed, allowed="0 or more")
    for option, value, allowed in (
        ("--format", format, FORMATS),
        ("--accelerometer", accelerometer, ACCELEROMETERS),
    ):
        if value not in allowed:
            raise UsageError(
                "unknown value",
                field=option,
                value=value,
                allowed=allowed,
                remedy=nearest(value, allowed),
            )
    vehicle_file = vehicle_file_of(vehicle)
    checked = load_vehicle(vehicle_file).vehicle
    entry = {"truth": truth, "seed": seed, "format": format, "accelerometer": accelerometer}
    try:
        twin = load_twin(
            entry, checked, plan=plan, vehicle_file=vehicle_file, folder=Path.cwd(), file=plan
        )
    except CampaignError as fault:
        raise UsageError.of(fault) if fault.field == "simulate.truth" else fault from None
    if isinstance(twin.plan, PlanDocument) and twin.plan.bench is not None:
        remedy = (
            "Make a campaign of kind bench_twin that names the plan under simulate, and run it."
        )
        raise CampaignError(
            "a bench plan needs the apparatus of a campaign",
            file=plan,
            field="bench",
            remedy=remedy,
        )
    results = simulate.run(simulate.Inputs(checked, twin), simulate.Params())
    for name, content in results.logs.items():
        write_atomically(folder / "logs" / name, content)
    if format == "csv":
        maps = column_maps(accelerometer=accelerometer)
        logs, _ = entries_of(twin.plan, format=format)
        for name in {item["columns"] for log in logs for item in log["files"]}:
            write_atomically(folder / name, _yaml(maps[Path(name).stem]))
    for leg, table in results.truth.items():
        write_atomically(folder / "truth" / f"{leg}.parquet", encode(table, "truth", file=leg))
        sink = io.BytesIO()
        pc.write_csv(table, sink)
        write_atomically(folder / "truth" / f"{leg}.csv", sink.getvalue())
    write_atomically(
        folder / "truth" / "simulation.json",
        encode(results.simulation, "simulation", file="simulation"),
    )
    write_atomically(folder / "vehicle.yaml", vehicle_file.read_bytes())
    write_atomically(folder / "campaign.yaml", _yaml(_manifest(results.simulation, twin)))
    return [
        f"leg '{leg['id']}': {leg['stopped']}"
        for leg in results.simulation["legs"]
        if leg["stopped"]
    ]


FORMATS = ("bin", "tlog", "csv")
ACCELEROMETERS = ("specific_force", "inertial")


def _manifest(simulation: Mapping[str, Any], twin: TwinDocument) -> dict[str, Any]:
    """Return a manifest over the legs that were reached, each cut where it stopped."""
    ends = {leg["id"]: leg["end_s"] for leg in simulation["legs"] if leg["end_s"] is not None}
    logs, legs = entries_of(twin.plan, format=twin.format)
    for log in logs:
        for item in log.get("files", [log]):
            item["file"] = f"logs/{item['file']}"
    notes = (
        f"Simulated: truth {simulation['truth']}, seed {simulation['seed']}. The true motion and"
        " forces lie in truth/."
    )
    return {
        "kind": "identification",
        "title": str(simulation["plan"]),
        "notes": notes,
        "vehicle": "./vehicle.yaml",
        "logs": [log for log in logs if log["id"] in ends],
        "legs": [{**leg, "end_s": float(ends[leg["id"]])} for leg in legs if leg["id"] in ends],
    }


def _yaml(document: Mapping[str, Any]) -> bytes:
    return yaml.safe_dump(dict(document), sort_keys=False, allow_unicode=True, width=140).encode()
