"""Candidate lessons from an episode, by rules: what it brought itself, else what its transcript shows; and whether what
a model wrote about an episode rests on it.

A model that writes lessons has read the transcript, and with it whatever a tool returned. What it passes on from there
is trusted no more than the tool.
"""

from __future__ import annotations

import re

from gvla2.memory.contracts import Lesson, MemoryEpisode, RecordType, Verdict
from gvla2.memory.curation.transcripts import acts_of
from gvla2.memory.indexing.terms import terms

MAX_STEPS = 8
MAX_STEP = 160
MAX_CONTENT = 1200
_STEP = re.compile(
    r"^\s*(?:[-*•]|\d+[.)]|\$|>>>|#|step\s+\d+[:.]|schritt\s+\d+[:.]|action:|aktion:|tool:|cmd:|command:)\s*(.+)$",
    re.IGNORECASE,
)
_FURTHER = re.compile(r"(?<=[a-z\])])[.;!?](?:\s|$)")
_TROUBLE = re.compile(
    r"error|exception|traceback|fail|abort|stopped|denied|not found|time[d]? ?out|refused|invalid|no such"
    r"|fehler|gescheitert|abgebrochen|erreur|échou|fallo|错误|失败",
    re.IGNORECASE,
)


class RulesInducer:
    """Deterministic induction without a language model.

    An episode's own lessons are taken as they are. Of one without any, a success gives its steps as a hint, and a
    failure the last thing that went wrong as a constraint; an outcome that nobody could judge gives nothing certain,
    and the same as a success, which admission keeps provisional.
    """

    def induce(self, episode: MemoryEpisode, verdict: Verdict) -> tuple[Lesson, ...]:
        """The lessons of an episode; the same episode and verdict give the same."""
        if episode.lessons:
            return episode.lessons
        lines = [line for line in episode.transcript.splitlines() if line.strip()]
        subject = " ".join(episode.task.query.split())[:200]
        if not lines or not subject:
            return ()
        if verdict.outcome == "verified_fail":
            return self._from_failure(subject, episode.transcript)
        steps = _steps(episode.transcript)
        if not steps:
            return ()
        content = f"{subject}: these steps led to the end: " + "; ".join(steps)
        return (_bounded("procedural_hint", content),)

    @staticmethod
    def _from_failure(subject: str, transcript: str) -> tuple[Lesson, ...]:
        trouble = [line.strip() for line in transcript.splitlines() if _TROUBLE.search(line)]
        last = _steps(transcript)[-1:]
        if trouble:
            # What went wrong, and not what a tool says one should do about it.
            told = _FURTHER.split(trouble[-1], maxsplit=1)[0][:MAX_STEP]
            return (_bounded("failure_avoidance", f"{subject}: failed because of: {told}"),)
        if last:
            return (_bounded("failure_avoidance", f"{subject}: failed although it ended with: {last[0]}"),)
        return ()


def _steps(transcript: str) -> list[str]:
    """The acts, without repeats, the last ones where there are too many: those marked as such, else what looks like it.

    Where acts are marked, a line that begins like one may be what a tool said.
    """
    found = acts_of(transcript) or [
        match[1].strip() for line in transcript.splitlines() if (match := _STEP.match(line))
    ]
    return list(dict.fromkeys(step[:MAX_STEP] for step in found))[-MAX_STEPS:]


def _bounded(kind: RecordType, content: str) -> Lesson:
    return Lesson(kind, content if len(content) <= MAX_CONTENT else content[: MAX_CONTENT - 1] + "…")


_WORD = re.compile(r"\w+")
SHORTEST = 8
"""Characters that a passage of evidence has at least."""
ABOUT = 1 / 3
"""Share of a lesson's words, at least, that are the task's and the agent's own."""


def ungrounded(lesson: Lesson, episode: MemoryEpisode) -> str:
    """Why a lesson that a model wrote does not rest on its episode, "" where it does.

    Its evidence stands in the transcript word for word; a third of its words are about what the task names, what can be
    handled, or what the agent did; and no more of them stand only in what was returned to the agent.
    """
    transcript = _flat(episode.transcript)
    passages = [_flat(passage) for passage in lesson.evidence]
    if not any(len(passage) >= SHORTEST for passage in passages):
        return "it names no evidence in the episode"
    if any(passage not in transcript for passage in passages):
        return "its evidence does not stand in the episode"
    acts = acts_of(episode.transcript)
    own = terms(" ".join([episode.task.query, *episode.task.things, *acts]))
    said = terms(lesson.content)
    if len(said & (terms(episode.transcript) - own)) > len(said & own):
        return "it passes on what a tool returned"
    if len(said & own) < ABOUT * len(said) or not said:
        return "it is not about what the task names or the agent did"
    return ""


def _flat(text: str) -> str:
    return " ".join(_WORD.findall(text.casefold()))
