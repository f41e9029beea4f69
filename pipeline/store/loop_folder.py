"""Where numba keeps compiled loops if it can write neither beside them nor at home.

Without such a folder it refuses to compile what is to be kept.
"""

from __future__ import annotations

import atexit
import os
import shutil
import tempfile
from pathlib import Path

PACKAGE = Path(__file__).parents[2]
VARIABLE = "NUMBA_CACHE_DIR"


def keep_loops_somewhere() -> None:
    """Let numba use a folder of this process alone where it has no other.

    Processes that this one starts use it, too. To be called before numba is loaded.
    """
    if VARIABLE in os.environ or os.access(PACKAGE, os.W_OK) or _is_at_home():
        return
    try:
        folder = tempfile.mkdtemp(prefix="auvid_loops_")
    except OSError:
        return
    os.environ[VARIABLE] = folder
    atexit.register(_remove, folder, os.getpid())


def _is_at_home() -> bool:
    """Return whether numba has a folder in the user's home, as it makes it."""
    home = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"))
    try:
        (home / "numba").mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=home / "numba"):
            return True
    except OSError:
        return False


def _remove(folder: str, owner: int) -> None:
    if os.getpid() == owner:
        shutil.rmtree(folder, ignore_errors=True)
