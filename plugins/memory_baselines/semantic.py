"""The ``semantic`` memory's entries and their rendering."""

from __future__ import annotations

from collections.abc import Sequence

from gvla2.memory.contracts import MemoryEpisode, MemoryItem, Verdict
from gvla2.memory.rendering import render
from gvla2_plugins.memory_baselines.vector_store import Draft, Found


class Semantic:
    """Append only: each lesson of each episode is a separate entry, whatever the verdict."""

    of_content = True

    def drafts(self, episode: MemoryEpisode, verdict: Verdict) -> tuple[list[Draft], str]:
        """Every lesson that has words."""
        drafts = [Draft((lesson,)) for lesson in episode.lessons if lesson.content.strip()]
        return drafts, "" if drafts else "The episode brought no lessons."

    def show(self, items: Sequence[MemoryItem], found: Sequence[Found], max_chars: int) -> str:
        """One line per lesson."""
        return render(items, max_chars)
