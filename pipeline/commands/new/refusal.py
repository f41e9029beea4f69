"""Why a log feeds no campaign: in one line, and route by route."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from auvid.data_schemas.errors import DataError
from auvid.pipeline.commands.check.log_page import LogPage
from auvid.stages.ingest.formats.csv.column_proposal import SPEED_AHEAD
from auvid.stages.ingest.formats.csv.draft.drafting import NO_UNIT
from auvid.stages.ingest.health.actuation.outputs import activity
from auvid.stages.ingest.health.finding import CheckedLog, listed
from auvid.stages.ingest.health.usability import SHORTEST_DRIVEN_S, driven_s

FRAMES = {
    1: "fixed-wing aircraft",
    2: "quadrotor",
    3: "coaxial helicopter",
    4: "helicopter",
    7: "airship",
    10: "ground rover",
    11: "surface boat",
    13: "hexarotor",
    14: "octorotor",
    15: "tricopter",
    **dict.fromkeys(range(19, 26), "VTOL aircraft"),
}
"""MAV_TYPE in words."""
MEASURED = {
    "velocity": "velocity",
    "pose": "pose",
    "position": "position",
    "attitude": "attitude",
    "imu": "gyro",
    "depth": "depth",
}
NOT_UNDER_WATER = "not an underwater vehicle"
NO_ACTUATORS = "no actuators"
GCS_CSV = "QGroundControl"
NO_MEANING = "no meaning found for"


@dataclass(frozen=True)
class Refusal:
    """A log that feeds no campaign: what it is, what it lacks, what to do.

    `routes`: every route's own reason, and what the file has beside.
    """

    name: str
    log: str
    lacks: str
    remedy: str
    routes: tuple[str, ...] = ()

    @property
    def reason(self) -> str:
        """Return the refusal in one line, without the name of the log."""
        parts = (" ".join(part.split()).rstrip(".") for part in (self.log, self.lacks))
        return f"{'; '.join(filter(None, parts))}. {self.remedy}".rstrip(". ") + "."

    @property
    def line(self) -> str:
        """Return the refusal in one line."""
        return f"{self.name}: {self.reason}"


class NoCampaignError(DataError):
    """Logs of which none feeds a campaign, each with its refusal."""

    refusals: tuple[Refusal, ...] = ()

    @classmethod
    def of(
        cls, refusals: Sequence[Refusal], *, parted: Sequence[str] = (), in_full: bool = False
    ) -> NoCampaignError:
        """Return the fault of refused logs, a line each; in full each kind's reason.

        parted: which files belong together but for their times.
        """
        lines = list(parted)
        for item in refusals:
            lines += [item.line, *(f"  {words}" for words in item.routes if in_full)]
        head = "no campaign can be written: "
        if len(lines) > 1:
            head = "no campaign can be written\n"
        routes = any(item.routes for item in refusals)
        more = "" if in_full or not routes else "--verbose says why, for each kind of campaign."
        fault = cls(head + "\n".join(lines).rstrip("."), remedy=more or None)
        fault.refusals = tuple(refusals)
        return fault


def unreadable(name: str, page: LogPage) -> Refusal:
    """Return the refusal of a log that cannot be read, or that fills no stream."""
    return Refusal(name, "", str(page.refused).removeprefix(f"{name}: "), "")


def refusal_of(
    name: str, page: LogPage, log: CheckedLog, routes: Mapping[str, str], more: Sequence[str]
) -> Refusal:
    """Return the refusal of a decoded log.

    routes: kind -> why not. What counts is the reason of the route that the log comes
    furthest on: it goes by what drives it, a buoyancy drive or thrusters. more: what else
    its file has to say.
    """
    if log.under_water is False:
        lacks = NOT_UNDER_WATER
    elif log.has("glider"):
        lacks = routes["glide"]
    elif log.has("tow") or log.vehicle is not None:
        lacks = routes["passive"]
    elif not log.has("actuators"):
        lacks = f"{NO_ACTUATORS}: nothing in it tells what drives the vehicle"
    elif not log.thrusters() and not log.commands():
        lacks = routes["identification"]  # a propeller and fins feed no other kind
    else:
        lacks = routes["axes"]
    alike: dict[str, list[str]] = {}
    for kind, why in routes.items():
        alike.setdefault(why, []).append(f"kind: {kind}")
    reasons = tuple(f"{', '.join(kinds)}: {why}" for why, kinds in alike.items())
    return Refusal(name, _what(page, log), lacks, _remedy(log, lacks, more), (*reasons, *more))


def _what(page: LogPage, log: CheckedLog) -> str:
    """Return what a log is: firmware or format, length, and what it measures."""
    assert page.health is not None
    length = f"{float(page.health['duration_s']):.0f} s"
    mav_type = log.info.parameters.get("MAV_TYPE")
    frame = FRAMES.get(int(mav_type)) if mav_type is not None else None
    formats = " and ".join(page.health["formats"])
    name = log.info.vehicle or (f"{formats} of a {frame}" if frame else formats)
    cut = {"truncated": ", cut off", "damaged": ", damaged"}.get(page.health["status"], "")
    if log.has("actuators"):
        return f"{name}, {length}{cut}"
    there = [words for stream, words in MEASURED.items() if log.has(stream)]
    return f"{name}, {length} of {listed(there)}{cut}" if there else f"{name}, {length}{cut}"


def _remedy(log: CheckedLog, lacks: str, more: Sequence[str]) -> str:
    """Return what would make a log feed a campaign; more: what its file says beside."""
    if log.under_water is False:
        return "auvid models bodies under water"
    if log.has("glider"):
        unitless = "".join(f"{words.rstrip('.')}. " for words in more if NO_UNIT in words)
        density = (
            "Density follows from conductivity, temperature and pressure (TEOS-10); in mixed water"
            " stages.glide.constant_density: true of a campaign takes one figure. "
        )
        return (
            f"{unitless}{density if 'density' in lacks else ''}Settled glides need pressure, pitch,"
            " buoyancy drive and density of the water in the stream glider (docs/glide.md)"
        )
    if log.has("tow") or log.vehicle is not None:
        nameless = [f"{words.rstrip('.')}. " for words in more if _is_nameless(words)]
        return "".join(nameless) + (
            "Log a tow of 30 s and more at two speeds with velocity and tow force, three releases"
            " at speed, or a decay of roll, pitch or depth (docs/coasting.md)"
        )
    if not log.has("actuators"):
        if any(GCS_CSV in note for note in log.info.notes):
            return "Take the .tlog of the same dive: this CSV never holds outputs"
        unnamed = [words for words in more if "--commands" in words or "never move" in words]
        if unnamed:
            return " ".join(unnamed)
        if str(log.info.files[0].format).startswith("CSV"):
            nameless = [f"{words.rstrip('.')}. " for words in more if _is_nameless(words)]
            return "".join(nameless) + (
                "Add the file of its commands in the same call (--from imu.csv outputs.csv):"
                " pulses of each output, or commands of surge, sway, heave, yaw as shares of the"
                " largest, not in newtons (divide by that of a full command, and write it as"
                " full_force of the vehicle file, docs/axes.md); for a body that nothing drives"
                " (towed, let go, adrift) add --vehicle passive_body, or your own vehicle file"
                " without actuators"
            )
        return "Log the outputs that drive the vehicle (docs/streams.md)"
    if not log.has("velocity") and not log.thrusters() and not log.commands():
        unused = "".join(f" {words.rstrip('.')}." for words in more if _is_nameless(words))
        return (
            "Propeller and fins are fitted to velocities ahead, aside and down (a Doppler log, an"
            f" inertial navigation); one ahead alone does not tell them.{unused}"
        ).rstrip(".")
    acting = activity(log)
    if acting is None or not acting.any() or driven_s(log) < SHORTEST_DRIVEN_S:
        return (
            f"Log a dive in which it is armed and driven for {SHORTEST_DRIVEN_S:g} s and more,"
            " both ways in every axis of interest"
        )
    if "surface" in lacks:
        return "Log a dive that is deep enough for the thrusters to stay under water"
    return "Log a dive under water that moves both ways in every axis of interest, for a minute"


def _is_nameless(words: str) -> bool:
    """Return whether a sentence names columns that nothing uses."""
    return NO_MEANING in words or SPEED_AHEAD in words
