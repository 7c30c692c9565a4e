"""The arms of an ablation over memory: plain names or variants with options of their own, and the controls.

``off`` has no memory and ``shuffled`` recalls for another task; any other arm is a memory by its name. All arms learn
from the same explored episodes, and are frozen before the test.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter

from gvla2.errors import ConfigurationError
from gvla2.evaluation.components import given_options, options_of
from gvla2.evaluation.config import MemoryArms
from gvla2.memory.contracts import (
    Embedder,
    Learned,
    Memory,
    MemoryContext,
    MemoryEpisode,
    MemoryTask,
    Verdict,
)
from gvla2.plugins.registry import Registry
from gvla2.reconstruction.options import VARIANTS

MEMORY = ("memory", "retriever", "embedder", "inducer", "judge")
CONTROLS = ("off", "shuffled")
"""Arms without a memory of their own: none, and another task's."""
WITHOUT_MEMORY = ("off", "none")
"""Sources of arms without any memory."""
PERCEIVED = "none"
"""An arm's ``geometry`` that leaves boxes as perceived."""
MEMORY_OF = MappingProxyType({"on": "governed", "shuffled": "governed"})
"""Arms whose memory has a different name."""
FROZEN = Learned(notes=("The memory is frozen: this is a test.",))


@dataclass(frozen=True)
class BenchArm:
    """One arm: its ``name``, source and configuration.

    ``source`` is ``off``, ``shuffled`` or the name of a memory; ``options`` are the memory's; ``replan`` further
    attempts are allowed in an episode, None for the bench's number. ``geometry`` is a row of GeoFuse's
    ablation, "none" for perceived boxes, "" for the bench's own branch.
    """

    name: str
    source: str
    options: Mapping[str, Any] = field(default_factory=dict)
    replan: int | None = None
    geometry: str = ""

    @property
    def memory(self) -> str:
        """The name of the memory component."""
        return "none" if self.source == "off" else MEMORY_OF.get(self.source, self.source)

    @property
    def learns(self) -> bool:
        """Whether it learns from exploration."""
        return self.source not in WITHOUT_MEMORY

    @property
    def variant(self) -> str:
        """How it differs from the plain arm of its name: "governed, admission=False"; "" if it does not."""
        plain = self.geometry or self.source == self.name or MEMORY_OF.get(self.name) == self.source
        options = dict(sorted(self.options.items()))
        options |= {} if self.replan is None else {"replan": self.replan}
        return ", ".join([*([] if plain else [self.source]), *(f"{k}={v}" for k, v in options.items())])


def arm_named(config: MemoryArms, name: str) -> BenchArm:
    """One arm by its name; raises :class:`ConfigurationError` if its value is not a mapping of options."""
    given = config.own_arms.get(name) or {}
    if not isinstance(given, Mapping):
        raise ConfigurationError(f"arms.{name} is {given!r}; give options: arms.{name}={{memory: governed}}.")
    options = dict(given)
    source = str(options.pop("memory", name if name == "shuffled" else MEMORY_OF.get(name, name)))
    replan = options.pop("replan", None)
    if replan is not None and (not isinstance(replan, int) or isinstance(replan, bool) or replan < 0):
        raise ConfigurationError(f"arms.{name}.replan is {replan!r}; it is a count, 0 or more.")
    geometry = str(options.pop("geometry", ""))
    rows = ("", PERCEIVED, *VARIANTS)
    if geometry not in rows:
        raise ConfigurationError(f"arms.{name}.geometry is '{geometry}'; it is one of {', '.join(rows[1:])}.")
    return BenchArm(name, source, options, replan, geometry)


