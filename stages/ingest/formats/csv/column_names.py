"""What names of CSV columns mean: streams, fields, units, as programs write them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from auvid.data_schemas.schemas import schema
from auvid.data_schemas.streams import STREAMS

WORDS = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+")
BRACKET = re.compile(r"\s*[\[(]([^\[\]()]*)[\])]\s*$")
INDEX = re.compile(r"(?<=\w)[\[(]([0-9])[\])]\s*$")
"""`gyro[1]` is the second of several, `gain [1]` has no unit."""
NO_MEASUREMENT = re.compile(
    r"\b(?:desired|target|setpoint|set point|reference|ref|sp|goal|cmd vel|command vel|std|sd|sigma"
    r"|variance|covariance|fom|temperature|temp|magnetometer|mag(?! heading)|north|east|ned|enu"
    r"|error|err|valid|status|raw count)\b"
)
"""What is commanded, says how sure something is, or is no field: velocities over ground too."""
TIME = re.compile(r"\b(?:t|time|timestamp|stamp|times|datetime|utc|elapsed|secs?|seconds|epoch)\b")
QUATERNION = re.compile(r"^(?:.* )?(?:q|quat|quaternion|orientation|rotation) ?[wxyz]$|^q[wxyz]$")
UNIT_WORDS: tuple[tuple[str, str], ...] = (
    (r"m s 2|mps 2|ms 2|m per s 2|mps2|m s s", "m/s^2"),
    (r"rad s|radps|rads|rad per s|rad sec|radians per second", "rad/s"),
    (r"deg s|degps|dps|deg per s|deg sec|degrees per second", "deg/s"),
    (r"cm s|cmps", "cm/s"),
    (r"mm s|mmps", "mm/s"),
    (r"m s|mps|m per s|meters per second|metres per second", "m/s"),
    (r"rad|rads|radian|radians", "rad"),
    (r"deg|degs|degree|degrees", "deg"),
    (r"mm|millimeters|millimetres", "mm"),
    (r"cm|centimeters|centimetres", "cm"),
    (r"m|meter|meters|metre|metres", "m"),
    (r"ft|feet", "ft"),
    (r"kn|knot|knots|kt", "knot"),
    (r"us|usec|micros|microseconds", "us"),
    (r"ms|msec|millis|milliseconds", "ms"),
    (r"ns|nsecs?|nanos|nanosecs?|nanoseconds", "ns"),
    (r"s|sec|secs|seconds", "s"),
    (r"mv|millivolt|millivolts", "mV"),
    (r"volt|volts", "V"),
    (r"amp|amps|ampere", "A"),
    (r"rpm", "rpm"),
    (r"mbar|millibar|hpa", "mbar"),
    (r"dbar|decibar", "dbar"),
    (r"kpa", "kPa"),
    (r"pa|pascal", "Pa"),
    (r"bar", "bar"),
    (r"kgpm 3|kg m 3|kgm 3|kg per m 3", "kg/m^3"),
    (r"cc|ccm|cm 3|ml", "cm^3"),
    (r"degc|celsius", "degC"),
    (r"percent|pct", "percent"),
)
TOW_WORDS = re.compile(r"\b(?:tow(?:ing)? (?:force|tension|load)|tension|load cell)\b")
TOW_UNITS = re.compile(
    r" (?:in )?(?:(?P<kgf>kgf|kg f|kgs?|kilogram force|kp)"
    r"|(?P<lbf>lbf|lb f|lbs?|pounds?(?: force)?)|(?P<kN>k ?n|kilonewtons?)|(?P<N>n|newtons?))$"
)
"""Units of the force of a line: kg and lb of a load cell are forces, kn is no knot."""
UNIT_TEXTS: Mapping[str, str] = {
    "m/s": "m/s",
    "m/s^2": "m/s^2",
    "m/s2": "m/s^2",
    "m/s/s": "m/s^2",
    "m/s²": "m/s^2",
    "rad/s": "rad/s",
    "rad/sec": "rad/s",
    "deg/s": "deg/s",
    "deg/sec": "deg/s",
    "°/s": "deg/s",
    "°": "deg",
    "cm/s": "cm/s",
    "mm/s": "mm/s",
    "µs": "us",
    "μs": "us",
    "kn": "knot",
    "kts": "knot",
    "v": "V",
    "a": "A",
    "g": "g0",
    "%": "percent",
    "-": "1",
    "1": "1",
    "pwm": "us",
}
AXIS = {
    "x": "x",
    "y": "y",
    "z": "z",
    "roll": "x",
    "pitch": "y",
    "yaw": "z",
    "p": "x",
    "q": "y",
    "r": "z",
}
SPEED = {"surge": "u", "sway": "v", "heave": "w", "x": "u", "y": "v", "z": "w"}
SPEED |= {"u": "u", "v": "v", "w": "w"}
ANGLE = {"roll": "phi", "pitch": "theta", "yaw": "psi", "heading": "psi", "hdg": "psi"}
ANGLE |= {"phi": "phi", "theta": "theta", "psi": "psi", "compass": "psi"}
ANGLE |= {"x": "phi", "y": "theta", "z": "psi"}
COMMAND = {"x": "surge", "y": "sway", "z": "heave", "k": "roll", "m": "pitch", "n": "yaw"}
GLOBE = {"lat": "latitude", "lon": "longitude", "lng": "longitude", "long": "longitude"}
PLACE = {"northing": "x", "easting": "y"}
PATTERNS: tuple[tuple[str, str, str, dict[str, str]], ...] = (
    (
        r"\b(?:gyro|gyroscope|gyr|angular rate|angular velocity|angular vel|ang vel|angvel"
        r"|angular|omega|body rates?|rate|w|g|gx) ?([xyz])\b",
        "imu",
        "gyro_{}_rad_s",
        AXIS,
    ),
    (r"^(?:gyro |rate |imu |body |nu )?([pqr])(?: rate| body)?$", "imu", "gyro_{}_rad_s", AXIS),
    (r"\b(roll|pitch|yaw) ?(?:rate|speed|vel|velocity|spd)", "imu", "gyro_{}_rad_s", AXIS),
    (
        r"\b(?:accel|accelerometer|acceleration|acc|linear acceleration|specific force|a)"
        r" ?([xyz])\b",
        "imu",
        "accel_{}_m_s2",
        AXIS,
    ),
    (r"\b(surge|sway|heave) (?:rate|speed|velocity|vel)\b", "velocity", "{}_m_s", SPEED),
    (
        r"\b(?:vel|velocity|speed|linear velocity|linear|twist linear|v)"
        r"(?: (?:body|b|dvl|bt|frd|bottom track))? ?([xyz])\b",
        "velocity",
        "{}_m_s",
        SPEED,
    ),
    (
        r"^(?:(?:dvl|body|vel|velocity|speed|bottom track|bt|nu) )*([uvw])"
        r"(?: ?(?:dvl|body|bt|b))?$",
        "velocity",
        "{}_m_s",
        SPEED,
    ),
    (
        r"^(surge|sway|heave)$|^(?:cmd|command|u|tau|ctrl|control|input|joy|thrust|force|demand)"
        r" ?(surge|sway|heave|roll|pitch|yaw|x|y|z|k|m|n)$"
        r"|^(surge|sway|heave|roll|pitch|yaw) (?:cmd|command|input|control|demand|effort)$",
        "actuators",
        "command_{}",
        COMMAND,
    ),
    (
        r"^(?:pwm|pulse|servo|motor|thruster|output|thr|rcou|rc out|esc|servo output|mot|thrust)s?"
        r"(?: out| c| pwm| cmd| command| chan| channel| ch)? ?(\d+)"
        r"(?: raw| pwm| output| cmd| command)*$"
        r"|^(?:ch|chan|channel|c|t|m) ?(\d+)(?: out| raw| pwm| cmd)*$",
        "actuators",
        "pwm_{}_us",
        {},
    ),
    (r"^(?:propeller|prop|shaft|motor|thruster)? ?rpm$", "actuators", "propeller_rev_s", {}),
    (
        r"\b(roll|pitch|yaw|heading|hdg|compass|phi|theta|psi)(?: angle)?$",
        "attitude",
        "{}_rad",
        ANGLE,
    ),
    (r"\b(?:euler|rpy|euler angles?) ?([xyz])$", "attitude", "{}_rad", ANGLE),
    (
        r"\b(?:depth(?: (?:value|sensor|filtered|measured))?|pressure|press|water pressure)$",
        "depth",
        "depth_m",
        {},
    ),
    (
        r"^(?:p|loc|location|mocap|marker|odom)? ?([xyz])$"
        r"|\b(?:pos|position|translation) ?([xyz])$",
        "position",
        "{}_m",
        {},
    ),
    (
        r"^(?:usbl |ugps |gps |acoustic )?(lat|latitude|lon|lng|long|longitude)$",
        "fixes",
        "{}_rad",
        GLOBE,
    ),
    (r"^(?:usbl|ugps|lbl|acoustic|fix) (north|east)(?:ing)?$", "fixes", "{}_m", {}),
    (r"\b(northing|easting)$", "position", "{}_m", PLACE),
    (
        r"\b(?:tow(?:ing)? (?:force|tension|load)|tension|load cell)(?: n| newtons?)?$",
        "tow",
        "tow_force_n",
        {},
    ),
    (r"\b(?:voltage|volt|vbat|vbatt|millivolt|batt v|battery v)\b", "battery", "voltage_v", {}),
)
BUOYANCY = re.compile(r"\b(?:buoyancy|ballast|oil vol|oil volume|bladder|vbd)\b")
GLIDER: tuple[tuple[str, str], ...] = (
    (r"\b(?:pressure|press|p)$", "pressure_pa"),
    (r"\b(?:pitch|theta)(?: angle)?$", "pitch_rad"),
    (BUOYANCY.pattern, "buoyancy_drive_m3"),
    (r"\b(?:density|rho)$", "density_kg_m3"),
    (r"\b(?:temperature|temp|water temp)$", "temperature_K"),
    (r"^(?:u|speed|velocity|stw)(?: (?:adcp|dvl|water|through water))?$", "speed_m_s"),
)
"""Columns of a glider by their words; a column of the buoyancy drive tells one."""
SIDES = {"forward": "u", "starboard": "v", "right": "v", "left": "v", "down": "w", "up": "w"}
"""A velocity whose columns are called by where they point."""
SHORT_SIDES = {"fwd": "u", "stbd": "v", "port": "v"}
"""These may be thrusters, too: a velocity where their unit is that of a speed."""
AHEAD, ASIDE = {"forward", "fwd"}, {"left", "right", "starboard", "stbd", "port"}
FLIPPED = ("left", "port", "up")
OF_ANY = ("pitch_rad", "pressure_pa")
"""Fields of a glider by name, which other vehicles have too."""
SPEED_UNITS, RATE_UNITS = ("m/s", "cm/s", "mm/s", "knot"), ("rad/s", "deg/s")
VELOCITY_WORDS = re.compile(r"(?:^|\b)(?:velocity|vel|speed|spd|dvl|body|bt|bottom track|v)\b ?")
VECTORS: Mapping[int, str] = {3: "xyz", 4: "wxyz", 6: "uvwpqr"}
"""Letters of the numbered parts of a vector, by how many there are."""
OF_VECTORS = ("imu", "velocity", "position", "attitude")


@dataclass(frozen=True)
class NamedColumn:
    """A column by its name: words without the unit, unit or '', place or None."""

    name: str
    words: str
    unit: str
    place: tuple[str, str] | None
    frame: str = ""


def named_columns(names: Sequence[str]) -> list[NamedColumn]:
    """Return what every name of a header means."""
    parts = _without_numbers([split_unit(name) for name in names])
    stems = [words for words, _ in parts]
    # Beside commands of surge and sway a bare `yaw` is one as well, but not that of a pose.
    steered = {"surge", "sway"} <= set(stems) and not _is_pose(stems)
    directions = [VELOCITY_WORDS.sub("", words).strip() for words in stems]
    pointed = bool(AHEAD & set(directions)) and bool(ASIDE & set(directions))
    glides = any(BUOYANCY.search(words) for words in stems)
    result = []
    for name, (words, unit), direction in zip(names, parts, directions, strict=True):
        place, frame = place_of(name, words, glides=glides), ""
        if glides:
            place = _place_on_glider(words) or place
        if steered and words in ("yaw", "roll", "pitch") and not unit:
            place = ("actuators", f"command_{words}")
        place = _place_by_unit(words, unit) or place
        speed = unit in SPEED_UNITS or direction != words
        sides = SIDES | SHORT_SIDES if speed else SIDES
        if pointed and direction in sides and not NO_MEASUREMENT.search(words):
            place = ("velocity", f"{sides[direction]}_m_s")
            frame = "flu" if direction in FLIPPED else ""
        result.append(NamedColumn(name, words, unit, place, frame))
    return result


def _without_numbers(parts: Sequence[tuple[str, str]]) -> list[tuple[str, str]]:
    """Return words and units with letters for the numbers of a vector's parts.

    A vector of 3, 4 or 6 parts, counted from 0 or 1, that no other column continues, and
    whose letters name something: gyro 0, 1, 2 are gyro x, y, z; nu 1 to 6 u to r.
    """
    numbers: dict[str, dict[int, int]] = {}
    for at, (words, _) in enumerate(parts):
        match = re.fullmatch(r"((?:.* )?(?:[a-z]{2,}|q)) (\d)", words)
        if match:
            numbers.setdefault(match[1], {})[int(match[2])] = at
    result = list(parts)
    for stem, places in numbers.items():
        first, count = min(places), len(places)
        letters = VECTORS.get(count, "")
        if first > 1 or sorted(places) != list(range(first, first + count)) or not letters:
            continue
        named = [f"{stem} {letter}" for letter in letters]
        meanings = [place_of("", words) for words in named]
        quaternion = all(QUATERNION.search(words) for words in named)
        if quaternion or all(place and place[0] in OF_VECTORS for place in meanings):
            for number, at in places.items():
                result[at] = named[number - first], parts[at][1]
    return result


def _place_by_unit(words: str, unit: str) -> tuple[str, str] | None:
    """Return the place of a column whose unit tells what it measures, else None."""
    if unit in SPEED_UNITS and words in ("surge", "sway", "heave"):
        return "velocity", f"{SPEED[words]}_m_s"
    if unit in RATE_UNITS and words in ("roll", "pitch", "yaw"):
        return "imu", f"gyro_{AXIS[words]}_rad_s"
    if unit == "rpm" and re.fullmatch(r"(?:propeller|prop|shaft|motor|thruster)", words):
        return "actuators", "propeller_rev_s"
    return None


def _is_pose(stems: Sequence[str]) -> bool:
    """Return whether bare roll, pitch and yaw are the attitude of a position."""
    places = {(words, place_of(words, words)) for words in stems}
    position = {place[1] for _, place in places if place and place[0] == "position"}
    attitudes = {words for words, place in places if place and place[0] == "attitude"}
    quaternion = any(QUATERNION.search(words) for words in stems)
    angles = {"roll", "pitch", "yaw"}
    return position == {"x_m", "y_m", "z_m"} and attitudes == angles and not quaternion


def _place_on_glider(words: str) -> tuple[str, str] | None:
    """Return the place of a glider's column, None for one that is none of GLIDER."""
    for pattern, field in GLIDER:
        if re.search(pattern, words):
            return "glider", field
    return None


