"""Arguments and options that several commands take."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from auvid.pipeline import completion

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
