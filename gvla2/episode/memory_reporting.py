"""An episode as memory gets it: one story for each attempt and part, with its own verdict and conversation."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from gvla2.episode.lessons import memory_episode
from gvla2.episode.multi_step import with_whole_program
from gvla2.episode.record import EpisodeRecord
from gvla2.io.files import plain
from gvla2.memory.contracts import MemoryEpisode, Verdict
from gvla2.planning.contracts import Plan
from gvla2.planning.skill import Skill
from gvla2.skills.table import STANDARD

_SECRET = re.compile(r"\b(?:sk|hf|gsk|xai|ghp|AIza)[-_]?[A-Za-z0-9_-]{16,}|(?i:\bbearer\s+)\S{8,}")
"""Patterns of common services' access keys, and of keys in headers."""
CONVERSATION_LIMIT = 6000
"""Characters of a planner's conversation with a language model that memory keeps per episode."""


def stories_of(
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
            story = _story(
                replace(part, episode_id=source), part.plan, part.verdict, place, len(parts), skills
            )
            yield story, part.verdict


def _story(
    part: EpisodeRecord, plan: Plan, verdict: Verdict, place: int, of: int, skills: Mapping[str, Skill]
) -> MemoryEpisode:
    episode = memory_episode(part, verdict, skills)
    lines = []
    if of > 1 or plan.remaining:
        left = f" Still to come: {', '.join(map(str, plan.remaining))}." if plan.remaining else ""
        lines.append(f"Part {place} of a program: {', '.join(map(str, plan.calls))}.{left}")
    lines.append(episode.transcript)
    if plan.fallback:
        lines.append(f"Planned by the fallback planner '{plan.fallback}'.")
    if plan.transcript:
        lines.append(_conversation(plan.transcript))
    return replace(episode, transcript="\n".join(line for line in lines if line))


def _conversation(transcript: tuple[Mapping[str, Any], ...]) -> str:
    """The planner's conversation as text; if it is too long, its beginning is cut."""
    text = "\n".join(f"{turn.who}: {turn.text}" for turn in turns(transcript))
    if len(text) > CONVERSATION_LIMIT:
        text = "…" + text[-(CONVERSATION_LIMIT - 1) :]
    return f"The planner's conversation with a language model:\n{text}"


@dataclass(frozen=True)
class Turn:
    """One message: its role (``system``, ``user``, ``assistant``, ...), and the text."""

    who: str
    text: str


def turns(transcript: Iterable[Mapping[str, Any]]) -> list[Turn]:
    """The turns of a plan's transcript, in any planner's format, without keys."""
    return [_turn(turn) for turn in kept(transcript)]


def turns_of(record: EpisodeRecord) -> list[Turn]:
    """All turns for the plans of an episode's last attempt, part by part."""
    return [turn for part in record.whole if part.plan is not None for turn in turns(part.plan.transcript)]


def kept(transcript: Iterable[Mapping[str, Any]]) -> list[Any]:
    """The transcript as JSON, without keys."""
    return [_blotted(plain(dict(turn))) for turn in transcript]


def _blotted(value: Any) -> Any:
    if isinstance(value, str):
        return _SECRET.sub("[key]", value)
    if isinstance(value, dict):
        return {_blotted(key): _blotted(item) for key, item in value.items()}
    return [_blotted(item) for item in value] if isinstance(value, list) else value


def _turn(turn: dict[str, Any]) -> Turn:
    who = str(turn.pop("role", "") or "note")
    said = [_words(turn.pop("content"))] if "content" in turn else []
    return Turn(who, "\n".join([*said, *(f"{key}: {_words(value)}" for key, value in turn.items())]))


def _words(content: object) -> str:
    """Text unchanged; for contents in several pieces (text, images) the texts and the others' types."""
    if isinstance(content, list):
        return "\n".join(map(_words, content))
    if isinstance(content, dict):
        return str(content["text"]) if "text" in content else f"[{content.get('type', 'data')}]"
    return str(content)
