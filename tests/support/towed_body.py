"""A body that is towed, let go, and rolls: a CSV with known drag and restoring."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from auvid.hydro.arrays import Array

MASS_KG, LINEAR, QUADRATIC = 40.0, 4.0, 25.0
K, D_1, D_2 = 6.0, 0.4, 0.3
STEP_S = 0.05


def towed_body(
    seed: int = 0, *, forces: tuple[float, ...] = (8.0, 25.0, 14.0, 30.0), steady: bool = False
) -> dict[str, Array]:
    """Return columns: tows of 25 s, each let go for 8 s, with a roll that decays after each.

    m x' = T - LINEAR x - QUADRATIC x|x| + water, y'' = -K sin(y) - D_1 y' - D_2 y'|y'|.
    """
    rng = np.random.default_rng(seed)
    pull = [np.r_[np.full(500, force), np.zeros(160)] for force in forces]
    tow = np.concatenate(pull)
    t_s = np.arange(tow.size) * STEP_S
    if not steady:
        tow = tow * (1.0 + 0.25 * np.sin(2.0 * np.pi * t_s / 6.0))
    water, x, roll = np.zeros(tow.size), np.zeros(tow.size), np.zeros(tow.size)
    y = rate = 0.0
    for n in range(1, tow.size):
        water[n] = water[n - 1] * (1.0 - STEP_S / 2.0) + 0.06 * rng.standard_normal()
        drag = LINEAR * x[n - 1] + QUADRATIC * x[n - 1] * abs(x[n - 1])
        x[n] = x[n - 1] + STEP_S / MASS_KG * (tow[n - 1] + water[n] - drag)
        if tow[n] == 0.0 and tow[n - 1] != 0.0:
            y, rate = 0.4, 0.0
        for _ in range(10):
            rate += STEP_S / 10 * (-K * np.sin(y) - D_1 * rate - D_2 * rate * abs(rate))
            y += STEP_S / 10 * rate
        roll[n] = y
    noise = rng.standard_normal((3, tow.size))
    return {
        "time_s": t_s,
        "u_m_s": x + 0.005 * noise[0],
        "v_m_s": 0.0 * x,
        "w_m_s": 0.0 * x,
        "phi_rad": roll + 0.002 * noise[1],
        "theta_rad": 0.0 * x,
        "psi_rad": 0.0 * x,
        "depth_m": 5.0 + 0.0 * x,
        "tow_force_n": tow + 0.1 * noise[2],
    }


def write_towed_body(path: Path, columns: dict[str, Array]) -> Path:
    """Write the columns as CSV and return the path."""
    rows = np.column_stack(list(columns.values()))
    np.savetxt(path, rows, fmt="%.6f", delimiter=",", header=",".join(columns), comments="")
    return path
