"""The ablation's special arms: frozen memories, another task's, and a search without a bank."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from statistics import fmean

from gvla2.evaluation.robot.experience import Experience
from gvla2.memory.contracts import (
    Learned,
    Memory,
    MemoryContext,
    MemoryEpisode,
    MemoryItem,
    MemoryTask,
    Verdict,
)
from gvla2.planning.effects import Prior, effect_from_json

FROZEN = Learned(notes=("The memory is frozen: this is a test.",))
CERTAIN = 1_000_000
"""Successes claimed for the best theta, so that the default has no weight left."""


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


class BestTheta:
    """No bank: the plain mean theta of a task's explorations that the robot verified as successes.

    The control for "a search over parameters would have done": the same episodes and the parameters that their lessons
    name, but no retrieval and no governance. Without a success it keeps the defaults.
    """

    def __init__(self, experiences: Sequence[Experience]) -> None:
        won = [e for e in experiences if e.verdict.outcome == "verified_success"]
        told = [lesson.effect for e in won for lesson in e.episode.lessons if lesson.effect]
        tried: dict[tuple[str, str], list[Prior]] = {}
        for effect in map(effect_from_json, told):
            if isinstance(effect, Prior):
                tried.setdefault((effect.skill, effect.parameter), []).append(effect)
        self._best = [
            replace(some[0], value=fmean(one.value for one in some), sd=0.0, count=CERTAIN)
            for some in tried.values()
        ]

    def recall(self, task: MemoryTask) -> MemoryContext:
        """One hint per parameter."""
        items = tuple(
            MemoryItem(
                id=f"best-{effect.skill}-{effect.parameter}",
                type="procedural_hint",
                content=f"To {effect.skill}, the best {effect.parameter.replace('_', ' ')} is {effect.value:.4g}.",
                confidence=1.0,
                score=1.0,
                terms={},
                binding=False,
                effect=effect.to_json(),
            )
            for effect in self._best
        )
        text = "\n".join(item.content for item in items)
        return MemoryContext(items, text, "" if items else "no exploration succeeded")

    def learn(self, episode: MemoryEpisode, verdict: Verdict) -> Learned:
        """Nothing."""
        return FROZEN

    def close(self) -> None:
        """Nothing is open."""
