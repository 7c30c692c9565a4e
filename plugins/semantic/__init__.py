"""Memory by similarity alone: every lesson is kept, the most similar ones come back."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, hookimpl
from gvla2.memory.methods.options import VectorStoreConfig

if TYPE_CHECKING:
    from gvla2.memory.contracts import Embedder, Memory


@dataclass(kw_only=True)
class SemanticConfig(VectorStoreConfig):
    """Options of the ``semantic`` memory.

    ``url`` is the database, "" the default one, and ``bank`` the bank in it; ``busy_seconds`` is how long to wait for
    other processes. ``top_k`` is how many lessons are recalled, ``frozen`` recalls and learns nothing, ``max_chars``
    bounds the text given to a planner.
    """

    bank: str = "semantic"
    top_k: int = 6
    max_chars: int = 2400


def _build(config: SemanticConfig, embedder: Embedder) -> Memory:
    """Keeps every lesson, verified or not, and recalls the most similar ones: the plain baseline."""
    from gvla2.memory.methods.whole_method import WholeMethod
    from gvla2_plugins.semantic.method import Semantic

    return WholeMethod(config, Semantic(), embedder)


@hookimpl
def gvla2_memories() -> list[Component[Memory]]:
    """The one memory of this plugin."""
    return [Component("semantic", SemanticConfig, _build, needs=("embedder",))]