def chosen_arms(config: MemoryArms, registry: Registry) -> list[BenchArm]:
    """The arms of a bench in order.

    Raises :class:`ConfigurationError` for an arm, a memory or an option that does not exist.
    """
    arms, memories = [arm_named(config, name) for name in config.chosen_arms], registry.components("memory")
    for arm in arms:
        if arm.source not in CONTROLS and arm.source not in memories:
            available = ", ".join(dict.fromkeys([*CONTROLS, *MEMORY_OF, *memories]))
            raise ConfigurationError(
                f"No arm '{arm.source}'. Available: {available}; or a variant of one of them with a name of its own: "
                f"arms.NAME={{memory: governed, failures: false}}."
            )
        known = [] if not arm.learns else options_of(registry, "memory", arm.memory)
        own = {*known, "replan", "geometry"} - {"url"}
        given_options(f"arms.{arm.name}", arm.options, f"'{arm.source}'", own)
    return arms


def has_bank(registry: Registry, arm: BenchArm) -> bool:
    """Whether the arm's memory keeps its bank in a configurable file."""
    return arm.learns and "url" in options_of(registry, "memory", arm.memory)


def chosen_memory(config: MemoryArms, registry: Registry, arm: BenchArm, bank: str) -> dict[str, Any]:
    """What to build for an arm's memory; one that has a ``url`` option keeps its bank in the file ``bank``."""
    options = {"name": arm.memory, **arm.options}
    if has_bank(registry, arm):
        options |= {"url": f"sqlite:///{bank}"}
    helpers = (*MEMORY[1:], "verifier", "language")
    return {**{kind: getattr(config, kind) for kind in helpers}, "memory": options}


class _Remembering:
    """An embedder that embeds each text once: arms learn the same words."""

    def __init__(self, embedder: Embedder) -> None:
        self._embedder, self._known = embedder, dict[str, NDArray[np.float32]]()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._embedder, name)

    def embed(self, texts: Sequence[str]) -> NDArray[np.float32]:
        """(N, D) unit rows."""
        new = [text for text in dict.fromkeys(texts) if text not in self._known]
        self._known |= zip(new, self._embedder.embed(new) if new else (), strict=True)
        return np.stack([self._known[text] for text in texts]) if texts else self._embedder.embed(())


_EMBEDDERS: dict[str, _Remembering] = {}
"""By configuration, for all memories of this process."""


def open_memory(config: MemoryArms, registry: Registry, arm: BenchArm, bank: str) -> Memory:
    """An arm's memory, on the bank in the file ``bank`` if it has one."""
    key, root = repr(config.embedder), chosen_memory(config, registry, arm, bank)
    if key not in _EMBEDDERS and "embedder" in registry.get("memory", arm.memory).needs:
        _EMBEDDERS[key] = _Remembering(registry.build(root, "embedder"))
    memory: Memory = registry.build(root, "memory", {"embedder": _EMBEDDERS.get(key)})
    return memory


Story = tuple[MemoryEpisode, Verdict]
"""What memory learns from an explored episode, and the robot's own verdict, never the success check's."""
STORIES: TypeAdapter[tuple[Story, ...]] = TypeAdapter(tuple[Story, ...])
"""Stories to JSON and back."""


def teach(memory: Memory, stories: Iterable[Story]) -> None:
    """Let a memory learn from stories, in their order."""
    for episode, verdict in stories:
        memory.learn(episode, verdict)


class Frozen:
    """A memory that recalls but does not learn during the test."""

    def __init__(self, memory: Memory) -> None:
        self._memory = memory

    def recall(self, task: MemoryTask) -> MemoryContext:
        """What the memory recalls."""
        return self._memory.recall(task)

    def learn(self, episode: MemoryEpisode, verdict: Verdict) -> Learned:
        """Nothing."""
        return FROZEN

    def close(self) -> None:
        """Release the memory."""
        self._memory.close()


class Shuffled(Frozen):
    """A frozen memory that is always asked about another task.

    The control for "any memory would have helped": as many records, as much text, the wrong lessons. If no other task
    left any experience (``asked`` is None) it recalls nothing, never the task's own.
    """

    def __init__(self, memory: Memory, asked: MemoryTask | None) -> None:
        super().__init__(memory)
        self._asked = asked

    def recall(self, task: MemoryTask) -> MemoryContext:
        """What the memory recalls for the other task."""
        if self._asked is None:
            return MemoryContext((), "", "no other task left experience")
        return super().recall(self._asked)
