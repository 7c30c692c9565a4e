"""How far the memory suite is: its tests take from a second to many minutes, so time is counted, not tests."""

from __future__ import annotations

import time
from collections.abc import Mapping
from types import TracebackType
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn

if TYPE_CHECKING:
    from gvla2.evaluation.memory.figure import Test

EVERY = 10.0
"""Seconds between lines where there is no terminal."""


class MemoryProgress:
    """A bar with the time left on a terminal, a line now and then elsewhere; nothing when ``quiet``.

    ``seconds`` says about how long each test takes; how the first ones do corrects it for this machine.
    """

    def __init__(
        self, seconds: Mapping[Test, float], quiet: bool = False, console: Console | None = None
    ) -> None:
        self._seconds, self._quiet = dict(seconds), quiet or not seconds
        self._whole = sum(self._seconds.values())
        self._console = console or Console(stderr=True, highlight=False)
        self._finished, self._test, self._share = 0.0, "", 0.0
        self._now = 0.0
        self._began = self._told = time.monotonic()
        self._bar: Progress | None = None
        if self._console.is_terminal and not self._console.is_dumb_terminal and not self._quiet:
            self._bar = Progress(
                TextColumn("{task.description}", markup=False),
                BarColumn(),
                TextColumn("{task.fields[left]} left"),
                console=self._console,
            )
            self._task = self._bar.add_task("measuring", total=self._whole, left="?")

    def __enter__(self) -> MemoryProgress:
        if self._bar is not None:
            self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.stop()

    def begin(self, test: Test) -> None:
        """From now on this test is measured."""
        self._test, self._now = test.label, self._seconds[test]
        self.tell(0.0, "")

    def tell(self, share: float, what: str) -> None:
        """So much of the test is done, in [0, 1]."""
        self._share = min(max(share, 0.0), 1.0)
        self._show(f"{self._test}: {what}" if what else self._test)

    def done(self, test: Test) -> None:
        """The test is measured."""
        self._finished += self._seconds[test]
        self._now = self._share = 0.0
        self._show(test.label, last=self._finished >= 0.999 * self._whole)

    def left(self) -> float:
        """Seconds until the end: what is expected, corrected by how long what is done was expected to take."""
        done = self._finished + self._share * self._now
        expected = max(self._whole - done, 0.0)
        # A few seconds tell too little about a machine.
        slower = (time.monotonic() - self._began + 5.0) / (done + 5.0)
        return expected * slower

    def _show(self, what: str, last: bool = False) -> None:
        if self._bar is not None:
            done = self._finished + self._share * self._now
            self._bar.update(self._task, completed=done, description=what, left=_clock(self.left()))
        elif not self._quiet:
            now = time.monotonic()
            if now - self._told >= EVERY or last:
                self._told = now
                self._console.print(f"{what}, {_clock(self.left())} left", markup=False)


def _clock(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes}:{rest:02d}"
