"""Commands that look at runs, serve their recordings and compare them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from auvid.pipeline import completion
from auvid.pipeline.command_line.application import app
from auvid.pipeline.command_line.arguments import (
    CampaignName,
    EngineName,
    Force,
    JobCount,
    RunName,
    Screenshot,
)
from auvid.pipeline.output import (
    COMPARING,
    FAILED,
    LOOKING,
    Command,
    answering,
)

if TYPE_CHECKING:
    pass


@app.command(
    cls=Command, rich_help_panel=LOOKING, epilog="Example: auvid inspect dive.BIN --save dive.rrd"
)
def inspect(
    target: Annotated[
        str,
        typer.Argument(
            metavar="CAMPAIGN|LOG",
            help="A campaign that has been run, a log file, or a recording (.rrd).",
            autocompletion=completion.runs,
        ),
    ],
    log: Annotated[
        str | None, typer.Option(metavar="ID", help="This raw log of the campaign, with its legs.")
    ] = None,
    columns: Annotated[
        Path | None, typer.Option(metavar="MAP.yaml", help="Column map of a CSV log.")
    ] = None,
    save: Annotated[
        Path | None, typer.Option(metavar="FILE.rrd", help="Write the recording and open nothing.")
    ] = None,
    screenshot: Screenshot = None,
    web: Annotated[
        bool, typer.Option("--web", help="Serve it to a browser on this machine.")
    ] = False,
    tab: Annotated[
        str,
        typer.Option(
            metavar="TAB", help="Open on this tab, as State, or on a leg in it, as Answer/LEG."
        ),
    ] = "",
    preview: Annotated[
        bool,
        typer.Option(
            "--preview", help="Thin long series by minimum and maximum: small and quick to draw."
        ),
    ] = False,
) -> None:
    """Look at a campaign's run or at a raw log in the Rerun viewer."""
    from auvid.pipeline.commands.look.inspect import inspect_command

    inspect_command.inspect(
        target,
        log=log,
        columns=columns,
        save=save,
        picture=screenshot,
        web=web,
        preview=preview,
        tab=tab,
    )


@app.command(
    cls=Command, rich_help_panel=LOOKING, epilog="Example: auvid history bluerov2_dvl --run 1"
)
@answering
def history(
    campaign: RunName,
    number: Annotated[
        int | None,
        typer.Option(
            "--run",
            metavar="N",
            help="Show this run in full.",
            autocompletion=completion.run_numbers,
        ),
    ] = None,
    csv: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Write a row per run, a column per parameter and figure."
        ),
    ] = None,
) -> None:
    """List the earlier runs of a campaign: changes and the model to take."""
    from auvid.pipeline.commands.history import history_page

    history_page.show(campaign, number=number, csv=csv)


@app.command(
    cls=Command,
    rich_help_panel=LOOKING,
    epilog='Example: auvid catalog fleet --where "surge = identified and J/J0 < .5"',
)
@answering
def catalog(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="A fleet, a workspace, or a folder of recordings.")
    ],
    where: Annotated[
        str,
        typer.Option(
            metavar="EXPRESSION", help="Only those of a fleet that auvid fleet find finds."
        ),
    ] = "",
    port: Annotated[int, typer.Option(metavar="N", help="Port. (default: a free one)")] = 0,
    jobs: Annotated[
        int,
        typer.Option(metavar="N", help="Processes that draw recordings which are not there yet."),
    ] = 1,
) -> None:
    """Serve the recordings of all runs to the Rerun viewer of this machine.

    Those of a fleet are drawn first, where none has asked for them before. Each has typed
    properties: vehicle, best model, J/J0, verdicts by axis.
    """
    from auvid.pipeline.commands.fleet.queries.catalog_command import serve_catalog
    from auvid.pipeline.execution.engines import make_engine

    serve_catalog(folder, where=where, port=port, engine=make_engine(None, jobs))


