"""The governed memory: the KnowledgeBank as a memory method."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl

if TYPE_CHECKING:
    from gvla2.memory.contracts import Embedder, Inducer, Memory, Retriever, Verifier


@dataclass
class GovernedConfig(ComponentConfig):
    """Options of the ``governed`` memory.

    ``url`` is ``sqlite:///path`` or ``postgresql://…``; "" is ``memory.db`` in ``$GVLA2_HOME``, else in
    ``$XDG_DATA_HOME/gvla2``, else in ``~/.local/share/gvla2``. ``bank`` names the bank in it. ``busy_seconds`` is how
    long to wait for other processes. ``snapshot`` false keeps no copy of the index for a fast start of large banks.
    All other options are those of :class:`gvla2.memory.bank_options.BankOptions`,
    with the same defaults; the ablations are ``admission``, ``replay``, ``governance`` and ``failures`` false, and
    ``retrieval`` semantic.
    """

    url: str = ""
    bank: str = "default"
    busy_seconds: float = 5.0
    snapshot: bool = True
    admission: bool = True
    replay: bool = True
    governance: bool = True
    failures: bool = True
    retrieval: str = "full"
    show_provisional: bool = False
    frozen: bool = False
    max_chars: int = 2400
    max_per_episode: int = 16
    active_budget: int = 10_000
    provisional_budget: int = 2_000
    per_source: int = 64
    per_source_days: float = 1.0
    per_source_copies: int = 4
    copy_cosine: float = 0.95
    constant_verdicts: int = 20
    constant_confidence: float = 0.6
    rivals: int = 16
    match: float = 0.35
    merge_surface: float = 0.80
    merge_signature: float = 0.5
    discard: float = 0.95
    retire_days: float = 14.0
    summary_size: int = 3
    summary_match: float = 0.5
    replay_confidence: float = 0.4
    replay_per_episode: int = 1


def _build(
    config: GovernedConfig,
    retriever: Retriever,
    embedder: Embedder,
    verifier: Verifier | None = None,
    inducer: Inducer | None = None,
) -> Memory:
    """Verified lessons with quality, confidence and lifecycle, in a database; hints and binding constraints."""
    from gvla2_plugins.governed.memory import GovernedMemory

    return GovernedMemory(config, retriever, embedder, verifier, inducer)


@hookimpl
def gvla2_memories() -> list[Component[Memory]]:
    """The one memory of this plugin."""
    return [
        Component("governed", GovernedConfig, _build, needs=("retriever", "embedder", "verifier", "inducer"))
    ]
