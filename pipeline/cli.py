"""The command line: signatures and help of the commands.

Heavy modules are imported by the command that needs them, so that help and refusals
are quick.
"""

from __future__ import annotations

import io
import os
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from auvid import __version__
from auvid.data_schemas.errors import PipelineError, UsageError
from auvid.pipeline import completion, output
from auvid.pipeline.output import (
    COMPARING,
    FAILED,
    LISTING,
    LOOKING,
    LOSSES,
    OUTPUT,
    RUNNING,
    TWINS,
    USING,
    WRONG_USE,
    Command,
    Commands,
    answer,
    answering,
    note,
)
from auvid.pipeline.terminal import plain_lines

if TYPE_CHECKING:
    from typer._click.core import Context

app = typer.Typer(
    name="auvid",
    cls=Commands,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
)


def _print_version(asks: bool) -> None:
    if asks:
        print(f"auvid {__version__}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version and exit."
        ),
    ] = False,
) -> None:
    """From field logs of underwater vehicles to identified hydrodynamic models."""


CampaignName = Annotated[
    str,
    typer.Argument(
        metavar="CAMPAIGN",
        help="Name of a folder under campaigns/, or a path to one or to its campaign.yaml.",
        autocompletion=completion.campaigns,
    ),
]
RunName = Annotated[
    str,
    typer.Argument(
        metavar="CAMPAIGN",
        help="A campaign that has been run, by name or path.",
        autocompletion=completion.runs,
    ),
]

EngineName = Annotated[
    str | None,
    typer.Option(
        metavar="serial|processes|dask",
        help="Where items run; results are the same. (default: serial)",
        autocompletion=lambda: ["serial", "processes", "dask"],
    ),
]
JobCount = Annotated[
    int | None, typer.Option(metavar="N", help="How many processes. (default: one per core)")
]
Scheduler = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        help="Dask: run on the workers of this scheduler, as tcp://HOST:8786. (default: workers"
        " on this machine)",
    ),
]
WorkerMemory = Annotated[
    str | None,
    typer.Option(
        metavar="SIZE",
        help="Dask: memory of each worker on this machine, as 1.2GB; one that takes more is"
        " started anew. (default: its share)",
    ),
]
ExchangeURL = Annotated[
    str | None,
    typer.Option(
        metavar="URL",
        help="Dask: where files go that workers need and make if they share no folder with"
        " this machine, as s3://bucket/folder.",
    ),
]
Force = Annotated[bool, typer.Option("--force", help="Run again what is up to date.")]
Screenshot = Annotated[
    Path | None, typer.Option(metavar="FILE.png", help="Write a picture of how it opens.")
]


@app.command(
    cls=Command, rich_help_panel=RUNNING, epilog="Example: auvid run bluerov2_dvl --until fuse"
)
@answering
def run(
    campaign: CampaignName,
    only: Annotated[
        str | None,
        typer.Option(
            metavar="STAGE",
            help="Run only this stage, on the results of the others.",
            autocompletion=completion.stages,
        ),
    ] = None,
    until: Annotated[
        str | None,
        typer.Option(
            metavar="STAGE",
            help="Run this stage and all that it needs.",
            autocompletion=completion.stages,
        ),
    ] = None,
    strict: Annotated[
        bool,
        typer.Option("--strict", help="Exit with 3 if a log was damaged or samples were rejected."),
    ] = False,
    engine: EngineName = None,
    jobs: JobCount = None,
    scheduler: Scheduler = None,
    memory: WorkerMemory = None,
    exchange: ExchangeURL = None,
    force: Force = False,
) -> None:
    """Run a campaign: only what is stale runs.

    A run stops behind stage ingest where findings of the logs speak against it
    (auvid check CAMPAIGN ends with the same code).

    Exit codes: 0 fine; 1 a log cannot be read, findings stop the run, a
    stage fails, or a twin misses a bound of its campaign; 2 wrong use;
    3 losses, with --strict; 130 interrupted.
    """
    from auvid.pipeline.execution.kept_output import printed_before

    chosen = engine or jobs or scheduler or memory or exchange
    if not (only or until or chosen or force or OUTPUT.quiet or OUTPUT.verbose):
        printed = printed_before(campaign, strict=strict)
        if printed is not None:
            print(printed.text, end="")
            answer(printed.answer)
            raise typer.Exit(printed.status)
    from auvid.pipeline.commands.run.run_command import run_campaign
    from auvid.pipeline.execution.engines import make_engine

    status = run_campaign(
        campaign,
        only=only,
        until=until,
        strict=strict,
        engine=make_engine(engine, jobs, scheduler=scheduler, memory=memory, exchange=exchange),
        force=force,
    )
    raise typer.Exit(status)


