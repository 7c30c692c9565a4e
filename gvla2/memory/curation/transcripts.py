"""The steps of an episode, read from its transcript: actions without what was seen between them.

Understood are the robot's own transcripts, shell sessions (`$ command`, fenced blocks), actions in tags or after
"action:", and numbered or "Step n:" lists. In any other text each line is a step.
"""

from __future__ import annotations

import re
from collections.abc import Callable

MOST_STEPS = 60
_LONGEST = 20_000

_EXECUTED = re.compile(r"^Executed:\n((?:- .*(?:\n|\Z))+)", re.MULTILINE)
_WAYPOINT = re.compile(r"^- \d+ (.+?): ", re.MULTILINE)
_TAGGED = re.compile(r"<action>\s*(.*?)\s*</action>", re.DOTALL | re.IGNORECASE)
_FENCED = re.compile(
    r"^[ \t]*```(?:bash|sh|shell|mswea_bash_command)\n(.*?)^[ \t]*```", re.DOTALL | re.MULTILINE
)
_PROMPT = re.compile(r"^[ \t]*[$>][ \t]+(\S.*)$", re.MULTILINE)
_NAMED = re.compile(r"^[ \t]*action[ \t]*(?:\d+[ \t]*)?:[ \t]*(\S.*)$", re.MULTILINE | re.IGNORECASE)
_NUMBERED = re.compile(r"^[ \t]*(?:step[ \t]+)?\d+[.):][ \t]+(\S.*)$", re.MULTILINE | re.IGNORECASE)

_PROGRAM = re.compile(r"\s*[./~]*[A-Za-z_][\w./+-]*(?=\s|$)")
_VALUES = (
    (re.compile(r"https?://\S+"), "{url}"),
    (re.compile(r"\"[^\"\n]*\"|'[^'\n]*'|“[^”\n]*”|«[^»\n]*»|「[^」\n]*」"), "{text}"),
    (re.compile(r"(?<!\w)(?:~|\.{1,2})?/?(?:[\w.@+-]+/)+[\w.@+*-]*"), "{path}"),
    (re.compile(r"\b[0-9a-f]{7,40}\b(?<!\b[a-f]{7})"), "{id}"),
    (re.compile(r"(?<![\w{])[-+]?\d+(?:[.,]\d+)*"), "{number}"),
)
"""What a step says of one occasion alone, and the slots that take its place."""


def steps_of(transcript: str) -> list[str]:
    """The actions in their order, one line each, at most 60; repeats in a row count once."""
    return acts_of(transcript) or _steps(transcript, (str.splitlines,))


def acts_of(transcript: str) -> list[str]:
    """The same where the transcript marks actions as such, none of any other text: a line may be what a tool said."""
    return _steps(
        transcript,
        (
            _waypoints,
            _TAGGED.findall,
            _FENCED.findall,
            _PROMPT.findall,
            _NAMED.findall,
            _NUMBERED.findall,
        ),
    )


def _steps(transcript: str, forms: tuple[Callable[[str], list[str]], ...]) -> list[str]:
    text = transcript[:_LONGEST]
    for form in forms:
        steps = [line for found in form(text) if (line := " ".join(found.split()))]
        if steps:
            distinct = [s for i, s in enumerate(steps) if i == 0 or s != steps[i - 1]]
            return distinct[:MOST_STEPS]
    return []


def abstracted(step: str) -> str:
    """The step without the values of its occasion: ``open "a.txt" 3`` is ``open {text} {number}``."""
    program = _PROGRAM.match(step)  # what a command runs is the step itself, not a value of it
    head, rest = (step[: program.end()], step[program.end() :]) if program else ("", step)
    for pattern, slot in _VALUES:
        rest = pattern.sub(slot, rest)
    return " ".join((head + rest).split())


def ending_of(transcript: str) -> str:
    """The last line that says anything: how the episode ended, in its own words."""
    return next((line.strip() for line in reversed(transcript.splitlines()) if line.strip()), "")


def _waypoints(text: str) -> list[str]:
    executed = _EXECUTED.search(text)
    return _WAYPOINT.findall(executed[1]) if executed else []
