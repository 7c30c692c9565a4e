"""The bank behind a run: opened late, and never in the run's way."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from gvla2.errors import Gvla2Error
from gvla2.memory.bank import BankOptions, KnowledgeBank
from gvla2.memory.contracts import (
    Embedder,
    Learned,
    MemoryContext,
    MemoryEpisode,
    MemoryTask,
    Retriever,
    Verdict,
)
from gvla2.memory.sqlite import database_path

if TYPE_CHECKING:
    from gvla2_plugins.governed import GovernedConfig


def default_url(environment: Mapping[str, str]) -> str:
    """Where the bank is kept unless told otherwise."""
    if environment.get("GVLA2_HOME"):
        folder = Path(environment["GVLA2_HOME"])
    elif environment.get("XDG_DATA_HOME"):
        folder = Path(environment["XDG_DATA_HOME"]) / "gvla2"
    else:
        folder = Path("~/.local/share/gvla2")
    return f"sqlite:///{folder.expanduser() / 'memory.db'}"


class GovernedMemory:
    """A :class:`KnowledgeBank` that opens on first use and answers "degraded" where the bank raises.

    An address that can be no database at all is an error of the configuration and raises
    :class:`~gvla2.errors.ConfigurationError` at once. A database that cannot be used now is tried again at the next
    call.
    """

    def __init__(self, config: GovernedConfig, retriever: Retriever, embedder: Embedder) -> None:
        # Absolute from the start: a run may change its working directory later.
        self.url = f"sqlite:///{database_path(config.url or default_url(os.environ))}"
        self._config, self._retriever, self._embedder = config, retriever, embedder
        self._opened: KnowledgeBank | None = None

    def recall(self, task: MemoryTask) -> MemoryContext:
        """Knowledge for the task; an empty context that says why when the bank cannot be used."""
        try:
            return self._bank().recall(task)
        except Gvla2Error as error:
            return MemoryContext(degraded=str(error))

    def learn(self, episode: MemoryEpisode, verdict: Verdict) -> Learned:
        """Store what the episode teaches, all of it or nothing; says why when the bank cannot be used."""
        try:
            return self._bank().learn(episode, verdict)
        except Gvla2Error as error:
            return Learned(degraded=str(error))

    def close(self) -> None:
        """Release the database; safe to call twice."""
        if self._opened is not None:
            self._opened.close()
            self._opened = None

    def _bank(self) -> KnowledgeBank:
        if self._opened is None:
            config = self._config
            self._opened = KnowledgeBank.open(
                self.url,
                retriever=self._retriever,
                embedder=self._embedder,
                bank=config.bank,
                options=BankOptions(
                    admission=config.admission,
                    failures=config.failures,
                    show_provisional=config.show_provisional,
                    frozen=config.frozen,
                    max_chars=config.max_chars,
                    max_per_episode=config.max_per_episode,
                ),
                busy_seconds=config.busy_seconds,
            )
        return self._opened
