"""Writing a model in the form of a target: refusals, files, README."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from auvid.data_schemas.errors import DataError, PipelineError, UsageError, nearest
from auvid.data_schemas.records.model_file import AS_PUBLISHED, ModelFile
from auvid.data_schemas.records.models import UsableFor
from auvid.data_schemas.records.partial import PartialFigures
from auvid.export.body import body_of
from auvid.export.exported import Request, Target
from auvid.export.losses import LARGEST_SHARE, ExportLosses, measure
from auvid.export.readme import readme
from auvid.export.targets import TARGETS, load_target
from auvid.export.text import identifier, one_line, sanitised
from auvid.hydro.arrays import AXES
from auvid.hydro.model_file import coriolis_acts
from auvid.hydro.published_model import MOTIONS


@dataclass(frozen=True)
class Prepared:
    """Files of a target (name -> text, with a README), and what they lose.

    name: of the files, and of functions or classes in them.
    """

    name: str
    files: Mapping[str, str]
    losses: ExportLosses


def write(
    model: ModelFile,
    target: str,
    folder: Path,
    *,
    lossy: bool = False,
    force: bool = False,
    name: str | None = None,
    draws: int = 1000,
) -> list[Path]:
    """Write a model in the form of a target into a folder and return the paths.

    Raises as `prepare`, and `UsageError` where a file exists, unless `force`.
    """
    prepared = prepare(model, target, lossy=lossy, force=force, name=name, draws=draws)
    return write_files(prepared, folder, force=force)


def prepare(
    model: ModelFile,
    target: str,
    *,
    lossy: bool = False,
    force: bool = False,
    name: str | None = None,
    draws: int = 1000,
) -> Prepared:
    """Return the files of a target as text, with the losses.

    name: of files and of functions or classes in them; default VEHICLE_MODEL, and
    `vehicle_MODEL` where the vehicle is a guess. Raises
    `UsageError` for an unknown target and a name that is no identifier; `DataError` where
    the target needs axes or newtons that a partial model lacks, for
    a model that is usable for nothing, unless `force`, and where the target loses more
    than `LARGEST_SHARE` of the viscous force on an axis that the model is usable for,
    unless `lossy`.
    """
    to = check_target(target)
    _refuse_partial(model, to)
    vehicle = "vehicle" if model.vehicle.guessed else model.vehicle.name
    own = dict.fromkeys((vehicle, model.name))  # of a published set they are one
    named = identifier(name) if name else sanitised("_".join(own))
    if draws < 1:
        raise UsageError("how many draws", field="draws", value=draws, allowed="1 or more")
    useless = _usable_for_nothing(model.use.axes)
    if useless and not force:
        raise DataError(
            "the model is usable for nothing",
            field="model",
            value=f"{model.title}: {model.use.sentence}",
            remedy="Export the model that its run recommends, or this one with --force"
            " (force=True): its files then say so.",
        )
    body = body_of(model)
    head = _head(model, useless)
    exported = to.export(Request(model, body, named, head, draws))
    losses = measure(
        to.name,
        body,
        exported.lost,
        validity=model.validity,
        use=model.use.axes,
        notes=exported.notes,
    )
    if losses.too_large and not lossy:
        raise DataError(
            f"{to.title} cannot hold this model: it loses"
            f" {_shares(losses)} of the RMS viscous force {losses.within}",
            field="target",
            value=to.name,
            allowed=f"{100 * LARGEST_SHARE:g} % on the axes that the model is usable for",
            remedy=f"Lost: {'; '.join(row.what for row in losses.rows)}. Take --lossy"
            " (lossy=True) to write it all the same, a model without these terms, or the"
            " target python, which holds everything.",
        )
    page = readme(model, to, exported, losses, name=named, head=head)
    # Several targets and models may go into one folder.
    return Prepared(named, {**exported.files, f"README_{named}_{target}.md": page}, losses)


def write_files(prepared: Prepared, folder: Path, *, force: bool = False) -> list[Path]:
    """Write prepared files into a folder and return their paths.

    Raises `UsageError` where one exists, unless `force`.
    """
    paths = [folder / name for name in prepared.files]
    there = [str(path) for path in paths if path.exists()]
    if there and not force:
        raise PipelineError(
            "the file exists",
            file=there[0],
            remedy="Name another folder with --output, or overwrite with --force (force=True).",
        )
    folder.mkdir(parents=True, exist_ok=True)
    for path, text in zip(paths, prepared.files.values(), strict=True):
        path.write_text(text, encoding="utf-8")
    return paths


def check_target(name: str) -> Target:
    """Return a target by its name, or of the name of its simulator.

    Raises `UsageError` for an unknown one.
    """
    if name not in TARGETS:
        meant = SIMULATORS.get(name.lower())
        raise UsageError(
            "unknown target",
            field="target",
            value=name,
            allowed=list(TARGETS),
            remedy=meant or nearest(name, TARGETS),
        )
    return load_target(name)


MOTION_WORDS = dict(zip(AXES, MOTIONS, strict=True))
SIMULATORS = {
    **dict.fromkeys(
        ("simulink", "matlab", "octave"), "MATLAB, Simulink and Octave take the target mss."
    ),
    **dict.fromkeys(
        ("gz", "ignition", "gz-sim", "sdf", "gazebosim"), "Gazebo Sim takes the target gazebo."
    ),
    **dict.fromkeys(
        ("uuvsim", "uuv_simulator", "plankton", "dave", "xacro", "urdf"),
        "UUV Simulator, Plankton and DAVE take the target uuv.",
    ),
    **dict.fromkeys(("ardusub", "ardupilot"), "ArduSub takes the target sitl."),
    **dict.fromkeys(("numpy", "py"), "Python without a simulator takes the target python."),
}
"""What users write for a target -> which one that is."""


def _refuse_partial(model: ModelFile, to: Target) -> None:
    """Raise `DataError` where a target needs axes or newtons that a model lacks."""
    part = model.partial
    if part is None:
        return
    holding = [name for name in TARGETS if load_target(name).lacking_axes]
    if part.lacking and not to.lacking_axes:
        lacking = [f"{MOTION_WORDS[a]} ({item.verdict})" for a, item in part.lacking.items()]
        raise DataError(
            f"{to.title} needs six axes, and this model lacks {', '.join(lacking)}",
            field="target",
            value=to.name,
            allowed=holding,
            remedy="Fill the axes in campaign.yaml from a published set or a bench, as"
            f" `fill: {{{MOTION_WORDS[next(iter(part.lacking))]}: bluerov2_wu_2018}}`, and run"
            " again; or measure them: "
            + " ".join(dict.fromkeys(item.remedy for item in part.lacking.values())),
        )
    if (part.cross_forces or not coriolis_acts(model)) and not to.any_unit_of_mass:
        has = "a force that follows surge" if part.cross_forces else "no Coriolis force"
        raise DataError(
            f"{to.title} has Coriolis force and no force that follows another; here is {has}",
            field="target",
            value=to.name,
            allowed=[name for name in TARGETS if load_target(name).any_unit_of_mass],
            remedy="Set `fit_axes: {together: always, surge_in_heave: false}` under `stages`, and"
            " run again.",
        )
    if part.unit_of_mass is not None and not to.any_unit_of_mass:
        raise DataError(
            f"{to.title} needs newtons, and this model has none: its unit of mass is the"
            f" apparent inertia of {MOTION_WORDS[part.unit_of_mass]}",
            field="target",
            value=to.name,
            allowed=[name for name in TARGETS if load_target(name).any_unit_of_mass],
            remedy="Measure one bollard pull and write it into the vehicle file, as `actuators:"
            " {commands: {full_force: {surge: {value: 60, unit: N, source: a scale}}}}`, or name"
            " its measured mass with `fit_axes: {newtons_from: mass}` under `stages`, and run"
            " again.",
        )


def _usable_for_nothing(use: UsableFor | None) -> bool:
    return use is not None and not (use.forces or use.simulation or use.control)


def _head(model: ModelFile, useless: bool) -> tuple[str, ...]:
    """Return lines that each file carries: origin, use, and what is not known."""
    unknown = sum(not item.determined for item in model.coefficients)
    if model.method == AS_PUBLISHED:
        first = f"Written by auvid {model.auvid} from {model.name}, published: {model.source}."
    else:
        first = (
            f"Written by auvid {model.auvid} from model {model.name} ({model.title}) of campaign"
            f" {model.origin.campaign}; fitted by {model.method}."
        )
    lines = [first, f"Use: {model.use.sentence}."]
    if model.vehicle.guessed:
        lines.append(
            f"The vehicle is a guess, {model.vehicle.guessed}: so are its masses and inertias."
        )
    if useless:
        lines.append("USABLE FOR NOTHING, exported by force: " + model.use.rule)
    if model.partial is not None:
        lines += _partial_lines(model.partial)
    if model.use.axes is None:
        lines.append("No validation leg judges this model: no axis has a verdict.")
    motion = None if model.validation is None else model.validation.motion
    if motion is not None:
        lines += [f"By itself: {motion.words}.", *motion.remedies]
    if unknown and model.method != AS_PUBLISHED:
        lines.append(
            f"{unknown} of {len(model.coefficients)} coefficients are not determined by the data;"
            " the numbers here belong together and mean nothing one by one."
        )
    if model.validity:
        flown = ", ".join(
            f"{name} {span.low:.3g} to {span.high:.3g}" for name, span in model.validity.items()
        )
        lines.append(f"Valid within the flown range (m/s, rad/s): {flown}.")
    return tuple(map(one_line, lines))


def _partial_lines(part: PartialFigures) -> list[str]:
    """Return what a file of a partial model says of its axes and units."""
    lines = [
        f"It lacks {MOTION_WORDS[axis]}, {item.verdict}: {item.words}."
        for axis, item in part.lacking.items()
    ]
    if part.lacking:
        lines.append(
            "Velocities of lacking axes are held: their acceleration is 0 here, and their forces"
            " are not known."
        )
    lines += [
        f"{MOTION_WORDS[axis].capitalize()} was not fitted to this log, it is from the"
        f" {item.source}: {item.name}."
        for axis, item in part.axes.items()
        if item.source != "fitted"
    ]
    if part.together is not None and not part.together.chosen:
        lines.append("Its axes were fitted one by one: no Coriolis force acts.")
    lines += [
        f"{MOTION_WORDS[item.axis].capitalize()} has a force that follows that of"
        f" {MOTION_WORDS[item.of]}, late by {item.lag_s:g} s."
        for item in part.cross_forces
    ]
    lines += [
        f"{MOTION_WORDS[item.axis].capitalize()} {item.words}: {item.value:.3g} {item.unit}"
        f" ({item.interval_95[0]:.3g} to {item.interval_95[1]:.3g}, 95 %), linear and"
        " quadratic part together; these share their error."
        for item in part.total_drag
    ]
    if part.unit_of_mass is not None:
        lines.append(
            "NO NEWTONS, NO KILOGRAMS: every mass, inertia and force is a share of the apparent"
            f" inertia of {MOTION_WORDS[part.unit_of_mass]}; ratios of inertia are those of the"
            " vehicle file."
        )
    return lines


def _shares(losses: ExportLosses) -> str:
    return ", ".join(f"{100 * losses.shares[axis]:.3g} % of {axis}" for axis in losses.too_large)
