"""The tracker and the viewer of a run, guarded: a failure is logged once, and the run goes on."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

from omegaconf import OmegaConf

from gvla2.errors import kept_alive
from gvla2.plugins.discovery import describe
from gvla2.record.text import printable
from gvla2.record.tracker import TrackedRun, Tracker, Viewer

if TYPE_CHECKING:
    from gvla2.episode.record import EpisodeRecord

log = logging.getLogger(__name__)


class Tracking:
    """Reports a run to tracker and viewer, ``named`` so in messages, as a context manager around its episodes."""

    def __init__(
        self,
        tracker: Tracker | None,
        config: Any,
        folder: Path,
        viewer: Viewer | None = None,
        named: Callable[[str], str] = "The {}".format,
    ) -> None:
        self._told: dict[str, Any] = {"tracker": tracker, "view": viewer}
        self._config, self._folder, self._named = config, folder, named

    def __enter__(self) -> Tracking:
        self._tell("tracker", lambda tracker: tracker.begin(self._begun()))
        return self

    def _begun(self) -> TrackedRun:
        told = OmegaConf.to_container(OmegaConf.structured(self._config), enum_to_str=True)
        assert isinstance(told, dict)
        name = "/".join(self._folder.parts[-2:])
        return TrackedRun(name, self._folder, {str(key): value for key, value in told.items()})

    def episode(self, number: int, record: EpisodeRecord, folder: Path) -> None:
        """Report a finished episode."""
        measures = measures_of(record)
        self._tell("tracker", lambda tracker: tracker.episode(number, measures, folder))
        self._tell("view", lambda viewer: viewer.show(record, folder))

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._tell("tracker", lambda tracker: tracker.end(well=error is None))

    def _tell(self, who: str, call: Callable[[Any], None]) -> None:
        try:
            if self._told[who] is not None:
                with kept_alive():
                    call(self._told[who])
        except Exception as error:
            self._told[who] = None
            named = self._named(who)
            log.warning("%s failed and is no longer used: %s", named, printable(describe(error)))
            log.info("What it raised:", exc_info=error)


def measures_of(record: EpisodeRecord) -> dict[str, float]:
    """The numbers of an episode: outcome, seconds of each stage, tokens. Unjudged outcomes are left out."""
    found = {f"seconds/{stage}": seconds for stage, seconds in record.timings.items()}
    found["seconds"] = record.seconds
    if record.success_check is not None:
        found |= {
            "success": float(record.success_check.relaxed),
            "success_strict": float(record.success_check.strict),
        }
    if record.verdict is not None:
        found["verified"] = float(record.verdict.outcome == "verified_success")
    tallies = record.language.values()
    if tallies:
        found["tokens"] = sum(t.get("prompt_tokens", 0) + t.get("completion_tokens", 0) for t in tallies)
    found["attempts"] = len(record.attempts) + 1
    return found
