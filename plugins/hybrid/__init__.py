"""The built-in retriever: by score S, with abstention."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl
from gvla2.memory.options import HybridOptions

if TYPE_CHECKING:
    from gvla2.memory.contracts import Retriever


@dataclass(kw_only=True)
class HybridConfig(HybridOptions, ComponentConfig):
    """Options of the ``hybrid`` retriever."""


def _build(config: HybridConfig) -> Retriever:
    """Ranks by words, cosine, confidence and use; abstains when nothing is reliable enough."""
    from gvla2.memory.retrieval import HybridRetriever

    return HybridRetriever(config)


@hookimpl
def gvla2_retrievers() -> list[Component[Retriever]]:
    """``retriever=hybrid``."""
    return [Component("hybrid", HybridConfig, _build)]
