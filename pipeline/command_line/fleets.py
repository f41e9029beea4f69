"""Commands over many dives: fleet run, report, pool and find."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from auvid.pipeline.collector import kept_for_good
from auvid.pipeline.command_line.application import app
from auvid.pipeline.command_line.arguments import (
    EngineName,
    Force,
    JobCount,
    Scheduler,
    WorkerMemory,
)
from auvid.pipeline.output import (
    RUNNING,
    Command,
    Commands,
    answer,
    answering,
)

if TYPE_CHECKING:
    pass


fleet = typer.Typer(cls=Commands)
app.add_typer(
    fleet,
    name="fleet",
    rich_help_panel=RUNNING,
    help="Run a disk of dives, and say what they agree on.",
    epilog="Example: auvid fleet run /media/dives --out fleet",
)
FleetName = Annotated[
    Path, typer.Argument(metavar="FLEETDIR", help="Folder that auvid fleet run has written.")
]


@fleet.command(
    "run",
    cls=Command,
    rich_help_panel=RUNNING,
    epilog="Example: auvid fleet run /media/dives --out fleet --jobs 2",
)
@answering
def fleet_run(
    disk: Annotated[
        Path,
        typer.Argument(
            metavar="DIR|LIST", help="Folder with logs in it and below, or a text file of paths."
        ),
    ],
    out: Annotated[
        Path, typer.Option(metavar="FLEETDIR", help="Folder for all that is made.")
    ] = Path("fleet"),
    vehicle: Annotated[
        list[str] | None,
        typer.Option(
            metavar="[PATTERN=]NAME",
            help=(
                "Vehicle, by name or file, of all logs or of those whose path matches; may be"
                " repeated. (default: the one that each log names)"
            ),
        ),
    ] = None,
    engine: EngineName = None,
    jobs: JobCount = None,
    scheduler: Scheduler = None,
    memory: WorkerMemory = None,
    reports: Annotated[
        bool,
        typer.Option(
            "--reports", help="Draw page and recording of each dive now, not when asked for."
        ),
    ] = False,
    force: Force = False,
) -> None:
    """Run every log of a disk as far as it goes; only new and changed ones run again.

    Each log ends as done, partly or refused, with the reason. Nothing is written beside
    the logs. auvid report, inspect and catalog draw a dive when they are asked for it.

    Exit codes: 0 all done; 1 none is done, or the call cannot be followed; 2 wrong use;
    3 some logs are not done; 130 interrupted, what was finished is kept.
    """
    from auvid.pipeline.execution.engines import LOGS, make_engine

    workers = make_engine(engine, jobs, scheduler=scheduler, memory=memory, preload=LOGS)
    # Imported after it, since it takes a second, in which the workers import as much.
    with kept_for_good():
        from auvid.pipeline.commands.fleet.fleet_run import print_fleet_run

    raise typer.Exit(
        print_fleet_run(
            disk, out, vehicles=vehicle or (), engine=workers, reports=reports, force=force
        )
    )


@fleet.command(
    "report",
    cls=Command,
    rich_help_panel=RUNNING,
    epilog="Example: auvid fleet report fleet --open",
)
@answering
def fleet_report(
    folder: FleetName = Path("fleet"),
    open_it: Annotated[
        bool, typer.Option("--open", help="Open the report in the browser.")
    ] = False,
    by_name: Annotated[
        bool,
        typer.Option(
            "--by-name", help="Names of files are in order of time, where logs have no clock."
        ),
    ] = False,
) -> None:
    """Write the page of a fleet, and print its path and those of its tables.

    Which dives are usable for what, states and reasons, findings, coefficients dive by
    dive with what they agree on, outlying dives and changes.
    """
    with kept_for_good():
        from auvid.pipeline.commands.fleet.fleet_folder import TABLES, open_fleet
        from auvid.pipeline.commands.fleet.report.fleet_page import write_page

    place = open_fleet(folder)
    write_page(place, by_name=by_name)
    print(place.page)
    answer({"report": place.page, "tables": {name: place.table(name) for name in TABLES}})
    if open_it:
        typer.launch(place.page.as_uri())


@fleet.command(
    "pool",
    cls=Command,
    rich_help_panel=RUNNING,
    epilog="Example: auvid fleet pool bluerov2_heavy --in fleet",
)
@answering
def fleet_pool(
    vehicle: Annotated[
        str | None,
        typer.Argument(metavar="VEHICLE", help="Vehicle, where the fleet has several."),
    ] = None,
    fleet_folder: Annotated[
        Path, typer.Option("--in", metavar="FLEETDIR", help="Folder of the fleet.")
    ] = Path("fleet"),
    name: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Name of the campaign. (default: VEHICLE_dives)"),
    ] = None,
    since: Annotated[
        str | None,
        typer.Option(metavar="LOG", help="First dive that counts, as after a change."),
    ] = None,
) -> None:
    """Write one campaign of all dives of a vehicle: one model of all.

    auvid run then fits each model to the training legs of all dives together, leaves out
    one part of them at a time, and writes report and model files as of any campaign.
    Dives that are not done, or whose vehicle file or settings are not those of most, are
    left out and named.

    Exit codes: 0 written; 1 no fleet there, fewer than two dives, or a campaign of that
    name; 2 wrong use.
    """
    from auvid.pipeline.commands.fleet.pooled_campaign import print_pooled_campaign

    raise typer.Exit(print_pooled_campaign(fleet_folder, vehicle, name=name, since=since))


@fleet.command(
    "find",
    cls=Command,
    rich_help_panel=RUNNING,
    epilog='Example: auvid fleet find "surge = identified and J/J0 < .5"',
)
@answering
def fleet_find(
    expression: Annotated[
        str,
        typer.Argument(
            metavar="EXPRESSION", help="Comparisons of fields of a run, joined by and, or, not."
        ),
    ],
    fleet_folder: Annotated[
        Path, typer.Option("--in", metavar="FLEETDIR", help="Folder of the fleet.")
    ] = Path("fleet"),
) -> None:
    """Print the logs of a fleet of which an expression holds.

    Fields are the columns of table runs (J/J0, surge, state, vehicle, ...), and
    coefficients of the recommended model as X_u.

    Exit codes: 0 some; 1 none, or no fleet there; 2 wrong use.
    """
    from auvid.pipeline.commands.fleet.queries.find_command import print_matches

    raise typer.Exit(print_matches(fleet_folder, expression))
