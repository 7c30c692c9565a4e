"""The governed memory: the KnowledgeBank as a memory method."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl
from gvla2.memory.options import BankOptions

if TYPE_CHECKING:
    from gvla2.memory.contracts import Embedder, Inducer, Judge, Memory, Retriever, Verifier


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


def _build(
    config: GovernedConfig,
    retriever: Retriever,
    embedder: Embedder,
    verifier: Verifier | None = None,
    inducer: Inducer | None = None,
    judge: Judge | None = None,
) -> Memory:
    """Verified lessons with quality, confidence and lifecycle, in a database; hints and binding constraints."""
    from gvla2_plugins.governed.memory import GovernedMemory

    return GovernedMemory(config, retriever, embedder, verifier, inducer, judge)


@hookimpl
def gvla2_memories() -> list[Component[Memory]]:
    """The one memory of this plugin."""
    return [
        Component(
            "governed",
            GovernedConfig,
            _build,
            needs=("retriever", "embedder", "verifier", "inducer", "judge"),
        )
    ]