@app.command(
    cls=Command,
    rich_help_panel=COMPARING,
    epilog="Example: auvid diff bluerov2_dvl bluerov2_dvl@fuse.cutoff_hz=0.8 --save cutoff.rrd",
)
@answering
def diff(
    first: Annotated[
        str,
        typer.Argument(
            metavar="A",
            help="Campaign, run folder or golden folder; @MODEL, @RUN or @STAGE.PARAMETER=VALUE.",
            autocompletion=completion.run_or_model,
        ),
    ],
    second: Annotated[
        str,
        typer.Argument(
            metavar="B",
            help="What A is compared with, written likewise.",
            autocompletion=completion.run_or_model,
        ),
    ],
    save: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.rrd",
            help="Write the recording: both runs overlaid, and their difference.",
        ),
    ] = None,
    screenshot: Screenshot = None,
    relative: Annotated[
        float,
        typer.Option(
            metavar="SHARE",
            min=0.0,
            help=(
                "Signals and coefficients may move by this share; error tables by their own"
                " tolerances."
            ),
        ),
    ] = 1e-6,
) -> None:
    """Compare two runs, a run with its golden tables, two variants or two models.

    Exits with 1 if anything left its tolerance.
    """
    from auvid.pipeline.commands.look.diff import diff_command

    if not diff_command.diff(first, second, save=save, picture=screenshot, relative=relative):
        raise typer.Exit(FAILED)


@app.command(
    cls=Command,
    rich_help_panel=COMPARING,
    epilog='Example: auvid regress bluerov2_dvl --update --message "fuse: lag corrected"',
)
@answering
def regress(
    campaign: RunName,
    baseline: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help=(
                "Folder of golden tables. (default: tests/golden/CAMPAIGN, else golden in the"
                " campaign's folder)"
            ),
        ),
    ] = None,
    update: Annotated[
        bool, typer.Option("--update", help="Write the golden tables again; needs --message.")
    ] = False,
    message: Annotated[
        str | None,
        typer.Option(
            metavar="TEXT", help="For the changelog: 'STAGE: what changed and why'; needs --update."
        ),
    ] = None,
) -> None:
    """Compare the error tables with the golden ones.

    Exits with 1 and names every cell that left its tolerance.
    """
    if update != (message is not None):
        raise typer.BadParameter(
            "--update and --message go together: a changed baseline goes into the changelog"
        )
    from auvid.pipeline.commands.regress import regress_command

    setting = regress_command.open_setting(campaign, baseline)
    if message is not None:
        regress_command.update(setting, message)
    elif not regress_command.check(setting):
        raise typer.Exit(FAILED)


@app.command(cls=Command, rich_help_panel=COMPARING, epilog="Example: auvid reproduce vt690_twin")
@answering
def reproduce(
    campaign: CampaignName,
    engine: EngineName = None,
    jobs: JobCount = None,
    force: Force = False,
    open_it: Annotated[bool, typer.Option("--open", help="Open the page in the browser.")] = False,
) -> None:
    """Compare published tables with those of a twin, on a page.

    A campaign with `published` in its manifest is run, and its results are printed
    with the published values. Exits with 1 if a bound is missed without a reason given.
    """
    from auvid.pipeline.commands.open_run import show_progress
    from auvid.pipeline.commands.reproduce import printed_values, reproduce_command
    from auvid.pipeline.commands.run.run_command import execute
    from auvid.pipeline.commands.run.run_summary import result_files
    from auvid.pipeline.execution.engines import make_engine

    printed = printed_values.open_comparison(campaign)
    if printed is not None:
        execute(printed, printed.graph.stages, engine=make_engine(engine, jobs), force=force)
        met = printed_values.print_comparison(printed)
        page = result_files(printed).get("report")
    else:
        reproduction = reproduce_command.open_reproduction(campaign)
        with show_progress() as progress:
            done = reproduce_command.reproduce(
                reproduction, make_engine(engine, jobs), progress, force=force
            )
        reproduce_command.print_tables(done)
        met, page = not done.missed, done.page
    if open_it and page is not None:
        typer.launch(page.resolve().as_uri())
    if not met:
        raise typer.Exit(FAILED)
