"""A drive that moves less than logged shows in layered water, a sound one does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from auvid.hydro.identification.glide.bins import GlideRows
from auvid.hydro.identification.glide.drive_gap import DriveGap, doubted, drive_gap
from auvid.hydro.identification.glide.fit import GlideEstimate, fit_glides
from tests.support.glider_twin import BODY, file_figures, flight, record, rows_of

PITCH_RAD = -float(np.radians(24.0))
STROKE_M3 = 4.6e-4


def gap_of(rows: GlideRows) -> tuple[GlideEstimate, DriveGap]:
    estimate = fit_glides(rows, body=BODY, prior=file_figures())
    gap = drive_gap(
        rows,
        estimate,
        body=BODY,
        prior=file_figures(),
        stroke_m3=STROKE_M3,
        pitch_rad=PITCH_RAD,
    )
    assert gap is not None
    return estimate, gap


def test_a_drive_at_its_stop_on_climbs_is_named_with_the_drag_it_hides() -> None:
    """The log says 80 cm^3 more on climbs than the hull has: drag is a fifth too large."""
    sound = rows_of(record(flight(), 1))
    up = sound.state.pitch_rad > 0.0
    logged = replace(sound.state, drive_m3=sound.state.drive_m3 + 8e-5 * up)
    true, without = gap_of(sound)
    wrong, gap = gap_of(replace(sound, state=logged))
    assert not without.named
    assert without.drag_factor == pytest.approx(0.9, abs=0.01)
    assert gap.named
    assert gap.size_m3 == pytest.approx(-8e-5, abs=3e-5)
    off = wrong.at_pitch(PITCH_RAD)["C_D"][0] / true.at_pitch(PITCH_RAD)["C_D"][0]
    assert off > 1.12
    assert off * gap.drag_factor == pytest.approx(1.0, abs=0.05)
    assert doubted(wrong, "C_D0").verdicts["C_D0"] == "weak"
