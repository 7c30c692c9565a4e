"""Items of reasoning without a language model: the lessons of an episode, titled and described."""

from __future__ import annotations

import re
from collections.abc import Sequence

from gvla2.memory.contracts import Lesson, MemoryEpisode, MemoryItem, Verdict
from gvla2_plugins.memory_baselines.exemplars import show_exemplars, with_values
from gvla2_plugins.memory_baselines.transcripts import abstracted, ending_of, steps_of
from gvla2_plugins.memory_baselines.vector_store import Draft, Found

_SENTENCE = re.compile(r"(?<=[.!?。！？])\s+|\n")
_TITLE_WORDS = 8


class Strategies:
    """An entry for each judged episode: at most three items, what to do after success, what to avoid after failure."""

    of_content = False

    def __init__(self, most_items: int) -> None:
        self._most = most_items

    def drafts(self, episode: MemoryEpisode, verdict: Verdict) -> tuple[list[Draft], str]:
        """The items of a judged episode."""
        if verdict.outcome not in ("verified_success", "verified_fail"):
            return [], "Items are drawn only from judged episodes: this one's outcome is open."
        failed = verdict.outcome == "verified_fail"
        usable = [lesson for lesson in episode.lessons if lesson.content.strip()]
        if failed:
            usable = [lesson for lesson in usable if lesson.type != "procedural_hint"]
        lessons = usable[: self._most] or _from_transcript(episode, failed=failed)
        if not lessons:
            return [], "The episode has neither lessons nor a transcript."
        items = tuple(Lesson(lesson.type, item_of(lesson.content), lesson.effect) for lesson in lessons)
        return [Draft(items)], ""

    def show(self, items: Sequence[MemoryItem], found: Sequence[Found], max_chars: int) -> str:
        """Each item with its title, description and content."""
        entries = with_values(items, [1] * len(items))
        return show_exemplars("Strategies from similar tasks (optional):", entries, max_chars)


def item_of(content: str) -> str:
    """A lesson as an item: title (what it is about), description (its first sentence) and content.

    The three are in one text, a line each; repetitions of the line above are left out.
    """
    flat = " ".join(content.split())
    subject, colon, _ = flat.partition(": ")
    words = subject.split()
    title = " ".join(words[:_TITLE_WORDS]) + ("" if colon and len(words) <= _TITLE_WORDS else " …")
    description = _SENTENCE.split(content.strip(), maxsplit=1)[0].strip()
    lines = [f"Title: {title}"] if len(title) < len(flat) else []
    lines += [f"Description: {description}"] if description and description != content.strip() else []
    return "\n".join([*lines, f"Content: {flat}"])


def _from_transcript(episode: MemoryEpisode, *, failed: bool) -> list[Lesson]:
    """One item if there are no lessons: the steps that worked, or how the attempt ended."""
    steps = [abstracted(step) for step in steps_of(episode.transcript)]
    if not steps:
        return []
    goal = abstracted(episode.task.query)
    if failed:
        tried = "; ".join(steps[-3:])
        words = (
            f"{goal}: this failed. It ended with: {ending_of(episode.transcript)[:300]}. Tried last: {tried}."
        )
        return [Lesson("failure_avoidance", words)]
    return [Lesson("procedural_hint", f"{goal}: these steps succeeded. {'; '.join(steps[:12])}.")]
