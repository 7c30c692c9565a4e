"""What language models cost: calls, tokens and seconds, by purpose."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Mapping

from gvla2.language.completion import Completion

Tally = Mapping[str, float]
"""``calls``, ``cached`` (answers that cost nothing), ``unmetered`` (calls whose tokens the server did not count),
``failed``, ``prompt_tokens``, ``completion_tokens``, ``seconds``."""

_COUNTED = ("calls", "cached", "unmetered", "failed", "prompt_tokens", "completion_tokens", "seconds")


class Ledger:
    """Counts by purpose ("plan", "verify", "induce"); one ledger may serve several endpoints and threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._tallies: dict[str, Counter[str]] = {}

    def add(self, purpose: str, answer: Completion | None) -> None:
        """Count one call; None is one that failed."""
        counts: dict[str, float] = {"failed": 1}
        if answer is not None and answer.cached:
            counts = {"cached": 1}
        elif answer is not None:
            counts = {
                "calls": 1,
                "unmetered": not answer.usage.metered,
                "prompt_tokens": answer.usage.prompt_tokens,
                "completion_tokens": answer.usage.completion_tokens,
                "seconds": round(answer.latency, 3),
            }
        with self._lock:
            self._tallies.setdefault(purpose, Counter()).update(counts)

    def totals(self, since: Mapping[str, Tally] | None = None) -> dict[str, Tally]:
        """The counts so far, or from an earlier ``totals()`` on; purposes without a call are left out."""
        with self._lock:
            now = {purpose: dict(tally) for purpose, tally in self._tallies.items()}
        told: dict[str, Tally] = {}
        for purpose, tally in now.items():
            before = (since or {}).get(purpose, {})
            counts = {name: round(tally.get(name, 0) - before.get(name, 0), 3) for name in _COUNTED}
            if any(counts.values()):
                told[purpose] = counts
        return told
