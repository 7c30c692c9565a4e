"""A planner's conversation with a language model, in any planner's format, without keys."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from gvla2.episode.record import EpisodeRecord
from gvla2.io.files import plain
from gvla2.io.secrets import ACCESS_KEY


def kept(transcript: Iterable[Mapping[str, Any]]) -> list[Any]:
    """The transcript as JSON, without keys."""
    return [_blotted(plain(dict(turn))) for turn in transcript]


def turns_of(record: EpisodeRecord) -> list[tuple[str, str]]:
    """Who says what, for the plans of an episode's last attempt, part by part."""
    plans = [part.plan for part in record.whole if part.plan is not None]
    return [_turn(turn) for plan in plans for turn in kept(plan.transcript)]


def _blotted(value: Any) -> Any:
    if isinstance(value, str):
        return ACCESS_KEY.sub("[key]", value)
    if isinstance(value, dict):
        return {_blotted(key): _blotted(item) for key, item in value.items()}
    return [_blotted(item) for item in value] if isinstance(value, list) else value


def _turn(turn: dict[str, Any]) -> tuple[str, str]:
    who = str(turn.pop("role", "") or "note")
    said = [_words(turn.pop("content"))] if "content" in turn else []
    return who, "\n".join([*said, *(f"{key}: {_words(value)}" for key, value in turn.items())])


def _words(content: object) -> str:
    """Text unchanged; for contents in several pieces (text, images) the texts and the others' types."""
    if isinstance(content, list):
        return "\n".join(map(_words, content))
    if isinstance(content, dict):
        return str(content["text"]) if "text" in content else f"[{content.get('type', 'data')}]"
    return str(content)
