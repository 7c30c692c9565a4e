"""The built-in retrievers: by score S with abstention, and by cosine alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl
from gvla2.memory.options import HybridOptions, SemanticOptions

if TYPE_CHECKING:
    from gvla2.memory.contracts import Retriever


@dataclass(kw_only=True)
class HybridConfig(HybridOptions, ComponentConfig):
    """Options of the ``hybrid`` retriever."""


@dataclass(kw_only=True)
class SemanticConfig(SemanticOptions, ComponentConfig):
    """Options of the ``semantic`` retriever."""


def _build_hybrid(config: HybridConfig) -> Retriever:
    """Ranks by BM25, cosine, quality and geometry; abstains when nothing is reliable enough."""
    from gvla2.memory.retrieval import HybridRetriever

    return HybridRetriever(config)


def _build_semantic(config: SemanticConfig) -> Retriever:
    """Returns the records of the nearest vectors, without a threshold; for comparison."""
    from gvla2.memory.retrieval import SemanticRetriever

    return SemanticRetriever(config)


@hookimpl
def gvla2_retrievers() -> list[Component[Retriever]]:
    """The retrievers of this plugin."""
    return [
        Component("hybrid", HybridConfig, _build_hybrid),
        Component("semantic", SemanticConfig, _build_semantic),
    ]
