"""Draft a column map from the header and the values of a CSV file.

What the name of a column does not say is taken from its values, or assumed, and then
the draft says so.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from auvid.data_schemas.errors import LogError
from auvid.hydro.arrays import Array
from auvid.stages.base import RawFile
from auvid.stages.columns import POSITION
from auvid.stages.ingest.formats.csv.column_names import (
    NamedColumn,
    named_columns,
)
from auvid.stages.ingest.formats.csv.draft.cell_faults import check_cells
from auvid.stages.ingest.formats.csv.draft.cells import cells_of, is_number, numbers_of
from auvid.stages.ingest.formats.csv.draft.column_draft import NO_NAME, ColumnDraft, DraftColumn
from auvid.stages.ingest.formats.csv.draft.commands import (
    AXIS_NAMES,
    COMMANDS,
    MATCHED,
    MATCHED_REVERSED,
    NAMED_REVERSED,
    as_command,
    possible_outputs,
    with_commands,
    with_pulses,
    without_guess,
)
from auvid.stages.ingest.formats.csv.draft.pose_draft import (
    TURNED_AXES,
    Y_UP,
    in_frame_with_y_up,
    in_named_frame,
    in_upward_axes,
    is_numbered,
    pose_frame,
    pose_velocities,
    with_level_order,
    with_pose,
)
from auvid.stages.ingest.formats.csv.draft.time_column import seconds_of, time_column
from auvid.stages.ingest.formats.csv.draft.units import (
    PRESSURES,
    accelerometer_of,
    are_pulses,
    of_one_unit,
    repeating_streams,
    roughness,
    unit_of,
)
from auvid.stages.ingest.formats.csv.names.lexicon import SOURCES
from auvid.stages.ingest.formats.csv.pose_columns import lacking_fields
from auvid.stages.ingest.formats.csv.reader import header

WORLD_OR_BODY = re.compile(r"[xyz]$")
"""End of a velocity's name that may as well be of world axes."""
FROM_ABOVE = "up"
"""Mark of a height that is negative under water."""
UPWARD = "flu"
"""Frame of a command that is upward by its name."""
REVERSED = (FROM_ABOVE, MATCHED_REVERSED, NAMED_REVERSED)
BETWEEN_RUNS_S = 10.0
"""Runs with the same columns are looked at one behind the other with such a pause."""
NO_UNIT = "its name tells no unit"
HEIGHTS = frozenset({"altitude", "alt", "height"})
OF_HEIGHTS = SOURCES | {"baro", "barometer"}
OTHER_OF_PAIR = {"rudder": "fin_t_rad", "elevator": "fin_p_rad"}
"""A column of a pair of fins moves this one too."""
FIN_SIGN = "positive pushes the stern to starboard or up, else sign: -1"
WITHOUT_UNIT = {"surge": "u_m_s", "sway": "v_m_s", "heave": "w_m_s"}
WITHOUT_UNIT |= {"roll": "phi_rad", "pitch": "theta_rad", "yaw": "psi_rad"}
ONE_AXIS = "; of a body that moves in one axis alone (coasts, a decay) add them as columns of zeros"
OF_TOWS = frozenset({"tow", "towing", "towed", "carriage"})
UPWARD_WORDS = {"flu": "z up: commands answer so", "enu": "enu, z up: by the name"}
UPWARD_WORDS |= {"y_up": "y up: the name or the commands say so"}
SPOKEN = {"phi_rad": "roll", "theta_rad": "pitch", "psi_rad": "yaw"}


