"""What the words of a name mean: rules of quantity, axis and unit.

Words of sources are left out first. What then is neither a quantity nor an axis makes a
name unknown: wave_height and motor_temp mean nothing here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest

from auvid.stages.ingest.formats.csv.names.lexicon import (
    AXES,
    BARE_PLACE,
    FIN_LETTERS,
    FLIPPED,
    LETTERS,
    NO_MEASUREMENT,
    PHRASES,
    SHORT_OUTPUTS,
    SOURCES,
    UPWARD,
    WORLD,
)
from auvid.stages.ingest.formats.csv.names.unit_words import MEASURES
from auvid.stages.ingest.formats.csv.names.words import QUANTITY_OF

LONGEST_PHRASE = 3


@dataclass(frozen=True)
class Meaning:
    """Stream and field of a column; `part`: w, x, y or z of a quaternion.

    `frame`: flu, enu or y_up where its name says so. A column of the time has the stream `time`.
    """

    stream: str
    field: str
    part: str = ""
    frame: str = ""


@dataclass(frozen=True)
class Fields:
    """The fields of three axes in a stream, and what their units measure."""

    stream: str
    names: tuple[str, str, str]
    measures: frozenset[str]


NO_UNIT = ""
TIME = "time"
WAYS, TURNS = ("surge", "sway", "heave"), ("roll", "pitch", "yaw")
MARK = "."
"""Before the quantity that a letter stands for."""
VELOCITY = Fields("velocity", ("u_m_s", "v_m_s", "w_m_s"), frozenset({NO_UNIT, "speed"}))
GYRO = Fields(
    "imu", ("gyro_x_rad_s", "gyro_y_rad_s", "gyro_z_rad_s"), frozenset({NO_UNIT, "rate", "angle"})
)
TURNING = Fields("imu", GYRO.names, frozenset({"rate"}))
ACCELERATION = Fields(
    "imu", ("accel_x_m_s2", "accel_y_m_s2", "accel_z_m_s2"), frozenset({NO_UNIT, "acceleration"})
)
ATTITUDE = Fields("attitude", ("phi_rad", "theta_rad", "psi_rad"), frozenset({NO_UNIT, "angle"}))
POSITION = Fields("position", ("x_m", "y_m", "z_m"), frozenset({NO_UNIT, "length"}))
PUSH = Fields(
    "actuators", ("command_surge", "command_sway", "command_heave"), frozenset({NO_UNIT, "ratio"})
)
TURN = Fields("actuators", ("command_roll", "command_pitch", "command_yaw"), PUSH.measures)
MOVING = Fields("velocity", VELOCITY.names, frozenset({"speed"}))

SAME: Mapping[frozenset[str], str] = {
    frozenset(words.split()): meaning
    for meaning, spellings in {
        "": ("",),
        "velocity": ("velocity", "linear", "linear velocity"),
        "rate": (
            *("rate", "angular", "angular velocity", "angular rate", "ang velocity", "ang rate"),
            *("rotation velocity", "rotation rate", "attitude rate", "attitude velocity"),
            *("angle rate", "angle velocity"),
        ),
        "dot": ("dot", "attitude dot", "angle dot"),
        "acceleration": ("acceleration", "linear acceleration"),
        "angle": ("angle", "attitude angle", "rotation angle", "quaternion angle"),
        "attitude": ("attitude", "ang", "attitude ang"),
        "position": ("position", "linear position"),
        "quaternion": ("quaternion", "rotation", "attitude quaternion", "rotation quaternion"),
        "command": (
            *("command", "command force", "command thrust", "output command", "thrust", "force"),
            "output command thrust",
        ),
    }.items()
    for words in spellings
}
"""Sets of quantities -> what they are together."""
RULES: Mapping[tuple[str, str], tuple[Fields, ...]] = {
    ("", "uvw"): (VELOCITY,),
    ("", "pqr"): (GYRO,),
    ("", "turn"): (ATTITUDE, TURNING),
    ("", "heading"): (ATTITUDE, TURNING),
    ("", "way"): (PUSH, MOVING),
    ("", "xyz"): (POSITION,),
    ("velocity", "uvw"): (VELOCITY,),
    ("velocity", "xyz"): (VELOCITY,),
    ("velocity", "way"): (VELOCITY,),
    ("velocity", "side"): (VELOCITY,),
    ("velocity", "turn"): (GYRO,),
    ("velocity", "pqr"): (GYRO,),
    ("rate", "way"): (VELOCITY,),
    ("rate", "xyz"): (GYRO,),
    ("rate", "pqr"): (GYRO,),
    ("rate", "turn"): (GYRO,),
    ("rate", "heading"): (GYRO,),
    ("dot", "turn"): (GYRO,),
    ("dot", "heading"): (GYRO,),
    ("acceleration", "xyz"): (ACCELERATION,),
    ("angle", "turn"): (ATTITUDE,),
    ("angle", "heading"): (ATTITUDE,),
    ("angle", "xyz"): (ATTITUDE,),
    ("attitude", "turn"): (ATTITUDE,),
    ("attitude", "heading"): (ATTITUDE,),
    ("quaternion", "turn"): (ATTITUDE,),
    ("position", "turn"): (ATTITUDE,),
    ("position", "heading"): (ATTITUDE,),
    ("position", "xyz"): (POSITION,),
    ("command", "way"): (PUSH,),
    ("command", "xyz"): (PUSH,),
    ("command", "kmn"): (TURN,),
    ("command", "turn"): (TURN,),
}
"""Quantity and kind of axis -> the fields, by what the unit measures."""
SINGLE: tuple[tuple[tuple[str, ...], str, str, tuple[str, ...]], ...] = (
    (("depth", "depth pressure", "depth position"), "depth", "depth_m", (NO_UNIT, "length")),
    (("pressure",), "depth", "depth_m", (NO_UNIT, "pressure")),
    (("voltage", "battery voltage"), "battery", "voltage_v", (NO_UNIT, "voltage")),
    (("battery", "tension", "battery tension"), "battery", "voltage_v", ("voltage",)),
    (("battery current",), "battery", "current_a", (NO_UNIT, "current")),
    (("current", "battery"), "battery", "current_a", ("current",)),
    (
        ("turns", "propeller turns", "output turns", "propeller velocity"),
        *("actuators", "propeller_rev_s", (NO_UNIT, "turns")),
    ),
    (
        ("output velocity", "output propeller", "propeller", "output"),
        *("actuators", "propeller_rev_s", ("turns",)),
    ),
    (
        ("tow force", "tow drag", "tow drag force", "tow tension", "tension", "tension force"),
        *("tow", "tow_force_n", (NO_UNIT, "force")),
    ),
    (("tow velocity",), "tow", "tow_speed_m_s", (NO_UNIT, "speed")),
    (("latitude", "fix latitude"), "fixes", "latitude_rad", (NO_UNIT, "angle")),
    (("longitude", "fix longitude"), "fixes", "longitude_rad", (NO_UNIT, "angle")),
    (("fix northing",), "fixes", "north_m", (NO_UNIT, "length")),
    (("fix easting",), "fixes", "east_m", (NO_UNIT, "length")),
    (("northing",), "position", "x_m", (NO_UNIT, "length")),
    (("easting",), "position", "y_m", (NO_UNIT, "length")),
    (("time", "fix time"), TIME, "", (NO_UNIT, "time")),
)
"""Sets of quantities without an axis -> stream, field, what its unit may measure."""
FIN_QUANTITIES = {"fin": "", "rudder": "b", "elevator": "s"}
"""Quantity -> the fin that stands for a pair; the other of it moves with it."""
BESIDE_FINS = {"fin", "rudder", "elevator", "angle", "position"}


def meaning_of(words: Sequence[str], unit: str) -> Meaning | None:
    """Return what words with a unit ('' if there is none) mean; None for nothing known.

    >>> meaning_of(["imu", "gyro", "x"], "deg/s")
    Meaning(stream='imu', field='gyro_x_rad_s', part='', frame='')
    >>> meaning_of(["target", "depth"], "m"), meaning_of(["wave", "height"], "m")
    (None, None)
    """
    measure = MEASURES.get(unit, NO_UNIT)
    joined = with_phrases(words)
    fix = _fix(joined, measure)
    if fix is not None:
        return fix
    is_fin = any(QUANTITY_OF.get(word) in FIN_QUANTITIES for word in joined)
    if (NO_MEASUREMENT - set(FIN_LETTERS if is_fin else ())) & set(joined):
        return None
    if is_fin:
        return _fin(joined, measure)
    kept = _with_letters(_without_sources(joined))
    numbers = [int(word) for word in kept if word.isdigit()]
    quantities, axes = set[str](), list[str]()
    for at, word in enumerate(kept):
        if word.startswith(MARK):
            quantities.add(word.removeprefix(MARK))
        elif word.isdigit():
            if at + 1 < len(kept) and not quantities <= {"output", "command", "thrust"}:
                numbers.remove(int(word))  # the second sensor of a kind
        elif word in QUANTITY_OF and not (word in AXES and len(kept) == 1 and word != "t"):
            quantities.add(QUANTITY_OF[word])
        elif word in AXES:
            axes.append(word)
        else:
            return None
    if quantities - {"twist"}:
        quantities.discard("twist")
    if numbers:
        return _output(kept, quantities, axes, numbers, measure, unit)
    if not axes:
        return _single(quantities, measure, unit)
    if set(axes) in ({"heave", "up"}, {"heave", "down"}):
        meaning = _along_axis(joined, quantities, ["heave"], measure)
        return replace(meaning, frame="flu") if meaning and "up" in axes else meaning
    return _along_axis(joined, quantities, axes, measure) if len(axes) == 1 else None


def with_phrases(words: Sequence[str]) -> list[str]:
    """Return words with those of phrases in the place of what they are together."""
    joined: list[str] = []
    at = 0
    while at < len(words):
        for size in range(LONGEST_PHRASE, 1, -1):
            phrase = PHRASES.get(tuple(words[at : at + size]))
            if phrase is not None:
                joined += phrase
                at += size
                break
        else:
            joined.append(words[at])
            at += 1
    return joined


def _fix(words: Sequence[str], measure: str) -> Meaning | None:
    """Return a fix north or east of an acoustic system."""
    sides = {"north": "north_m", "east": "east_m"}
    side = [sides[word] for word in words if word in sides]
    others = [word for word in words if word not in sides and word not in SOURCES]
    is_fix = bool(others) and all(QUANTITY_OF.get(word) == "fix" for word in others)
    if is_fix and len(side) == 1 and measure in (NO_UNIT, "length"):
        return Meaning("fixes", side[0])
    return None


def _fin(words: Sequence[str], measure: str) -> Meaning | None:
    """Return the fin of a deflection: one by its letter, or that of a pair."""
    letters, quantities = list[str](), set[str]()
    for word in words:
        if QUANTITY_OF.get(word) in BESIDE_FINS:
            quantities.add(QUANTITY_OF[word])
        elif word in FIN_LETTERS:
            letters.append(FIN_LETTERS[word])
        elif word not in SOURCES:
            return None
    (pair,) = pairs if len(pairs := quantities & set(FIN_QUANTITIES)) == 1 else ("",)
    able = {"fin": "spbt", "rudder": "bt", "elevator": "sp"}.get(pair, "")
    letter = letters[0] if letters else FIN_QUANTITIES.get(pair, "")
    if measure not in (NO_UNIT, "angle") or len(letters) > 1 or not letter or letter not in able:
        return None
    return Meaning("actuators", f"fin_{letter}_rad", part="" if letters else pair)


def _without_sources(words: Sequence[str]) -> list[str]:
    """Return words without those of sources, nor their numbers: imu 2, not out 2."""
    has_output = any(QUANTITY_OF.get(word) == "output" for word in words)
    return [
        word
        for word, before in zip(words, ("", *words), strict=False)
        if word not in SOURCES and not (word.isdigit() and before in SOURCES and not has_output)
    ]


def _with_letters(words: Sequence[str]) -> list[str]:
    """Return words with the quantities that letters before an axis stand for."""
    result = []
    for word, after in zip_longest(words, words[1:], fillvalue=""):
        if word in SHORT_OUTPUTS and after.isdigit():
            word = f"{MARK}output"
        elif word in LETTERS and (after in ("x", "y", "z") or (word, after) == ("q", "w")):
            word = MARK + LETTERS[word]
        elif word == "u" and after in (*WAYS, *TURNS):
            word = f"{MARK}command"
        elif (word == "v" and after in WAYS) or (word == "w" and after in TURNS):
            word = MARK + LETTERS[word]
        result.append(word)
    return result


def _output(
    words: Sequence[str],
    quantities: set[str],
    axes: Sequence[str],
    numbers: Sequence[int],
    measure: str,
    unit: str,
) -> Meaning | None:
    """Return a numbered output of an actuator."""
    is_output = "output" in quantities or quantities == {"thrust"}
    if (
        is_output
        and not axes
        and len(numbers) == 1
        and quantities <= {"output", "command", "thrust"}
        and quantities != {"output", "thrust"}  # the newtons of a thruster
        and (unit == "us" or measure in (NO_UNIT, "ratio"))
    ):
        return Meaning("actuators", f"pwm_{numbers[0]}_us")
    return None


def _single(quantities: set[str], measure: str, unit: str) -> Meaning | None:
    """Return a quantity without an axis."""
    if unit == "us" and quantities != {"time"}:
        return None
    for spellings, stream, field, measures in SINGLE:
        if measure in measures and any(set(words.split()) == quantities for words in spellings):
            return Meaning(stream, field)
    return None


def _along_axis(
    words: Sequence[str], quantities: set[str], axes: Sequence[str], measure: str
) -> Meaning | None:
    """Return a quantity along or about an axis."""
    kind, number = AXES[axes[0]]
    quantity = SAME.get(frozenset(quantities))
    if quantity == "quaternion" and axes[0] in "wxyz" and measure == NO_UNIT:
        return Meaning("quaternion", "", part=axes[0])
    if axes[0] == "n" and quantities <= {"propeller", "turns"}:
        return Meaning("actuators", "propeller_rev_s") if measure == "turns" else None
    fields = next(
        (item for item in RULES.get((quantity or "", kind), ()) if measure in item.measures), None
    )
    if fields is None or quantity is None:
        return None
    if fields is POSITION and quantity == "" and not _may_be_place(words, axes[0]):
        return None
    if fields in (VELOCITY, MOVING, ACCELERATION) and WORLD & set(words):
        return None
    frame = "flu" if axes[0] in FLIPPED or "flu" in words else ""
    if fields in (POSITION, ATTITUDE):
        frame = next((UPWARD[word] for word in words if word in UPWARD), frame)
    return Meaning(fields.stream, fields.names[number], frame=frame)


def _may_be_place(words: Sequence[str], axis: str) -> bool:
    """Return whether x, y or z behind these sources alone is a position."""
    return all(word in BARE_PLACE or word == axis for word in words)
