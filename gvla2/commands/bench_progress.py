"""How far a benchmark is, and how long it will still take."""

from __future__ import annotations

import time
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

EVERY = 10.0
"""Seconds between lines where there is no terminal."""


class BenchProgress:
    """A bar with the time left on a terminal, a line now and then elsewhere; nothing when ``quiet``.

    ``total`` counts cells to measure.
    """

    def __init__(self, total: int, quiet: bool = False, console: Console | None = None) -> None:
        self._console = console or Console(stderr=True, highlight=False)
        self._total, self._done, self._quiet = total, 0, quiet or total == 0
        self._began = self._told = time.monotonic()
        self._bar: Progress | None = None
        if self._console.is_terminal and not self._console.is_dumb_terminal and not self._quiet:
            self._bar = Progress(
                TextColumn("{task.description}", markup=False),
                BarColumn(),
                MofNCompleteColumn(),
                TextColumn("left:"),
                TimeRemainingColumn(),
                console=self._console,
            )
            self._task = self._bar.add_task("measuring", total=total)

    def __enter__(self) -> BenchProgress:
        if self._bar is not None:
            self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.stop()

    def done(self, cells: int, what: str) -> None:
        """So many more cells are measured, those of ``what``."""
        self._done += cells
        if self._bar is not None:
            self._bar.update(self._task, advance=cells, description=what)
        elif not self._quiet:
            now = time.monotonic()
            if now - self._told >= EVERY or self._done >= self._total:
                self._told = now
                left = (now - self._began) / self._done * (self._total - self._done)
                self._console.print(
                    f"{self._done} of {self._total} cells, {what}, {_clock(left)} left", markup=False
                )


def _clock(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes}:{rest:02d}"
