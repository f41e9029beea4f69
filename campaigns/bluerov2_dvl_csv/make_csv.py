"""Write the dive of campaigns/bluerov2_dvl as one CSV file per sensor, all on one
clock, to the last digit.

Run from the root of the repository: `python campaigns/bluerov2_dvl_csv/make_csv.py`.
Attitude is written in degrees, depth as an altitude and velocity forward-left-up, as
loggers do, so that the column maps have something to say.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa

from auvid.data_schemas.tables import column
from auvid.stages import ingest
from auvid.stages.base import RawFile, RawLog

HERE = Path(__file__).resolve().parent
SOURCE = HERE.parent / "bluerov2_dvl" / "logs" / "00000029_first130s.BIN"
DEGREES = 180.0 / np.pi
# Per file: header -> (field of the stream, factor).
FILES: dict[str, dict[str, tuple[str, float]]] = {
    "imu": {
        f"{kind}_{axis}": (f"{kind}_{axis}_{unit}", 1.0)
        for kind, unit in (("gyro", "rad_s"), ("accel", "m_s2"))
        for axis in "xyz"
    },
    "attitude": {
        "roll_deg": ("phi_rad", DEGREES),
        "pitch_deg": ("theta_rad", DEGREES),
        "yaw_deg": ("psi_rad", DEGREES),
    },
    "depth": {"altitude_m": ("depth_m", -1.0)},
    "velocity": {
        "forward": ("u_m_s", 1.0),
        "left": ("v_m_s", -1.0),
        "up": ("w_m_s", -1.0),
        "confidence": ("quality", 100.0),
    },
    "actuators": {f"thruster_{number}": (f"pwm_{number}_us", 1.0) for number in range(1, 9)},
    "battery": {"millivolt": ("voltage_v", 1000.0)},
}


def csv_text(table: pa.Table, columns: dict[str, tuple[str, float]], start_us: int) -> str:
    """A stream table as CSV: seconds since `start_us`, every number with the fewest
    digits that give it back.
    """
    cells = [[f"{(stamp - start_us) / 1e6:.6f}" for stamp in table["time_us"].to_pylist()]]
    cells += [
        [repr(value) for value in (column(table, field) * factor).tolist()]
        for field, factor in columns.values()
    ]
    return (
        "\n".join(
            [",".join(["time_s", *columns]), *(",".join(row) for row in zip(*cells, strict=True))]
        )
        + "\n"
    )


def main() -> None:
    log = RawLog("dive", (RawFile(SOURCE.name, np.memmap(SOURCE, np.uint8, "r")),))
    outputs = ingest.run(ingest.Inputs(log), ingest.Params())
    for name, columns in FILES.items():
        text = csv_text(getattr(outputs, name), columns, outputs.log_info["start_us"])
        (HERE / "logs" / f"{name}.csv").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
