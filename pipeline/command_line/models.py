"""Commands that use a model, make a twin or print theory."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from auvid.pipeline import completion
from auvid.pipeline.command_line.application import app
from auvid.pipeline.command_line.arguments import (
    RunName,
)
from auvid.pipeline.output import (
    LOSSES,
    TWINS,
    USING,
    Command,
    answer,
    answering,
    note,
)

if TYPE_CHECKING:
    pass


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
            metavar="NAME",
            help=(
                "Name of files, functions, classes. (default: VEHICLE_MODEL, CAMPAIGN_MODEL where"
                " the vehicle is a guess)"
            ),
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
