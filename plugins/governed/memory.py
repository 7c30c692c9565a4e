"""The bank behind a run: opened lazily, and never blocking the run."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

from gvla2.errors import Gvla2Error
from gvla2.memory.bank import KnowledgeBank
from gvla2.memory.contracts import (
    Embedder,
    Inducer,
    Judge,
    Learned,
    MemoryContext,
    MemoryEpisode,
    MemoryTask,
    Retriever,
    Verdict,
    Verifier,
)
from gvla2.memory.store import check_bank, settled

if TYPE_CHECKING:
    from gvla2_plugins.governed import GovernedConfig


class GovernedMemory:
    """A :class:`KnowledgeBank` that opens on first use and answers "degraded" if the bank raises.

    An invalid address or name of a bank raises :class:`~gvla2.errors.ConfigurationError` immediately. An unavailable
    database is tried again at the next call.
    """

    def __init__(
        self,
        config: GovernedConfig,
        retriever: Retriever,
        embedder: Embedder,
        verifier: Verifier | None = None,
        inducer: Inducer | None = None,
        judge: Judge | None = None,
    ) -> None:
        # Absolute from the start: a run may change its working directory later.
        self.url = settled(config.url, os.environ)
        check_bank(config.bank)
        config.check("memory")
        self._config, self._retriever, self._embedder = config, retriever, embedder
        self._verifier, self._inducer, self._judge = verifier, inducer, judge
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

    def stats(self) -> dict[str, Any]:
        """Numbers about the bank, see :meth:`KnowledgeBank.stats`; raises Gvla2Error when it cannot be used."""
        return self._bank().stats()

    def close(self) -> None:
        """Release the database; safe to call twice."""
        if self._opened is not None:
            self._opened.close()
            self._opened = None

    def _bank(self) -> KnowledgeBank:
        if self._opened is None:
            self._opened = KnowledgeBank(
                self.url,
                bank=self._config.bank,
                retriever=self._retriever,
                embedder=self._embedder,
                inducer=self._inducer,
                verifier=self._verifier,
                judge=self._judge,
                options=self._config,
                busy_seconds=self._config.busy_seconds,
            )
        return self._opened
