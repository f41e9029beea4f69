"""Exported files in a folder, and the bodies that their targets move."""

from collections.abc import Callable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from auvid.data_schemas.records.model_file import ModelFile
from auvid.export import write
from auvid.pipeline.store.model_files import read_model
from tests.support.targets import (
    gazebo,
    holoocean,
    mss,
    mujoco_body,
    pvs,
    python,
    sitl,
    stonefish,
    uuv,
)
from tests.support.targets.conformance import deviation, loss, moved, printed_loss
from tests.support.targets.frames import Body, readme_of
from tests.support.targets.mistakes import MISTAKES
from tests.support.targets.models import MODELS, states
from tests.support.targets.reference import reference

NAME = "craft"


def from_json(folder: Path, name: str) -> Body:
    """Return the body of folder/NAME.json: the model file by the reference equations."""
    return reference(read_model(folder / f"{name}.json"))


LOADERS: Mapping[str, Callable[[Path, str], Body]] = {
    "gazebo": gazebo.load,
    "uuv": uuv.load,
    "mss": mss.load,
    "pvs": pvs.load,
    "mujoco": mujoco_body.load,
    "python": python.load,
    "json": from_json,
    "holoocean": holoocean.load,
    "stonefish": stonefish.load,
    "sitl": sitl.load,
}
"""Target -> what its evaluator loads of a folder and a name."""

LOSSLESS = {
    "gazebo": ("full", "symmetric", "centred", "diagonal"),
    "uuv": ("centred", "diagonal"),
    **dict.fromkeys(("mss", "pvs", "mujoco", "python", "json"), tuple(MODELS)),
    **dict.fromkeys(("holoocean", "stonefish", "sitl"), ()),
}
"""Target -> models that it holds to the last digit; the first carries the mistakes."""

UPRIGHT = {"gazebo": (2, 3, 4, 5), "uuv": (2, 3, 4)}
"""Axes on which buoyancy, its centre and a torque hold constant forces."""
NEUTRAL = ("holoocean",)
"""Targets that set the buoyancy equal to the weight."""

IMPOSSIBLE = {"holoocean": ("no buoyancy",)}
"""Target -> mistakes that nothing in its file can make."""

EXACT = 1e-9
"""Deviation that a target may have from a model that it holds, in shares of the scale."""

LOSS_SHARE, LOSS_FLOOR = 0.01, 0.006
"""Deviation of a printed loss: 1 %, and the rounding of three digits."""

SAMPLES = 50
"""States by which a mistake has to show."""


def body_of(model: ModelFile, target: str, folder: Path) -> Body:
    """Return the body of a model file as exported to a folder, about the file's origin."""
    write(model, target, folder, lossy=True, force=True, name=NAME)
    body = LOADERS[target](folder, NAME)
    # that description stands about the centre of gravity, as its README says
    return moved(body, uuv.origin(folder)) if target == "uuv" else body


def faults(model: ModelFile, written: ModelFile, target: str, folder: Path) -> list[str]:
    """Return what differs between a model and the export of `written`, which should be it.

    Forces and inertia where the target holds the model, the printed loss where it does not.
    """
    try:
        body = body_of(written, target, folder)
    except ValueError:  # the target takes no box without volume, for instance
        return ["refused"]
    if model.name in LOSSLESS[target]:
        shares = deviation(body, reference(model), *states(SAMPLES))
        pairs = zip(("force", "inertia"), shares, strict=True)
        return [name for name, share in pairs if not share < EXACT]
    printed = printed_loss(readme_of(folder))
    upright = UPRIGHT.get(target, (2,))
    right = loss(body, model, neutral=target in NEUTRAL, upright=upright)
    near = np.abs(printed - right) <= LOSS_SHARE * right + LOSS_FLOOR
    return [] if near.all() else ["loss"]


def carrier(target: str) -> str:
    """Return the model that the mistakes of a target are planted in."""
    return (LOSSLESS[target] or ("symmetric",))[0]


def conformance() -> dict[str, dict[str, list[str]]]:
    """Return target -> mistake -> what shows it; the right export is named `none`."""
    table: dict[str, dict[str, list[str]]] = {}
    with TemporaryDirectory() as work:
        for target in LOADERS:
            model = MODELS[carrier(target)]()
            folder = Path(work) / target
            table[target] = {"none": faults(model, model, target, folder)}
            for name, mistake in MISTAKES.items():
                table[target][name] = faults(model, mistake(model), target, folder)
    return table
