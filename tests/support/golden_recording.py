"""The golden recording of a made-up log: `python -m tests.support.golden_recording`
writes it anew.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from auvid.data_schemas.records.logs import LogInfo
from auvid.data_schemas.tables import make_table
from auvid.stages.report.recording.log_recording import record_log

GOLDEN = Path(__file__).parents[1] / "data" / "recordings" / "log.rrd"
HOSTILE = "<script>alert(1)</script>\x1b]0;owned\x07\x1b[31m\u202egnp.exe"


def tables() -> dict[str, pa.Table]:
    """A minute of attitude, velocity, depth, outputs and messages; the velocity pauses
    for 20 s.
    """
    t = np.arange(0, 60, 0.1)
    stamps = (t * 1e6).astype(np.int64) + 5_000_000
    kept = (t < 20) | (t > 40)
    zero = np.zeros(t.size)
    entities: dict[str, dict[str, Any]] = {
        "attitude": {"time_us": stamps, "phi_rad": zero, "theta_rad": zero, "psi_rad": 0.1 * t},
        "velocity": {
            "time_us": stamps[kept],
            "u_m_s": np.ones(kept.sum()),
            "v_m_s": zero[kept],
            "w_m_s": zero[kept],
        },
        "depth": {"time_us": stamps, "depth_m": 3.0 + 0.1 * t},
        "actuators": {"time_us": stamps, **{f"pwm_{n}_us": 1500 + zero for n in range(1, 7)}},
        "mode": {"time_us": stamps[[0, 300]], "mode": ["MANUAL", HOSTILE], "armed": [False, True]},
        "events": {"time_us": stamps[[10]], "text": [HOSTILE]},
    }
    return {name: make_table(name, columns) for name, columns in entities.items()}


INFO = LogInfo.model_construct(start_us=5_000_000, end_us=65_000_000, notes=["a note"])
HEALTH: dict[str, Any] = {
    "bytes": 5_000_000,
    "duration_s": 60.0,
    "formats": ["ArduPilot DataFlash"],
    "status": "complete",
    "vehicle": HOSTILE,
    "verdict": "A force model can be fitted in surge.",
    "findings": [
        {"severity": "warning", "text": "Hardly any motion in roll.", "remedy": "Roll it."}
    ],
    "streams": {"depth": {"source": "BARO|x", "rows": 600, "rate_hz": 10.0, "longest_gap_s": 0.1}},
    "unseen": [],
    "capabilities": [{"name": "synthesise roll", "possible": False, "reason": "hardly any motion"}],
}
LEGS = [{"id": "train 1", "use": "training", "start_s": 2.0, "end_s": 30.0}]


def recording() -> bytes:
    """The recording as it is made now."""
    return record_log("dive", tables(), INFO, HEALTH, LEGS)


if __name__ == "__main__":
    GOLDEN.parent.mkdir(exist_ok=True)
    GOLDEN.write_bytes(recording())
