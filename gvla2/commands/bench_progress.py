"""A benchmark's progress and remaining time."""

from __future__ import annotations

import time
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn

EVERY = 10.0
"""Seconds between lines where there is no terminal."""
_FEW = 5.0
"""Seconds of work below which a machine's speed is unknown."""


class BenchProgress:
    """A bar with the time left on a terminal, an occasional line elsewhere; nothing when ``quiet``.

    ``total`` counts cells to measure; with ``seconds`` it is a rough total time, for work whose pieces vary a lot, and
    the first pieces calibrate it for this machine.
    """

    def __init__(
        self, total: float, quiet: bool = False, console: Console | None = None, *, seconds: bool = False
    ) -> None:
        self._console = console or Console(stderr=True, highlight=False)
        self._total, self._quiet, self._seconds = total, quiet or total == 0, seconds
        self._begun = 0.0
        self._done = 0.0
        self._began = self._told = time.monotonic()
        self._bar: Progress | None = None
        if self._console.is_terminal and not self._console.is_dumb_terminal and not self._quiet:
            columns = TextColumn("{task.description}", markup=False), TextColumn("{task.fields[left]}")
            self._bar = Progress(columns[0], BarColumn(), columns[1], console=self._console)
            self._task = self._bar.add_task("measuring", total=total, left="")

    def __enter__(self) -> BenchProgress:
        if self._bar is not None:
            self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.stop()

    def done(self, amount: float, what: str) -> None:
        """Report so much more measured, of ``what``."""
        self._begun += amount
        self.reached(0.0, what)

    def reached(self, part: float, what: str) -> None:
        """Report so much of the current work measured."""
        self._done = min(self._begun + max(part, 0.0), self._total)
        now = time.monotonic()
        minutes, rest = divmod(round(self.left()), 60)
        count = "" if self._seconds else f"{self._done:.0f} of {self._total:.0f} cells, "
        if self._bar is not None:
            left = f"{count}{minutes}:{rest:02d} left"
            self._bar.update(self._task, completed=self._done, description=what, left=left)
        elif not self._quiet and (now - self._told >= EVERY or self._begun >= 0.999 * self._total):
            self._told = now
            self._console.print(f"{count}{what}, {minutes}:{rest:02d} left", markup=False)

    def left(self) -> float:
        """Seconds until the end, extrapolated from the time so far."""
        spent, few = time.monotonic() - self._began, _FEW if self._seconds else 0.0
        return (self._total - self._done) * (spent + few) / (self._done + few) if self._done + few else 0.0
