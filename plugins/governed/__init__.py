"""The governed memory: the KnowledgeBank as a memory method."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl
from gvla2.memory.late import LateMemory, StoreOptions
from gvla2.memory.options import BankOptions

if TYPE_CHECKING:
    from gvla2.memory.contracts import Embedder, Inducer, Judge, Memory, Retriever, Verifier


@dataclass(kw_only=True)
class GovernedConfig(BankOptions, StoreOptions, ComponentConfig):
    """Options of the ``governed`` memory: where it is kept, and the bank's own.

    The ablations are ``admission``, ``replay``, ``governance`` and ``failures`` false, and ``retrieval`` semantic.
    """


def _build(
    config: GovernedConfig,
    retriever: Retriever,
    embedder: Embedder,
    verifier: Verifier | None = None,
    inducer: Inducer | None = None,
    judge: Judge | None = None,
) -> Memory:
    """Verified lessons with quality, confidence and lifecycle, in a database; hints and binding constraints."""
    config.check("memory")

    def opened(url: str) -> Memory:
        from gvla2.memory.bank import KnowledgeBank

        return KnowledgeBank(
            url,
            bank=config.bank,
            retriever=retriever,
            embedder=embedder,
            inducer=inducer,
            verifier=verifier,
            judge=judge,
            options=config,
            busy_seconds=config.busy_seconds,
        )

    return LateMemory(config, opened)


@hookimpl
def gvla2_memories() -> list[Component[Memory]]:
    """The one memory of this plugin."""
    needs = ("retriever", "embedder", "verifier", "inducer", "judge")
    return [Component("governed", GovernedConfig, _build, needs=needs)]
