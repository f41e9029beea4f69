"""One colour per axis, role, force and model, the same in report and recording.

Hues are those of Okabe and Ito (2008), which stay apart for colour-blind readers; each
is darkened for paper and lightened for a dark screen until it stands out at 3:1 (WCAG
2.1, 1.4.11). Where hues run out, the line is dashed.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

PAPER = "#ffffff"
SCREEN = "#14181f"


@dataclass(frozen=True)
class Ink:
    """How a line is drawn.

    Colour on paper, colour on a dark screen, dash pattern in pixels (empty: solid),
    width in pixels.
    """

    light: str
    dark: str
    dash: str = ""
    width: float = 1.5

    @property
    def rgb(self) -> tuple[int, int, int]:
        """Return the colour on a dark screen as 0..255, for Rerun."""
        return int(self.dark[1:3], 16), int(self.dark[3:5], 16), int(self.dark[5:7], 16)


BLACK = ("#1b2430", "#e9edf2")
GREY = ("#868f9b", "#848d99")
BLUE = ("#0072b2", "#4aa3dc")
VERMILLION = ("#c95600", "#ee7d31")
GREEN = ("#00875f", "#1fb98c")
PURPLE = ("#b0588a", "#d98ab6")
ORANGE = ("#b27800", "#e6a52a")
SKY = ("#2a8cc4", "#7cc7f0")
OLIVE = ("#857b00", "#ded34b")

AXIS_INKS: Mapping[str, Ink] = {
    **dict.fromkeys(("x", "u", "p", "phi", "k", "surge", "roll"), Ink(*VERMILLION)),
    **dict.fromkeys(("y", "v", "q", "theta", "m", "sway", "pitch"), Ink(*GREEN)),
    **dict.fromkeys(("z", "w", "r", "psi", "n", "heave", "yaw"), Ink(*BLUE)),
}
ROLES: Mapping[str, Ink] = {
    "raw": Ink(*GREY, width=1.2),
    "dropped": Ink(*VERMILLION, dash="2 3"),
    "resampled": Ink(*SKY),
    "fused": Ink(*BLUE, width=1.8),
    "measured": Ink(*BLACK, width=1.8),
    "true": Ink(*PURPLE, dash="6 3"),
    "desired": Ink(*PURPLE, dash="6 3"),
    "band": Ink(*SKY, width=1.0),
    "predicted": Ink(*VERMILLION),
    "difference": Ink(*ORANGE),
    "first": Ink(*BLUE, width=2.2),
    "second": Ink(*VERMILLION),
    "training": Ink(*BLUE),
    "validation": Ink(*VERMILLION),
    "quadratic": Ink(*VERMILLION),
    "linear_and_quadratic": Ink(*GREEN, dash="6 3", width=2.0),
}
COMPONENTS: Mapping[str, Ink] = {
    "tau_bar": ROLES["measured"],
    "rigid_body_inertia": Ink(*BLUE),
    "added_mass_inertia": Ink(*SKY, dash="5 2"),
    "rigid_body_coriolis": Ink(*GREEN),
    "added_mass_coriolis": Ink(*OLIVE, dash="5 2"),
    "restoring": Ink(*PURPLE),
    "fins": Ink(*ORANGE),
    "propeller": Ink(*VERMILLION),
    "thrusters": Ink(*VERMILLION),
}
MODELS: Mapping[str, Ink] = {
    "symmetric": Ink(*VERMILLION, width=1.8),
    "diagonal": Ink(GREEN[0], GREEN[0], dash="6 3"),
    "symmetric_quadratic": Ink(PURPLE[0], PURPLE[0], dash="6 3"),
    "lift_and_drag": Ink(BLUE[0], BLUE[0], dash="6 3"),
    "linear": Ink(*BLUE),
    "mcfarland": Ink(VERMILLION[0], VERMILLION[0], dash="2 3"),
    "mcfarland_whitcomb": Ink(VERMILLION[0], VERMILLION[0], dash="2 3"),
    "gertler_hagen": Ink(*GREEN),
    "prestero": Ink(*PURPLE),
    "pitch_yaw": Ink(*ORANGE),
    "coe": Ink(*SKY, dash="7 3"),
    "uncoupled": Ink(*OLIVE),
    "fossen": Ink(*GREY, dash="2 3", width=2.0),
}
SPARE = (BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY, OLIVE)
DASHES = ("", "6 3", "2 3")


def key(role: str) -> str:
    """Return a name as a plain word: `Gertler-Hagen` -> `gertler_hagen`."""
    return re.sub(r"[^a-z0-9]+", "_", role.lower()).strip("_")


def ink(role: str) -> Ink:
    """Return the ink of a role, force component, model or axis.

    An unknown name gets one that depends on the name alone.
    """
    name = key(role)
    return _own(name) or Ink(*SPARE[zlib.crc32(name.encode()) % len(SPARE)], dash="4 2")


def _own(name: str) -> Ink | None:
    return next(
        (family[name] for family in (ROLES, COMPONENTS, MODELS, AXIS_INKS) if name in family), None
    )


def distinct(names: Iterable[str]) -> dict[str, Ink]:
    """Return a colour for each of some names of no fixed colour (flight modes).

    Colours follow the order of the names; few names get different ones.
    """
    return {
        name: Ink(*SPARE[place % len(SPARE)]) for place, name in enumerate(dict.fromkeys(names))
    }


def inks_of(roles: Iterable[str]) -> dict[str, Ink]:
    """Return the ink of every role of a page or of a group of lines, by `key`.

    Names without a colour of their own get different ones.

    Those are told apart by hue, then by dash and (in recordings, which have no dashes)
    by a deeper shade.
    """
    names = list(dict.fromkeys(key(role) or "none" for role in roles))
    own = {name: _own(name) for name in names}
    free = sorted(name for name, item in own.items() if item is None)
    taken = {(item.light, item.dash) for item in own.values() if item is not None}
    inks = [
        Ink(light, dark if turn % 2 == 0 else light, dash=dash)
        for turn, dash in enumerate(DASHES)
        for light, dark in SPARE
        if (light, dash) not in taken
    ]
    own_inks = {name: inks[place % len(inks)] for place, name in enumerate(free)}
    return {name: item or own_inks[name] for name, item in own.items()}


def roles_of(sections: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Return all roles in the plots of sections."""
    blocks = [
        block
        for document in sections.values()
        for block in document["blocks"]
        if block["kind"] == "plot"
    ]
    return sorted(
        {
            str(series["role"])
            for block in blocks
            for panel in block["panels"]
            for series in panel["series"]
        }
    )


def is_model(role: str) -> bool:
    """Return whether a role names a viscous model that has a colour of its own."""
    return key(role) in MODELS
