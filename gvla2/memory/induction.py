"""Candidate lessons from an episode, by rules: its own, else those its transcript shows; and whether a model's lesson
is grounded in its episode.

A model that writes lessons has read the transcript, including tool output. What it repeats from there is trusted no
more than the tool.
"""

from __future__ import annotations

import re
from itertools import groupby

from gvla2.memory.contracts import Lesson, MemoryEpisode, Verdict
from gvla2.memory.records import RecordType
from gvla2.memory.text import terms

MAX_STEPS, MOST_ACTS = 8, 60
MAX_STEP = 160
MAX_CONTENT = 1200
_LONGEST = 20_000
_EXECUTED = re.compile(r"^Executed:\n((?:- .*(?:\n|\Z))+)", re.MULTILINE)
_WAYPOINT = re.compile(r"^- \d+ (.+?): ", re.MULTILINE)
_MARKED = (
    re.compile(r"<action>\s*(.*?)\s*</action>", re.DOTALL | re.IGNORECASE),
    re.compile(r"^[ \t]*```(?:bash|sh|shell|mswea_bash_command)\n(.*?)^[ \t]*```", re.DOTALL | re.MULTILINE),
    re.compile(r"^[ \t]*[$>][ \t]+(\S.*)$", re.MULTILINE),
)
_STEP = re.compile(r"^\s*(?:[-*•]|>>>|#|tool:|cmd:|command:)\s*(.+)$", re.IGNORECASE)
_STATUS = re.compile(r"\(exit status -?[1-9]\d*\)")
_FURTHER = re.compile(r"(?<=[a-z\])])[.;!?](?:\s|$)")
_TROUBLE = re.compile(
    r"error|exception|traceback|fail|abort|stopped|denied|not found|time[d]? ?out|refused|invalid|no such",
    re.IGNORECASE,
)


def acts_of(transcript: str) -> list[str]:
    """The actions marked in a transcript, one line each, at most 60; consecutive repeats count once.

    Recognized are the robot's own transcripts, actions in tags, and shell sessions (fenced blocks, `$ command`). No
    other text: a line may be tool output.
    """
    text = transcript[:_LONGEST]
    executed = _EXECUTED.search(text)
    forms = [_WAYPOINT.findall(executed[1]) if executed else [], *(form.findall(text) for form in _MARKED)]
    for form in forms:
        if steps := [line for found in form if (line := " ".join(found.split()))]:
            return [step for step, _ in groupby(steps)][:MOST_ACTS]
    return []


class RulesInducer:
    """Deterministic induction without a language model.

    An episode's own lessons are taken unchanged. Without any, a success gives its steps as a hint, and a failure as a
    constraint what the last command of a shell session that failed printed ("(exit status 1)" after its output), else
    the last line that tells of an error, else nothing. An unjudged outcome is treated as a success, which admission
    keeps provisional.
    """

    def induce(self, episode: MemoryEpisode, verdict: Verdict) -> tuple[Lesson, ...]:
        """The lessons of an episode; the same episode and verdict give the same."""
        if episode.lessons:
            return episode.lessons
        subject, steps = " ".join(episode.task.query.split())[:200], _steps(episode.transcript)
        if not subject:
            return ()
        if verdict.outcome == "verified_fail":
            # Where nothing says why, nothing is learned: a lesson that quotes any other act has a model repeat it.
            if refused := _refused(episode.transcript):
                act, answer = refused
                return _bounded("failure_avoidance", f"{subject}: failed; {act} printed: {answer}")
            trouble = [line.strip() for line in episode.transcript.splitlines() if _TROUBLE.search(line)]
            why = f"{subject}: failed because of: {_cut(trouble[-1])}" if trouble else ""
            return _bounded("failure_avoidance", why)
        how = f"{subject}: these steps led to the end: {'; '.join(steps)}" if steps else ""
        return _bounded("procedural_hint", how)


def _cut(line: str) -> str:
    """What went wrong, not a tool's advice about it: the first sentence."""
    return _FURTHER.split(line, maxsplit=1)[0][:MAX_STEP]


def _refused(transcript: str) -> tuple[str, str] | None:
    """The last command of a shell session that failed by its status, and the first sentence that it printed."""
    act = answer = ""
    last = None
    for line in transcript[:_LONGEST].splitlines():
        if command := _MARKED[-1].match(line):
            act, answer = command[1], ""
        elif _STATUS.fullmatch(line) and act:
            last = act[:MAX_STEP], answer or "nothing"
        elif not answer:
            answer = _cut(line.strip())
    return last


def _steps(transcript: str) -> list[str]:
    """The acts, each once, the last ones if there are too many: marked ones, else lines that look like acts."""
    found = acts_of(transcript) or [
        match[1].strip() for line in transcript.splitlines() if (match := _STEP.match(line))
    ]
    return list(dict.fromkeys(step[:MAX_STEP] for step in found))[-MAX_STEPS:]


def _bounded(kind: RecordType, content: str) -> tuple[Lesson, ...]:
    """One lesson, or none if there is nothing to say."""
    cut = content if len(content) <= MAX_CONTENT else content[: MAX_CONTENT - 1] + "…"
    return (Lesson(kind, cut),) if content else ()


_WORD = re.compile(r"\w+")
SHORTEST = 8
"""Least characters of a passage of evidence."""
ABOUT = 1 / 3
"""Least share of a lesson's words that are the task's or the agent's own."""


def ungrounded(lesson: Lesson, episode: MemoryEpisode) -> str:
    """Why a model's lesson is not grounded in its episode, "" if it is.

    Its evidence must occur verbatim in the transcript; a third of its words must be about what the task names, what can
    be handled, or what the agent did; and no more of them may occur only in output returned to the agent.
    """
    transcript = _flat(episode.transcript)
    passages = [_flat(passage) for passage in lesson.evidence]
    if not any(len(passage) >= SHORTEST for passage in passages):
        return "it names no evidence in the episode"
    if any(passage not in transcript for passage in passages):
        return "its evidence does not occur in the episode"
    own = terms(" ".join([episode.task.query, *episode.task.objects, *acts_of(episode.transcript)]))
    used = terms(lesson.content)
    if len(used & (terms(episode.transcript) - own)) > len(used & own):
        return "it repeats what a tool returned"
    if len(used & own) < ABOUT * len(used) or not used:
        return "it is not about what the task names or the agent did"
    return ""


def _flat(text: str) -> str:
    return " ".join(_WORD.findall(text.casefold()))
