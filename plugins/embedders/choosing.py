"""Which embedder serves best with what is installed."""

from __future__ import annotations

import importlib.util
import logging

from gvla2.memory.contracts import Embedder
from gvla2_plugins.embedders.minilm import PACKAGE, MiniLMEmbedder

log = logging.getLogger(__name__)


def best_installed() -> Embedder:
    """MiniLM where its package is installed, else the static table.

    A package that is there and cannot be used is an error, as with ``embedder=minilm``: to fall back without a word
    would make runs differ by what is broken on a machine.
    """
    from gvla2.memory.retrieval.static_embedding import StaticEmbedder

    if importlib.util.find_spec(PACKAGE) is None:
        log.info(
            "Memory embeds by its static table (embedder=static); MiniLM hears paraphrases better: "
            "pip install 'gvla2[embed]'."
        )
        return StaticEmbedder()
    log.info("Memory embeds by MiniLM, as it is installed (embedder=minilm; embedder=static starts faster).")
    return MiniLMEmbedder()
