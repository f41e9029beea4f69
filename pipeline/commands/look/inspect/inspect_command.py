"""`auvid inspect`: the recording of a campaign or a raw log in the Rerun viewer."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from auvid.data_schemas.errors import LogError, PipelineError, UsageError, nearest
from auvid.pipeline.commands.check.log_page import LogPage, log_pages, names_campaign
from auvid.pipeline.commands.look.inspect import rerun_viewer as viewer
from auvid.pipeline.commands.open_run import open_run
from auvid.pipeline.commands.run.run_command import write_deferred_report
from auvid.pipeline.execution.runner import Place, Run
from auvid.pipeline.graph import ONCE
from auvid.pipeline.output import note
from auvid.pipeline.store.atomic_files import write_output
from auvid.pipeline.store.pipes import saved_pieces
from auvid.pipeline.terminal import path_from_here, plain

RECORDING = ".rrd"
MEMORY_PER_BYTE = 6.0
"""Memory that decoding and drawing a log takes, per byte of it: decoding takes 3.9
(DataFlash) and 4.4 (telemetry) on logs of 38 MB.
"""


@dataclass(frozen=True)
class Subject:
    """What is inspected: its name, its recording, and a preview quick to draw."""

    name: str
    content: Callable[[], bytes]
    preview: Callable[[], bytes]
    file: Path | None = None


def inspect(
    target: str,
    *,
    log: str | None = None,
    columns: Path | None = None,
    save: Path | None = None,
    picture: Path | None = None,
    web: bool = False,
    preview: bool = False,
    tab: str = "",
) -> None:
    """Open the recording of a campaign, of one of its logs, or of a log file.

    A target may also be a recording itself; a `preview` is thinned and quick to draw.

    Raises `PipelineError` where there is nothing to show, or nothing to show it with.
    """
    viewer.require_rerun()
    subject = find_subject(target, log=log, columns=columns, tab=tab)
    if preview:
        subject = Subject(subject.name, subject.preview, subject.preview)
    if save is not None:
        check_suffix(save, RECORDING, "--save")
        content = subject.content()
        write_output(save, content)
        print(f"{path_from_here(save.resolve())}  {len(content) / 1e6:.1f} MB")
    if picture is not None:
        check_suffix(picture, ".png", "--screenshot")
        content = photograph(subject.preview())
        write_output(picture, content)
        print(f"{path_from_here(picture.resolve())}  {len(content) / 1e3:.0f} kB")
    if save is not None or picture is not None:
        return
    viewer.program()
    if not web:
        viewer.require_display(subject.name)
    path = subject.file or _temporary_file(subject)
    print(f"{plain(subject.name)}: {path_from_here(path)}")
    if web:
        viewer.serve(path)
    else:
        viewer.show(path)


def find_subject(
    target: str, *, log: str | None = None, columns: Path | None = None, tab: str = ""
) -> Subject:
    """Return what a target is. Raises `PipelineError` where it cannot be shown."""
    path = Path(target).expanduser()
    if path.suffix == RECORDING:
        if not path.is_file():
            raise PipelineError("the recording is not there", value=str(path))
        viewer.verify(path)
        return Subject(path.name, path.read_bytes, path.read_bytes, path)
    if log is None and names_campaign(target):
        return campaign_subject(open_run(target), tab)
    if not names_campaign(target):
        _check_memory(path)
    return log_subject(_page_of_log(log_pages(target, columns), log, target), tab)


def campaign_subject(run: Run, tab: str = "") -> Subject:
    """Return the recording of a campaign's run, with a note if it is stale."""
    stage = run.graph.stage("report")
    remedy = (
        f"auvid run {run.campaign.name}; or look at a raw log: auvid inspect {run.campaign.name}"
        " --log ID."
    )
    write_deferred_report(run)
    producer = run.graph.producers("recording")[0]
    artefact = run.artefacts_of(producer, ONCE).get(None)
    if artefact is None or not artefact.path.is_file():
        raise PipelineError("there is no recording yet", value=run.campaign.name, remedy=remedy)
    task = run.task(stage, Place(ONCE))
    if not run.is_fresh(task):
        note(f"the recording is not up to date: auvid run {run.campaign.name}")

    def draw(preview: bool) -> bytes:
        from auvid.stages import report

        inputs = report.Inputs(**{name: source.load() for name, source in task.sources.items()})
        content = report.collect(inputs)
        save = partial(
            report.render_recording, inputs, task.params, content, preview=preview, tab=tab
        )
        return b"".join(saved_pieces(save))

    if tab:
        return Subject(run.campaign.name, lambda: draw(False), lambda: draw(True))
    artefact.load()  # refuses one that is not as it was written
    return Subject(run.campaign.name, artefact.load, lambda: draw(True), artefact.path)


def log_subject(page: LogPage, tab: str = "") -> Subject:
    """Return the recording of a raw log. Raises `LogError` where it was refused."""
    if page.outputs is None or page.health is None:
        raise LogError(plain(page.refused))
    outputs, health = page.outputs, page.health

    def draw(preview: bool) -> bytes:
        from auvid.stages.report.recording.log_recording import record_log

        return record_log(
            page.name,
            page.streams,
            outputs.log_info,
            health,
            page.legs,
            preview=preview,
            tab=tab,
        )

    return Subject(page.name, lambda: draw(False), lambda: draw(True))


def photograph(content: bytes) -> bytes:
    """Return a picture of how a recording opens, as PNG."""
    with tempfile.TemporaryDirectory(prefix="auvid_") as folder:
        path = Path(folder) / f"picture{RECORDING}"
        path.write_bytes(content)
        return viewer.picture(path)


def _page_of_log(pages: list[LogPage], log: str | None, target: str) -> LogPage:
    if log is None:
        return pages[0]
    by_log = {page.name.rpartition(": ")[2]: page for page in pages}
    if log not in by_log:
        raise UsageError(
            "no such log", file=target, value=log, allowed=list(by_log), remedy=nearest(log, by_log)
        )
    return by_log[log]


def _check_memory(path: Path) -> None:
    """Raise `LogError` for a log that memory cannot hold."""
    if not path.is_file():
        return  # the reader says what is wrong with it
    size, memory = path.stat().st_size, os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    if MEMORY_PER_BYTE * size > memory:
        raise LogError(
            f"the log has {size / 1e9:.1f} GB: to draw it whole takes about"
            f" {MEMORY_PER_BYTE * size / 1e9:.0f} GB of memory",
            file=path,
            allowed=f"{memory / MEMORY_PER_BYTE / 1e9:.1f} GB on this machine",
            remedy=(
                "Write a campaign with short legs of it: auvid run reads it once, and auvid inspect"
                " CAMPAIGN shows the legs."
            ),
        )


def check_suffix(path: Path, suffix: str, option: str) -> None:
    """Raise `UsageError` for a file name with another suffix than its content."""
    if path.suffix != suffix:
        raise UsageError(f"the name does not end in {suffix}", field=option, value=str(path))


def _temporary_file(subject: Subject) -> Path:
    """Write the recording to a file that outlives this program, for the viewer."""
    handle, name = tempfile.mkstemp(prefix="auvid_", suffix=RECORDING)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(subject.content())
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise
    return Path(name)