def draft_columns(
    file: RawFile, *runs: RawFile, commands: Mapping[str, str] | None = None
) -> ColumnDraft:
    """Return a column map drafted from a file's names and values.

    runs: further files with the same columns, for one map together. commands: axis
    (surge, sway ..., with a minus where the column is reversed) of each column that is a
    command. Raises `LogError` where the first line names no columns, or no column is the
    time.
    """
    head = header(file, None)
    texts, decimal = cells_of(file, head.names, head.delimiter, head.encoding)
    if head.names and all(is_number(name) for name in head.names if name.strip()):
        raise LogError(
            "the first line holds numbers, no names of columns",
            file=file.name,
            row=1,
            value=", ".join(head.names[:4]),
            remedy="Put a line with the names of the columns above it: time_s,depth_m,...",
        )
    values = {name: numbers_of(cells, decimal) for name, cells in texts.items()}
    columns = named_columns(head.names)
    check_cells(columns, head.names, texts, values, file.name)
    columns = [item for item in columns if item.name in texts]
    time, time_check = time_column(columns, values, texts, file.name)
    of_time = {time["column"], time.get("nanoseconds")}
    rest = [item for item in columns if item.name not in of_time]
    rest, named_frame = in_named_frame(with_pulses(with_pose(rest), values), texts)
    t_s = seconds_of(time, values, texts[time["column"]])
    draft = ColumnDraft(file.name, time, time_check, (), head.delimiter, decimal)
    draft = replace(draft, remarks=named_frame)
    finite = t_s[np.isfinite(t_s)]
    draft = replace(draft, span_s=(float(finite[0]), float(finite[-1])))
    for run in runs:
        more, _ = cells_of(run, head.names, head.delimiter, head.encoding)
        own = {name: numbers_of(cells, decimal) for name, cells in more.items()}
        later = seconds_of(time, own, more[time["column"]])
        t_s = np.append(t_s, later - np.nanmin(later) + np.nanmax(t_s) + BETWEEN_RUNS_S)
        values = {name: np.append(values[name], own[name]) for name in values}
    rest = with_level_order(rest, values)
    named = dict(commands or {})
    rest = [
        as_command(item, named[item.name], file=file.name) if item.name in named else item
        for item in rest
    ]
    if named:
        rest = [item if item.name in named else without_guess(item) for item in rest]
    by_axis = _commands_by_axis(rest, values)
    numbered = (
        {}
        if by_axis
        else {item.name: values[item.name] for item in rest if COMMANDS.search(item.words)}
    )
    rest = in_frame_with_y_up(rest, values, t_s, by_axis, numbered)
    y_up = any(item.frame == Y_UP for item in rest if item.place and item.place[0] == "pose")
    velocities = pose_velocities(rest, values, t_s, Y_UP if y_up else "ned")
    if not named:
        rest = with_commands(rest, values, t_s, velocities)
    frame = _frame_of(rest, values, t_s, velocities)
    if not y_up:
        rest = _in_frame(rest, frame, velocities)
    return replace(_with_columns(draft, rest, values), commands_show="" if y_up else frame)


def _frame_of(
    columns: Sequence[NamedColumn],
    values: Mapping[str, Array],
    t_s: Array,
    velocities: Mapping[str, Array],
) -> str:
    """Return the frame of the pose that commands show, '' where they do not."""
    return pose_frame(_commands_by_axis(columns, values), velocities, t_s) if velocities else ""


def _commands_by_axis(
    columns: Sequence[NamedColumn], values: Mapping[str, Array]
) -> dict[str, Array]:
    """Return the commands (n,) of axes u, v ... that are named."""
    axes = {f"command_{name}": axis for axis, name in AXIS_NAMES.items()}
    return {
        axes[item.place[1]]: values[item.name]
        * (-1.0 if item.frame in (NAMED_REVERSED, UPWARD) else 1.0)
        for item in columns
        if item.place is not None and item.place[1] in axes
    }


def _in_frame(
    columns: Sequence[NamedColumn], frame: str, velocities: Mapping[str, Array]
) -> list[NamedColumn]:
    """Return the columns with the pose turned to z up where commands show that."""
    upward = any(item.frame and item.place and item.place[0] == "pose" for item in columns)
    if not velocities or not (upward or frame == "flu"):
        return list(columns)
    # Matched commands are reversed because the frame is, or the other way round.
    turned = {f"command_{AXIS_NAMES[axis]}" for axis in TURNED_AXES}
    other = {MATCHED: MATCHED_REVERSED, MATCHED_REVERSED: MATCHED}
    return [
        replace(item, frame=other[item.frame])
        if item.frame in other and item.place and item.place[1] in turned
        else item
        for item in in_upward_axes(columns)
    ]


