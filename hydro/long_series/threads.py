"""The same work on several items at once, in threads.

Compiled loops, and numpy on long arrays, let other threads run meanwhile.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")
NAME = "work beside"
"""Of the threads of this module begins so."""


def _thread_count() -> int:
    named = os.environ.get("NUMBA_NUM_THREADS", "")
    if named.isdecimal() and int(named) > 0:
        return int(named)
    own = getattr(os, "sched_getaffinity", None)
    return len(own(0)) if own else os.cpu_count() or 1


THREADS = _thread_count()
"""The processors that this process may use, or NUMBA_NUM_THREADS of the environment."""


def share_among(processes: int) -> None:
    """Leave the other processors to the other processes that work at once."""
    global THREADS
    THREADS = max(1, THREADS // processes)


def together(one: Callable[[], Item], other: Callable[[], Result]) -> tuple[Item, Result]:
    """Return what two works give that do not need one another.

    >>> together(lambda: 1, lambda: "b")
    (1, 'b')
    """
    if THREADS < 2:
        return one(), other()
    with ThreadPoolExecutor(1, NAME) as pool:
        later = pool.submit(other)
        return one(), later.result()


def at_once(
    work: Callable[[Item], Result], items: Iterable[Item], *, long: bool = True
) -> list[Result]:
    """Return what `work` gives for each item, in the order of the items.

    `long`: whether an item takes long enough to be worth a thread.

    >>> at_once(abs, [-1, 2])
    [1, 2]
    """
    of_items = list(items)
    if not long or THREADS < 2 or len(of_items) < 2:
        return [work(item) for item in of_items]
    with ThreadPoolExecutor(min(THREADS, len(of_items)), NAME) as pool:
        return list(pool.map(work, of_items))
