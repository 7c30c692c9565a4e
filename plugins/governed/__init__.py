"""The governed memory: the KnowledgeBank as a memory method."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl

if TYPE_CHECKING:
    from gvla2.memory.contracts import Embedder, Memory, Retriever


@dataclass
class GovernedConfig(ComponentConfig):
    """Options of the ``governed`` memory.

    ``url`` is ``sqlite:///path``; "" is ``memory.db`` in ``$GVLA2_HOME``, else in ``$XDG_DATA_HOME/gvla2``, else in
    ``~/.local/share/gvla2``. ``bank`` names the bank in it. ``busy_seconds`` is how long to wait for other
    processes. Switches: ``admission`` off lets unverified lessons in, ``failures`` off learns nothing from failures,
    ``show_provisional`` recalls unverified records too, ``frozen`` recalls and learns nothing. ``max_chars`` bounds
    the text given to a planner, ``max_per_episode`` the lessons of one episode.
    """

    url: str = ""
    bank: str = "default"
    busy_seconds: float = 5.0
    admission: bool = True
    failures: bool = True
    show_provisional: bool = False
    frozen: bool = False
    max_chars: int = 2400
    max_per_episode: int = 16


def _build(config: GovernedConfig, retriever: Retriever, embedder: Embedder) -> Memory:
    """Verified lessons with quality, confidence and lifecycle, in a database; hints and binding constraints."""
    from gvla2_plugins.governed.memory import GovernedMemory

    return GovernedMemory(config, retriever, embedder)


@hookimpl
def gvla2_memories() -> list[Component[Memory]]:
    """The one memory of this plugin."""
    return [Component("governed", GovernedConfig, _build, needs=("retriever", "embedder"))]