def split_unit(name: str) -> tuple[str, str]:
    """Return the words of a name without its unit, and that unit ('' if it has none).

    >>> split_unit("Yaw Rate [deg/s]"), split_unit("vel_x_mps"), split_unit("u")
    (('yaw rate', 'deg/s'), ('vel x', 'm/s'), ('u', ''))
    """
    unit = ""
    for stream in STREAMS:
        spec = None if name in OF_ANY else schema(stream).columns.get(name)
        if spec is not None and spec.dtype.startswith("float") and spec.unit:
            return _words(name), spec.unit
    towed = TOW_UNITS.search(_words(name)) if TOW_WORDS.search(_words(name)) else None
    if towed and towed.lastgroup:
        return _words(name)[: towed.start()], towed.lastgroup
    index = INDEX.search(name)
    if index:
        words, unit = split_unit(name[: index.start()])
        return f"{words} {index[1]}", unit
    bracket = BRACKET.search(name)
    if bracket:
        inner = bracket[1].strip()
        unit = UNIT_TEXTS.get(inner.lower(), "") or _unit_of_words(_words(inner))
        name = name[: bracket.start()] if unit else name
    words = _words(name)
    if not unit:
        for pattern, of_words in UNIT_WORDS:
            match = re.search(rf" (?:{pattern})$", words)
            if match and len(words[: match.start()]):
                return words[: match.start()], of_words
        if words in ("millivolt", "millivolts"):
            return "millivolt", "mV"
    return words, unit


def _unit_of_words(words: str) -> str:
    return next((unit for pattern, unit in UNIT_WORDS if re.fullmatch(pattern, words)), "")


def _words(name: str) -> str:
    return " ".join(WORDS.findall(name)).lower()


def place_of(name: str, words: str, *, glides: bool = False) -> tuple[str, str] | None:
    """Return stream and field of a column, None if its name tells none.

    pitch_rad is a glider's only where the file `glides`.
    """
    for stream in STREAMS:
        if stream == "glider" and not glides:
            continue
        spec = None if name == "time_us" else schema(stream).columns.get(name)
        if spec is not None and spec.dtype.startswith("float"):
            return stream, name
    if NO_MEASUREMENT.search(words) or QUATERNION.search(words):
        return None
    for pattern, stream, field, translated in PATTERNS:
        match = re.search(pattern, words)
        if match:
            part = next((item for item in match.groups() if item), "")
            return stream, field.format(translated.get(part, part))
    return None
