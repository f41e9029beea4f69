"""When outputs that come after the motion are on a late clock, and when they hold a vehicle."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from auvid.hydro.identification.checks.motion_checks import AxisGains
from auvid.hydro.identification.checks.response import Response
from auvid.stages.ingest.health.actuation import responses


@pytest.mark.parametrize(("gain", "late"), [(0.9, False), (0.05, True), (-0.9, True)])
def test_outputs_that_drive_a_motion_at_its_own_time_are_not_late(
    monkeypatch: pytest.MonkeyPatch, gain: float, late: bool
) -> None:
    """Outputs of a controller follow the motion, and their force still accelerates it."""
    own = AxisGains(np.array([gain]), np.array([0.02]), 0.5, 400)
    monkeypatch.setattr(responses, "push_responses", lambda _: [("v", own)])
    log: Any = object()
    answers = {"v": Response(-0.6, 0.9), "r": Response(0.2, 0.7)}
    assert (responses.late_outputs(log, answers) is not None) == late
