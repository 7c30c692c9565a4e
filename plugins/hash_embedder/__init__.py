"""The hash embedder: character n-grams to vectors, without a model and without a download."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl

if TYPE_CHECKING:
    from gvla2.memory.contracts import Embedder


@dataclass
class HashEmbedderConfig(ComponentConfig):
    """Options of the ``hash`` embedder: the vectors' ``dimension``, the ``shortest`` and ``longest`` n-grams."""

    dimension: int = 512
    shortest: int = 3
    longest: int = 5


def _build(config: HashEmbedderConfig) -> Embedder:
    """Hashes character n-grams of any language into unit vectors; no model, no download."""
    from gvla2.memory.retrieval.hashing import HashEmbedder

    return HashEmbedder(config.dimension, config.shortest, config.longest)


@hookimpl
def gvla2_embedders() -> list[Component[Embedder]]:
    """The one embedder of this plugin."""
    return [Component("hash", HashEmbedderConfig, _build)]