def _fixes_without_depth(
    chosen: dict[tuple[str, str], NamedColumn],
) -> dict[tuple[str, str], NamedColumn]:
    """Return northing and easting as fixes where there is no third coordinate."""
    flat = {("position", "x_m"): ("fixes", "north_m"), ("position", "y_m"): ("fixes", "east_m")}
    if not set(flat) <= set(chosen) or ("position", "z_m") in chosen:
        return chosen
    if not all("ing" in chosen[place].words for place in flat):
        return chosen
    return {flat.get(place, place): item for place, item in chosen.items()}


def _with_columns(
    draft: ColumnDraft, columns: Sequence[NamedColumn], values: Mapping[str, Array]
) -> ColumnDraft:
    """Return the draft with its columns, units and remarks."""
    chosen: dict[tuple[str, str], NamedColumn] = {}
    rivals: dict[tuple[str, str], list[str]] = {}
    remarks: list[str] = []
    for item in (fin for column in columns for fin in _fins_of(column)):
        filled = np.isfinite(values[item.name]).mean() if values[item.name].size else 0.0
        nameless = "press" in item.words and item.unit not in PRESSURES
        if nameless and item.place is not None and item.place[0] == "glider":
            remarks.append(f"{item.name} is left out: {NO_UNIT}, as {item.name}_dbar has one.")
        if item.place is None or filled <= 0.01 or nameless:
            continue
        if chosen.setdefault(item.place, item) is not item:
            rivals.setdefault(item.place, []).append(item.name)
    chosen = possible_outputs(chosen, values, remarks)
    chosen = _depth_of_others(chosen, columns, values)
    chosen = _fixes_without_depth(chosen)
    drafted = []
    for (stream, name), item in chosen.items():
        kind = name.split("_")[0] if stream in ("imu", "glider", "actuators") else stream
        group = [
            values[other.name]
            for (own, field_name), other in chosen.items()
            if (stream != "pose" or (field_name in POSITION) == (name in POSITION))
            and kind in (own, field_name.split("_")[0])
            and not field_name.startswith("quality")
        ]
        if stream == "pose" and name in POSITION:
            group = of_one_unit(values[item.name], group)
        group = [values[item.name], *group] if name.startswith("command_") else group
        if stream == "tow":  # a force and a speed are of no one unit
            group = [values[item.name]]
        unit, check = unit_of(stream, name, item, group)
        if item.frame in (MATCHED, MATCHED_REVERSED):
            check = f"{NO_NAME}; {name.split('_')[1]} answers it best of all columns"
        if stream == "velocity" and WORLD_OR_BODY.search(item.words):
            check = "; ".join(filter(None, (check, "body axes assumed, forward right down")))
        if stream == "pose":
            words = UPWARD_WORDS.get(item.frame, "ned, z down: else frame flu, enu or y_up")
            check = "; ".join(filter(None, (check, f"frame {words}")))
        if is_numbered(item):
            first = "w first of the four assumed"
            order = first if name.endswith(item.part) else "w last of the four: only so it is level"
            check = "; ".join(filter(None, (check, order)))
        check = "; ".join(
            filter(None, (check, _spoken(item, name, rivals.get((stream, name), []))))
        )
        sign = -1 if item.frame in REVERSED else 1
        frame = item.frame if item.frame in ("frd", "flu", "enu", Y_UP) else ""
        drafted.append(DraftColumn(item.name, stream, name, unit, sign, frame, check))
    partial = {stream: lacking_fields(set(chosen), stream) for stream, _ in chosen}
    for stream, lack in partial.items():
        if lack:
            names = ", ".join(SPOKEN.get(name, name) for name in lack)
            zeros = ONE_AXIS if stream in ("velocity", "attitude") else ""
            remarks.append(f"{stream} is left out: nothing looks like {names}{zeros}.")
    if (
        any(item.in_quaternion for item in columns)
        and not {("attitude", "q_w"), ("pose", "q_w"), ("attitude", "phi_rad")} & set(chosen)
        and ("pose", "phi_rad") not in chosen
    ):
        remarks.append("a quaternion is left out: it needs four columns w, x, y and z.")
    kept = tuple(item for item in drafted if not partial[item.stream])
    used = {item.column for item in kept}
    unmatched = [
        item.name
        for item in columns
        if item.name not in used and (COMMANDS.search(item.words) or are_pulses(values[item.name]))
    ]
    if unmatched and not any(item.field.startswith(("pwm_", "command_")) for item in kept):
        remarks.append(_unmatched_words(unmatched, values))
    return replace(
        draft,
        columns=kept,
        accelerometer=accelerometer_of(kept, values),
        repeating=repeating_streams(kept, values),
        unused=tuple(item.name for item in columns if item.name not in used),
        position_noise=tuple(
            roughness(values[item.column])
            for item in kept
            if item.stream == "pose" and item.field in POSITION
        ),
        ahead=tuple(
            item.name
            for item in columns
            if item.name not in used and (item.is_speed_ahead or item.is_lone_ahead(columns))
        ),
        remarks=(*draft.remarks, *remarks),
    )


