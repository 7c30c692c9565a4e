"""Which embedder serves a bank: that of its vectors, else the best that is installed."""

from __future__ import annotations

import importlib.util
import logging
from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gvla2.memory.contracts import Embedder
from gvla2.memory.retrieval.static_embedding import StaticEmbedder
from gvla2_plugins.embedders.minilm import MODEL, PACKAGE, MiniLMEmbedder

log = logging.getLogger(__name__)


class BestInstalled:
    """MiniLM where its package is installed, else the static table; a bank that has vectors stays with their model.

    A package that is there and cannot be used is an error, as with ``embedder=minilm``: to fall back without a word
    would make runs differ by what is broken on a machine.
    """

    def for_bank(self, model: str) -> Embedder:
        """The embedder for a bank whose vectors are of ``model``, "" for one without any."""
        installed = importlib.util.find_spec(PACKAGE) is not None
        if installed and model == MODEL:
            return self._taken(MiniLMEmbedder, "minilm", "the bank's vectors are of it")
        static = StaticEmbedder()
        if model == static.model:
            return self._taken(lambda: static, "static", "the bank's vectors are of it")
        if installed:
            return self._taken(MiniLMEmbedder, "minilm", "it is installed, and hears paraphrases best")
        return self._taken(lambda: static, "static", "MiniLM is not installed: pip install 'gvla2[embed]'")

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
