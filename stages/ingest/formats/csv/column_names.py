"""What names of CSV columns mean: streams, fields, units, as programs write them."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from auvid.data_schemas.schemas import schema
from auvid.data_schemas.streams import STREAMS
from auvid.stages.ingest.formats.csv.names.lexicon import FLIPPED, NO_MEASUREMENT
from auvid.stages.ingest.formats.csv.names.meaning import Meaning, meaning_of
from auvid.stages.ingest.formats.csv.names.unit_words import MEASURES
from auvid.stages.ingest.formats.csv.names.words import Reading, readings, vocabulary

LOOSELY_TIME = re.compile(
    r"\b(?:t|time|timestamp|stamp|times|datetime|utc|elapsed|secs?|seconds|epoch)\b"
)
"""Words of a time that may stand beside others."""
BUOYANCY = re.compile(r"\b(?:buoyancy|ballast|oil vol|oil volume|bladder|vbd)\b")
GLIDER: tuple[tuple[str, str], ...] = (
    (r"\b(?:pressure|press|p)$", "pressure_pa"),
    (r"\b(?:pitch|theta)(?: angle)?$", "pitch_rad"),
    (BUOYANCY.pattern, "buoyancy_drive_m3"),
    (r"\b(?:density|rho)$", "density_kg_m3"),
    (r"\b(?:temperature|temp|water temp)$", "temperature_K"),
)
"""Columns of a glider by their words; a column of the buoyancy drive tells one."""
SLOCUM = re.compile(r"(?:m|sci)_\w")
"""Sensors of a Slocum glider, whose pressures are in bar."""
SPEEDS = {"speed", "spd", "velocity", "vel", "stw", "geschwindigkeit", "vitesse"}
SPEED_SOURCES = {
    *("log", "em", "electromagnetic", "paddle", "wheel", "pitot", "adcp", "dvl", "sensor"),
    *("water", "through", "thru", "the", "forward", "ahead", "measured", "m"),
}
"""Words of a speed through the water ahead, and those that may stand beside one: no speed
over ground, and none along an axis."""
SIDES = {"forward": "u", "ahead": "u", "starboard": "v", "right": "v", "left": "v"}
SIDES |= {"down": "w", "up": "w"}
"""A velocity whose columns are called by where they point."""
SHORT_SIDES = {"fwd": "u", "stbd": "v", "port": "v"}
"""These may be thrusters, too: a velocity where their unit is that of a speed."""
AHEAD, ASIDE = {"forward", "fwd", "ahead"}, {"left", "right", "starboard", "stbd", "port"}
UPRIGHT = ("down", "up")
OF_ANY = ("pitch_rad", "pressure_pa")
"""Fields of a glider by name, which other vehicles have too."""
VELOCITY_WORDS = re.compile(r"(?:^|\b)(?:velocity|vel|speed|spd|dvl|body|bt|bottom track|v)\b ?")
VECTORS: Mapping[int, str] = {3: "xyz", 4: "wxyz", 6: "uvwpqr"}
"""Letters of the numbered parts of a vector, by how many there are."""
POSES = ("eta", "pose")
OF_POSE = ("x", "y", "z", "phi", "theta", "psi")
OF_VECTORS = ("imu", "velocity", "position", "attitude", "quaternion")
TOWED_SPEEDS = ("speed", "velocity", "vel", "v")
"""Beside the force of a line these are the speed of the tow."""
LEAST_SHARED, SHARE_OF_PREFIX = 3, 0.4
"""Columns that begin with one unknown word: a vehicle or a topic, not what it measures."""
DIGITS_OF_TYPE = 3
"""A word with such a number, as bno055, is the type of a sensor."""
MEASURED, OF_NO_USE = "m", {"lat", "lon", "water"}
"""The first word of what a Slocum glider measured; its latitudes are degrees and minutes in one
number, its water is the current and the depth of the sea.
"""
RATE_LETTERS: Mapping[str, str] = {"r": "roll", "p": "pitch", "y": "yaw"}
"""Rates of the message RATE of ArduPilot, which the desired ones `RDes`, `PDes`, `YDes` tell."""


@dataclass(frozen=True)
class NamedColumn:
    """A column by its name: words without the unit, unit or '', place or None.

    `part`: w, x, y or z of a quaternion, or the pair that a fin stands for. `is_time`: it
    is a time and nothing else.
    """

    name: str
    words: str
    unit: str
    place: tuple[str, str] | None
    frame: str = ""
    part: str = ""
    is_time: bool = False

    @property
    def may_be_time(self) -> bool:
        """Return whether a word or the unit of the name is one of a time."""
        of_time = LOOSELY_TIME.search(self.words) or MEASURES.get(self.unit) == "time"
        return self.is_time or (self.place is None and bool(of_time))

    @property
    def is_speed_ahead(self) -> bool:
        """Return whether it is a speed through the water ahead, as of a log.

        >>> [i.is_speed_ahead for i in named_columns(["speed_thru_water", "em_log_kn", "sog"])]
        [True, True, False]
        """
        words = set(self.words.split())
        by_log = "log" in words and MEASURES.get(self.unit) == "speed"
        is_speed = bool(words & SPEEDS) or by_log
        return (
            is_speed
            and words <= SPEEDS | SPEED_SOURCES
            and MEASURES.get(self.unit, "speed") == "speed"
        )

    def is_lone_ahead(self, columns: Sequence[NamedColumn]) -> bool:
        """Return whether it is a speed ahead without one aside or down."""
        aside = {("velocity", "v_m_s"), ("velocity", "w_m_s")}
        return self.place == ("velocity", "u_m_s") and not aside & {it.place for it in columns}

    @property
    def in_quaternion(self) -> bool:
        """Return whether the column is a part of a quaternion."""
        return self.part in tuple("wxyz")


def named_columns(names: Sequence[str]) -> list[NamedColumn]:
    """Return what every name of a header means."""
    options = _without_prefix([readings(name) for name in names])
    options = _without_numbers(_of_rates(options))
    columns = [_named(name, read) for name, read in zip(names, options, strict=True)]
    return _in_header(columns)


def _named(name: str, options: Sequence[Reading]) -> NamedColumn:
    """Return what a name means by itself."""
    exact = _exact(name)
    if exact is not None:
        return NamedColumn(name, " ".join(options[-1][0]), *exact)
    for words, unit in options:
        meaning = meaning_of(words, unit)
        if meaning is not None:
            return _of_meaning(name, " ".join(words), unit, meaning)
    words, unit = options[0] if options[0][0] else options[-1]
    return NamedColumn(name, " ".join(words), unit, None)


def _of_meaning(name: str, words: str, unit: str, meaning: Meaning) -> NamedColumn:
    nameless = meaning.stream in ("time", "quaternion")
    place = None if nameless else (meaning.stream, meaning.field)
    is_time = meaning.stream == "time"
    return NamedColumn(name, words, unit, place, meaning.frame, meaning.part, is_time)


def _exact(name: str) -> tuple[str, tuple[str, str]] | None:
    """Return unit and place of a column that has the name of a field."""
    for stream in STREAMS:
        spec = None if name in (*OF_ANY, "time_us") else schema(stream).columns.get(name)
        if spec is not None and stream != "glider" and spec.dtype.startswith("float"):
            return spec.unit or "", (stream, name)
    return None


def _without_prefix(options: Sequence[list[Reading]]) -> list[list[Reading]]:
    """Return readings without an unknown word that most names begin with."""
    first = Counter(read[-1][0][0] for read in options if len(read[-1][0]) > 1)
    least = max(LEAST_SHARED, SHARE_OF_PREFIX * len(options))
    prefixes = {word for word, count in first.items() if count >= least}
    return [[(_behind(words, prefixes), unit) for words, unit in read] for read in options]


def _behind(words: tuple[str, ...], prefixes: set[str]) -> tuple[str, ...]:
    """Return words without a first one that is a prefix or a type of sensor."""
    if len(words) < 2 or words[0].isdigit():
        return words
    if words[0] == MEASURED and not (words[1].isdigit() or OF_NO_USE & set(words)):
        return words[1:] if MEASURED in prefixes else words
    if words[0] in vocabulary():
        return words
    number = words[1] if words[1].isdigit() else ""
    if number and len(words) < 3:
        return words
    is_prefix = words[0] in prefixes or len(number) >= DIGITS_OF_TYPE
    return words[1 + bool(number) :] if is_prefix else words


def _of_rates(options: Sequence[list[Reading]]) -> list[list[Reading]]:
    """Return readings in which R, P and Y beside RDes, PDes and YDes are rates.

    ROut, POut and YOut are outputs of their controller, as the desired ones nothing measured.
    """
    names = {read[-1][0] for read in options}
    result = []
    for read in options:
        *upper, letter = read[-1][0] or ("",)
        is_output = letter == "out" and bool(upper)
        if is_output:
            letter = upper.pop()
        if letter in RATE_LETTERS and all((*upper, other, "des") in names for other in "rpy"):
            read = [((*upper, RATE_LETTERS[letter], "des" if is_output else "rate"), "")]
        result.append(read)
    return result


def _without_numbers(options: Sequence[list[Reading]]) -> list[list[Reading]]:
    """Return readings with letters for the numbers of a vector's parts.

    A vector of 3, 4 or 6 parts, counted from 0 or 1, that no other column continues, and
    whose letters name something: gyro 0, 1, 2 are gyro x, y, z; nu 1 to 6 u to r.
    """
    numbers: dict[tuple[str, ...], dict[int, int]] = {}
    for at, read in enumerate(options):
        words = read[0][0] if read[0][0] and read[0][0][-1].isdigit() else read[-1][0]
        if len(words) > 1 and words[-1].isdigit() and (len(words[-2]) > 1 or words[-2] == "q"):
            numbers.setdefault(words[:-1], {})[int(words[-1])] = at
    result = list(options)
    for stem, places in numbers.items():
        first, count = min(places), len(places)
        letters = tuple(VECTORS.get(count, ""))
        if count == 6 and set(POSES) & set(stem):
            letters = OF_POSE
        if first > 1 or sorted(places) != list(range(first, first + count)) or not letters:
            continue
        units = {number: options[at][0][1] for number, at in places.items()}
        meanings = [
            meaning_of((*stem, letter), units[first + n]) for n, letter in enumerate(letters)
        ]
        if all(item is not None and item.stream in OF_VECTORS for item in meanings):
            for number, at in places.items():
                result[at] = [((*stem, letters[number - first]), units[number])]
    return result


def _in_header(columns: Sequence[NamedColumn]) -> list[NamedColumn]:
    """Return columns with what the others of the header tell of them."""
    stems = [item.words for item in columns]
    # Beside commands of surge and sway a bare `yaw` is one as well, but not that of a pose.
    steered = {"surge", "sway"} <= set(stems) and not _is_pose(columns)
    directions = [VELOCITY_WORDS.sub("", words).strip() for words in stems]
    pointed = bool(AHEAD & set(directions)) and bool(ASIDE & set(directions))
    glides = any(BUOYANCY.search(words) for words in stems)
    is_towed = any(item.place and item.place[0] == "tow" for item in columns)
    result = []
    for item, direction in zip(columns, directions, strict=True):
        if glides:
            item = _on_glider(item)
        if steered and item.words in ("yaw", "roll", "pitch") and not item.unit:
            item = replace(item, place=("actuators", f"command_{item.words}"))
        item = _with_side(item, direction, pointed=pointed)
        if is_towed and (item.place is None or item.is_lone_ahead(columns)):
            item = _beside_tow_force(item, columns)
        result.append(item)
    return result


def _with_side(item: NamedColumn, direction: str, *, pointed: bool) -> NamedColumn:
    """Return a velocity called by where it points; down alone may be of the world."""
    speed = MEASURES.get(item.unit) == "speed" or direction != item.words
    sides = SIDES | SHORT_SIDES if speed else SIDES
    if pointed and direction in sides and not NO_MEASUREMENT & set(item.words.split()):
        frame = "flu" if direction in FLIPPED else ""
        return replace(item, place=("velocity", f"{sides[direction]}_m_s"), frame=frame)
    upright = item.place is not None and item.place[0] == "velocity" and direction in UPRIGHT
    return replace(item, place=None) if upright else item


def _beside_tow_force(item: NamedColumn, columns: Sequence[NamedColumn]) -> NamedColumn:
    """Return a speed without an axis as that of the tow, where nothing else is."""
    streams = {other.place[0] for other in columns if other.place}
    fields = {other.place[1] for other in columns if other.place}
    if item.words in ("drag force", "drag") and MEASURES.get(item.unit, "force") == "force":
        return replace(item, place=("tow", "tow_force_n"))
    is_speed = item.words in TOWED_SPEEDS and MEASURES.get(item.unit, "speed") == "speed"
    lone = item.is_lone_ahead(columns)
    is_speed = is_speed or item.is_speed_ahead or lone
    if is_speed and (lone or "velocity" not in streams) and "tow_speed_m_s" not in fields:
        return replace(item, place=("tow", "tow_speed_m_s"))
    return item


def _is_pose(columns: Sequence[NamedColumn]) -> bool:
    """Return whether bare roll, pitch and yaw are the attitude of a position."""
    position = {item.place[1] for item in columns if item.place and item.place[0] == "position"}
    attitudes = {item.words for item in columns if item.place and item.place[0] == "attitude"}
    quaternion = any(item.in_quaternion for item in columns)
    angles = {"roll", "pitch", "yaw"}
    return position == {"x_m", "y_m", "z_m"} and attitudes == angles and not quaternion


def _on_glider(item: NamedColumn) -> NamedColumn:
    """Return a glider's column with its place; others as they are."""
    spec = schema("glider").columns.get(item.name)
    if spec is not None and item.name != "time_us":
        return replace(item, place=("glider", item.name), unit=spec.unit or "")
    for pattern, field in GLIDER:
        if re.search(pattern, item.words):
            of_slocum = field == "pressure_pa" and SLOCUM.match(item.name)
            unit = "bar" if of_slocum and not item.unit else item.unit
            return replace(item, place=("glider", field), unit=unit)
    words = set(item.words.split())
    is_speed = item.is_speed_ahead or ("u" in words and words <= {"u"} | SPEED_SOURCES)
    return replace(item, place=("glider", "speed_m_s")) if is_speed else item
