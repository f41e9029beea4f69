"""The application `auvid`, to which the other modules of this room add commands."""

from __future__ import annotations

from typing import Annotated

import typer

from auvid import __version__
from auvid.pipeline.output import Commands

app = typer.Typer(
    name="auvid",
    cls=Commands,
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
