"""Progress on standard error: bars on a terminal, plain lines otherwise."""

from __future__ import annotations

import sys
import threading
import time
from types import TracebackType
from typing import Protocol, Self

EVERY_S = 5.0
"""Between two lines of a stage that is at work, at its beginning."""
EVERY_SHARE = 0.1
"""Share of its time so far between two lines of a stage that takes long."""


class Progress(Protocol):
    """What the runner tells while it works."""

    def stage(self, name: str, *, todo: int, total: int, level: str) -> None: ...

    def part(self, words: str, share: float) -> None: ...

    def item(self, name: str) -> None: ...

    def finish(self, *, failed: int) -> None: ...


class Silent:
    """Says nothing."""

    def stage(self, name: str, *, todo: int, total: int, level: str) -> None:
        """A stage begins: `todo` of its `total` items are stale."""

    def part(self, words: str, share: float) -> None:
        """An item does this now, and has done this share of its work."""

    def item(self, name: str) -> None:
        """An item is done."""

    def finish(self, *, failed: int) -> None:
        """The stage is over."""


class StageWork:
    """How far a stage is: items, the share of the present one, and the time left."""

    def __init__(self, todo: int) -> None:
        self.todo, self.done, self.words, self.share = todo, 0, "", 0.0
        self.start = self.part_start = time.monotonic()

    def part(self, words: str, share: float) -> None:
        self.words, self.share, self.part_start = words, share, time.monotonic()

    def item(self) -> None:
        self.done, self.words, self.share = self.done + 1, "", 0.0
        self.part_start = time.monotonic()

    @property
    def elapsed_s(self) -> float:
        return time.monotonic() - self.start

    @property
    def left_s(self) -> float | None:
        """Seconds left if all goes on as until the present part began.

        None at the beginning, and where that part takes longer than all should.
        """
        share = (self.done + self.share) / self.todo
        if not share:
            return None
        before_s = self.part_start - self.start
        left = before_s * (1.0 - share) / share - (time.monotonic() - self.part_start)
        return left if left > 0.0 else None

    @property
    def left_words(self) -> str:
        return "" if self.left_s is None else f"about {duration(self.left_s)} left"


def duration(seconds: float) -> str:
    """Return a time in words: 4 s, 1 min 15 s, 1 h 6 min."""
    rounded = round(seconds)
    if rounded < 60:
        return f"{rounded} s"
    minutes, rest = divmod(rounded, 60)
    return f"{minutes} min {rest} s" if minutes < 60 else f"{minutes // 60} h {minutes % 60} min"


def wait_s(elapsed_s: float, least_s: float) -> float:
    """Return the time to the next line of a stage that has worked for some time.

    >>> wait_s(20.0, 5.0), wait_s(400.0, 5.0)
    (5.0, 40.0)
    """
    return max(least_s, EVERY_SHARE * elapsed_s)


class ProgressLines:
    """A line when a stage ends, and meanwhile one every few seconds, later more seldom.

    These say how much is left. `verbose`: one per item as well, with its seconds.
    """

    def __init__(self, *, verbose: bool = False, every_s: float = EVERY_S) -> None:
        self._verbose, self._every_s = verbose, every_s
        self._name, self._level, self._item_start = "", "", 0.0
        self._work = StageWork(0)
        self._over = threading.Event()

    def stage(self, name: str, *, todo: int, total: int, level: str) -> None:
        self._name, self._level, self._item_start = name, level, time.monotonic()
        self._work = StageWork(todo)
        if not todo:
            self._say(f"{name}: up to date")
            return
        self._over = threading.Event()
        threading.Thread(target=self._tell, args=(self._work, self._over), daemon=True).start()

    def part(self, words: str, share: float) -> None:
        self._work.part(words, share)

    def item(self, name: str) -> None:
        self._work.item()
        now = time.monotonic()
        if self._verbose and self._level != "campaign":
            self._say(f"{self._name}: {self._level} {name} ({now - self._item_start:.1f} s)")
        self._item_start = now

    def finish(self, *, failed: int) -> None:
        self._over.set()
        if self._work.todo:
            end = f"{failed} failed" if failed else "done"
            self._say(f"{self._name}: {end} ({self._work.elapsed_s:.1f} s)")

    def close(self) -> None:
        """Say no more, also where a stage did not come to its end."""
        self._over.set()

    def _tell(self, work: StageWork, over: threading.Event) -> None:
        """Print how far a stage is until it is over, ever more seldom."""
        while not over.wait(wait_s(work.elapsed_s, self._every_s)):
            items = (
                "" if self._level == "campaign" else f"{self._level} {work.done + 1} of {work.todo}"
            )
            parts = [items, work.words, f"{duration(work.elapsed_s)} so far", work.left_words]
            if work.done < work.todo:
                self._say(f"{self._name}: {', '.join(filter(None, parts))}")

    def _say(self, line: str) -> None:
        print(line, file=sys.stderr, flush=True)


class Bars:
    """A bar per stage, made by rich."""

    def __init__(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn
        from rich.progress import Progress as RichProgress

        columns = (
            TextColumn("{task.description:<12}"),
            BarColumn(24),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TextColumn("{task.fields[note]}"),
        )
        self._bars = RichProgress(*columns, console=Console(stderr=True))
        self._now = self._bars.add_task("", visible=False, note="")
        self._work, self._before = StageWork(0), 0

    def __enter__(self) -> Self:
        self._bars.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._bars.stop()

    def stage(self, name: str, *, todo: int, total: int, level: str) -> None:
        self._work, self._before = StageWork(todo), total - todo
        self._now = self._bars.add_task(
            name, total=total, completed=total - todo, note="" if todo else "up to date"
        )
        if not todo:
            self._bars.stop_task(self._now)

    def part(self, words: str, share: float) -> None:
        self._work.part(words, share)
        self._show(words)

    def item(self, name: str) -> None:
        self._work.item()
        self._show(name)

    def finish(self, *, failed: int) -> None:
        note = f"{failed} failed" if failed else ""
        self._bars.update(self._now, note=note)
        self._bars.stop_task(self._now)

    def _show(self, words: str) -> None:
        work = self._work
        note = ", ".join(filter(None, (words, work.left_words if work.done < work.todo else "")))
        self._bars.update(self._now, completed=self._before + work.done + work.share, note=note)
