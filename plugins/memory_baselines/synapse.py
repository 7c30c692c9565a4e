"""The ``synapse`` memory's entries and their rendering."""

from __future__ import annotations

from collections.abc import Sequence

from gvla2.memory.contracts import Lesson, MemoryEpisode, MemoryItem, Verdict
from gvla2_plugins.memory_baselines.exemplars import show_exemplars, with_values
from gvla2_plugins.memory_baselines.vector_store import Draft, Found


class Exemplars:
    """The unchanged transcript of each verified success, and its successful numbers."""

    of_content = False

    def drafts(self, episode: MemoryEpisode, verdict: Verdict) -> tuple[list[Draft], str]:
        """One exemplar of a verified success."""
        if verdict.outcome != "verified_success":
            return [], "Exemplars are only verified successes."
        if not episode.transcript.strip():
            return [], "The episode has no transcript."
        told = f"Task: {episode.task.query}\n{episode.transcript}"
        values = (
            lesson for lesson in episode.lessons if lesson.effect and lesson.type != "failure_avoidance"
        )
        return [Draft((Lesson("procedural_hint", told), *values))], ""

    def show(self, items: Sequence[MemoryItem], found: Sequence[Found], max_chars: int) -> str:
        """The trajectories, the most similar task first."""
        entries = with_values(items, [len(entry.records) for entry in found])
        return show_exemplars("Trajectories of similar tasks that succeeded (optional):", entries, max_chars)
