"""Run stale stages of a campaign and record the results in the manifests.

An item is fresh if its key (hash of inputs, parameters, schemas and code) is that of
its record and its files still have the recorded hashes. Inputs count by content, so a
stage that gives the same result again makes nothing after it stale.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import Path
from typing import Any

from auvid.data_schemas.documents import delivered, written
from auvid.data_schemas.errors import DataError, PipelineError, raise_faults
from auvid.data_schemas.schemas import schema
from auvid.pipeline.campaigns.campaign import Campaign
from auvid.pipeline.execution import code_stamp
from auvid.pipeline.execution.engines import Engine
from auvid.pipeline.execution.lock import locked
from auvid.pipeline.execution.progress import Progress, Silent
from auvid.pipeline.execution.task import Outcome, Task
from auvid.pipeline.execution.task_inputs import (
    Artefact,
    ColumnsOnDisk,
    Log,
    Many,
    RowsOnDisk,
    Source,
    Value,
    artefacts_of,
    log_files,
    log_source,
    shelf_source,
    vehicle_source,
)
from auvid.pipeline.graph import (
    MANIFEST_PORTS,
    ONCE,
    SIMULATED_LOG,
    AnyStage,
    Feed,
    Graph,
    Port,
    names_of,
)
from auvid.pipeline.store.atomic_files import (
    refuse_linked_folders,
    remove_stale_files,
    remove_temporary_files,
    write_atomically,
)
from auvid.pipeline.store.file_hashes import HASHES, FileHashes, hash_file, hash_value
from auvid.pipeline.store.fingerprints import as_document, fingerprint_line, stage_code
from auvid.pipeline.store.manifest import Manifest
from auvid.pipeline.store.package_versions import package_versions
from auvid.stages.base import ports
from auvid.stages.steps import listening

OF_CAMPAIGN = ("stages.", "priors[", "legs")
"""Beginnings of keys that stand in the campaign's file."""


class StageFault(PipelineError):
    """A user's fault, with the stage and the item in which it came up."""


class InternalFault(Exception):
    """A fault of auvid itself.

    `trace` is the Python traceback of the process where it happened.
    """

    def __init__(self, message: str, trace: str) -> None:
        super().__init__(message)
        self.trace = trace


@dataclass(frozen=True)
class Place:
    """An item with the log and the leg that it belongs to."""

    item: str
    log: str | None = None
    leg: str | None = None