@app.command(
    cls=Command, rich_help_panel=RUNNING, epilog="Example: auvid report bluerov2_dvl --open"
)
@answering
def report(
    campaigns: Annotated[
        list[str],
        typer.Argument(
            metavar="CAMPAIGN...",
            help="A campaign; or several, or runs of one as CAMPAIGN@N, on one page.",
            autocompletion=completion.runs,
        ),
    ],
    rebuild: Annotated[
        bool, typer.Option("--rebuild", help="Write the report again from the artefacts.")
    ] = False,
    open_it: Annotated[
        bool, typer.Option("--open", help="Open the report in the browser.")
    ] = False,
    compare: Annotated[
        bool, typer.Option("--compare", help="Write a copy that compares with the run before.")
    ] = False,
    against: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="As --compare, with run N of auvid history.",
            autocompletion=completion.run_numbers,
        ),
    ] = None,
    history: Annotated[
        bool, typer.Option("--history", help="All runs of the campaign's history on one page.")
    ] = False,
) -> None:
    """Print the path of a campaign's report, rebuild it, or open it.

    Of several campaigns (or runs), write one page that sets them side by side:
    parameters that differ, error tables, coefficients with intervals, free runs.
    """
    if history or len(campaigns) > 1 or "@" in campaigns[0]:
        from auvid.pipeline.commands.history.runs_page import write_runs_page

        if rebuild or compare or against is not None or (history and len(campaigns) > 1):
            raise UsageError(
                "these options are of the report of one campaign",
                value=" ".join(campaigns),
                remedy="auvid report A B C, or auvid report CAMPAIGN --history",
            )
        page = write_runs_page(campaigns, whole_history=history)
    else:
        from auvid.pipeline.commands.run.run_command import report_file

        page = report_file(campaigns[0], rebuild=rebuild, compare=compare, against=against)
    print(page)
    answer({"report": page})
    if open_it:
        typer.launch(page.resolve().as_uri())


@app.command(
    cls=Command, rich_help_panel=RUNNING, epilog="Example: auvid check dive.BIN dive.tlog --align"
)
@answering
def check(
    targets: Annotated[
        list[str],
        typer.Argument(
            metavar="LOG... | CAMPAIGN",
            help="Log files, or a campaign for all its logs and legs.",
            autocompletion=completion.campaigns,
        ),
    ],
    columns: Annotated[
        Path | None, typer.Option(metavar="MAP.yaml", help="Column map of CSV logs.")
    ] = None,
    html: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the page as one HTML file.")
    ] = None,
    align: Annotated[
        bool,
        typer.Option(
            "--align", help="Estimate the offset between the clocks of two logs of one dive."
        ),
    ] = False,
) -> None:
    """Check what is wrong with logs and what they can be used for.

    Exit codes: 0 fine; 1 a log cannot be read, or auvid run CAMPAIGN would
    stop at its findings; 2 wrong use; 3 losses or errors that stop no run.
    """
    from auvid.pipeline.commands.check import check_command

    raise typer.Exit(check_command.check(targets, columns=columns, html_file=html, align=align))


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
    cls=Command, rich_help_panel=LOOKING, epilog="Example: auvid history bluerov2_dvl --run 3"
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
    """List the earlier runs of a campaign: changes and the best model."""
    from auvid.pipeline.commands.history import history_page

    history_page.show(campaign, number=number, csv=csv)


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


@app.command(
    cls=Command,
    rich_help_panel=TWINS,
    epilog=(
        "Example: auvid simulate vt690 campaigns/vt690_twin/plans/short.yaml -o campaigns/my_twin"
        " --seed 3"
    ),
)
@answering
def simulate(
    vehicle: Annotated[
        str,
        typer.Argument(
            metavar="VEHICLE",
            help="Name of a vehicle, or a path to its file.",
            autocompletion=completion.vehicles,
        ),
    ],
    plan: Annotated[Path, typer.Argument(metavar="PLAN", help="Path of the plan.")],
    output_folder: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            metavar="DIR",
            help="Folder for logs, truth and campaign; new or empty.",
        ),
    ],
    log_format: Annotated[
        str, typer.Option("--format", metavar="bin|tlog|csv", help="Kind of log files.")
    ] = "bin",
    seed: Annotated[int, typer.Option(metavar="N", help="Seed of all noise.")] = 0,
    truth: Annotated[
        str,
        typer.Option(
            metavar="TRUTH",
            help=(
                "physics, the name of a model with published coefficients, refit:MODEL, or a model"
                " card."
            ),
        ),
    ] = "physics",
    accelerometer: Annotated[
        str,
        typer.Option(
            metavar="specific_force|inertial",
            help="What the accelerometer columns of CSV logs hold.",
        ),
    ] = "specific_force",
) -> None:
    """Simulate a plan: write logs, truth, and a campaign that is ready to run.

    Exits with 3 if a leg was cut short.
    """
    from auvid.pipeline.commands.simulate import write_campaign

    losses = write_campaign(
        vehicle,
        plan,
        output_folder,
        truth=truth,
        format=log_format,
        seed=seed,
        accelerometer=accelerometer,
    )
    print(f"made {output_folder}\n\n    auvid run {output_folder}\n")
    answer(
        {"folder": output_folder, "campaign": output_folder / "campaign.yaml", "cut_short": losses}
    )
    for line in losses:
        note(f"cut short: {line}")
    if losses:
        raise typer.Exit(LOSSES)


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


