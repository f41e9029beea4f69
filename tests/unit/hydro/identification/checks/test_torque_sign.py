"""The sign of a propeller's torque, from made roll moments."""

from __future__ import annotations

import numpy as np
import pytest

from auvid.hydro.identification.checks.torque_sign import RollLeg, torque_share

STEP_S, SECONDS = 0.05, 200.0


def roll_leg(feels: float, seed: int = 1, *, cant: float = 0.0, steady: bool = False) -> RollLeg:
    """Return a leg whose hull feels so much of the file's torque, and fins at a cant."""
    rng = np.random.default_rng(seed)
    n = round(SECONDS / STEP_S)
    turns = np.repeat(rng.choice([13.0, 18.0, 25.0], n // 400 + 1), 400)[:n]
    nu = np.zeros((n, 6))
    for k in range(n - 1):  # a second or two until the speed follows the propeller
        nu[k + 1, 0] = nu[k, 0] + STEP_S * 0.7 * (turns[k] / 15.0 - nu[k, 0])
    if steady:
        nu[:, 0] = turns / 15.0
    nu[:, 3] = 0.2 * np.sin(np.arange(n) * STEP_S)
    torque = -0.002 * turns**2 * (1.3 - 0.6 * nu[:, 0] * 15.0 / turns)
    moment = (feels - 1.0) * torque - 0.5 * nu[:, 0] * nu[:, 3] + cant * nu[:, 0] ** 2 + 0.1
    moment += 0.05 * rng.standard_normal(n)
    return RollLeg(nu, moment, torque, STEP_S)


@pytest.mark.parametrize("cant", [0.0, 0.4])
@pytest.mark.parametrize(("feels", "backward"), [(1.0, False), (-1.0, True), (0.0, False)])
def test_the_share_of_the_torque_is_found_beside_a_cant(
    feels: float, backward: bool, cant: float
) -> None:
    share = torque_share([roll_leg(feels, cant=cant)])
    assert share is not None
    assert share.value == pytest.approx(feels, abs=4.0 * share.standard_error)
    assert share.standard_error < 0.1
    assert share.backward == backward


def test_nothing_is_said_where_the_torque_is_no_other_than_a_cant() -> None:
    """In steady legs torque goes with the square of the speed, and the error is large."""
    for seed in range(5):
        share = torque_share([roll_leg(1.0, seed, cant=0.4, steady=True)])
        assert share is None or not share.backward


def test_a_short_leg_and_a_propeller_without_torque_tell_nothing() -> None:
    leg = roll_leg(-1.0)
    short = RollLeg(leg.nu[:400], leg.moment[:400], leg.torque[:400], STEP_S)
    assert torque_share([short]) is None
    assert torque_share([RollLeg(leg.nu, leg.moment, np.zeros_like(leg.torque), STEP_S)]) is None
    assert torque_share([]) is None