@dataclass
class Run:
    """A campaign, its graph and the parameters of its stages over a folder of results.

    `members`: the runs by name that feed ports of several runs; `title` stands before
    the names of stages in the progress, where stages that are up to date are left out.
    """

    campaign: Campaign
    graph: Graph
    params: Mapping[str, Any]
    folder: Path
    members: Mapping[str, Run] = field(default_factory=dict)
    title: str = ""
    manifests: dict[str, Manifest] = field(init=False)
    hashes: FileHashes = field(init=False)

    def __post_init__(self) -> None:
        self.manifests = {
            stage.name: Manifest(self.folder / stage.name) for stage in self.graph.stages
        }
        self.hashes = FileHashes(self.folder / HASHES)

    def execute(
        self,
        stages: Sequence[AnyStage],
        engine: Engine,
        progress: Progress | None = None,
        *,
        force: bool = False,
        after: Callable[[Run], None] | None = None,
        close_engine: bool = True,
    ) -> int:
        """Bring these stages up to date and return how many items had to run.

        `after` is called with the folder still locked, also where no item had to run: an
        earlier run may have been killed before it.
        Raises `StageFault` (all faults of a stage together), or `InternalFault`.
        """
        for stage in stages:
            refuse_linked_folders(self.manifests[stage.name].folder)
        with locked(self.folder):
            remove_temporary_files(self.folder)
            try:
                count = sum(
                    self._stage(stage, engine, progress or Silent(), force) for stage in stages
                )
                if after is not None:
                    after(self)
                return count
            finally:
                if close_engine:
                    engine.close()
                remove_temporary_files(self.folder)
                self.hashes.save()

    def _stage(self, stage: AnyStage, engine: Engine, progress: Progress, force: bool) -> int:
        manifest = self.manifests[stage.name]
        places = self.places(stage.maps_over)
        order = [place.item for place in places]
        outcomes: dict[str, Outcome] = {}
        stale: list[Task] = []
        for place in places:
            try:
                task = self.task(stage, place)
            except PipelineError as fault:
                outcomes[place.item] = Outcome(place.item, fault=fault)
                continue
            if force or not self.is_fresh(task):
                stale.append(task)
        again = {*outcomes, *(task.item for task in stale)}
        names = {
            *(port.name for port in self.graph.outputs if port.stage is stage),
            *(name for record in manifest.records.values() for name in record.outputs),
        }
        manifest.write(
            {item: record for item, record in manifest.records.items() if item not in again}, order
        )
        if self.title and not again:
            progress = Silent()
        progress.stage(
            f"{self.title}/{stage.name}" if self.title else stage.name,
            todo=len(again),
            total=len(places),
            level=ONCE if self.title else stage.maps_over,
        )
        with listening(progress.part):
            for outcome in engine.map(stale):
                outcomes[outcome.item] = outcome
                if outcome.record is not None:
                    manifest.write({**manifest.records, outcome.item: outcome.record}, order)
                progress.item(outcome.item)
        remove_stale_files(
            manifest.folder,
            {manifest.path, *(artefact.path for *_, artefact in self.artefacts(stage))},
            names,
        )
        progress.finish(failed=sum(outcome.record is None for outcome in outcomes.values()))
        faults = [outcomes[item] for item in order if item in outcomes]
        _raise(stage, faults, self.campaign.file.path)
        return len(stale)

    def places(self, level: str) -> list[Place]:
        """Return the items of a level, in the order of the manifest.

        Segments come in the order of their legs.
        """
        legs = self.campaign.legs
        if level == ONCE:
            return [Place(ONCE)]
        if level == "log":
            return [Place(log, log) for log in self.campaign.logs]
        if level == "leg":
            return [Place(leg, entry["log"], leg) for leg, entry in legs.items()]
        manifest = self.manifests[self._divider.name]
        missing = [leg for leg in legs if leg not in manifest.records]
        if missing:
            raise self._not_run(self._divider)
        return [
            Place(key, entry["log"], leg)
            for leg, entry in legs.items()
            for key in manifest.keys(leg)
        ]

    @cached_property
    def _codes(self) -> dict[str, str]:
        hash_once = cache(hash_file)
        return {stage.name: stage_code(stage, hash_once) for stage in self.graph.stages}

    @cached_property
    def _divider(self) -> AnyStage:
        """Return the stage that divides legs into segments."""
        return next(stage for stage in self.graph.stages if stage.yields == "segment")

    def task(self, stage: AnyStage, place: Place) -> Task:
        """Return the task of one item: its inputs, and its key.

        Raises `DataError` where an input has not been made yet.
        """
        sources = {feed.port: self._source(stage, feed, place) for feed in self.graph.feeds(stage)}
        params, code = self.params[stage.name], self._codes[stage.name]
        inputs = {name: source.fingerprint for name, source in sources.items()}
        key = hash_value(
            {
                "stage": stage.name,
                "item": place.item,
                "inputs": inputs,
                "params": params,
                "code": code,
            }
        )
        outputs = tuple(port for port in self.graph.outputs if port.stage is stage)
        folder = self.manifests[stage.name].folder
        return Task(stage, place.item, params, sources, outputs, folder, key, code)

    def is_fresh(self, task: Task) -> bool:
        """Return whether an item's record has this key and its files are unchanged."""
        record = self.manifests[task.stage.name].records.get(task.item)
        if record is None or record.key != task.key:
            return False
        return all(
            self._has(artefact)
            for port in task.outputs
            for artefact in self.artefacts_of(port, task.item).values()
        )

    def _has(self, artefact: Artefact) -> bool:
        try:
            return self.hashes.of(artefact.path) == artefact.hash
        except OSError:
            return False

    def artefacts(self, stage: AnyStage) -> Iterator[tuple[Port, str, str | None, Artefact]]:
        """Yield all artefacts of a stage: port, item, key, artefact.

        The key is None for a port with a single one.
        """
        for port in self.graph.outputs:
            if port.stage is stage:
                for item in self.manifests[stage.name].records:
                    for key, artefact in self.artefacts_of(port, item).items():
                        yield port, item, key, artefact

    def artefacts_of(self, port: Port, item: str) -> dict[str | None, Artefact]:
        """Return what a port gave for an item, by key (None for a single one)."""
        return artefacts_of(self.manifests[port.stage.name], port, item)

    def loaded(self, schema_name: str) -> Iterator[tuple[str, Any]]:
        """Yield all artefacts of a schema, each loaded, with the item that it is of."""
        for port in self.graph.producers(schema_name):
            for item in self.manifests[port.stage.name].records:
                for artefact in self.artefacts_of(port, item).values():
                    yield item, artefact.load()

    def documents(self, schema_name: str) -> Iterator[Any]:
        """Yield all artefacts of a schema, each loaded."""
        return (artefact for _, artefact in self.loaded(schema_name))

    def _source(self, stage: AnyStage, feed: Feed, place: Place) -> Source:
        if feed.runs:
            return self._of_members(feed)
        if feed.schema == "raw_log":
            assert place.log is not None
            return self._log(place.log)
        if feed.schema in MANIFEST_PORTS:
            if feed.schema == "vehicle":
                if ports(stage.inputs)[feed.port]["many"]:
                    return shelf_source(self.campaign.shelf)
                return vehicle_source(self.campaign.vehicle)
            document = self._manifest_document(feed.schema, place)
            keys = ports(stage.inputs)[feed.port].get("keys")
            if keys:
                document = {key: document[key] for key in keys if key in document}
            if feed.schema == "leg":
                return Value(delivered(document, "leg"), document)
            return Value(document)
        if feed.every:
            return Many(self._collected(feed))
        if not feed.producers:
            many = ports(stage.inputs)[feed.port][
                "many"
            ]  # the manifest names one document: no collection (report) takes it
            document = None if many else self.campaign.documents.get(feed.schema)
            if document is None:
                return Value(None)
            return Value(delivered(document, feed.schema), document)
        parts = [self._produced(stage, feed, producer, place) for producer in feed.producers]
        if len(parts) == 1:
            return parts[0]
        return Many(
            {
                key: part
                for many in parts
                if isinstance(many, Many)
                for key, part in many.entries.items()
            }
        )

    def _manifest_document(self, schema_name: str, place: Place) -> Any:
        if schema_name == "campaign":
            return self.campaign.seen_by(place.log, place.leg)
        if schema_name == "leg":
            return self.campaign.legs[str(place.leg)]
        if schema_name == "provenance":
            return self.provenance()
        if schema_name == "twin":
            return self.campaign.twin
        return self.campaign.documents[schema_name]

    def _of_members(self, feed: Feed) -> Source:
        """A document of each member by its name, or their artefacts by `RUN/ITEM`."""
        if feed.schema in MANIFEST_PORTS:
            documents = {
                name: run._manifest_document(feed.schema, Place(ONCE))
                for name, run in self.members.items()
            }
            return Value(documents, {name: written(each) for name, each in documents.items()})
        entries = {}
        for name, run in self.members.items():
            for port in run.graph.producers(feed.schema):
                for item in run.manifests[port.stage.name].records:
                    for key, artefact in run.artefacts_of(port, item).items():
                        last = key if key is not None else "" if port.level == ONCE else item
                        entries[f"{name}/{last}".rstrip("/")] = artefact
        return Many(entries)

    def _log(self, log: str) -> Log:
        """Return the source of a log: files of the manifest, or what the twin wrote."""
        simulated = Path()
        for producer in self.graph.producers(SIMULATED_LOG):
            self._items(producer.stage)
            simulated = self.manifests[producer.stage.name].folder / producer.name
        return log_source(
            log,
            log_files(self.campaign, log, simulated),
            reader=self.campaign.logs[log].get("reader"),
            hash_of=self.hashes.of,
            named_in=self.campaign.file.path,
        )

    def provenance(self) -> dict[str, Any]:
        """Return where the results come from.

        Content hashes of the logs and the vehicle, code and parameters of every stage,
        package versions.
        """
        logs = {log: self._log(log).fingerprint["files"] for log in self.campaign.logs}
        return {"logs": logs, **self._provenance_but_logs()}

    def _provenance_but_logs(self) -> dict[str, Any]:
        stages = {
            name: {"code": code, "parameters": as_document(self.params[name])}
            for name, code in self._codes.items()
        }
        return {
            "vehicle": vehicle_source(self.campaign.vehicle).fingerprint,
            "stages": stages,
            "packages": package_versions(),
        }

    def inputs_from_files(self, stage: AnyStage) -> str:
        """Return the hash of what a stage takes from manifest, logs and parameters.

        What it takes from other stages is left out: they need not have been run.
        """
        own = [
            feed
            for feed in self.graph.feeds(stage)
            if not (feed.producers or feed.every or feed.runs)
        ]
        inputs = {
            place.item: {
                feed.port: self._provenance_but_logs()
                if feed.schema == "provenance"
                else self._source(stage, feed, place).fingerprint
                for feed in own
            }
            for place in self.places("leg" if stage.maps_over == "segment" else stage.maps_over)
        }
        return hash_value({"inputs": inputs, "params": self.params[stage.name]})

    def _collected(self, feed: Feed) -> dict[str, Artefact]:
        """Return artefacts of a schema from all stages, keyed `stage/item`.

        Tables by `stage/item/port`, several of a port by `stage/item/port/key`.
        """
        entries: dict[str, Artefact] = {}
        for producer in feed.producers:
            for item in self._items(producer.stage):
                for key, artefact in self.artefacts_of(producer, item).items():
                    entries[self._label(feed, producer, item, key)] = artefact
        return entries

    def _label(self, feed: Feed, producer: Port, item: str, key: str | None) -> str:
        parts = (
            [producer.stage.name]
            if producer.level == ONCE
            else [producer.stage.name, producer.owner(item, key)]
        )
        if feed.schema == "table" or producer.keyed:
            parts.append(producer.name)
        return "/".join([*parts, *([str(key)] if producer.keyed else [])])

    def _produced(self, stage: AnyStage, feed: Feed, producer: Port, place: Place) -> Source:
        """Return what a port delivers for an item.

        The artefact of the item or of what it belongs to, or all of them for a campaign
        stage.
        """
        items = self._items(producer.stage)
        if stage.maps_over == ONCE and producer.level != ONCE:
            artefacts = {
                f"{item}/{key}" if producer.keyed else producer.owner(item, key): artefact
                for item in items
                for key, artefact in self.artefacts_of(producer, item).items()
            }
            return Many(artefacts)
        item = {
            "log": place.log,
            "leg": place.leg,
            "segment": place.item,
            ONCE: ONCE,
        }[producer.stage.maps_over]
        if item not in items:
            raise self._not_run(producer.stage)
        of_item = self.artefacts_of(producer, item)
        if producer.keyed:
            return Many({str(key): artefact for key, artefact in of_item.items()})
        artefact = of_item.get(place.item if producer.many else None)
        if artefact is not None:
            spec = ports(stage.inputs)[feed.port]
            if spec.get("by_rows"):
                return RowsOnDisk(artefact)
            columns = spec.get("columns")
            return ColumnsOnDisk(artefact, columns) if columns else artefact
        if feed.optional:
            return Value(None)
        meaning = schema(producer.schema).meaning.rstrip(".")
        raise DataError(
            f"needs '{producer.schema}' ({meaning}), and stage {producer.stage.name} gave none for"
            f" '{item}'"
        )

    def _items(self, producer: AnyStage) -> tuple[str, ...]:
        """Return the items that a stage has finished; an error if there is none."""
        records = self.manifests[producer.name].records
        if not records:
            raise self._not_run(producer)
        return tuple(records)

    def _not_run(self, producer: AnyStage) -> PipelineError:
        return DataError(
            f"stage {producer.name} has not been run",
            file=self.folder,
            remedy=f"auvid run {self.campaign.name} --until {producer.name}",
        )


