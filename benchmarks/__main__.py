"""All benchmarks, each in a process of its own so that memory is its own: one JSON
document, also written to runs/benchmarks.json.

python -m benchmarks
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
BENCHMARKS = {
    "decode_dataflash": ["campaigns/bluerov2_dvl/logs/00000029_first130s.BIN"],
    "decode_tlog": ["tests/data/bluerov2_ugps_small/small.tlog"],
    "decode_ulog": ["tests/data/px4_ulog/sample_log_small.ulg"],
    "decode_text": ["tests/data/bluerov2_ugps_small/small.BIN"],
    "decode_csv": [
        "campaigns/bluerov2_dvl_csv/logs/imu.csv",
        "campaigns/bluerov2_dvl_csv/columns/imu.yaml",
    ],
    "simulation": [],
    "recording": [],
    "synthesis": [],
    "estimators": [],
    "recursive": [],
    "bench_twin": [],
    "closed_loop": [],
    "chain": [],
}


def main() -> None:
    """Run all and print the figures."""
    figures = {}
    for name, arguments in BENCHMARKS.items():
        print(f"{name} ...", file=sys.stderr, flush=True)
        done = subprocess.run(
            [sys.executable, "-m", f"benchmarks.{name}", *arguments],
            cwd=ROOT,
            check=True,
            stdout=subprocess.PIPE,
        )
        figures[name] = json.loads(done.stdout)
    words = json.dumps(figures, indent=2)
    (ROOT / "runs").mkdir(exist_ok=True)
    (ROOT / "runs" / "benchmarks.json").write_text(words + "\n")
    print(words)


if __name__ == "__main__":
    main()
