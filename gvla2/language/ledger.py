"""What language models cost, in tokens."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

Purpose = Literal["agent", "extra"]
"""``agent``: the agent's own work. ``extra``: what is done about it, such as verifying, inducing and probing."""


@dataclass(frozen=True)
class Tally:
    """Tokens of some calls. ``cached`` answers cost nothing; ``unmetered`` calls were answered without counts."""

    prompt_tokens: int = 0
    completion_tokens: int = 0
    calls: int = 0
    cached: int = 0
    unmetered: int = 0

    @property
    def tokens(self) -> int:
        """Prompt and completion together."""
        return self.prompt_tokens + self.completion_tokens


class Ledger:
    """Counts by purpose; one ledger may serve several endpoints and threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._tallies: dict[Purpose, Tally] = {"agent": Tally(), "extra": Tally()}

    def add(
        self, purpose: Purpose, prompt: int, completion: int, *, cached: bool = False, metered: bool = True
    ) -> None:
        """Count one answered call; a cached one adds no tokens."""
        with self._lock:
            old = self._tallies[purpose]
            if cached:
                self._tallies[purpose] = replace(old, cached=old.cached + 1)
                return
            self._tallies[purpose] = Tally(
                old.prompt_tokens + prompt,
                old.completion_tokens + completion,
                old.calls + 1,
                old.cached,
                old.unmetered + (not metered),
            )

    def totals(self) -> Mapping[Purpose, Tally]:
        """The counts so far."""
        with self._lock:
            return dict(self._tallies)
