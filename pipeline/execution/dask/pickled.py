"""What is sent to a worker as source: it runs also where auvid is missing or another.

Nothing of auvid is imported here but inside the function.
"""

from __future__ import annotations

import pickle
from typing import Any


def run_pickled(work: bytes) -> Any:
    """Run a pickled task, or return this worker's address and why it cannot begin."""
    try:
        from auvid.pipeline.execution.dask.worker import run_task

        task, terms = pickle.loads(work)
    except Exception as fault:
        from distributed import get_worker

        return get_worker().address, f"auvid is missing there, or another version ({fault})"
    return run_task(task, terms)
