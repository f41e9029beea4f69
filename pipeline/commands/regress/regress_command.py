"""Compare results of a campaign with its golden tables and figures; renew these.

New golden content comes with a line in the changelog.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any

from auvid.data_schemas.errors import DataError, PipelineError, UsageError
from auvid.pipeline.campaigns.workspace import workspace_of
from auvid.pipeline.commands.open_run import check_fresh, open_run
from auvid.pipeline.commands.regress import changelog
from auvid.pipeline.commands.regress import golden_figures as figures
from auvid.pipeline.commands.regress import golden_tables as golden
from auvid.pipeline.commands.regress.golden_figures import Figures
from auvid.pipeline.commands.regress.golden_tables import Departure, Tables
from auvid.pipeline.execution.runner import Run
from auvid.pipeline.graph import ONCE, select
from auvid.pipeline.output import answer, note
from auvid.pipeline.store.atomic_files import REMEDIES, TEMPORARY, sync_folder, write_atomically
from auvid.pipeline.terminal import path_from_here, table
from auvid.stages.reference_check import Tolerance
from auvid.stages.registry import STAGES

DEFAULT_TOLERANCES = "default_tolerances.yaml"
MOST_ROWS = 20


@dataclass(frozen=True)
class Setting:
    """What is compared: a run's tables and figures, golden folder, changelog."""

    campaign: str
    folder: Path
    changelog: Path
    tables: Tables
    figures: Figures = field(default_factory=dict)
    not_run: tuple[str, ...] = ()


def open_setting(campaign: str, baseline: Path | None) -> Setting:
    """Return the results of a campaign's run and where its golden content is.

    Unless a folder is given: `tests/golden/<campaign>` of the workspace, else `golden`
    in the campaign's folder. Stages behind the error tables need not have run. Raises
    `PipelineError` where others have not, or results are not up to date.
    """
    run = open_run(campaign)
    root = workspace_of(campaign).root
    folder = (
        baseline.expanduser() if baseline is not None else default_folder(root, run.campaign.folder)
    )
    tables, stages = error_tables(run), figures.stages_of(run)
    not_run = tuple(
        stage.name for stage in stages if tables and not run.manifests[stage.name].records
    )
    check_fresh(run, [stage for stage in stages if stage.name not in not_run])
    return Setting(
        run.campaign.name,
        folder,
        root / changelog.FILE,
        tables,
        figures.figures_of(run, without=figures.left_out(folder)),
        not_run,
    )


def default_folder(root: Path, campaign: Path) -> Path:
    """Return the folder for the golden tables of a campaign."""
    shared, own = root / "tests" / "golden" / campaign.name, campaign / "golden"
    return next(
        (folder for folder in (shared, own) if folder.is_dir()),
        shared if shared.parent.is_dir() else own,
    )


def error_tables(run: Run) -> Tables:
    """The golden tables of a run; none for a campaign whose kind has no error table."""
    producers = run.graph.producers("error_table")
    if not producers:
        return {}
    check_fresh(run, select(run.graph, until=producers[0].stage.name))
    artefact = next(iter(run.artefacts_of(producers[0], ONCE).values()))
    return golden.tables_of(artefact.load().to_pylist())


def check(setting: Setting) -> bool:
    """Print whether all holds, or every cell that does not; True if all holds."""
    old, old_figures = golden.read_tables(setting.folder), figures.read_figures(setting.folder)
    if not old and not any(old_figures.values()):
        remedy = f'Make them: auvid regress {setting.campaign} --update --message "STAGE: why"'
        raise DataError("there are no golden tables", file=setting.folder, remedy=remedy)
    columns = golden.columns_of(old, setting.tables)
    tolerances = (
        golden.read_tolerances(setting.folder / golden.TOLERANCES, columns) if columns else {}
    )
    within, departures = golden.compare(old, setting.tables, tolerances)
    if setting.not_run:
        names = ", ".join(setting.not_run)
        note(f"not run, and not compared: {names}")
    ran = figures.without(old_figures, setting.not_run)
    more, moved = figures.compare(ran, setting.figures)
    answer(_document(setting, within + more, departures, moved))
    _print(setting, within + more, departures, moved)
    return not departures and not moved


