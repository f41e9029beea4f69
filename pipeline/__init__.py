"""Campaigns, runner, store of artefacts, execution engines and the command line.

One BLAS thread, here and in every worker: more threads would change the last digits of
a result with the machine. Arrow takes its memory from the system, which has it back at
once: a pool of its own keeps the columns of one table while the next is read. So does
Rerun (mimalloc): it kept what it had written for what came next, 60 MB of a recording of
six hours. The variables work only if they are set before the libraries are loaded, so they
are set where this floor is entered; so is that memory of freed arrays serves the next ones.
"""

import os

from auvid.hydro.long_series.freed_memory import keep_freed_memory
from auvid.pipeline.store.loop_folder import keep_loops_somewhere

for _name in (
    "OPENBLAS_NUM_THREADS",
    "OMP_NUM_THREADS",
    "MKL_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "NUMEXPR_NUM_THREADS",
):
    os.environ[_name] = "1"
os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")
os.environ.setdefault("MIMALLOC_PURGE_DELAY", "0")
keep_freed_memory()
keep_loops_somewhere()
