"""Which embedder serves a bank: that of its vectors, else the best that is installed."""

from __future__ import annotations

import importlib.util
import logging
from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gvla2.memory.contracts import Embedder
from gvla2.memory.embedding import StaticEmbedder
from gvla2_plugins.embedders.minilm import MODEL, PACKAGE, MiniLMEmbedder

log = logging.getLogger(__name__)


class BestInstalled:
    """MiniLM if its package is installed, else the static table; a bank with vectors keeps their model.

    An installed but broken package is an error, as with ``embedder=minilm``: a silent fallback would make runs differ
    between machines.
    """

    def for_bank(self, model: str) -> Embedder:
        """The embedder for a bank whose vectors are by ``model``, "" for a bank without any."""
        installed = importlib.util.find_spec(PACKAGE) is not None
        if installed and model == MODEL:
            return self._taken(MiniLMEmbedder, "minilm", "the bank's vectors are by it")
        if model and model == StaticEmbedder().model:
            return self._taken(StaticEmbedder, "static", "the bank's vectors are by it")
        if installed:
            return self._taken(MiniLMEmbedder, "minilm", "it is installed, and finds paraphrases best")
        return self._taken(StaticEmbedder, "static", "MiniLM is not installed: pip install 'gvla2[embed]'")

    @property
    def model(self) -> str:
        """That of the best one."""
        return self._best.model

    def embed(self, texts: Sequence[str]) -> NDArray[np.float32]:
        """(N, D) unit rows by the best one."""
        return self._best.embed(texts)

    @cached_property
    def _best(self) -> Embedder:
        return self.for_bank("")

    @staticmethod
    def _taken(make: Callable[[], Embedder], name: str, why: str) -> Embedder:
        log.info("Memory embeds by %s: %s.", name, why)
        return make()