@app.command(cls=Command, rich_help_panel=LISTING, epilog="Example: auvid stages fuse")
@answering
def stages(
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="STAGE", help="Show only this stage.", autocompletion=completion.stages
        ),
    ] = None,
) -> None:
    """List the stages with inputs, outputs and parameters, from their declarations."""
    from auvid.pipeline.commands.list import print_stages

    print_stages(name)


@app.command(cls=Command, rich_help_panel=LISTING, epilog="Example: auvid models linear")
@answering
def models(
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="MODEL", help="Show the terms of this model.", autocompletion=completion.models
        ),
    ] = None,
) -> None:
    """List the viscous force models, from their declarations."""
    from auvid.pipeline.commands.list import print_models

    print_models(name)


@app.command(cls=Command, rich_help_panel=LISTING, epilog="Example: auvid vehicles")
@answering
def vehicles() -> None:
    """List the vehicles of this workspace and those that come with auvid."""
    from auvid.pipeline.commands.list import print_vehicles

    print_vehicles()


@app.command(
    cls=Command,
    rich_help_panel=LISTING,
    epilog="Example: auvid schema campaign > campaign.schema.json",
)
def schema(
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="DOCUMENT",
            help="campaign, vehicle, column_map ...",
            autocompletion=completion.documents,
        ),
    ] = None,
) -> None:
    """Print the JSON schema of a document, for editors; without a name, list them."""
    from auvid.pipeline.commands.list import print_schema

    print_schema(name)


@app.command(
    cls=Command, rich_help_panel=TWINS, epilog="Example: auvid coefficients hauv --set as_printed"
)
@answering
def coefficients(
    vehicle: Annotated[
        str,
        typer.Argument(
            metavar="VEHICLE",
            help="Name of a vehicle, or a path to a vehicle file with `geometry`.",
            autocompletion=completion.vehicles,
        ),
    ],
    parameter_set: Annotated[
        str,
        typer.Option(
            "--set",
            metavar="SET",
            help=(
                "corrected (errata applied), as_printed (formulas of the thesis), or as_simulated."
            ),
        ),
    ] = "corrected",
    model: Annotated[
        str | None,
        typer.Option(
            metavar="MODEL",
            help="Compare with a published model of this vehicle, for example prestero.",
        ),
    ] = None,
) -> None:
    """Print coefficients of strip theory and published ones, with their sources."""
    from auvid.pipeline.commands.model.coefficients import print_coefficients

    print_coefficients(vehicle, parameter_set=parameter_set, model=model)


@app.command(
    cls=Command,
    rich_help_panel=USING,
    epilog=(
        "Example: auvid export bluerov2_dvl --to gazebo --lossy; auvid export"
        " bluerov2_dvl/fossen --to mss --name rov; auvid export linear.json --to draws --draws 500;"
        " auvid export bluerov2_wu_2018 --to gazebo"
    ),
)
@answering
def export(
    model: Annotated[
        str,
        typer.Argument(
            metavar="MODEL",
            help=(
                "Path of a model file, CAMPAIGN for its recommended model, CAMPAIGN/MODEL, or a"
                " published set by name."
            ),
            autocompletion=completion.exportable,
        ),
    ],
    target: Annotated[
        str,
        typer.Option(
            "--to",
            metavar="TARGET",
            help=(
                "gazebo, uuv, mss, pvs, holoocean, stonefish, mujoco, sitl, python, json or draws."
            ),
            autocompletion=completion.targets,
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", metavar="DIR", help="Folder. (default: exported/NAME_TARGET)"
        ),
    ] = None,
    name: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="Name of files, functions, classes. (default: VEHICLE_MODEL)"
        ),
    ] = None,
    lossy: Annotated[
        bool,
        typer.Option(
            "--lossy", help="Write it although the target loses more than 1 % of a force."
        ),
    ] = False,
    force: Annotated[
        bool,
        typer.Option(
            "--force", help="Overwrite files, and export a model that is usable for nothing."
        ),
    ] = False,
    draws: Annotated[
        int, typer.Option(metavar="N", min=1, help="How many draws target draws writes.")
    ] = 1000,
) -> None:
    """Write a model for a simulator, and print what the simulator cannot hold.

    Exit codes: 0 written; 1 refused; 2 wrong use.
    """
    from auvid.pipeline.commands.model import export_command

    export_command.export(
        model,
        target,
        folder=output,
        file_name=name,
        lossy=lossy,
        force=force,
        draws=draws,
    )


