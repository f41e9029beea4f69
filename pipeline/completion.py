"""Names that the shell completes: campaigns, runs, models, stages and more.

Each call of a shell's completion is a process of its own, so the stages are not loaded:
names come from folders and files. Paths are left to the shell, which quotes them: its
script takes what is returned here as it stands.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[1]
PARAMS_FILE = "params.yaml"
PLAIN = re.compile(r"[\w.+,:@%/][\w.+,:@%/-]*")
"""A name that a shell takes as one word without quotes."""


def _root() -> Path:
    """Return the workspace around the current folder, or that folder."""
    here = Path.cwd()
    return next((at for at in (here, *here.parents) if (at / PARAMS_FILE).is_file()), here)


def _with_start(names: Iterator[str], start: str) -> list[str]:
    """Return the names that begin so and that mean nothing else to a shell."""
    return sorted({name for name in names if name.startswith(start) and PLAIN.fullmatch(name)})


def campaigns(incomplete: str) -> list[str]:
    """Return the campaigns of the workspace here whose names begin so."""
    paths = _root().glob("campaigns/*/campaign.yaml")
    return _with_start((path.parent.name for path in paths), incomplete)


def runs(incomplete: str) -> list[str]:
    """Return the campaigns that have been run."""
    paths = _root().glob("runs/*/*/manifest.json")
    return _with_start((path.parents[1].name for path in paths), incomplete)


def run_models(incomplete: str) -> list[str]:
    """Return CAMPAIGN and CAMPAIGN/MODEL of the runs that have model files."""
    paths = list(_root().glob("runs/*/model_file/model_file/*.json"))
    names = (path.parents[2].name for path in paths)
    both = (f"{path.parents[2].name}/{path.stem}" for path in paths)
    return _with_start(
        (name for pair in zip(names, both, strict=True) for name in pair), incomplete
    )


def exportable(incomplete: str) -> list[str]:
    """Return what `run_models` does, and the published sets."""
    published = (path.stem for path in (PACKAGE / "vehicles" / "shelf").glob("*.yaml"))
    return run_models(incomplete) + _with_start(published, incomplete)


def run_or_model(incomplete: str) -> list[str]:
    """Return CAMPAIGN, CAMPAIGN@MODEL and CAMPAIGN@RUN of the runs, for diff."""
    of_models = (name.replace("/", "@") for name in run_models(""))
    of_history = (f"{path.parents[1].name}@{int(path.stem)}" for path in _history())
    return _with_start(iter([*runs(""), *of_models, *of_history]), incomplete)


def run_numbers(incomplete: str) -> list[str]:
    """Return the numbers of the runs in the histories of this workspace."""
    return _with_start((str(int(path.stem)) for path in _history()), incomplete)


def _history() -> Iterator[Path]:
    """Yield the entries of the histories of this workspace."""
    paths = _root().glob("runs/*/history/*.json")
    return (path for path in paths if path.stem.isdecimal())


def stages(incomplete: str) -> list[str]:
    """Return the stages, as their registry names them."""
    text = (PACKAGE / "stages" / "registry.py").read_text(encoding="utf-8")
    names = text.partition("STAGES = ")[2].partition("KINDS")[0]
    return _with_start(iter(re.findall(r'"(\w+)",', names)), incomplete)


def models(incomplete: str) -> list[str]:
    """Return the viscous force models."""
    from auvid.hydro.dynamics.viscous.models import MODELS

    return _with_start((model.name for model in MODELS), incomplete)


def vehicles(incomplete: str) -> list[str]:
    """Return the vehicles of the workspace and those that come with auvid."""
    folders = (PACKAGE / "vehicles", _root() / "vehicles")
    paths = (path.stem for folder in folders for path in folder.glob("*.yaml"))
    return _with_start(paths, incomplete)


def shelf(incomplete: str) -> list[str]:
    """Return the published sets of the shelf, and its name for all of them."""
    paths = (path.stem for path in (PACKAGE / "vehicles" / "shelf").glob("*.yaml"))
    return _with_start(iter(["shelf", *paths]), incomplete)


def targets(incomplete: str) -> list[str]:
    """Return the simulators and forms that models are exported to."""
    from auvid.export.targets import TARGETS

    return _with_start(iter(TARGETS), incomplete)


def documents(incomplete: str) -> list[str]:
    """Return the documents that users write."""
    from auvid.data_schemas.documents import MODELS

    written = (name for name, place in MODELS.items() if place.startswith("documents."))
    return _with_start(written, incomplete)
