"""`auvid fleet pool`: one campaign of the dives of a vehicle, for one model."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from auvid.data_schemas.errors import PipelineError, UsageError, nearest
from auvid.data_schemas.yaml_text import read_yaml
from auvid.pipeline.campaigns.campaign import ID
from auvid.pipeline.commands.fleet.fleet_folder import FleetFolder, open_fleet
from auvid.pipeline.commands.fleet.fleet_tables import read_table
from auvid.pipeline.commands.new.campaign_command import write_files
from auvid.pipeline.output import FINE, answer
from auvid.pipeline.terminal import path_from_here

KINDS = ("identification", "axes")
"""Kinds of campaigns whose legs can be of several dives."""
DIVE_SETTINGS = {"title", "notes", "logs", "legs", "vehicle", "accept"}
"""Keys of a manifest that may differ from dive to dive."""
FEWEST_DIVES = 2
NOTES = (
    "The dives of a fleet as the legs of one vehicle. Intervals are those of all dives"
    " together; how much a figure differs from dive to dive (tau), and where it changed,"
    " stands on the page of the fleet."
)
Document = dict[str, Any]


@dataclass(frozen=True)
class DiveCampaign:
    """A dive of a fleet: its log, its manifest, and the document of its vehicle."""

    log: str
    start_utc: str | None
    folder: Path
    manifest: Document
    vehicle: Any

    @property
    def alike(self) -> str:
        """Return what has to be the same in dives that one campaign holds."""
        rest = {key: item for key, item in self.manifest.items() if key not in DIVE_SETTINGS}
        stages = {name: dict(item) for name, item in rest.get("stages", {}).items()}
        stages.get("fuse", {}).pop("cutoff_hz", None)
        return json.dumps([rest | {"stages": stages}, self.vehicle], sort_keys=True, default=str)


@dataclass(frozen=True)
class PooledCampaign:
    """A campaign that was written: folder, dives, and those left out with reasons."""

    folder: Path
    vehicle: str
    dives: tuple[str, ...]
    legs: Mapping[str, int]
    left_out: Mapping[str, str]


def pool_campaign(
    fleet: FleetFolder, vehicle: str | None, *, name: str | None = None, since: str | None = None
) -> PooledCampaign:
    """Write a campaign of the dives of a vehicle, and return what it holds.

    Dives count that are done. vehicle: as table `runs` names it; None where the fleet has
    one. name: of the campaign, default the vehicle and `_dives`. since: log of the first
    dive that counts, as after a change of the vehicle. Dives whose vehicle file or
    settings are not those of most are left out. Raises `UsageError` for a vehicle, a log
    or a name that cannot be, `PipelineError` for fewer than two dives and for a campaign
    that is there.
    """
    rows = read_table(fleet, "runs").to_pylist()
    chosen = _vehicle_of(rows, vehicle)
    own = [row for row in rows if row["vehicle"] == chosen and not row["same_as"]]
    left_out = {row["log"]: row["reason"] for row in own if row["state"] != "done"}
    done = [row for row in own if row["state"] == "done"]
    if since is not None:
        left_out |= _before(done, since)
    dives = []
    for row in sorted(done, key=lambda row: (row["start_utc"] or "", row["log"])):
        if row["log"] in left_out:
            continue
        if row["kind"] not in KINDS:
            left_out[row["log"]] = f"a campaign of kind {row['kind']} is not pooled"
            continue
        dives.append(_dive(fleet, row))
    counts = Counter(dive.alike for dive in dives)
    most = max(counts, key=lambda key: counts[key], default="")
    for dive in dives:
        if dive.alike != most:
            left_out[dive.log] = "its vehicle file, kind or settings are not those of most dives"
    dives = [dive for dive in dives if dive.alike == most]
    if len(dives) < FEWEST_DIVES:
        raise PipelineError(
            f"fewer than {FEWEST_DIVES} dives of {chosen} can stand in one campaign",
            file=fleet.root,
            value=len(dives),
            remedy="; ".join(f"{log}: {why}" for log, why in list(left_out.items())[:3]),
        )
    campaign = name or f"{chosen}_dives".replace(" ", "_")
    if not ID.fullmatch(campaign):
        raise UsageError(
            "not a name for a campaign",
            field="--name",
            value=campaign,
            allowed="at most 100 letters, digits, _ and -, not starting with -",
        )
    folder = fleet.campaign(campaign)
    if (folder / "campaign.yaml").exists():
        raise PipelineError(
            "there is a campaign already, and nothing is overwritten",
            file=folder / "campaign.yaml",
            remedy="Give another --name, or remove the folder.",
        )
    manifest, texts, sources = _joined(dives, f"{len(dives)} dives of {chosen}")
    texts["campaign.yaml"] = yaml.safe_dump(
        manifest, sort_keys=False, allow_unicode=True, width=140, default_flow_style=None
    )
    write_files(folder, texts, sources, link=True)
    uses = Counter(leg.get("use", "training") for leg in manifest["legs"])
    return PooledCampaign(folder, chosen, tuple(dive.log for dive in dives), uses, left_out)


def _vehicle_of(rows: Sequence[Document], vehicle: str | None) -> str:
    names = sorted({row["vehicle"] for row in rows if row["state"] == "done"})
    if vehicle is None and len(names) == 1:
        return str(names[0])
    if vehicle not in names:
        raise UsageError(
            "name the vehicle" if vehicle is None else "no dive of this vehicle is done",
            field="VEHICLE",
            value=vehicle,
            allowed=names,
            remedy=None if vehicle is None else nearest(vehicle, names),
        )
    return str(vehicle)


def _before(done: Sequence[Document], since: str) -> dict[str, str]:
    """Return the dives before the one of a log, or without a clock, and why they go."""
    first = next((row for row in done if row["log"] == since), None)
    if first is None or first["start_utc"] is None:
        raise UsageError(
            "no dive with a clock has this log",
            field="--since",
            value=since,
            allowed=[row["log"] for row in done if row["start_utc"] is not None],
        )
    return {
        row["log"]: f"before {since}" if row["start_utc"] else "no clock tells its day"
        for row in done
        if not row["start_utc"] or row["start_utc"] < first["start_utc"]
    }


def _dive(fleet: FleetFolder, row: Document) -> DiveCampaign:
    folder = fleet.campaign(row["log"])
    manifest = read_yaml((folder / "campaign.yaml").read_text(encoding="utf-8"))
    vehicle = folder / manifest["vehicle"]
    document = (
        read_yaml(vehicle.read_text(encoding="utf-8")) if vehicle.is_file() else manifest["vehicle"]
    )
    return DiveCampaign(row["log"], row["start_utc"], folder, manifest, document)


def _joined(
    dives: Sequence[DiveCampaign], title: str
) -> tuple[Document, dict[str, str], dict[str, Path]]:
    """Return the manifest of all dives, texts beside it, and the logs, by place."""
    texts: dict[str, str] = {}
    sources: dict[str, Path] = {}
    logs: list[Document] = []
    legs: list[Document] = []
    for dive in dives:
        several = len(dive.manifest["logs"]) > 1
        ids = {
            log["id"]: f"{dive.log}_{log['id']}" if several else dive.log
            for log in dive.manifest["logs"]
        }
        logs += [
            _log(dive, {**log, "id": ids[log["id"]]}, texts, sources)
            for log in dive.manifest["logs"]
        ]
        legs += [
            {**leg, "id": f"{dive.log}_{leg['id']}", "log": ids[leg["log"]]}
            for leg in dive.manifest["legs"]
        ]
    first = dives[0]
    rest = {key: item for key, item in first.manifest.items() if key not in DIVE_SETTINGS}
    cutoffs = list(_cutoffs(dives))
    if cutoffs:
        # The low-pass leaves what the liveliest dive has.
        stages = {name: dict(item) for name, item in rest["stages"].items()}
        stages["fuse"]["cutoff_hz"] = max(cutoffs)
        rest["stages"] = stages
    vehicle = first.manifest["vehicle"]
    if (first.folder / vehicle).is_file():
        texts["vehicle.yaml"] = (first.folder / vehicle).read_text(encoding="utf-8")
        vehicle = "vehicle.yaml"
    head = {"kind": rest.pop("kind"), "title": title, "notes": NOTES, "vehicle": vehicle}
    return {**head, **rest, "logs": logs, "legs": legs}, texts, sources


def _cutoffs(dives: Sequence[DiveCampaign]) -> Iterator[float]:
    for dive in dives:
        cutoff = (dive.manifest.get("stages", {}).get("fuse") or {}).get("cutoff_hz")
        if cutoff is not None:
            yield float(cutoff)


def _log(
    dive: DiveCampaign, log: Document, texts: dict[str, str], sources: dict[str, Path]
) -> Document:
    """Return the entry of a log whose files and column maps stand beside the others."""

    def moved(item: Document) -> Document:
        place = f"logs/{dive.log}/{Path(item['file']).name}"
        sources[place] = (dive.folder / item["file"]).resolve()
        out = {**item, "file": place}
        if item.get("columns"):
            out["columns"] = f"columns/{dive.log}/{Path(item['columns']).name}"
            texts[out["columns"]] = (dive.folder / item["columns"]).read_text(encoding="utf-8")
        return out

    entry = moved(log) if log.get("file") else {**log, "files": [moved(i) for i in log["files"]]}
    accepted = sorted({*(log.get("accept") or ()), *(dive.manifest.get("accept") or ())})
    return {**entry, "accept": accepted} if accepted else entry


def print_pooled_campaign(
    folder: Path, vehicle: str | None, *, name: str | None, since: str | None
) -> int:
    """Write a campaign of a vehicle's dives, print it, and return the exit code."""
    fleet = open_fleet(folder)
    result = pool_campaign(fleet, vehicle, name=name, since=since)
    answer(
        {
            "folder": result.folder,
            "vehicle": result.vehicle,
            "dives": list(result.dives),
            "legs": dict(result.legs),
            "left_out": dict(result.left_out),
        }
    )
    print(f"wrote {path_from_here(result.folder)}")
    legs = ", ".join(f"{count} {use}" for use, count in sorted(result.legs.items()))
    print(f"  {len(result.dives)} dives of {result.vehicle}, legs: {legs}")
    for log, why in result.left_out.items():
        print(f"  left out: {log}: {why}")
    print(f"\n    cd {path_from_here(fleet.root)}; auvid run {result.folder.name}\n")
    return FINE
