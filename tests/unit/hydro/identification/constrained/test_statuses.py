"""Statuses of numbers, and inertia told from lag or not."""

import numpy as np
import pytest

from auvid.hydro.dynamics.viscous.structures import symmetric
from auvid.hydro.identification.constrained.equations import Unknown, viscous_equations
from auvid.hydro.identification.constrained.fit import fit_within
from auvid.hydro.identification.constrained.inertia import inertia_against_lag
from auvid.hydro.identification.constrained.limits import damping, linear_dissipation
from auvid.hydro.identification.constrained.priors import NormalPrior
from auvid.hydro.identification.constrained.statuses import AT_BOUND, FROM_PRIOR, statuses
from auvid.hydro.identification.regression.verdicts import IDENTIFIED, INSEPARABLE, WEAK
from tests.support.constrained import Dive

EQUATIONS = viscous_equations(symmetric(), trim=True)
LOUD = dict.fromkeys("XYZKMN", 30.0)


def test_a_number_says_whether_data_bound_or_prior_gave_it():
    factor = Dive(size=np.array([0.2, 0.1, 0.1, 0.05, 0.001, 0.2])).factor()
    pitch, roll, surge = Unknown("M", "q"), Unknown("K", "p"), Unknown("X", "u")
    prior = NormalPrior.independent("vehicle", {pitch: (-1.0, 0.5), surge: (-50.0, 20.0)})
    fit = fit_within(factor, EQUATIONS, limits=[damping(EQUATIONS.unknowns)], priors=[prior])
    table = statuses(fit, {pitch: "not excited", roll: IDENTIFIED, surge: IDENTIFIED})
    assert table[pitch].status == FROM_PRIOR
    assert table[pitch].verdict == "not excited"
    assert fit.value("M", "q") == pytest.approx(-1.0, abs=0.1)
    assert table[roll].status == AT_BOUND
    assert table[roll].verdict == IDENTIFIED
    assert table[surge].status == IDENTIFIED
    assert table[surge].prior_share < 0.01
    # Shares are exact for independent information: prior over prior and data.
    i = fit.unknowns.index(pitch)
    data = 1.0 / fit.data_variances[i]
    assert table[pitch].prior_share == pytest.approx(4.0 / (4.0 + data), rel=0.02)


def test_a_limit_on_several_names_itself():
    factor = Dive().factor()
    fit = fit_within(factor, EQUATIONS, cuts=[linear_dissipation(EQUATIONS.unknowns)])
    table = statuses(fit, {})
    assert "damping matrix positive definite" in table[Unknown("K", "v")].held_by
    assert table[Unknown("K", "v")].status == ""


def test_what_the_data_leave_open_is_all_from_the_prior():
    factor = Dive(size=np.array([0.2, 0.1, 0.1, 0.0, 0.05, 0.2])).factor()
    chosen = [Unknown("Y", "p"), Unknown("K", "p"), Unknown("N", "p")]
    prior = NormalPrior.independent("vehicle", dict.fromkeys(chosen, (-1.0, 0.3)))
    table = statuses(fit_within(factor, EQUATIONS, priors=[prior]), {})
    assert [table[u].prior_share for u in chosen] == [1.0, 1.0, 1.0]


def test_inertia_is_identified_beside_a_lag_where_the_motion_tells_them_apart():
    dive = Dive(change=np.diag([0.0, 0, 0, 0, 0, -2.5]), lag_s=0.1, noise=0.2)
    trade = inertia_against_lag(dive.factor(), EQUATIONS, "N_rdot")
    assert trade.verdict == IDENTIFIED
    assert trade.joint[0] == pytest.approx(-2.5, abs=4 * trade.joint_errors[0])
    assert trade.joint[1] == pytest.approx(0.1, abs=4 * trade.joint_errors[1])
    assert trade.gain[2] >= max(trade.gain[:2])
    assert "beside a lag of 0.1" in str(trade)


def test_inertia_is_inseparable_where_thrust_follows_the_acceleration():
    # Little roll and pitch: their Coriolis moments q r and p r would give it away.
    size = np.array([0.2, 0.1, 0.1, 0.003, 0.003, 0.2])
    dive = Dive(change=np.diag([0.0, 0, 0, 0, 0, -2.5]), noise=0.2, size=size)
    # The actuator's moment is proportional to the yaw rate, but for a little.
    wobble = 1e-3 * np.sin(7.0 * 0.02 * np.arange(len(dive.nu)))
    dive.actuators[:, 5] = 3.0 * dive.nu[:, 5] + wobble
    trade = inertia_against_lag(dive.factor(), EQUATIONS, "N_rdot")
    assert trade.verdict == INSEPARABLE
    assert abs(trade.correlation) > 0.9
    assert "inseparable from the thrust lag of N" in str(trade)
    assert trade.single[0] == pytest.approx(-2.5, abs=0.2)


def test_inertia_that_the_data_do_not_show_is_weak():
    trade = inertia_against_lag(Dive().factor(), EQUATIONS, "N_rdot", noise=LOUD)
    assert trade.verdict == WEAK