def _raise(stage: AnyStage, outcomes: Sequence[Outcome], campaign_file: Path) -> None:
    """Raise what went wrong; a key of the campaign comes with its file, and once."""
    faults: list[str] = []
    of_campaign: dict[str, list[str]] = {}
    for outcome in outcomes:
        where, fault = _where(stage, outcome.item), outcome.fault
        if outcome.crash is not None:
            raise InternalFault(f"{where}: {outcome.crash}", outcome.trace)
        if fault is None:
            continue
        if (fault.field or "").startswith(OF_CAMPAIGN):
            fault.file = fault.file or campaign_file
            of_campaign.setdefault(str(fault), []).append(where)
        else:
            faults.append(f"{where}: {fault}")
    for words, places in of_campaign.items():
        faults.append(f"{places[0] if len(places) == 1 else stage.name}: {words}")
    raise_faults([StageFault(words) for words in faults])


def _where(stage: AnyStage, item: str) -> str:
    return stage.name if stage.maps_over == ONCE else f"{stage.name}, {stage.maps_over} '{item}'"


def write_code_files(stages: Sequence[AnyStage], folder: Path) -> None:
    """Write the small file per stage on which DVC depends in place of the code.

    Unchanged ones are left as they are; nothing is read where no source has changed.
    """
    names = [f"{name}.txt" for name in names_of(stages)]
    if code_stamp.unchanged(folder, names):
        return
    remove_temporary_files(folder, shared=True)
    stamp = code_stamp.source_stamp()
    hash_once = cache(hash_file)
    for stage in stages:
        path, line = folder / f"{stage.name}.txt", fingerprint_line(stage, hash_once).encode()
        if not path.is_file() or path.read_bytes() != line:
            write_atomically(path, line)
    write_atomically(folder / code_stamp.FILE, code_stamp.stamp_file(folder, stamp, names))