@app.command(
    cls=Command,
    rich_help_panel=USING,
    epilog=(
        "Example: auvid score bluerov2_dvl; auvid score bluerov2_dvl --with 'bluerov2_*' --with"
        " other.json"
    ),
)
@answering
def score(
    campaign: RunName,
    others: Annotated[
        list[str],
        typer.Option(
            "--with",
            metavar="NAME",
            help=(
                "shelf (all published sets), a name of one (* stands for any letters), a vehicle"
                " file (.yaml) or a model file (.json); may be repeated."
            ),
            autocompletion=completion.shelf,
        ),
    ] = ["shelf"],  # noqa: B006
) -> None:
    """Judge published sets of coefficients, or models, on the dive of a run."""
    from auvid.pipeline.commands.model.score_command import print_score

    print_score(campaign, others)


class _New(Commands):
    """`auvid new DIR` is `auvid new workspace DIR`."""

    def parse_args(self, ctx: Context, args: list[str]) -> list[str]:
        """Put the word workspace before a folder, also before one of that name."""
        named = args == ["workspace"]
        if named or (args and args[0] not in self.commands and not args[0].startswith("-")):
            args = ["workspace", *args]
        return super().parse_args(ctx, args)


new = typer.Typer(cls=_New, no_args_is_help=True)
app.add_typer(
    new,
    name="new",
    rich_help_panel=RUNNING,
    help="Make a workspace (auvid new DIR), or a campaign from logs.",
    epilog="Example: auvid new ~/campaigns_2026",
)


@new.command(cls=Command, epilog="Example: auvid new ~/campaigns_2026")
@answering
def workspace(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="New or empty folder.")],
) -> None:
    """Make a workspace with a small example campaign; `auvid new DIR` does too."""
    from auvid.pipeline.commands.new.new_command import make_workspace

    make_workspace(folder)
    answer({"folder": folder, "campaign": folder / "campaigns" / "example" / "campaign.yaml"})
    print(f"made {folder}\n\n    cd {folder}\n    auvid run example\n")


@new.command(cls=Command, epilog="Example: auvid new campaign pier --from 00000029.BIN")
@answering
def campaign(
    name: Annotated[
        str,
        typer.Argument(metavar="NAME", help="Name of the campaign, or a path to its new folder."),
    ],
    first: Annotated[
        list[Path],
        typer.Option(
            "--from",
            metavar="LOG [LOG ...]",
            help="Logs of one vehicle; CSV files of one dive become one log.",
        ),
    ],
    more: Annotated[list[Path] | None, typer.Argument(metavar="", hidden=True)] = None,
    vehicle: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Vehicle, by name or file. (default: the one that the log names)",
            autocompletion=completion.vehicles,
        ),
    ] = None,
    link: Annotated[
        bool, typer.Option("--link", help="Link to the logs in place of copying them.")
    ] = False,
    commands: Annotated[
        str,
        typer.Option(
            metavar="AXIS=COLUMN,...",
            help="Columns of CSV files that are commands: surge=cmd4,heave=-cmd2 (reversed).",
        ),
    ] = "",
) -> None:
    """Write a campaign from logs: campaign.yaml, column maps, vehicle file.

    Legs are proposed where the vehicle moves. What no log tells is marked `# check:`,
    with what to do. Nothing is written for logs that feed no campaign.

    Exit codes: 0 auvid run can follow; 1 the logs feed no campaign, or something must
    be filled in first; 2 wrong use.
    """
    from auvid.pipeline.commands.new.campaign_command import print_new_campaign

    logs = [*first, *(more or [])]
    raise typer.Exit(print_new_campaign(name, logs, vehicle=vehicle, link=link, commands=commands))


