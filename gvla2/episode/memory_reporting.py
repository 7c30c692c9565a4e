"""What is reported to memory: one story per attempt and part, each with its own verdict."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from gvla2.episode.lessons import memory_episode
from gvla2.episode.memory_reporting import turns
from gvla2.episode.multi_step import with_whole_program
from gvla2.episode.record import EpisodeRecord
from gvla2.memory.contracts import MemoryEpisode, Verdict
from gvla2.skills.skill import Skill
from gvla2.skills.table import STANDARD

CONVERSATION_LIMIT = 6000
"""Characters of a planner's conversation with a language model that memory keeps per episode."""


def told_of(
    record: EpisodeRecord, skills: Mapping[str, Skill] = STANDARD
) -> Iterator[tuple[MemoryEpisode, Verdict]]:
    """The stories of a finished episode, first to last; unjudged ones are left out.

    The last part of the last attempt has the episode's id, others that id and a number: ``#2`` the second attempt,
    ``#2.1`` its first part.
    """
    attempts = (*record.attempts, replace(record, attempts=()))
    for number, attempt in enumerate(attempts, 1):
        parts = with_whole_program(attempt.whole)
        for place, part in enumerate(parts, 1):
            if part.plan is None or part.verdict is None:
                continue
            name = f"#{number}.{place}" if len(parts) > 1 else f"#{number}"
            last = number == len(attempts) and place == len(parts)
            source = record.episode_id if last else f"{record.episode_id}{name}"
            yield _story(replace(part, episode_id=source), place, len(parts), skills), part.verdict


def _story(part: EpisodeRecord, place: int, of: int, skills: Mapping[str, Skill]) -> MemoryEpisode:
    assert part.plan is not None
    assert part.verdict is not None
    told = memory_episode(part, part.verdict, skills)
    lines = []
    if of > 1 or part.plan.remaining:
        left = f" Still to come: {', '.join(map(str, part.plan.remaining))}." if part.plan.remaining else ""
        lines.append(f"Part {place} of a program: {', '.join(map(str, part.plan.calls))}.{left}")
    lines.append(told.transcript)
    if part.plan.fallback:
        lines.append(f"Planned by the fallback planner '{part.plan.fallback}'.")
    if part.plan.transcript:
        lines.append(_conversation(part.plan.transcript))
    return replace(told, transcript="\n".join(line for line in lines if line))


def _conversation(transcript: tuple[Mapping[str, Any], ...]) -> str:
    """The planner's conversation as text; if it is too long, its beginning is cut."""
    text = "\n".join(f"{turn.who}: {turn.text}" for turn in turns(transcript))
    if len(text) > CONVERSATION_LIMIT:
        text = "…" + text[-(CONVERSATION_LIMIT - 1) :]
    return f"The planner's conversation with a language model:\n{text}"