def _document(
    setting: Setting, within: int, departures: Sequence[Departure], moved: Sequence[Departure]
) -> dict[str, Any]:
    return {
        "campaign": setting.campaign,
        "baseline": str(setting.folder),
        "holds": not departures and not moved,
        "held": within,
        "first_change": figures.first_change(moved) or None,
        "departures": [item.document for item in departures],
        "figures": [item.document for item in moved],
    }


def _print(
    setting: Setting, within: int, departures: Sequence[Departure], moved: Sequence[Departure]
) -> None:
    where = path_from_here(setting.folder.resolve())
    if not departures and not moved:
        print(f"{setting.campaign}: all {within} cells hold ({where})")
        return
    unmatched = [item for item in departures if item.check is None]
    for item in unmatched:
        print(_without_partner(item))
    heads, rows = golden.departure_rows(departures)
    table(heads, rows)
    for item in moved[:MOST_ROWS]:
        print(_moved(item))
    if len(moved) > MOST_ROWS:
        print(f"and {len(moved) - MOST_ROWS} more figures (all: --json)")
    cells = len(rows) + len(moved)
    counts = f"{cells} of {cells + within} cells left their tolerance"
    counts += f", {len(unmatched)} missing or new" if unmatched else ""
    if moved:
        print(f"\nfirst changed: {figures.first_change(moved)}")
    print(f"\n{setting.campaign}: {counts} ({where})")
    print(
        f'If this is meant: auvid regress {setting.campaign} --update --message "STAGE: what'
        ' changed and why"'
    )


def _moved(item: Departure) -> str:
    """Return a golden figure that left its tolerance, on one line."""
    place = f"{item.stage}, {item.model}: {item.column}"
    if item.check is None:
        return f"{place}: " + (
            "in the baseline, not in the run"
            if item.kind == "missing"
            else "in the run, not in the baseline"
        )
    cells = item.check.cells
    name = "" if item.check.quantity == item.column else f" ({item.check.quantity})"
    words = f"{place}{name}: {cells['reference']} -> {cells['measured']} {cells['unit']}".rstrip()
    return words + (f", {cells['status']}" if cells["status"] else "")


def _without_partner(item: Departure) -> str:
    what = f"{item.use} tables" if item.model is None else f"{item.use}: model {item.model}"
    what += f": axis {item.column}" if item.column is not None else ""
    if item.kind == "missing":
        return f"{what}: in the baseline, not in the run"
    return f"{what}: in the run, not in the baseline"


def update(setting: Setting, message: str) -> None:
    """Write golden tables and the changelog's message: all of them or nothing.

    The message goes to the entries of the stage that it begins with (`fuse: why`), else
    of the one whose results moved the tables. Raises `PipelineError` for an empty
    message, or a changelog without a heading for the current version.
    """
    words = " ".join(message.split())
    if not words:
        raise UsageError(
            "the message is empty",
            field="--message",
            remedy="Say what changed and why; it goes into the changelog.",
        )
    old = _old_tables(setting.folder)
    contents: dict[Path, bytes | None] = {
        setting.folder / f"{use}.csv": golden.to_csv(table) for use, table in setting.tables.items()
    }
    contents |= {
        setting.folder / f"{use}.csv": None for use in golden.USES if use not in setting.tables
    }
    if setting.not_run:
        raise PipelineError(
            "not all stages have been run",
            field="--update",
            value=", ".join(setting.not_run),
            remedy=f"auvid run {setting.campaign}",
        )
    for name in figures.FILES:
        rows = setting.figures.get(name)
        contents[setting.folder / f"{name}.csv"] = figures.to_csv(rows) if rows else None
    tolerances = setting.folder / golden.TOLERANCES
    if not setting.tables:
        contents[tolerances] = None
    elif tolerances.is_file():
        golden.read_tolerances(tolerances, golden.columns_of(setting.tables))
    else:
        contents[tolerances] = (resources.files(__package__) / DEFAULT_TOLERANCES).read_bytes()
    changed = {
        path: content
        for path, content in contents.items()
        if content != (path.read_bytes() if path.is_file() else None)
    }
    if changed:
        stage, words, note = _entry(setting, old, words)
        changed[setting.changelog] = changelog.with_entry(
            setting.changelog, stage, f"{words} ({note})"
        )
        write_together(changed)
    paths = [path_from_here(path.resolve()) for path in changed]
    answer({"campaign": setting.campaign, "baseline": str(setting.folder), "written": paths})
    print(
        "\n".join(f"written: {path}" for path in paths)
        or f"{setting.campaign}: the golden tables are the same, nothing is written"
    )


