"""When outputs that come after the motion are on a late clock, and when they hold a vehicle."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from auvid.hydro.identification.checks.motion_checks import response_gains
from auvid.hydro.identification.checks.response import Response
from auvid.hydro.identification.checks.robust_gains import AxisGains
from auvid.stages.ingest.health.actuation import responses
from auvid.stages.ingest.health.actuation.push_answers import OWN_PUSH, weak_forces


@pytest.mark.parametrize(("gain", "late"), [(0.9, False), (0.05, True), (-0.9, True)])
def test_outputs_that_drive_a_motion_at_its_own_time_are_not_late(
    monkeypatch: pytest.MonkeyPatch, gain: float, late: bool
) -> None:
    """Outputs of a controller follow the motion, and their force still accelerates it."""
    own = AxisGains(np.array([gain]), np.array([0.02]), 0.5, 400, np.array([0.6]))
    monkeypatch.setattr(responses, "push_responses", lambda _: [("v", own)])
    log: Any = object()
    answers = {"v": Response(-0.6, 0.9), "r": Response(0.2, 0.7)}
    assert (responses.late_outputs(log, answers) is not None) == late


@pytest.mark.parametrize(("levelling", "apart_from_damping"), [(0.0, True), (2.0, False)])
def test_a_push_that_levels_the_hull_tells_no_scale(
    levelling: float, apart_from_damping: bool
) -> None:
    """What turns against rate and tilt stands for damping: its gain is no scale of the thrust.

    phi_ddot = 3 a - 0.8 phi_dot - 2 phi - 3 phi_dot |phi_dot|, with thrust that the
    vehicle file takes for a third: a stick, or -levelling (phi + phi_dot) against a push
    from elsewhere.
    """
    step, rng = 0.02, np.random.default_rng(4)
    t_s = np.arange(0.0, 120.0, step)
    stick = np.repeat(rng.normal(0.0, 0.6, t_s.size // 50 + 1), 50)[: t_s.size]
    tilt, rate, push = np.zeros((3, t_s.size))
    for i in range(1, t_s.size):
        push[i] = -levelling * (tilt[i - 1] + rate[i - 1]) if levelling else stick[i]
        turn = 3.0 * push[i] - 0.8 * rate[i - 1] - 2.0 * tilt[i - 1]
        turn += stick[i] if levelling else 0.0
        rate[i] = rate[i - 1] + step * (turn - 3.0 * rate[i - 1] * abs(rate[i - 1]))
        tilt[i] = tilt[i - 1] + step * rate[i]
    measured = rate + 0.002 * rng.standard_normal(t_s.size)
    gains = response_gains(t_s, np.column_stack([push, np.sin(tilt)]), t_s, measured)
    assert gains is not None
    findings = list(weak_forces({"p": gains, "q": gains}))
    assert (gains.own[0] > OWN_PUSH, len(findings) == 1) == (apart_from_damping, apart_from_damping)
    if apart_from_damping:
        assert gains.gain[0] == pytest.approx(3.0, rel=0.1)


@pytest.mark.parametrize(("slow", "name"), [("pr", "response_scale"), ("ur", "response_unit")])
def test_turns_that_are_slow_alone_stop_no_run(slow: str, name: str) -> None:
    """Moments of inertia in files are off by factors, which is no wrong unit of the thrust."""
    gains = AxisGains(np.array([0.18]), np.array([0.005]), 0.93, 400, np.array([0.6]))
    (one,) = weak_forces(dict.fromkeys(slow, gains))
    assert one["id"] == name
    assert ("moments of inertia" in one["remedy"]) == (slow == "pr")