def _unmatched_words(names: Sequence[str], values: Mapping[str, Array]) -> str:
    """Return what to do about columns that may be commands, which no axis answers."""
    finite = [values[name][np.isfinite(values[name])] for name in names]
    if not any(np.ptp(column) for column in finite if column.size):
        return (
            f"{', '.join(names)} never move: closed-loop set points at rest drive nothing. Log the"
            " outputs of the controller, or what it commands of surge, sway, heave, yaw"
        )
    return (
        f"{', '.join(names)} may be commands, and neither name nor motion tells of which"
        f" axis: name them with --commands surge={names[0]},sway=... and so on"
    )


def _fins_of(item: NamedColumn) -> list[NamedColumn]:
    """Return a column, twice where it is the deflection of two fins."""
    other = OTHER_OF_PAIR.get(item.part)
    return [item, replace(item, place=("actuators", other))] if other else [item]


def _spoken(item: NamedColumn, field: str, rivals: Sequence[str]) -> str:
    """Return in words what a name leaves open; rivals: columns that say the same."""
    words = []
    if field.startswith("fin_"):
        words.append(FIN_SIGN)
    if item.words in WITHOUT_UNIT and field.startswith("command_"):
        words.append(f"a command, as no unit tells otherwise; else {WITHOUT_UNIT[item.words]}")
    if field in ("tow_speed_m_s", "tow_force_n") and not OF_TOWS & set(item.words.split()):
        words.append(f"taken for the {'speed' if 'speed' in field else 'force'} of the tow")
    if rivals and not field.startswith("pwm_"):
        more = f" and {len(rivals) - 1} more" if len(rivals) > 1 else ""
        words.append(f"or {rivals[0]}{more}, by the name")
    return "; ".join(words)


def _depth_of_others(
    chosen: dict[tuple[str, str], NamedColumn],
    columns: Sequence[NamedColumn],
    values: Mapping[str, Array],
) -> dict[tuple[str, str], NamedColumn]:
    """Return the columns, with depth from altitude or z where none is named so."""
    if ("depth", "depth_m") in chosen or ("pose", "z_m") in chosen:
        return chosen
    for item in columns:
        if set(item.words.split()) - OF_HEIGHTS and set(item.words.split()) - OF_HEIGHTS <= HEIGHTS:
            finite = values[item.name][np.isfinite(values[item.name])]
            if finite.size and float(np.median(finite)) < 0.0:  # above the surface, so below it
                return chosen | {("depth", "depth_m"): replace(item, frame=FROM_ABOVE)}
    height = chosen.get(("position", "z_m")) or next(
        (item for item in columns if item.place == ("position", "z_m")), None
    )
    if height is None:
        return chosen
    below = bool(height.frame) or float(np.nanmedian(values[height.name])) < 0.0
    return chosen | {("depth", "depth_m"): replace(height, frame=FROM_ABOVE if below else "")}
