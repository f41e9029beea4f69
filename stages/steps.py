"""How far a stage is, for whoever runs it; results do not depend on it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TypeVar

T = TypeVar("T")
Listener = Callable[[str, float], None]
"""Takes what a stage does now, and the share of it that is done."""
_LISTENER: ContextVar[Listener | None] = ContextVar("_LISTENER", default=None)


@contextmanager
def listening(listener: Listener) -> Iterator[None]:
    """Let a listener hear how far the stages are that run here meanwhile."""
    token = _LISTENER.set(listener)
    try:
        yield
    finally:
        _LISTENER.reset(token)


def tell(words: str, done: int, of: int) -> None:
    """Tell the listener, if there is one, what begins, after `done` of `of` steps."""
    listener = _LISTENER.get()
    if listener is not None:
        listener(words, done / of)


def counted(words: str, items: Collection[T]) -> Iterator[T]:
    """Yield the items, and tell before each how many of them are done."""
    for done, item in enumerate(items):
        tell(f"{words} {done + 1} of {len(items)}", done, len(items))
        yield item
