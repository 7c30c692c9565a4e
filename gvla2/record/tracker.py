"""Reporting of runs: a tracker gets configuration and numbers, a viewer each complete episode."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from gvla2.episode.record import EpisodeRecord


@dataclass(frozen=True)
class TrackedRun:
    """A starting run: a ``name`` for people, the ``folder`` of its files, and its composed ``config``, nested."""

    name: str
    folder: Path
    config: Mapping[str, Any]


class Tracker(Protocol):
    """Reports a run to an experiment-tracking service. Its errors become warnings: a run never stops for them."""

    def begin(self, run: TrackedRun) -> None:
        """A run starts; called once, before any episode."""
        ...

    def episode(self, number: int, measures: Mapping[str, float], folder: Path) -> None:
        """Episode ``number`` (from 0) has ended: its numbers by name, and the ``folder`` with its page and pictures."""
        ...

    def end(self, *, well: bool) -> None:
        """The run is over; ``well`` is false after an error or an interrupt."""
        ...


class Viewer(Protocol):
    """Shows episodes in an external program. Its errors become warnings: a run never stops for them."""

    def show(self, record: EpisodeRecord, folder: Path) -> None:
        """Show the finished episode of ``record``; ``folder`` has its page, film and states, and may get more files."""
        ...
