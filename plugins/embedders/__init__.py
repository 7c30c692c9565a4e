"""The built-in embedders: a static table of token vectors, MiniLM, and the better one available."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl

if TYPE_CHECKING:
    from gvla2.memory.contracts import Embedder


@dataclass
class StaticConfig(ComponentConfig):
    """The ``static`` embedder has no options."""


@dataclass
class MiniLMConfig(ComponentConfig):
    """The ``minilm`` embedder has no options."""


@dataclass
class AutoConfig(ComponentConfig):
    """The ``auto`` embedder has no options."""


def _build_static(config: StaticConfig) -> Embedder:
    """Averages token vectors of a pip-installed table: finds synonyms, loads fast, mostly English."""
    from gvla2.memory.embedding import StaticEmbedder

    return StaticEmbedder()


def _build_minilm(config: MiniLMConfig) -> Embedder:
    """Embeds sentences by all-MiniLM-L6-v2, offline, on the CPU, without torch: closer to the meaning."""
    from gvla2_plugins.embedders.minilm import MiniLMEmbedder

    return MiniLMEmbedder()


def _build_auto(config: AutoConfig) -> Embedder:
    """MiniLM if its package is installed, else the static table."""
    from gvla2.memory.embedding import StaticEmbedder
    from gvla2_plugins.embedders.minilm import PACKAGE, MiniLMEmbedder

    return MiniLMEmbedder() if find_spec(PACKAGE) else StaticEmbedder()


@hookimpl
def gvla2_embedders() -> list[Component[Embedder]]:
    """The embedders of this plugin."""
    return [
        Component("auto", AutoConfig, _build_auto),
        Component("static", StaticConfig, _build_static),
        Component("minilm", MiniLMConfig, _build_minilm),
    ]
