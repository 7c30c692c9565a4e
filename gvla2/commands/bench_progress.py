"""A benchmark's progress and remaining time."""

from __future__ import annotations

import time
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

EVERY = 10.0
"""Seconds between lines where there is no terminal."""


class BenchProgress:
    """A bar with the time left on a terminal, an occasional line elsewhere; nothing when ``quiet``.

    ``total`` counts what is to be measured.
    """

    def __init__(self, total: int, quiet: bool = False, console: Console | None = None) -> None:
        self._console = console or Console(stderr=True, highlight=False)
        drawn = self._console.is_terminal and not self._console.is_dumb_terminal
        columns = (TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn())
        off = quiet or not drawn or total == 0
        self._bar = Progress(*columns, TimeRemainingColumn(), console=self._console, disable=off)
        self._task = self._bar.add_task("measuring", total=total)
        self._total, self._done, self._in_lines = total, 0, not quiet and not drawn
        self._began = self._told = time.monotonic()

    def __enter__(self) -> BenchProgress:
        self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bar.stop()

    def done(self, amount: int, what: str) -> None:
        """Report so many more measured, of ``what``."""
        self._done += amount
        self._bar.update(self._task, completed=self._done, description=what)
        now = time.monotonic()
        if self._in_lines and (now - self._told >= EVERY or self._done >= self._total):
            self._told = now
            left = (now - self._began) * (self._total - self._done) / self._done
            minutes, rest = divmod(round(left), 60)
            count = f"{self._done} of {self._total} cells"
            self._console.print(f"{count}, {what}, {minutes}:{rest:02d} left", markup=False)
