"""Progress on the terminal: a line per stage during a run."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path

from rich.console import Console
from rich.status import Status
from rich.text import Text

from gvla2.episode.record import EpisodeRecord, Stage
from gvla2.record.text import one_line
from gvla2.record.wording import State, finding, headline, state, summary_line

_MARKS: Mapping[State, tuple[str, str, str]] = {
    "done": ("✓", "ok", "green"),
    "warn": ("!", "!!", "yellow"),
    "failed": ("✗", "FAIL", "bold red"),
    "skipped": ("·", "-", "dim"),
}
"""The mark of each state, its form without Unicode, and its style."""


class Progress:
    """Shows a person what a run is doing, as a context manager.

    On a terminal each stage shows a spinner, then a tick, its seconds and what it found; elsewhere (a file, a pipe)
    plain lines, one per finished stage. ``quiet`` reports only how an episode ended and what makes its result
    doubtful, a closed terminal gets nothing. Each line begins with ``label``, for parallel jobs of a sweep. Texts
    from outside (instructions, labels) are printed literally, without terminal control characters or markup.
    """

    def __init__(self, quiet: bool = False, console: Console | None = None, label: str = "") -> None:
        self._console = console or Console(stderr=True, highlight=False)
        self._quiet, self._gone = quiet, False
        self._label = f"{self._printable(label, 80)} " if label else ""
        self._live = self._console.is_terminal and not self._console.is_dumb_terminal
        self._status: Status | None = None
        self._began = time.monotonic()

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def say(self, text: str, style: str = "", *, always: bool = False) -> None:
        """Print a line; with ``always`` also when quiet."""
        if always or not self._quiet:
            self._print(Text(self._printable(text, 400), style=style))

    def begin(self, stage: str) -> None:
        """A stage begins."""
        self.close()
        self._began = time.monotonic()
        if self._live and not self._quiet:
            self._status = self._console.status(Text(stage, style="cyan"), spinner="line")
            self._status.start()

    def stage(self, record: EpisodeRecord, stage: Stage) -> None:
        """A stage ended, successfully or not; ``record`` already holds its result (and its seconds in ``timings``)."""
        elapsed = record.timings.get(stage, time.monotonic() - self._began)
        self.line(state(record, stage), stage, elapsed, finding(record, stage))

    def line(self, how: State, name: str, elapsed: float, found: str) -> None:
        """Something called ``name`` ended after ``elapsed`` seconds; ``found`` says with what."""
        self.close()
        if self._quiet:
            return
        mark, plain, style = _MARKS[how]
        mark = mark if self._console.encoding.lower().startswith("utf") else plain
        took = (f"{elapsed:6.1f} s  ", "dim")
        self._print(
            Text.assemble((f"{mark:<2}", style), (f"{name:<14}", "bold"), took, self._printable(found))
        )

    def finish(self, record: EpisodeRecord, folder: Path) -> None:
        """The episode is over: its outcome on one line, and where to look."""
        self.close()
        tone = {"good": "bold green", "bad": "bold red", "unsure": "bold yellow"}[headline(record)[1]]
        self._print(Text(self._printable(summary_line(record), 400), style=tone))
        page = folder / "index.html"
        self._print(Text(self._printable(f"-> {page if page.is_file() else folder}", 400)))

    def close(self) -> None:
        """Remove the spinner; safe to call twice."""
        if self._status is not None:
            self._status.stop()
            self._status = None

    def _print(self, line: Text) -> None:
        if self._gone:
            return
        try:
            self._console.print(Text.assemble((self._label, "dim"), line), soft_wrap=True)
        except (OSError, SystemExit):  # the pipe was closed; rich would exit, and stop the robot
            self._gone = self._quiet = True

    def _printable(self, text: str, limit: int = 160) -> str:
        encoding = self._console.encoding
        return one_line(text, limit).encode(encoding, errors="replace").decode(encoding)
