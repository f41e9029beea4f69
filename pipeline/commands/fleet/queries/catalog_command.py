"""`auvid catalog`: the recordings of all runs, served by Rerun on this machine."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from auvid.data_schemas.errors import PipelineError, UsageError
from auvid.pipeline.commands.fleet.dive_reports import draw_reports
from auvid.pipeline.commands.fleet.fleet_folder import FleetFolder, open_fleet
from auvid.pipeline.commands.fleet.queries.find_command import find
from auvid.pipeline.commands.look.inspect.rerun_viewer import require_rerun
from auvid.pipeline.execution.engines import Engine, make_engine
from auvid.pipeline.output import answer, note
from auvid.pipeline.terminal import path_from_here

if TYPE_CHECKING:
    from rerun.server import Server

LOOPBACK = "127.0.0.1"
SUFFIX = ".rrd"
HIGHEST_PORT = 65535
QUERIES = (
    "queries in Python and the table of properties need the datafusion of this Rerun: pip install"
    " 'auvid[catalog]'"
)
INTERRUPT_EVERY_S = 0.5


def recordings_of(folder: Path, where: str = "") -> list[Path]:
    """Return the recordings below a folder; of a fleet those of which `where` holds.

    Raises `PipelineError` where there is none.
    """
    place = folder.expanduser().resolve()
    if where:
        if not FleetFolder(place).index.is_file():
            raise UsageError(
                "only a fleet can be asked",
                field="--where",
                value=where,
                remedy="auvid fleet run DIR --out FLEETDIR makes one of many logs.",
            )
        rows = find(open_fleet(place), where)
        named = [place / row["recording"] for row in rows if row["recording"]]
        paths = [path for path in named if path.is_file()]
    else:
        paths = sorted(path for path in place.rglob(f"*{SUFFIX}") if path.is_file())
    if not paths:
        raise PipelineError(
            "no recordings",
            file=folder,
            remedy="auvid run CAMPAIGN, or auvid fleet run DIR, makes them.",
        )
    return paths


@contextmanager
def served(paths: Sequence[Path], name: str, port: int = 0) -> Iterator[Server]:
    """Serve recordings as a dataset to programs of this machine only, while in use.

    Raises `PipelineError` where the port cannot be had.
    """
    require_rerun()
    from rerun.server import Server

    if not 0 <= port <= HIGHEST_PORT:
        raise UsageError("no port", field="--port", value=port, allowed=f"0 to {HIGHEST_PORT}")
    try:
        server = Server(host=LOOPBACK, port=port, datasets={name: [str(path) for path in paths]})
    except (OSError, RuntimeError, ValueError) as fault:
        raise PipelineError(f"the catalogue cannot be served: {fault}", value=port) from fault
    try:
        yield server
    finally:
        server.shutdown()


def segments(server: Server, name: str) -> int | None:
    """Return how many recordings the server has, with the blueprint of a dataset set.

    None where that cannot be told: without datafusion, or with another than Rerun's.
    """
    if find_spec("datafusion") is None:
        return None
    try:
        dataset = server.client().get_dataset(name)
    except ImportError:
        return None
    with tempfile.TemporaryDirectory() as folder:
        dataset.register_blueprint(_blueprint(Path(folder) / "catalog.rbl").as_uri())
        return len(dataset.segment_ids())


def _blueprint(path: Path) -> Path:
    """Write how a recording of the catalogue opens."""
    import rerun.blueprint as rrb

    answer_view = rrb.TextDocumentView(origin="answer/text", name="Answer")
    rrb.Blueprint(answer_view, auto_views=False, collapse_panels=True).save("auvid", path)
    return path


def draw_lacking(folder: Path, where: str, engine: Engine) -> None:
    """Draw the recordings of a fleet that nobody has asked for before.

    `where` holds of them. Nothing is done for another folder.
    """
    fleet = FleetFolder(folder.expanduser().resolve())
    if fleet.index.is_file():
        logs = [row["log"] for row in find(fleet, where)] if where else None
        try:
            for fault in draw_reports(fleet, logs, engine):
                note(fault)
        finally:
            engine.close()


def serve_catalog(
    folder: Path, *, where: str = "", port: int = 0, engine: Engine | None = None
) -> None:
    """Serve the recordings below a folder until interrupted; a fleet's are drawn first.

    `engine`: closed at the end; None draws here, one after another.
    """
    require_rerun()
    draw_lacking(folder, where, engine or make_engine())
    paths = recordings_of(folder, where)
    name = folder.expanduser().resolve().name or "runs"
    with served(paths, name, port) as server:
        count = segments(server, name)
        url = server.url()
        answer({"url": url, "dataset": name, "recordings": len(paths), "served": count})
        if count is None:
            note(QUERIES)
        elif count < len(paths):
            note(f"{len(paths) - count} of {len(paths)} are copies of others, or cannot be read")
        there = path_from_here(folder.expanduser().resolve())
        print(f"{len(paths)} recordings of {there} at {url} (this machine only)", flush=True)
        print(f"\n    rerun {url}\n\nCtrl-C ends it.", flush=True)
        while server.is_running():
            time.sleep(INTERRUPT_EVERY_S)
