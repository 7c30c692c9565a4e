"""Sentence embeddings by MiniLM: nearer to meaning than characters are, English mostly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl

if TYPE_CHECKING:
    from gvla2.memory.contracts import Embedder


@dataclass
class MiniLMConfig(ComponentConfig):
    """Options of the ``minilm`` embedder: ``batch`` texts are worked on at a time."""

    batch: int = 32


def _build(config: MiniLMConfig) -> Embedder:
    """Embeds sentences by all-MiniLM-L6-v2, offline, on the CPU, without torch."""
    from gvla2_plugins.minilm.embedder import MiniLMEmbedder

    return MiniLMEmbedder(config.batch)


@hookimpl
def gvla2_embedders() -> list[Component[Embedder]]:
    """The one embedder of this plugin."""
    return [Component("minilm", MiniLMConfig, _build)]
