"""Synapse (Zheng et al., 2024): whole trajectories of similar tasks as exemplars."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, hookimpl
from gvla2.memory.methods.options import VectorStoreConfig

if TYPE_CHECKING:
    from gvla2.memory.contracts import Embedder, Memory


@dataclass(kw_only=True)
class SynapseConfig(VectorStoreConfig):
    """Options of the ``synapse`` memory.

    ``url`` is the database, "" the default one, and ``bank`` the bank in it; ``busy_seconds`` is how long to wait for
    other processes. ``top_k`` is how many trajectories are recalled; ``frozen`` recalls and learns nothing;
    ``max_chars`` bounds the text given to a planner.
    """

    bank: str = "synapse"
    top_k: int = 3
    max_chars: int = 12000


def _build(config: SynapseConfig, embedder: Embedder) -> Memory:
    """Whole trajectories of verified successes as exemplars, found by their task; after Synapse."""
    from gvla2.memory.methods.whole_method import WholeMethod
    from gvla2_plugins.synapse.method import Exemplars

    return WholeMethod(config, Exemplars(), embedder)


@hookimpl
def gvla2_memories() -> list[Component[Memory]]:
    """The one memory of this plugin."""
    return [Component("synapse", SynapseConfig, _build, needs=("embedder",))]
