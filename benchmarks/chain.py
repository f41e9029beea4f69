"""The whole chain on the bundled dive: seconds, samples per second of the uniform
clock, a second run that has nothing to do, peak memory.

    python -m benchmarks.chain [CAMPAIGN]

Each run is the command that a user gives, in a process of its own, on a copy of the
campaign, so that results in `runs/` stay.
"""

from __future__ import annotations

import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
RUNS = 3


def seconds_of(*command: str, folder: Path) -> float:
    """How long a command takes; its words are shown only if it fails."""
    begin = time.perf_counter()
    subprocess.run(
        [sys.executable, "-m", "auvid", *command], cwd=folder, check=True, capture_output=True
    )
    return time.perf_counter() - begin


def measure(campaign: str = "bluerov2_dvl") -> dict[str, float]:
    """Shortest of three full runs and of three runs with nothing to do; peak memory of
    the largest process in MB.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        shutil.copytree(ROOT / "campaigns" / campaign, folder / "campaigns" / campaign)
        shutil.copy(ROOT / "params.yaml", folder)
        chain_s = min(seconds_of("run", campaign, "--force", folder=folder) for _ in range(RUNS))
        peak_mb = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
        idle_s = min(seconds_of("run", campaign, folder=folder) for _ in range(RUNS))
        segments = (folder / "runs" / campaign / "resample").glob("*/segment.json")
        samples = sum(json.loads(path.read_text())["samples"] for path in segments)
    return {
        "chain_s": chain_s,
        "samples": samples,
        "samples_per_s": samples / chain_s,
        "nothing_to_do_s": idle_s,
        "peak_memory_mb": peak_mb,
    }


if __name__ == "__main__":
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    print(
        json.dumps(
            {key: round(value, 3) for key, value in measure(*sys.argv[1:]).items()}, indent=2
        )
    )
