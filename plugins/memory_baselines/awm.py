"""Inducing workflows without a language model."""

from __future__ import annotations

from collections.abc import Sequence

from gvla2.memory.contracts import Lesson, MemoryEpisode, MemoryItem, Verdict
from gvla2_plugins.memory_baselines.exemplars import show_exemplars, with_values
from gvla2_plugins.memory_baselines.transcripts import abstracted, steps_of
from gvla2_plugins.memory_baselines.vector_store import Draft, Found


class Workflows:
    """The steps of a success with abstracted values are a workflow; the same steps again confirm it.

    Multi-line lessons, as written by an inducer with a language model, are workflows as they are. Numbers of the other
    lessons are kept with the workflow, pooled over all episodes that confirm it: the usual values of its slots.
    """

    of_content = False

    def __init__(self, fewest_steps: int) -> None:
        self._fewest = fewest_steps

    def drafts(self, episode: MemoryEpisode, verdict: Verdict) -> tuple[list[Draft], str]:
        """One workflow of a verified success."""
        if verdict.outcome != "verified_success":
            return [], "Workflows are induced only from verified successes."
        told = [x for x in episode.lessons if x.type != "failure_avoidance" and "\n" in x.content.strip()]
        if told:  # a language model has written workflows already
            return [Draft((Lesson("procedural_hint", x.content, x.effect),)) for x in told], ""
        steps: list[str] = []
        for step in map(abstracted, steps_of(episode.transcript)):
            if not steps or steps[-1] != step:  # only the values differed
                steps.append(step)
        if len(steps) < self._fewest:
            return [], f"A workflow needs {self._fewest} steps; this episode's transcript has {len(steps)}."
        goal = f"Workflow for: {abstracted(episode.task.query)}"
        text = "\n".join([goal, *(f"{number}. {step}" for number, step in enumerate(steps, 1))])
        values = (
            lesson for lesson in episode.lessons if lesson.effect and lesson.type != "failure_avoidance"
        )
        key = "\n".join([episode.task.skill, *steps])
        return [Draft((Lesson("procedural_hint", text), *values), key)], ""

    def show(self, items: Sequence[MemoryItem], found: Sequence[Found], max_chars: int) -> str:
        """The workflows, each with its usual values."""
        entries = with_values(items, [len(entry.records) for entry in found])
        return show_exemplars("Workflows that succeeded before (optional):", entries, max_chars)
