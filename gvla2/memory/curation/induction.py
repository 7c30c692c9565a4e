"""Candidate lessons from an episode, by rules: what it brought itself, else what its transcript shows."""

from __future__ import annotations

import re

from gvla2.memory.contracts import Lesson, MemoryEpisode, RecordType, Verdict

MAX_STEPS = 8
MAX_STEP = 160
MAX_CONTENT = 1200
_STEP = re.compile(
    r"^\s*(?:[-*•]|\d+[.)]|\$|>>>|#|step\s+\d+[:.]|schritt\s+\d+[:.]|action:|aktion:|tool:|cmd:|command:)\s*(.+)$",
    re.IGNORECASE,
)
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
            return self._from_failure(subject, lines)
        steps = _steps(lines)
        if not steps:
            return ()
        content = f"{subject}: these steps led to the end: " + "; ".join(steps)
        return (_bounded("procedural_hint", content),)

    @staticmethod
    def _from_failure(subject: str, lines: list[str]) -> tuple[Lesson, ...]:
        trouble = [line.strip()[:MAX_STEP] for line in lines if _TROUBLE.search(line)]
        last = _steps(lines)[-1:]
        if trouble:
            return (_bounded("failure_avoidance", f"{subject}: failed because of: {trouble[-1]}"),)
        if last:
            return (_bounded("failure_avoidance", f"{subject}: failed although it ended with: {last[0]}"),)
        return ()


def _steps(lines: list[str]) -> list[str]:
    """The lines that look like acts, without repeats, the last ones where there are too many."""
    found = [match[1].strip()[:MAX_STEP] for line in lines if (match := _STEP.match(line))]
    return list(dict.fromkeys(found))[-MAX_STEPS:]


def _bounded(kind: RecordType, content: str) -> Lesson:
    return Lesson(kind, content if len(content) <= MAX_CONTENT else content[: MAX_CONTENT - 1] + "…")
