"""ReasoningBank (Ouyang et al., 2025): strategies from successes and from failures, as titled items."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, hookimpl
from gvla2.memory.methods.options import VectorStoreConfig

if TYPE_CHECKING:
    from gvla2.memory.contracts import Embedder, Inducer, Memory


@dataclass(kw_only=True)
class ReasoningBankConfig(VectorStoreConfig):
    """Options of the ``reasoning_bank`` memory.

    ``url`` is the database, "" the default one, and ``bank`` the bank in it; ``busy_seconds`` is how long to wait for
    other processes. ``top_k`` is how many earlier tasks are recalled, each with all its items; ``most_items`` how
    many items one episode brings; ``frozen`` recalls and learns nothing; ``max_chars`` bounds the text given to a
    planner.
    """

    bank: str = "reasoning_bank"
    top_k: int = 1
    max_chars: int = 4000
    most_items: int = 3


def _build(config: ReasoningBankConfig, embedder: Embedder, inducer: Inducer | None = None) -> Memory:
    """Titled items from successes and failures of the most similar task; after ReasoningBank."""
    from gvla2.memory.methods.whole_method import WholeMethod
    from gvla2_plugins.reasoning_bank.method import Strategies

    return WholeMethod(config, Strategies(config.most_items), embedder, inducer)


@hookimpl
def gvla2_memories() -> list[Component[Memory]]:
    """The one memory of this plugin."""
    return [Component("reasoning_bank", ReasoningBankConfig, _build, needs=("embedder", "inducer"))]
