"""Commands that list what there is: stages, models, vehicles, schemas."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from auvid.pipeline import completion
from auvid.pipeline.command_line.application import app
from auvid.pipeline.output import (
    LISTING,
    Command,
    answering,
)

if TYPE_CHECKING:
    pass


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
