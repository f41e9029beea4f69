"""Commands that lead from logs to a model: run, report, check, new."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from auvid.data_schemas.errors import UsageError
from auvid.pipeline import completion
from auvid.pipeline.collector import kept_for_good
from auvid.pipeline.command_line.application import app
from auvid.pipeline.command_line.arguments import (
    CampaignName,
    EngineName,
    ExchangeURL,
    Force,
    JobCount,
    Scheduler,
    WorkerMemory,
)
from auvid.pipeline.output import (
    OUTPUT,
    RUNNING,
    Command,
    Commands,
    answer,
    answering,
    note,
)

if TYPE_CHECKING:
    from typer._click.core import Context


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
    with kept_for_good():
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
        from auvid.pipeline.commands.run.staleness import stale_words

        page = report_file(campaigns[0], rebuild=rebuild, compare=compare, against=against)
        if stale := stale_words(campaigns[0]):
            note(f"WARNING: the page is of an earlier run: {stale}")
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


class _New(Commands):
    """`auvid new DIR` is `auvid new workspace DIR`."""

    def parse_args(self, ctx: Context, args: list[str]) -> list[str]:
        """Put the word workspace before a folder, also before one of that name."""
        named = args == ["workspace"]
        if named or (args and args[0] not in self.commands and not args[0].startswith("-")):
            args = ["workspace", *args]
        return super().parse_args(ctx, args)


new = typer.Typer(cls=_New)
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


@new.command(
    cls=Command,
    epilog="Example: auvid new campaign harbour --from dive.BIN",
)
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
    more: Annotated[list[Path] | None, typer.Argument(metavar="--from LOG...", hidden=True)] = None,
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


@app.command(hidden=True, epilog="Example: auvid code")
def code(
    campaign: Annotated[
        str, typer.Argument(metavar="CAMPAIGN", help="Write what its stages take from files.")
    ] = "",
) -> None:
    """Write hashes on which DVC depends to runs/.code: of each stage's code.

    With a campaign: of the keys of its manifest, the logs, vehicles and parameters that
    each stage takes.
    """
    from auvid.pipeline.campaigns.workspace import find_workspace

    workspace = find_workspace(Path.cwd())
    if campaign:
        from auvid.pipeline.execution.dvc_inputs import inputs_unchanged

        if not inputs_unchanged(workspace, campaign):
            from auvid.pipeline.commands.open_run import write_inputs_of

            write_inputs_of(campaign)
        return
    from auvid.pipeline.execution.code_stamp import unchanged

    if not unchanged(workspace.code):
        from auvid.pipeline.commands.open_run import write_codes

        write_codes()
