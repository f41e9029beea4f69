"""Swings of one channel pooled: damping of one kind only."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from scipy.signal import lfilter

from auvid.data_schemas.documents.campaign import LegEntry
from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.tables import make_table
from auvid.hydro.arrays import Array
from auvid.hydro.constants import NORMAL_95
from auvid.hydro.identification.passive.free_swing import FreeSwing
from auvid.hydro.identification.passive.tow import TowRecord, fit_tow, force_delay
from auvid.stages.columns import POSITION
from auvid.stages.passive.figures import alike_damped, passive_results, pooled
from auvid.stages.passive.motions import (
    MotionRules,
    PassiveMotions,
    motions_of,
    position_slope,
    read_leg,
)
from auvid.stages.passive.presentation import passive_section
from tests.support.motions import shipped_vehicle
from tests.support.towed_body import LINEAR, MASS_KG, QUADRATIC, towed_body

T_S, PATH = 0.05 * np.arange(2400), np.array([0.12, -0.05])


def swing(damping: str, values: tuple[float, float, float], amplitude: float) -> FreeSwing:
    nothing = np.zeros(0)
    return FreeSwing(
        np.array(values), np.diag([1e-4, 1e-4, 1e-4]), 0.0, 4.0, amplitude, 0.01, damping,
        nothing, nothing, nothing,
    )  # fmt: skip


def test_damping_is_the_mean_of_swings_with_the_same_terms() -> None:
    both = [swing("both", (6.0, 0.4, 0.3), 0.4), swing("both", (6.2, 0.42, 0.32), 0.4)]
    values, errors = pooled([*both, swing("linear", (5.8, 0.6, 0.0), 0.2)])
    assert values == pytest.approx([6.0, 0.41, 0.31])
    assert errors[0] == pytest.approx(4.302653 / 1.959964 * 0.2 / np.sqrt(3.0))


def test_nothing_is_identified_beside_an_interval_with_zero() -> None:
    """Of six windows the interval has one degree of freedom."""
    for seed in range(8):
        body = towed_body(seed)
        names = ("time_s", "u_m_s", "tow_force_n")
        tows = [TowRecord(*(body[name][at : at + 280] for name in names)) for at in (0, 660)]
        fit = fit_tow(tows, mass_kg=MASS_KG, mass_sd_kg=MASS_KG)
        motions = PassiveMotions(tow_fits={"surge": fit})
        rows = passive_results(motions, shipped_vehicle("bluerov2_heavy"))["rows"]
        # The drag is that at the speed in its name.
        at_speed = float(rows[0]["quantity"].split()[-2])
        assert rows[0]["value"] == pytest.approx(fit.drag(at_speed)[0])
        for row in rows:
            if row["verdict"] == "identified":
                assert np.prod(np.sign([row["low"], row["high"]])) > 0.0, row


def test_one_decay_is_weak_for_nothing_tells_what_water_adds() -> None:
    of = swing("both", (6.0, 0.4, 0.3), 0.4)
    for count, verdict in ((1, "weak"), (2, "identified")):
        motions = PassiveMotions(swings={"roll": [("leg", of)] * count})
        rows = passive_results(motions, shipped_vehicle("bluerov2_heavy"))["rows"]
        assert rows[0]["quantity"] == "frequency in roll"
        assert rows[0]["verdict"] == verdict


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({}, None),
        ({"tow_force_n": 1.0 / 9.81}, "in another unit"),
        ({"u_m_s": 0.0}, "the speed does not follow it"),
    ],
)
def test_tows_that_no_body_of_the_file_makes_are_weak(
    change: dict[str, float], words: str | None
) -> None:
    body = towed_body(3)
    for name, factor in change.items():
        body[name] = 0.3 * (factor == 0.0) + factor * body[name]
    names = ("time_us", "u_m_s", "v_m_s", "w_m_s")
    micro = (1e6 * body["time_s"]).astype(np.int64)
    tables = {
        "velocity": make_table("velocity", {"time_us": micro} | {n: body[n] for n in names[1:]}),
        "tow": make_table("tow", {"time_us": micro, "tow_force_n": body["tow_force_n"]}),
    }
    vehicle = replace(
        shipped_vehicle("bluerov2_heavy"), mass_kg=33.6, spreads={"mass": 2.0, "added_mass": 0.1}
    )
    leg = read_leg(
        LegEntry(id="a", log="a"),
        tables,
        cast(LogInfo, SimpleNamespace(start_us=0, end_us=int(micro[-1]))),
        vehicle,
        rate_hz=20.0,
        max_gap_s=1.0,
    )
    motions = motions_of([leg], MotionRules(0.1, 0.2, 8.0), vehicle)
    rows = passive_results(motions, vehicle)["rows"]
    assert rows[0]["verdict"] == ("identified" if words is None else "weak")
    page = str(passive_section(motions, {"rows": rows}))
    assert ("Figures of the tow are weak" in page) == (words is not None)
    assert (words or "") in page


@pytest.mark.parametrize("late_s", [0.0, 2.0])
def test_the_start_of_steady_tows_tells_a_late_force_and_their_noise_none(late_s: float) -> None:
    """Six steady speeds, each reached in 2 s and let go; noise of 3 % of the force."""
    t_s, speed = 0.1 * np.arange(1800), np.zeros(1800)
    for n in range(1, t_s.size):
        goal, at = (0.5, 0.9, 0.7, 1.2, 0.6, 1.0)[n // 300], t_s[n % 300]
        drag = (4.0 * speed[n - 1] + 25.0 * speed[n - 1] ** 2) / 40.0
        coasts = max(speed[n - 1] - 0.1 * drag, 0.0)
        speed[n] = coasts if at > 18.0 else max(goal * min(at / 2.0, 1.0), coasts)
    force = 40.0 * np.gradient(speed, 0.1) + 4.0 * speed + 25.0 * speed**2
    force[t_s % 30.0 > 18.0] = 0.0
    micro = (1e6 * t_s).astype(np.int64)
    info = cast(LogInfo, SimpleNamespace(start_us=0, end_us=int(micro[-1])))
    vehicle = replace(shipped_vehicle("passive_body"), mass_kg=40.0)
    for seed in range(4):
        noise = np.random.default_rng(seed).standard_normal((2, t_s.size))
        logged = np.roll(force, round(10.0 * late_s)) + 0.5 * noise[0]
        pull = {"tow_force_n": logged, "tow_speed_m_s": speed + 0.01 * noise[1]}
        leg = read_leg(
            LegEntry(id="a", log="a"), {"tow": make_table("tow", {"time_us": micro} | pull)},
            info, vehicle, rate_hz=10.0, max_gap_s=1.0,
        )  # fmt: skip
        motions = motions_of([leg], MotionRules(0.1, 0.2, 8.0), vehicle)
        assert force_delay(motions.around_tows["surge"]) == pytest.approx(late_s, abs=0.3)
        assert ("logged" in motions.odd.get("surge", "")) == bool(late_s)


@pytest.mark.parametrize("role", [None, "tow"])
@pytest.mark.parametrize("speed", [0.0, 1.0])
def test_a_slack_line_is_named_whether_or_not_the_body_moves(
    role: str | None, speed: float
) -> None:
    body = towed_body(5)
    micro = (1e6 * body["time_s"]).astype(np.int64)
    noise = 0.1 * np.random.default_rng(5).standard_normal(micro.size)
    pull = {"tow_force_n": noise, "tow_speed_m_s": speed * body["u_m_s"] + 0.02 * noise}
    vehicle = shipped_vehicle("bluerov2_heavy")
    leg = read_leg(
        LegEntry(id="a", log="a", role=role),
        {"tow": make_table("tow", {"time_us": micro} | pull)},
        cast(LogInfo, SimpleNamespace(start_us=0, end_us=int(micro[-1]))),
        vehicle,
        rate_hz=20.0,
        max_gap_s=1.0,
    )
    motions = motions_of([leg], MotionRules(0.1, 0.2, 8.0), vehicle)
    assert motions.tow_fits == {}
    (words,) = motions.left_out
    assert "slack" in words
    assert "taut" in words
    if role is not None:
        assert ("while the body moves" if speed else "the body does not move") in words


def test_of_as_many_the_larger_swings_are_taken() -> None:
    large, small = swing("both", (6.0, 0.4, 0.3), 0.4), swing("linear", (6.0, 0.5, 0.0), 0.2)
    assert alike_damped([small, large]) == [large]


@pytest.mark.parametrize("role", [None, "tow"])
def test_the_speed_of_a_carriage_gives_drag_and_no_coast(role: str | None) -> None:
    """Nothing on board measures the speed; after the line lets go the body has another."""
    body = towed_body(4)
    time_us = np.rint(1e6 * body["time_s"]).astype(np.int64)
    columns = {"tow_force_n": body["tow_force_n"], "tow_speed_m_s": body["u_m_s"]}
    tow = make_table("tow", {"time_us": time_us, **columns})
    info = SimpleNamespace(start_us=0, end_us=int(time_us[-1]))
    vehicle = shipped_vehicle("bluerov2_heavy")
    entry = LegEntry(id="leg", log="dive", role=role)
    leg = read_leg(entry, {"tow": tow}, cast(LogInfo, info), vehicle, rate_hz=20.0, max_gap_s=1.0)
    motions = motions_of([leg], MotionRules(0.1, 0.2, 8.0), vehicle)
    assert motions.coasts == {}
    rows = {row["quantity"]: row for row in passive_results(motions, vehicle)["rows"]}
    for name, truth in (("X_u", -LINEAR), ("X_u|u|", -QUADRATIC)):
        row = rows[name]
        assert row["verdict"] == "identified"
        half = row["high"] - row["low"]
        assert row["low"] - half < truth < row["high"] + half


@pytest.mark.parametrize("role", [None, "tow"])
def test_a_tow_with_sideslip_is_named(role: str | None) -> None:
    """12 degrees at 0.21 of the speed ahead; noise across is none."""
    body = towed_body(4)
    time_us = np.rint(1e6 * body["time_s"]).astype(np.int64)
    noise = 0.02 * np.random.default_rng(1).standard_normal(time_us.size)
    vehicle = shipped_vehicle("bluerov2_heavy")
    info = SimpleNamespace(start_us=0, end_us=int(time_us[-1]))
    angles = []
    for share in (0.0, 0.2126):
        aside = {"v_m_s": share * body["u_m_s"] + noise, "w_m_s": body["w_m_s"]}
        tables = {
            "tow": make_table("tow", {"time_us": time_us, "tow_force_n": body["tow_force_n"]}),
            "velocity": make_table(
                "velocity", {"time_us": time_us, "u_m_s": body["u_m_s"], **aside}
            ),
        }
        leg = read_leg(
            LegEntry(id="leg", log="dive", role=role), tables, cast(LogInfo, info), vehicle,
            rate_hz=20.0, max_gap_s=1.0,
        )  # fmt: skip
        motions = motions_of([leg], MotionRules(0.1, 0.2, 8.0), vehicle)
        angles.append(motions.oblique)
        section = passive_section(motions, passive_results(motions, vehicle))
        words = " ".join(str(block.get("text", "")) for block in section["blocks"])
        assert ("sideslip of 12 degrees" in words) is bool(share)
    assert angles[0] == {}
    assert np.degrees(angles[1]["leg"]) == pytest.approx(12.0, abs=0.3)


def adrift(depth: Array, noise: Array) -> PassiveMotions:
    """Return the motions of a body at depths (n,) that goes along `PATH`, without a role."""
    micro = (5e4 * np.arange(depth.size)).astype(np.int64)
    position = np.column_stack(
        [micro[:, None] / 1e6 * PATH + 0.05 * noise[:2].T, np.zeros(depth.size)]
    )
    places = dict(zip(POSITION, position.T, strict=True))
    tables = {
        "depth": make_table("depth", {"time_us": micro, "depth_m": depth + 0.003 * noise[2]}),
        "position": make_table("position", {"time_us": micro} | places),
    }
    vehicle = shipped_vehicle("passive_body")
    leg = read_leg(
        LegEntry(id="leg", log="dive"), tables,
        cast(LogInfo, SimpleNamespace(start_us=0, end_us=int(micro[-1]))), vehicle,
        rate_hz=20.0, max_gap_s=1.0,
    )  # fmt: skip
    return motions_of([leg], MotionRules(0.1, 0.2, 8.0), vehicle)


def test_a_body_that_only_drifts_tells_the_current_and_a_float_that_bobs_no_drag() -> None:
    """Neither has a role; what pushes a float back would count as drag of a coast."""
    noise = np.random.default_rng(2).standard_normal((3, T_S.size))
    bob = 0.4 * np.exp(-0.1 * (T_S % 40.0)) * np.cos(1.4 * (T_S % 40.0))
    drifts, bobs, in_waves = (
        adrift(3.0 + moved, noise) for moved in (0.0 * T_S, bob, 0.5 * np.sin(0.9 * T_S))
    )
    for water in (drifts, in_waves):
        ((name, velocity, error),) = water.drifts
        assert name == "leg"
        assert np.all(np.abs(velocity - PATH) < 4.0 * error)
        assert water.coasts == {}
    words = str(passive_section(drifts, passive_results(drifts, shipped_vehicle("passive_body"))))
    assert "'leg' is taken for a drift" in words
    assert len(bobs.swings["heave"]) == 3
    assert bobs.coast_fits == {}
    assert bobs.drifts == []


def test_the_current_of_a_drift_lies_in_its_interval_where_the_water_meanders() -> None:
    """0.03 m/s over 60 s, ten minutes; blocks that count as independent hold in .88."""
    rng, t_s, share = np.random.default_rng(5), np.arange(600.0), np.exp(-1.0 / 60.0)
    noise = rng.standard_normal((600, 400))
    noise[1:] *= np.sqrt(1.0 - share**2)
    water = 0.1 + 0.03 * lfilter([1.0], [1.0, -share], noise, axis=0)
    path = np.cumsum(water, axis=0) + 0.5 * rng.standard_normal(water.shape)
    inside = []
    for first in range(0, 400, 2):
        velocity, error = position_slope(t_s, path[:, first : first + 2])
        inside.extend(np.abs(velocity - 0.1) < NORMAL_95 * error)
    assert np.mean(inside) > 0.91
