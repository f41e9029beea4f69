"""Units at the end of a column's name, and what they measure."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

UNIT_TEXTS: Mapping[str, str] = {
    "m/s": "m/s",
    "m/s^2": "m/s^2",
    "m/s2": "m/s^2",
    "m/s/s": "m/s^2",
    "m/s²": "m/s^2",
    "m/s**2": "m/s^2",
    "m.s-1": "m/s",
    "m.s-2": "m/s^2",
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
    "rev/s": "rps",
    "rev/min": "rpm",
    "1/s": "rps",
    "1/min": "rpm",
}
"""Units in brackets, as text."""
TABLE = """
m/s^2   m s 2; mps 2; ms 2; m per s 2; mps2; m s s; mss; m ss
g0      g; gs; gee
mg_n    mg
rad/s   rad s; rad s 1; rads 1; radps; rads; rad per s; rad sec; radians per second; rps
mrad/s  mrad s; mradps
deg/s   deg s; deg s 1; degs 1; degps; dps; degs; deg per s; deg sec; degrees per second; grad s
mdeg/s  mdps; mdeg s
cm/s    cm s; cmps; cms
mm/s    mm s; mmps; mms
m/s     m s; m s 1; ms 1; mps; m per s; meters per second; metres per second; ms
knot    kn; knot; knots; kt; kts
rad     rad; rads; radian; radians
deg     deg; degs; degree; degrees; grad
mm      mm; millimeters; millimetres
cm      cm; centimeters; centimetres
m       m; meter; meters; metre; metres
ft      ft; feet
us      us; usec; usecs; micros; microseconds
ms      ms; msec; msecs; millis; milliseconds
ns      ns; nsec; nsecs; nanos; nanosec; nanosecs; nanoseconds
s       s; sec; secs; second; seconds
mV      mv; millivolt; millivolts
V       v; volt; volts
A       a; amp; amps; ampere
mA      ma
rpm     rpm; rev min; rev per min
rps     rps; rev s; revps; hz
mbar    mbar; millibar; hpa
dbar    dbar; decibar
kPa     kpa
Pa      pa; pascal
psi     psi
bar     bar
kg/m^3  kgpm 3; kg m 3; kgm 3; kg per m 3
cm^3    cc; ccm; cm 3; ml
degC    degc; celsius; deg c; c
percent percent; pct
N       n; newton; newtons
kgf     kgf; kg f; kg; kgs; kilogram force; kp
lbf     lbf; lb f; lb; lbs; pound; pounds; pound force; pounds force
kN      kn; k n; kilonewton; kilonewtons
us      pwm
"""
MEASURES: Mapping[str, str] = {
    "m/s^2": "acceleration",
    "g0": "acceleration",
    "mg_n": "acceleration",
    "rad/s": "rate",
    "mrad/s": "rate",
    "deg/s": "rate",
    "mdeg/s": "rate",
    "cm/s": "speed",
    "mm/s": "speed",
    "m/s": "speed",
    "knot": "speed",
    "rad": "angle",
    "deg": "angle",
    "mm": "length",
    "cm": "length",
    "m": "length",
    "ft": "length",
    "us": "time",
    "ms": "time",
    "ns": "time",
    "s": "time",
    "mV": "voltage",
    "V": "voltage",
    "A": "current",
    "mA": "current",
    "rpm": "turns",
    "rps": "turns",
    "mbar": "pressure",
    "dbar": "pressure",
    "kPa": "pressure",
    "Pa": "pressure",
    "psi": "pressure",
    "bar": "pressure",
    "kg/m^3": "density",
    "cm^3": "volume",
    "degC": "temperature",
    "percent": "ratio",
    "1": "ratio",
    "N": "force",
    "kgf": "force",
    "lbf": "force",
    "kN": "force",
}
"""What a unit measures."""
LONGEST = 4
"""Words of the longest unit."""


def _units_by_words() -> dict[tuple[str, ...], tuple[str, ...]]:
    units: dict[tuple[str, ...], tuple[str, ...]] = {}
    for line in TABLE.strip().splitlines():
        unit, spellings = line.split(maxsplit=1)
        for spelling in spellings.split("; "):
            words = tuple(spelling.split())
            units[words] = (*units.get(words, ()), unit)
    return units


UNITS = _units_by_words()
"""Words -> the units that they may be: ms after a speed is m/s, after a time it is not."""
CASED = re.compile(r"(?<![A-Za-z])(?:hPa|kPa|mBar|dBar|kN|mV|mA|degC|rad/s|GPa|mG)(?![A-Za-z])")
"""Units whose capitals are no new word."""


def units_at_end(words: Sequence[str]) -> list[tuple[tuple[str, ...], str]]:
    """Return words before a unit, and the unit, for each that may end them."""
    readings = []
    for size in range(min(LONGEST, len(words) - 1), 0, -1):
        for unit in UNITS.get(tuple(words[-size:]), ()):
            readings.append((tuple(words[:-size]), unit))
    return readings


def unit_of_text(text: str, words: Sequence[str]) -> tuple[str, ...]:
    """Return the units that a text in brackets may be."""
    exact = UNIT_TEXTS.get(text.strip().lower().replace(" ", ""))
    return (exact,) if exact else UNITS.get(tuple(words), ())
