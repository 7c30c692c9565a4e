"""The tracker and the viewer of a run, guarded: what goes wrong with them is logged once, and the run goes on."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

from omegaconf import OmegaConf

from gvla2.record.tracker import TrackedRun, Tracker, Viewer

if TYPE_CHECKING:
    from gvla2.record.contents import EpisodeRecord

log = logging.getLogger(__name__)


class Tracking:
    """Tells the tracker and the viewer (None: nobody) of a run, as a context manager round its episodes."""

    def __init__(
        self, tracker: Tracker | None, config: Any, folder: Path, viewer: Viewer | None = None
    ) -> None:
        self._tracker, self._viewer = tracker, viewer
        self._config, self._folder = config, folder

    def __enter__(self) -> Tracking:
        if self._tracker is not None:
            told = OmegaConf.to_container(OmegaConf.structured(self._config), enum_to_str=True)
            assert isinstance(told, dict)
            name = "/".join(self._folder.parts[-2:])
            run = TrackedRun(name, self._folder, {str(key): value for key, value in told.items()})
            self._guarded(lambda tracker: tracker.begin(run))
        return self

    def episode(self, number: int, record: EpisodeRecord, folder: Path) -> None:
        """Tell of an episode that has ended."""
        measures = measures_of(record)
        self._guarded(lambda tracker: tracker.episode(number, measures, folder))
        if self._viewer is not None:
            try:
                self._viewer.show(record, folder)
            except Exception as error:
                self._viewer = None
                _left("viewer", error)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._guarded(lambda tracker: tracker.end(well=error is None))

    def _guarded(self, call: Callable[[Tracker], None]) -> None:
        if self._tracker is None:
            return
        try:
            call(self._tracker)
        except Exception as error:
            self._tracker = None
            _left("tracker", error)


def _left(who: str, error: Exception) -> None:
    log.warning("The %s failed and is not told any more: %s: %s", who, type(error).__name__, error)
    log.info("What the %s raised:", who, exc_info=error)


def measures_of(record: EpisodeRecord) -> dict[str, float]:
    """The numbers of an episode: outcome, seconds of each stage, tokens. What nobody judged is left out."""
    found = {f"seconds/{stage}": seconds for stage, seconds in record.timings.items()}
    found["seconds"] = record.seconds
    if record.judgement is not None:
        found |= {"success": float(record.judgement.eased), "success_strict": float(record.judgement.strict)}
    if record.verdict is not None:
        found["verified"] = float(record.verdict.outcome == "verified_success")
    tallies = record.language.values()
    if tallies:
        found["tokens"] = sum(t.get("prompt_tokens", 0) + t.get("completion_tokens", 0) for t in tallies)
    found["attempts"] = len(record.attempts) + 1
    return found
