"""Load a campaign: its checked manifest, its vehicle, and the places of its logs."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from auvid.data_schemas.documents.campaign import PriorEntry
from auvid.data_schemas.errors import (
    CampaignError,
    PipelineError,
    SchemaError,
    nearest,
    raise_faults,
)
from auvid.data_schemas.records.priors import PriorSourcesRecord
from auvid.hydro.dynamics.vehicle.vehicle import Vehicle
from auvid.pipeline.campaigns.prior_files import prior_source
from auvid.pipeline.campaigns.vehicle_files import load_published, load_vehicle, shelf_files
from auvid.pipeline.campaigns.yaml_files import YamlFile, load_yaml

if TYPE_CHECKING:
    from auvid.data_schemas.documents.twin import TwinDocument

SIMULATE = "simulate"
CONTROL = "control"
"""A campaign with this stage has no logs."""
DOCUMENTS = {
    "apparatus": ("apparatus", "pipendulum"),
    "published_values": ("published", "check_published"),
    "control_cases": ("cases", "control"),
    "model_card": ("model", "control"),
}
"""Documents beside a manifest: schema -> the key that names the file, and the stage
whose optional port it feeds.
"""
PRIORS = "prior_sources"
"""Schema of what the key `priors` of a manifest names."""
ID = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_-]{0,99}")


@dataclass(frozen=True)
class LogFile:
    """One file of a log: its name in the manifest, its path, its checked column map."""

    name: str
    path: Path
    columns: Mapping[str, Any] | None = None


@dataclass(frozen=True)
class Campaign:
    """A loaded campaign, in the order of the manifest.

    `twin`: the document of schema `twin`, where logs are simulated.
    """

    name: str
    folder: Path
    file: YamlFile
    vehicle_file: Path
    vehicle: Vehicle
    twin: TwinDocument | None = None
    documents: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """The documents that the manifest names, by schema."""
    shelf: Mapping[str, Vehicle] = field(default_factory=dict)
    """The published vehicles that the manifest names, by name."""

    @cached_property
    def document(self) -> Mapping[str, Any]:
        """Return the manifest; for a twin with the logs and legs of its plan."""
        value: Mapping[str, Any] = self.file.value
        if self.twin is None:
            return value
        from auvid.pipeline.campaigns.twin import with_logs_of_plan

        return with_logs_of_plan(value, self.twin)

    @property
    def priors(self) -> PriorSourcesRecord | None:
        """Return the priors of other measurements that the manifest names."""
        document = self.documents.get(PRIORS)
        return None if document is None else PriorSourcesRecord.model_validate(document)

    @cached_property
    def logs(self) -> dict[str, Mapping[str, Any]]:
        return {log["id"]: log for log in self.document.get("logs", ())}

    @cached_property
    def legs(self) -> dict[str, Mapping[str, Any]]:
        return {leg["id"]: leg for leg in self.document.get("legs", ())}

    def log_files(self, log: str) -> tuple[LogFile, ...]:
        """Return the files of a log.

        Raises `CampaignError` or `PipelineError` for what is missing, unreadable or
        outside the folder.
        """
        entry = self.logs[log]
        files = entry.get("files") or [entry]
        return tuple(self._log_file(item, log) for item in files)

    def _log_file(self, item: Mapping[str, Any], log: str) -> LogFile:
        columns = None
        if item.get("columns"):
            mapping = load_yaml(
                inside(self.folder, item["columns"], self.file.path),
                named_in=self.file.path,
                what=f"column map of log '{log}'",
            )
            mapping.check("column_map")
            columns = mapping.value
        return LogFile(item["file"], inside(self.folder, item["file"], self.file.path), columns)

    def seen_by(self, log: str | None = None, leg: str | None = None) -> Mapping[str, Any]:
        """Return the manifest as an item sees it.

        An item smaller than the campaign gets only the entries that concern it.

        So a changed leg or parameter does not rerun the logs that it has nothing to do
        with.
        """
        if log is None:
            return self.document
        legs = [self.legs[leg]] if leg is not None else []
        return {
            "kind": self.document["kind"],
            "vehicle": self.document["vehicle"],
            "logs": [self.logs[log]],
            "legs": legs,
        }


def load_campaign(
    folder: Path, *, kinds: Mapping[str, tuple[str, ...]], vehicles: Mapping[str, Path]
) -> Campaign:
    """Load the campaign of a folder.

    `kinds`: stage names per kind; `vehicles`: vehicle files by name.

    Raises `CampaignError` (all faults of the manifest together) or `SchemaError`.
    """
    file = load_yaml(folder / "campaign.yaml")
    _check(file, kinds)
    faults = [file.located(fault) for fault in _faults(file, kinds)]
    raise_faults(faults, file=file.path)
    vehicle_file = _vehicle_path(file, folder, vehicles)
    vehicle = load_vehicle(vehicle_file, named_in=file.path).vehicle
    twin = None
    if SIMULATE in kinds[file.value["kind"]]:
        from auvid.pipeline.campaigns.twin import load_twin

        plan = inside(folder, file.value[SIMULATE]["plan"], file.path)
        twin = load_twin(
            file.value[SIMULATE],
            vehicle,
            plan=plan,
            vehicle_file=vehicle_file,
            folder=folder,
            file=file.path,
        )
    return Campaign(
        folder.name,
        folder,
        file,
        vehicle_file,
        vehicle,
        twin,
        _documents(file, folder),
        _shelf(file, folder),
    )


def _documents(file: YamlFile, folder: Path) -> dict[str, Mapping[str, Any]]:
    """Return the documents that the manifest names, read and checked, by schema."""
    by_schema = {}
    for name, (key, _) in DOCUMENTS.items():
        if key in file.value:
            document = load_yaml(
                inside(folder, file.value[key], file.path), named_in=file.path, what=key
            )  # JSON is YAML
            document.check(name)
            by_schema[name] = document.value
    entries = [PriorEntry.model_validate(entry) for entry in file.value.get("priors") or ()]
    named = [(f"priors[{index}]", entry) for index, entry in enumerate(entries)]
    fill = file.value.get("fill") or {}
    named += [
        (f"fill.{motion}", PriorEntry(bench=source))
        for motion, source in fill.items()
        if source.endswith(".json")
    ]
    if named:
        sources = []
        for field, entry in named:
            path = (
                inside(folder, str(entry.bench or entry.campaign), file.path)
                if entry.shelf is None
                else _published_file(entry.shelf, folder, file.path, f"{field}.shelf")
            )
            sources.append(prior_source(entry, path, named_in=file.path, field=field))
        by_schema[PRIORS] = {"sources": sources}
    return by_schema


def _shelf(file: YamlFile, folder: Path) -> dict[str, Vehicle]:
    """Return the published vehicles that the manifest names.

    Raises `CampaignError` for a name or pattern that the shelf does not have.
    """
    shipped = shelf_files()
    vehicles: dict[str, Vehicle] = {}
    names = {f"shelf[{index}]": name for index, name in enumerate(file.value.get("shelf") or ())}
    names |= {
        f"fill.{motion}": name
        for motion, name in (file.value.get("fill") or {}).items()
        if not name.endswith(".json")
    }
    for key_of, name in names.items():
        if name.endswith(".yaml"):
            paths = {Path(name).stem: inside(folder, name, file.path)}
        else:
            paths = {key: path for key, path in shipped.items() if fnmatchcase(key, name)}
        if not paths:
            raise _not_on_the_shelf(name, file.path, key_of)
        vehicles |= {key: load_published(path, named_in=file.path) for key, path in paths.items()}
    return vehicles


def _published_file(name: str, folder: Path, file: Path, field: str) -> Path:
    """Return the file of a published set by its name, or of a path to a vehicle file.

    Raises `CampaignError` for a name that the shelf does not have.
    """
    if name.endswith(".yaml"):
        return inside(folder, name, file)
    if name not in shelf_files():
        raise _not_on_the_shelf(name, file, field)
    return shelf_files()[name]


def _not_on_the_shelf(name: str, file: Path, field: str) -> CampaignError:
    shipped = shelf_files()
    return CampaignError(
        "not on the shelf",
        file=file,
        field=field,
        value=name,
        allowed=list(shipped),
        remedy=nearest(name, shipped),
    )


def _check(file: YamlFile, kinds: Mapping[str, tuple[str, ...]]) -> None:
    """Check the manifest against its schema.

    The logs and legs of a twin, and of a campaign without logs, are not in it.
    """
    value = file.value
    stages = kinds.get(str(value.get("kind")), ()) if isinstance(value, Mapping) else ()
    if SIMULATE in stages or CONTROL in stages:
        file = replace(file, value={"logs": [], "legs": [], **value})
    file.check("campaign")


def inside(folder: Path, name: str, file: object) -> Path:
    """The path that a manifest names; relative ones may not leave the campaign folder.

    Links within the folder may point elsewhere: who keeps big logs on another disk, or
    in a DVC cache, puts them there.
    """
    path = Path(name)
    if path.is_absolute():
        return path
    joined = Path(os.path.normpath(folder / path))
    if not joined.is_relative_to(os.path.normpath(folder)):
        remedy = "Put the file under the folder, or write an absolute path if you mean it."
        raise CampaignError("path leaves the campaign folder", file=file, value=name, remedy=remedy)
    return joined


def _faults(file: YamlFile, kinds: Mapping[str, tuple[str, ...]]) -> Iterator[PipelineError]:
    manifest, path = file.value, file.path
    if manifest["kind"] not in kinds:
        yield CampaignError(
            "unknown kind", file=path, field="kind", value=manifest["kind"], allowed=kinds
        )
        return
    stages = kinds[manifest["kind"]]
    others = {"priors": "synthesise", "fill": "fit_axes", "shelf": "score_shelf"}
    for key, stage in (*DOCUMENTS.values(), *others.items()):
        if key in manifest and stage not in stages:
            having = [kind for kind, names in kinds.items() if stage in names]
            yield CampaignError(
                f"no stage of kind '{manifest['kind']}' reads this",
                file=path,
                field=key,
                allowed=f"kinds {', '.join(having)}",
            )
    if SIMULATE in stages or CONTROL in stages:
        reason = (
            "a twin has these from its plan"
            if SIMULATE in stages
            else "this kind of campaign has none"
        )
        for part in ("logs", "legs"):
            if part in manifest:
                yield CampaignError(
                    reason, file=path, field=part, remedy="Leave them out of the manifest."
                )
    if SIMULATE in stages:
        if SIMULATE not in manifest:
            yield SchemaError(
                "missing key",
                file=path,
                field=SIMULATE,
                remedy="A twin needs the plan that it flies.",
            )
        yield from _stage_faults(manifest, kinds, path)
        return
    if SIMULATE in manifest:
        simulated = " or ".join(f"'{kind}'" for kind, names in kinds.items() if SIMULATE in names)
        yield CampaignError(
            f"only a campaign of kind {simulated} is simulated", file=path, field=SIMULATE
        )
    if CONTROL in stages:
        yield from _stage_faults(manifest, kinds, path)
        return
    for part in ("logs", "legs"):
        if not manifest[part]:
            yield CampaignError(
                "the list is empty", file=path, field=part, remedy="A campaign needs at least one."
            )
        yield from _id_faults(manifest[part], part, path)
    for index, log in enumerate(manifest["logs"]):
        yield from _log_faults(log, f"logs[{index}]", path)
    log_ids = [log["id"] for log in manifest["logs"]]
    for index, leg in enumerate(manifest["legs"]):
        at = f"legs[{index}]"
        if leg["log"] not in log_ids:
            yield CampaignError(
                "no such log",
                file=path,
                field=f"{at}.log",
                value=leg["log"],
                allowed=log_ids,
                remedy=nearest(leg["log"], log_ids),
            )
        start, end = leg.get("start_s"), leg.get("end_s")
        if end is not None and (start or 0) >= end:
            yield CampaignError(
                "the leg ends before it starts",
                file=path,
                field=f"{at}.end_s",
                value=end,
                allowed=f"more than start_s = {start or 0}",
            )
    yield from _stage_faults(manifest, kinds, path)


def _stage_faults(
    manifest: Mapping[str, Any], kinds: Mapping[str, tuple[str, ...]], path: Path
) -> Iterator[PipelineError]:
    for name in manifest.get("stages") or {}:
        allowed = kinds[manifest["kind"]]
        if name not in allowed:
            yield CampaignError(
                "unknown stage",
                file=path,
                field=f"stages.{name}",
                allowed=allowed,
                remedy=nearest(name, allowed),
            )


def _id_faults(entries: list[Mapping[str, Any]], part: str, path: Path) -> Iterator[PipelineError]:
    places: dict[str, int] = {}
    for index, entry in enumerate(entries):
        name = entry["id"]
        if not ID.fullmatch(name):
            yield CampaignError(
                "not a name",
                file=path,
                field=f"{part}[{index}].id",
                value=name,
                allowed="at most 100 letters, digits, _ and -, not starting with -",
            )
        if name.lower() in places:
            yield CampaignError(
                f"the same name as {part}[{places[name.lower()]}]",
                file=path,
                field=f"{part}[{index}].id",
                value=name,
            )
        places.setdefault(name.lower(), index)


def _log_faults(log: Mapping[str, Any], at: str, path: Path) -> Iterator[PipelineError]:
    single, several = "file" in log, bool(log.get("files"))
    if single == several:
        which = "both" if single else "neither"
        yield CampaignError(
            f"a log needs either file or files, this one has {which}",
            file=path,
            field=f"{at}.id",
            value=log["id"],
        )
    if several and "columns" in log:
        yield CampaignError(
            "a column map goes with each entry of files",
            file=path,
            field=f"{at}.columns",
            value=log["columns"],
        )
    for index, item in enumerate(log.get("files") or [log] if single or several else []):
        where = f"{at}.files[{index}]" if several else at
        for key in ("file", "columns"):
            if key in item:
                try:
                    inside(path.parent, item[key], path)
                except CampaignError as fault:
                    fault.field = f"{where}.{key}"
                    yield fault


def _vehicle_path(file: YamlFile, folder: Path, vehicles: Mapping[str, Path]) -> Path:
    name = file.value["vehicle"]
    if name in vehicles:
        return vehicles[name]
    if "/" in name or name.endswith(".yaml"):
        return inside(folder, name, file.path)
    raise file.located(
        CampaignError(
            "no such vehicle",
            file=file.path,
            field="vehicle",
            value=name,
            allowed=vehicles or "none",
            remedy=nearest(name, vehicles),
        )
    )
