"""Inducers: how an episode becomes candidate lessons. A model reads the episode as data, and nothing is trusted."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.resources import files

from gvla2 import Component, ComponentConfig, hookimpl
from gvla2.errors import Gvla2Error
from gvla2.language import LanguageModel, ask_typed, json_in
from gvla2.memory.contracts import Inducer, Lesson, MemoryEpisode, Verdict
from gvla2.memory.induction import MAX_CONTENT, RulesInducer
from gvla2.memory.records import TYPES, RecordType
from gvla2.memory.rendering import neutralised

MAX_EVIDENCE, MOST_PASSAGES = 400, 4
"""Characters of a passage of evidence, and passages."""
_AFTER: dict[str, tuple[RecordType, ...]] = {
    "verified_success": ("procedural_hint", "tool_usage"),
    "verified_fail": ("failure_avoidance", "tool_usage"),
}
"""The types of lessons that fit a verdict; all of them fit an open one."""


@dataclass
class RulesConfig(ComponentConfig):
    """The ``rules`` inducer has no options."""


@dataclass
class LanguageConfig(ComponentConfig):
    """Options of the ``llm`` inducer, which asks the run's ``language``.

    At most ``most`` lessons are taken from an answer; the first ``transcript`` characters of an episode's transcript
    are shown to the model.
    """

    most: int = 4
    transcript: int = 8000


def _build_rules(config: RulesConfig) -> Inducer:
    """The episode's own lessons, else its steps or what went wrong; deterministic, no language model."""
    return RulesInducer()


class LanguageInducer:
    """Lessons worded by a language model, besides the episode's own; by rules if it cannot answer."""

    def __init__(self, config: LanguageConfig, language: LanguageModel) -> None:
        self._config, self._language, self._rules = config, language, RulesInducer()
        self._orders = files(__package__).joinpath("prompt.md").read_text("utf-8").strip()

    def induce(self, episode: MemoryEpisode, verdict: Verdict) -> tuple[Lesson, ...]:
        """The lessons of the episode given the verdict."""
        if not episode.transcript.strip():
            return self._rules.induce(episode, verdict)
        messages = [
            {"role": "system", "content": self._orders},
            {"role": "user", "content": self._account(episode, verdict)},
        ]

        def parse(said: str) -> tuple[Lesson, ...]:
            return read_lessons(said, verdict, self._config.most)

        try:
            found = ask_typed(self._language, messages, parse, purpose="induce", tries=2)
        except Gvla2Error:
            return self._rules.induce(episode, verdict)
        return (*episode.lessons, *found.answer)

    def _account(self, episode: MemoryEpisode, verdict: Verdict) -> str:
        lines = episode.transcript[: self._config.transcript].splitlines()
        reasons = "; ".join(neutralised(reason, 200) for reason in verdict.reasons[:4]) or "none given"
        return "\n".join(
            [
                f"Task: {neutralised(episode.task.query, 500)}",
                f"Judged: {verdict.outcome} (reasons: {reasons})",
                "<account>",
                *(shown for line in lines if (shown := neutralised(line, 400))),
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
        if not isinstance(entry, dict) or entry.get("type") not in _AFTER.get(verdict.outcome, TYPES):
            continue
        content, evidence = entry.get("content"), entry.get("evidence")
        if isinstance(content, str) and content.strip():
            passages = evidence if isinstance(evidence, list) else ()
            kept = [passage[:MAX_EVIDENCE] for passage in passages if isinstance(passage, str)]
            words = " ".join(content.split())[:MAX_CONTENT]
            lessons.append(Lesson(entry["type"], words, evidence=tuple(kept[:MOST_PASSAGES])))
    return tuple(lessons[:most])


@hookimpl
def gvla2_inducers() -> list[Component[Inducer]]:
    """Induction by rules, and by a language model."""
    return [
        Component("rules", RulesConfig, _build_rules),
        Component("llm", LanguageConfig, LanguageInducer, needs=("language",)),
    ]