def _old_tables(folder: Path) -> Tables | None:
    """Return the golden tables to be replaced; None if there is nothing to read."""
    try:
        some = any(figures.read_figures(folder).values())
        return golden.read_tables(folder) or ({} if some else None)
    except PipelineError:
        return None


def _entry(setting: Setting, old: Tables | None, words: str) -> tuple[str, str, str]:
    """Stage, message without the stage, and which tables the line is about.

    The stage is the one that moved first. Where there are tables alone: J0 holds no
    model, so if it moved, the residual force did; all else moves with the fit.
    """
    match = re.match(r"([a-z_]+)\s*:\s*(\S.*)", words)
    named = match if match and match[1] in {stage.name for stage in STAGES} else None
    _, moved_figures = figures.compare(figures.read_figures(setting.folder), setting.figures)
    if old is None:
        stage, note = "validate", f"golden tables of {setting.campaign} made"
    else:
        exact = {name: Tolerance() for name in golden.columns_of(old, setting.tables)}
        _, moved = golden.compare(old, setting.tables, exact)
        stage = "residual" if any(item.column == "J0" for item in moved) else "synthesise"
        if moved_figures:
            stage = moved_figures[0].stage
        cells = sum(item.check is not None for item in moved) + len(moved_figures)
        note = f"golden tables of {setting.campaign}: {cells} cell{'s' * (cells != 1)} changed"
    return (named[1], named[2], note) if named else (stage, words, note)


def write_together(contents: Mapping[Path, bytes | None]) -> None:
    """Write several files, or remove those whose content is None.

    All are new or all stay. Raises `PipelineError`.

    All contents are on the disk under temporary names before the first file is
    replaced; a replacement that fails is taken back.
    """
    parts: dict[Path, Path] = {}
    try:
        for path, content in contents.items():
            if content is not None:
                path.parent.mkdir(parents=True, exist_ok=True)
                parts[path] = path.with_name(f".{path.name}.{os.getpid()}{TEMPORARY}")
                _write_through(parts[path], content)
        _replace_all(contents, parts)
    except OSError as fault:
        words = f"cannot be written: {fault.strerror or fault}; nothing is changed"
        raise PipelineError(
            words, file=fault.filename2 or fault.filename, remedy=REMEDIES.get(fault.errno or 0)
        ) from fault
    finally:
        for part in parts.values():
            part.unlink(missing_ok=True)
    for folder in {path.parent for path in contents if path.parent.is_dir()}:
        sync_folder(folder)


def _write_through(path: Path, content: bytes) -> None:
    with path.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())


def _replace_all(contents: Mapping[Path, bytes | None], parts: Mapping[Path, Path]) -> None:
    before = {path: path.read_bytes() if path.exists() else None for path in contents}
    done: list[Path] = []
    try:
        for path, content in contents.items():
            if content is None:
                path.unlink(missing_ok=True)
            else:
                parts[path].replace(path)
            done.append(path)
    except BaseException:
        for path in done:
            old = before[path]
            if old is None:
                path.unlink(missing_ok=True)
            else:
                write_atomically(path, old)
        raise
