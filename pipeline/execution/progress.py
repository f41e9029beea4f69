"""Progress on standard error: bars on a terminal, plain lines otherwise."""

from __future__ import annotations

import sys
import time
from types import TracebackType
from typing import Protocol, Self


class Progress(Protocol):
    """What the runner tells while it works."""

    def stage(self, name: str, *, todo: int, total: int, level: str) -> None: ...

    def item(self, name: str) -> None: ...

    def finish(self, *, failed: int) -> None: ...


class Silent:
    """Says nothing."""

    def stage(self, name: str, *, todo: int, total: int, level: str) -> None:
        """A stage begins: `todo` of its `total` items are stale."""

    def item(self, name: str) -> None:
        """An item is done."""

    def finish(self, *, failed: int) -> None:
        """The stage is over."""


class ProgressLines:
    """One line when a stage begins to work and one when it ends."""

    def __init__(self, *, verbose: bool = False) -> None:
        self._verbose = verbose
        self._name, self._todo, self._level, self._start = "", 0, "", 0.0

    def stage(self, name: str, *, todo: int, total: int, level: str) -> None:
        self._name, self._todo, self._level, self._start = name, todo, level, time.monotonic()
        if not todo:
            self._say(f"{name}: up to date")

    def item(self, name: str) -> None:
        if self._level != "campaign":
            self._say(f"{self._name}: {self._level} {name}")

    def finish(self, *, failed: int) -> None:
        if self._todo:
            end = f"{failed} failed" if failed else "done"
            self._say(f"{self._name}: {end} ({time.monotonic() - self._start:.1f} s)")

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
        self._now = self._bars.add_task(
            name, total=total, completed=total - todo, note="" if todo else "up to date"
        )
        if not todo:
            self._bars.stop_task(self._now)

    def item(self, name: str) -> None:
        self._bars.update(self._now, advance=1, note=name)

    def finish(self, *, failed: int) -> None:
        if failed:
            self._bars.update(self._now, note=f"{failed} failed")
        self._bars.stop_task(self._now)
