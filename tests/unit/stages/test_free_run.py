"""Free runs in the stage validate: the true model stays on the measured motion, an
unstable one is named.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pytest
from scipy.integrate import solve_ivp

from auvid.data_schemas.tables import column, make_table
from auvid.hydro.dynamics.equations_of_motion import Control, state_derivative
from auvid.hydro.dynamics.simulation.growth import Growth
from auvid.hydro.dynamics.viscous.models import IdentifiedModel
from auvid.stages.columns import ACCELERATION, POSE, POSE_RATE, VELOCITY, named
from auvid.stages.free_run import fits_in_percent, free_run_table, measured_motion, run_segment
from auvid.stages.validate.flight_presentation import growth_words
from auvid.stages.validate.presentation import cause_blocks, free_run_blocks
from tests.support.motions import shipped_vehicle

STABLE = {
    "X": {"u": -40.0},
    "Y": {"v": -60.0},
    "Z": {"w": -80.0},
    "K": {"p": -2.0},
    "M": {"q": -2.0},
    "N": {"r": -3.0},
}
UNSTABLE = {**STABLE, "N": {"r": 30.0}}
VEHICLE = shipped_vehicle("bluerov2_heavy")


@pytest.fixture(scope="module")
def flown() -> tuple[pa.Table, pa.Table]:
    """Fused state and controls of a driven run of the stable model."""
    t = np.arange(0.0, 16.0, 0.02)
    thrust = 4.0 * np.sin(np.outer(t, [0.5, 0.7, 0.3, 0.9, 0.2, 0.4, 0.6, 0.8]))
    model = IdentifiedModel("truth", STABLE)

    def rate(s: float, x: np.ndarray) -> np.ndarray:
        now = np.array([np.interp(s, t, row) for row in thrust.T])
        return state_derivative(VEHICLE, x, Control(thruster_force_N=now), model.force)

    start = np.concatenate([[0.2, 0.0, 0.0, 0.0, 0.0, 0.3], [0.0, 0.0, 5.0, 0.0, 0.0, 3.0]])
    state = solve_ivp(rate, (0.0, t[-1]), start, t_eval=t, rtol=1e-9, atol=1e-11, max_step=0.02).y.T
    nothing = np.zeros((len(t), 6))
    columns = (
        named(POSE, state[:, 6:])
        | named(VELOCITY, state[:, :6])
        | named(POSE_RATE, nothing)
        | named(ACCELERATION, nothing)
    )
    controls = {
        "t_s": t,
        **{f"thruster_{number}_N": thrust[:, number - 1] for number in range(1, 9)},
    }
    return make_table("fused", {"t_s": t, **columns}), make_table("controls", controls)


GROWS = Growth(3.0, "N", "N_r", 3.2)


def table_of(
    flown: tuple[pa.Table, pa.Table], *, every_s: float = 5.0, **models: dict[str, dict[str, float]]
) -> pa.Table:
    table = run_segment(
        VEHICLE,
        [IdentifiedModel(name, coefficients) for name, coefficients in models.items()],
        np.zeros((len(models), 6)),
        np.zeros((len(models), 6, 6)),
        measured_motion(*flown),
        horizons_s=(5.0, 10.0, 30.0),
        every_s=every_s,
        minimum_speed=0.05,
    )
    assert table is not None
    return free_run_table({("check", ""): table}, list(models))


def test_the_true_model_stays_on_the_motion(flown: tuple[pa.Table, pa.Table]) -> None:
    results = table_of(flown, true=STABLE)
    kept = results.filter(pc.equal(results["model"], "persistence"))
    assert kept["starts"].to_pylist() == [3, 2]
    assert column(kept, "u_rms_m_s").min() > 0.01, "the flown motion changes"
    results = results.filter(pc.equal(results["model"], "true"))
    assert results["horizon_s"].to_pylist() == [5.0, 10.0], "no start reaches 30 s"
    assert results["starts"].to_pylist() == [3, 2]
    for name in ("u_rms_m_s", "r_rms_rad_s", "psi_rms_rad"):
        # RK4 at 20 ms over the kinks of a sampled thrust; the yaw passes pi and must
        # wrap
        assert column(results, name).max() < 1e-5, name


def test_a_fit_in_percent_is_said_of_motion_alone(flown: tuple[pa.Table, pa.Table]) -> None:
    """1 - RMS error / RMS departure; nothing of few runs, nothing of a velocity at rest."""
    slow = {**STABLE, "X": {"u": -60.0}}
    results = table_of(flown, every_s=1.0, true=STABLE, slow=slow)
    rows = {row["model"]: row for row in results.to_pylist() if row["horizon_s"] == 5.0}
    t_s, u = (column(flown[0], name) for name in ("t_s", "u_m_s"))
    ends = np.interp(np.arange(5.0, 15.99, 1.0), t_s, u)
    assert rows["true"]["u_fit_percent"] == pytest.approx(100.0, abs=0.1)
    expected = 100.0 * (1.0 - rows["slow"]["u_rms_m_s"] / np.std(ends))
    assert rows["slow"]["u_fit_percent"] == pytest.approx(expected, abs=0.5)
    assert 0.0 < expected < 99.0
    assert rows["persistence"]["u_fit_percent"] < rows["slow"]["u_fit_percent"]
    assert rows["rest"]["u_fit_percent"] <= 0.0
    assert rows["rest"]["u_rms_m_s"] == pytest.approx(np.sqrt(np.mean(ends**2)), rel=1e-3)
    still = np.outer(np.linspace(-0.04, 0.04, 6), np.ones(6))
    assert np.isnan(fits_in_percent(0.1 * still, still)).all()
    blocks = free_run_blocks(results, {"true": "True", "slow": "Slow"}, {})
    fits = next(block for block in blocks if "fit of the velocities" in block.get("title", ""))
    assert "means nothing" in fits["note"]
    few = table_of(flown, true=STABLE)
    assert np.isnan(column(few, "u_fit_percent")).all()
    (only,) = (block for block in free_run_blocks(few, {"true": "True"}, {}))
    assert "fit" not in only["title"]


def test_a_motion_that_neither_grows_nor_decays_is_not_said_to_grow() -> None:
    assert growth_words(replace(GROWS, rate=5.6e-17)) == ""
    assert growth_words(GROWS) == "yaw grows at 3 1/s, mostly by N_r"


def test_an_unstable_model_is_named_with_its_time(flown: tuple[pa.Table, pa.Table]) -> None:
    results = table_of(flown, true=STABLE, wild=UNSTABLE)
    blocks = free_run_blocks(results, {"true": "True", "wild": "Wild"}, {"wild": GROWS})
    (remark,) = (block for block in blocks if block["kind"] == "remark")
    words = remark["text"]
    assert remark["level"] == "warning"
    assert "1 of 2 models" in words
    assert "Wild (yaw grows at 3 1/s, mostly by N_r)" in words
    assert "True" not in words
    (why,) = cause_blocks({"wild": GROWS}, results, {"wild": "Wild"})
    first = min(value for value in column(results, "first_divergence_s") if np.isfinite(value))
    assert why["rows"] == [["Wild", first, "N", 3.0, "N_r", 3.2]]


def test_horizons_that_no_run_reaches_are_one_warning_and_no_rows(
    flown: tuple[pa.Table, pa.Table],
) -> None:
    results = table_of(flown, true=STABLE, wild=UNSTABLE)
    blocks = free_run_blocks(results, {"true": "True", "wild": "Wild"}, {"wild": GROWS})
    table = next(block for block in blocks if block["kind"] == "table")
    lost = sum(
        row["model"] == "wild" and row["diverged"] == row["starts"] for row in results.to_pylist()
    )
    assert lost > 0
    assert len(table["rows"]) == results.num_rows - lost
    assert all(value is not None for row in table["rows"] for value in row)
    assert f"{lost} rows without a bounded run are left out" in table["note"]


def test_a_segment_shorter_than_every_horizon_gives_no_rows(
    flown: tuple[pa.Table, pa.Table],
) -> None:
    fused, controls = (part.slice(0, 100) for part in flown)
    runs = run_segment(
        VEHICLE,
        [IdentifiedModel("true", STABLE)],
        np.zeros((1, 6)),
        np.zeros((1, 6, 6)),
        measured_motion(fused, controls),
        horizons_s=(5.0,),
        every_s=5.0,
        minimum_speed=0.05,
    )
    assert runs is None
    assert free_run_blocks(free_run_table({}, ["true"]), {}, {}) == []