fleet = typer.Typer(cls=Commands, no_args_is_help=True)
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
    force: Force = False,
) -> None:
    """Run every log of a disk as far as it goes; only new and changed ones run again.

    Each log ends as done, partly or refused, with the reason. Nothing is written beside
    the logs.

    Exit codes: 0 all done; 1 none is done, or the call cannot be followed; 2 wrong use;
    3 some logs are not done; 130 interrupted, what was finished is kept.
    """
    from auvid.pipeline.commands.fleet.fleet_run import print_fleet_run
    from auvid.pipeline.execution.engines import make_engine

    workers = make_engine(engine, jobs, scheduler=scheduler, memory=memory)
    raise typer.Exit(
        print_fleet_run(disk, out, vehicles=vehicle or (), engine=workers, force=force)
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
) -> None:
    """Write the page of a fleet, and print its path and those of its tables.

    Which dives are usable for what, states and reasons, findings, coefficients dive by
    dive with what they agree on, outlying dives and changes.
    """
    from auvid.pipeline.commands.fleet.fleet_folder import TABLES, open_fleet
    from auvid.pipeline.commands.fleet.report.fleet_page import write_page

    place = open_fleet(folder)
    write_page(place)
    print(place.page)
    answer({"report": place.page, "tables": {name: place.table(name) for name in TABLES}})
    if open_it:
        typer.launch(place.page.as_uri())


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
    from auvid.pipeline.commands.fleet.find_command import print_matches

    raise typer.Exit(print_matches(fleet_folder, expression))


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
) -> None:
    """Serve the recordings of all runs to the Rerun viewer of this machine.

    Each has typed properties: vehicle, best model, J/J0, verdicts by axis.
    """
    from auvid.pipeline.commands.fleet.catalog_command import serve_catalog

    serve_catalog(folder, where=where, port=port)


@app.command(hidden=True, epilog="Example: auvid code")
def code() -> None:
    """Write the hash of each stage's code, on which DVC depends, to runs/.code."""
    from auvid.pipeline.execution.code_stamp import unchanged

    here = Path.cwd()
    root = next((at for at in (here, *here.parents) if (at / "params.yaml").is_file()), here)
    if unchanged(root / "runs" / ".code"):
        return
    from auvid.pipeline.commands.open_run import write_codes

    write_codes()


def main() -> None:
    """Run the command line; `output.EXIT_CODES` says how it ends."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    sys.stdout = sys.stdout or io.StringIO()  # a closed one is None
    sys.stderr = sys.stderr or io.StringIO()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # what a terminal cannot show is a ?
    output.start(sys.argv[1:])
    try:
        try:
            app(standalone_mode=True)
        except SystemExit as end:
            if end.code == WRONG_USE:
                output.print_envelope(WRONG_USE, "wrong use: standard error says which word")
            raise
        except PipelineError as fault:
            status = WRONG_USE if isinstance(fault, UsageError) else FAILED
            output.print_envelope(status, fault)
            sys.exit(_say(f"error: {fault}", status))
        finally:
            print(end="", flush=True)
    except BrokenPipeError:
        _close_output()
        sys.exit(FAILED)
    except Exception as crash:
        if isinstance(crash, OSError) and (words := _refused(crash)):
            output.print_envelope(FAILED, words)
            sys.exit(_say(f"error: {words}", FAILED))
        output.print_envelope(FAILED, f"{type(crash).__name__}: {crash}")
        sys.exit(_say(_internal(crash), FAILED))


def _refused(fault: OSError) -> str | None:
    """Return in words what the system refused; None where auvid itself is at fault."""
    from auvid.pipeline.store.atomic_files import REMEDIES, refusal

    if fault.errno not in REMEDIES:
        return None
    if fault.filename is None:
        _close_output()
    words = "the system refused it" if fault.filename else "nothing more can be printed"
    return str(refusal(fault, words))


def _close_output() -> None:
    """Lead standard output to nowhere, so that Python's own flush at exit is quiet."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _internal(crash: Exception) -> str:
    """Return a fault of auvid in one line, with its traceback under AUVID_TRACEBACK."""
    import traceback

    trace = getattr(crash, "trace", "") or "".join(traceback.format_exception(crash))
    words = str(crash) if hasattr(crash, "trace") else f"{type(crash).__name__}: {crash}"
    if OUTPUT.verbose or os.environ.get("AUVID_TRACEBACK"):
        return f"{trace}\ninternal fault: {words}"
    return (
        f"internal fault: {words}\nThis is a fault of auvid, not of your data. --verbose (or"
        " AUVID_TRACEBACK=1) shows where it happened."
    )


def _say(line: str, status: int) -> int:
    print(plain_lines(line), file=sys.stderr)
    return status
