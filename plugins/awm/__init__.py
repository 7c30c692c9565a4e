"""Agent Workflow Memory (Wang et al., 2024): reusable routines induced from what worked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, hookimpl
from gvla2.memory.methods.options import VectorStoreConfig

if TYPE_CHECKING:
    from gvla2.memory.contracts import Embedder, Inducer, Memory


@dataclass(kw_only=True)
class AwmConfig(VectorStoreConfig):
    """Options of the ``awm`` memory.

    ``url`` is the database, "" the default one, and ``bank`` the bank in it; ``busy_seconds`` is how long to wait for
    other processes. ``top_k`` is how many workflows are recalled, ``fewest_steps`` what a workflow needs at least,
    ``frozen`` recalls and learns nothing, ``max_chars`` bounds the text given to a planner.
    """

    bank: str = "awm"
    top_k: int = 3
    max_chars: int = 6000
    fewest_steps: int = 2


def _build(config: AwmConfig, embedder: Embedder, inducer: Inducer | None = None) -> Memory:
    """Workflows induced from verified successes, values replaced by slots; after Agent Workflow Memory."""
    from gvla2.memory.methods.whole_method import WholeMethod
    from gvla2_plugins.awm.method import Workflows

    return WholeMethod(config, Workflows(config.fewest_steps), embedder, inducer)


@hookimpl
def gvla2_memories() -> list[Component[Memory]]:
    """The one memory of this plugin."""
    return [Component("awm", AwmConfig, _build, needs=("embedder", "inducer"))]
