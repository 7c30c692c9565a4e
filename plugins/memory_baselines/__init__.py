"""The baselines for the governed memory: whole methods after their papers, on one vector store.

``semantic`` keeps every lesson, ``constants`` the means of what succeeded; ``awm`` is Agent Workflow Memory (Wang et
al., 2024), ``reasoning_bank`` ReasoningBank (Ouyang et al., 2025), ``synapse`` Synapse (Zheng et al., 2024).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl
from gvla2.errors import ConfigurationError
from gvla2.memory.late import StoreOptions

if TYPE_CHECKING:
    from gvla2.memory.contracts import Embedder, Inducer, Memory


@dataclass(kw_only=True)
class VectorStoreConfig(StoreOptions, ComponentConfig):
    """Options common to all of them.

    ``top_k`` is the number of recalled entries (lessons, workflows, tasks, trajectories); ``max_chars`` bounds the text
    given to a planner.
    """

    top_k: int = 3
    max_chars: int = 4000

    def __post_init__(self) -> None:
        if self.top_k < 1 or self.max_chars < 200:
            raise ConfigurationError(
                f"A memory needs top_k >= 1 and max_chars >= 200, not {self.top_k} and {self.max_chars}."
            )


@dataclass(kw_only=True)
class SemanticMemoryConfig(VectorStoreConfig):
    """Options of the ``semantic`` memory."""

    bank: str = "semantic"
    top_k: int = 6
    max_chars: int = 2400


def _build_semantic(
    config: SemanticMemoryConfig, embedder: Embedder, inducer: Inducer | None = None
) -> Memory:
    """Keeps every lesson, verified or not, and recalls the most similar ones: the plain baseline."""
    from gvla2_plugins.memory_baselines.methods import Semantic

    return Semantic.late(config, embedder, inducer)


@dataclass(kw_only=True)
class ConstantsConfig(VectorStoreConfig):
    """Options of the ``constants`` memory; it recalls everything, whatever ``top_k`` is."""

    bank: str = "constants"


def _build_constants(config: ConstantsConfig, embedder: Embedder) -> Memory:
    """Each skill's parameters, averaged over all verified successes: the best constants, without retrieval."""
    from gvla2_plugins.memory_baselines.methods import Constants

    return Constants.late(config, embedder)


@dataclass(kw_only=True)
class AwmConfig(VectorStoreConfig):
    """Options of the ``awm`` memory."""

    bank: str = "awm"
    max_chars: int = 6000


def _build_awm(config: AwmConfig, embedder: Embedder, inducer: Inducer | None = None) -> Memory:
    """Workflows induced from verified successes, values replaced by slots; after Agent Workflow Memory."""
    from gvla2_plugins.memory_baselines.methods import Workflows

    return Workflows.late(config, embedder, inducer)


@dataclass(kw_only=True)
class ReasoningBankConfig(VectorStoreConfig):
    """Options of the ``reasoning_bank`` memory."""

    bank: str = "reasoning_bank"
    top_k: int = 1


def _build_reasoning_bank(
    config: ReasoningBankConfig, embedder: Embedder, inducer: Inducer | None = None
) -> Memory:
    """Titled items from successes and failures of the most similar task; after ReasoningBank."""
    from gvla2_plugins.memory_baselines.methods import Strategies

    return Strategies.late(config, embedder, inducer)


@dataclass(kw_only=True)
class SynapseConfig(VectorStoreConfig):
    """Options of the ``synapse`` memory."""

    bank: str = "synapse"
    max_chars: int = 12000


def _build_synapse(config: SynapseConfig, embedder: Embedder) -> Memory:
    """Whole trajectories of verified successes as exemplars, found by their task; after Synapse."""
    from gvla2_plugins.memory_baselines.methods import Exemplars

    return Exemplars.late(config, embedder)


@hookimpl
def gvla2_memories() -> list[Component[Memory]]:
    """``memory=semantic``, ``constants``, ``awm``, ``reasoning_bank`` and ``synapse``."""
    both = ("embedder", "inducer")
    return [
        Component("semantic", SemanticMemoryConfig, _build_semantic, needs=both),
        Component("constants", ConstantsConfig, _build_constants, needs=("embedder",)),
        Component("awm", AwmConfig, _build_awm, needs=both),
        Component("reasoning_bank", ReasoningBankConfig, _build_reasoning_bank, needs=both),
        Component("synapse", SynapseConfig, _build_synapse, needs=("embedder",)),
    ]
