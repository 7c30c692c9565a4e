"""Induction by a language model: the episode is data, lessons are JSON, and nothing is trusted."""

from __future__ import annotations

from importlib.resources import files
from typing import TYPE_CHECKING

from gvla2.errors import Gvla2Error
from gvla2.language import LanguageModel, ask_typed, json_in
from gvla2.memory.contracts import Lesson, MemoryEpisode, Verdict
from gvla2.memory.induction import MAX_CONTENT, RulesInducer
from gvla2.memory.records import RecordType
from gvla2.memory.rendering import neutralised

if TYPE_CHECKING:
    from gvla2_plugins.inducers import LanguageConfig

MAX_EVIDENCE, MOST_PASSAGES = 400, 4
"""Characters of a passage of evidence, and passages."""
_SYSTEM = files(__package__).joinpath("prompt.md").read_text("utf-8").strip()

_AFTER: dict[str, tuple[RecordType, ...]] = {
    "verified_success": ("procedural_hint", "tool_usage"),
    "verified_fail": ("failure_avoidance", "tool_usage"),
    "uncertain": ("procedural_hint", "failure_avoidance", "tool_usage"),
    "unavailable": ("procedural_hint", "failure_avoidance", "tool_usage"),
}


class LanguageInducer:
    """Asks a model for lessons and keeps those that fit the verdict, besides the episode's own.

    If the model is unavailable, or its answer is not a list of lessons, the rules decide.
    """

    def __init__(self, config: LanguageConfig, language: LanguageModel) -> None:
        self._config, self._language, self._rules = config, language, RulesInducer()

    def induce(self, episode: MemoryEpisode, verdict: Verdict) -> tuple[Lesson, ...]:
        """The lessons of the episode given the verdict."""
        if not episode.transcript.strip():
            return self._rules.induce(episode, verdict)
        messages = [
            {"role": "system", "content": _SYSTEM},
            {"role": "user", "content": self._account(episode, verdict)},
        ]
        most = self._config.most
        try:
            found = ask_typed(
                self._language,
                messages,
                lambda said: read_lessons(said, verdict, most),
                purpose="induce",
                tries=2,
            )
        except Gvla2Error:
            return self._rules.induce(episode, verdict)
        return (*episode.lessons, *found.answer)

    def _account(self, episode: MemoryEpisode, verdict: Verdict) -> str:
        lines = episode.transcript[: self._config.transcript].splitlines()
        shown = [line for line in (neutralised(line, 400) for line in lines) if line]
        reasons = "; ".join(neutralised(reason, 200) for reason in verdict.reasons[:4]) or "none given"
        return "\n".join(
            [
                f"Task: {neutralised(episode.task.query, 500)}",
                f"Judged: {verdict.outcome} (reasons: {reasons})",
                "<account>",
                *shown,
                "</account>",
            ]
        )


def read_lessons(answer: str, verdict: Verdict, most: int) -> tuple[Lesson, ...]:
    """The lessons of an answer that fit the verdict; raises :class:`ValueError` if it holds no JSON array."""
    found = json_in(answer)
    if not isinstance(found, list):
        raise ValueError("It must be one JSON array.")
    lessons: list[Lesson] = []
    for entry in found:
        if not isinstance(entry, dict) or entry.get("type") not in _AFTER[verdict.outcome]:
            continue
        content, evidence = entry.get("content"), entry.get("evidence")
        if isinstance(content, str) and content.strip():
            passages = evidence if isinstance(evidence, list) else ()
            kept = [passage[:MAX_EVIDENCE] for passage in passages if isinstance(passage, str)]
            words = " ".join(content.split())[:MAX_CONTENT]
            lessons.append(Lesson(entry["type"], words, evidence=tuple(kept[:MOST_PASSAGES])))
    return tuple(lessons[:most])
