"""The governed memory: the KnowledgeBank as a memory method."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from gvla2 import Component, ComponentConfig, hookimpl
from gvla2.errors import Gvla2Error
from gvla2.memory.contracts import Learned, MemoryContext
from gvla2.memory.options import BankOptions

if TYPE_CHECKING:
    from gvla2.memory.bank import KnowledgeBank
    from gvla2.memory.contracts import (
        Embedder,
        Inducer,
        Judge,
        Memory,
        MemoryEpisode,
        MemoryTask,
        Retriever,
        Verdict,
        Verifier,
    )


@dataclass
class GovernedConfig(BankOptions, ComponentConfig):
    """Options of the ``governed`` memory.

    ``url`` is ``sqlite:///path`` or ``postgresql://…``; "" is ``memory.db`` in ``$GVLA2_HOME``, else in
    ``$XDG_DATA_HOME/gvla2``, else in ``~/.local/share/gvla2``. ``bank`` names the bank in it. ``busy_seconds`` is how
    long to wait for other processes. All other options are the bank's own; the ablations are ``admission``,
    ``replay``, ``governance`` and ``failures`` false, and ``retrieval`` semantic.
    """

    url: str = ""
    bank: str = "default"
    busy_seconds: float = 5.0


class GovernedMemory:
    """A :class:`KnowledgeBank` that opens on first use and answers "degraded" if the bank raises.

    An invalid address or name of a bank raises :class:`~gvla2.errors.ConfigurationError` immediately. An unavailable
    database is tried again at the next call.
    """

    def __init__(self, config: GovernedConfig, **components: Any) -> None:
        from gvla2.memory.store import check_bank, resolved_address

        # Absolute from the start: a run may change its working directory later.
        self.url = resolved_address(config.url, os.environ)
        check_bank(config.bank)
        config.check("memory")
        self._config, self._components = config, components
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
        from gvla2.memory.bank import KnowledgeBank

        if self._opened is None:
            config, more = self._config, self._components
            self._opened = KnowledgeBank(
                self.url, bank=config.bank, options=config, busy_seconds=config.busy_seconds, **more
            )
        return self._opened


def _build(
    config: GovernedConfig,
    retriever: Retriever,
    embedder: Embedder,
    verifier: Verifier | None = None,
    inducer: Inducer | None = None,
    judge: Judge | None = None,
) -> Memory:
    """Verified lessons with quality, confidence and lifecycle, in a database; hints and binding constraints."""
    components = {"verifier": verifier, "inducer": inducer, "judge": judge}
    return GovernedMemory(config, retriever=retriever, embedder=embedder, **components)


@hookimpl
def gvla2_memories() -> list[Component[Memory]]:
    """The one memory of this plugin."""
    needs = ("retriever", "embedder", "verifier", "inducer", "judge")
    return [Component("governed", GovernedConfig, _build, needs=needs)]
