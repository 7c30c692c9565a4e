"""Candidate lessons from an episode, by rules: what it brought itself, else what its transcript shows."""

from __future__ import annotations

import re

from gvla2.memory.contracts import Lesson, MemoryEpisode, RecordType, Verdict
from gvla2.memory.curation.transcripts import acts_of

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
