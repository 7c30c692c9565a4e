"""The steps of an episode without its specific values, for these methods."""

from __future__ import annotations

import re

from gvla2.memory.induction import MOST_ACTS, acts_of

_PROGRAM = re.compile(r"\s*[./~]*[A-Za-z_][\w./+-]*(?=\s|$)")
_VALUES = (
    (re.compile(r"https?://\S+"), "{url}"),
    (re.compile(r"\"[^\"\n]*\"|'[^'\n]*'|“[^”\n]*”|«[^»\n]*»|「[^」\n]*」"), "{text}"),
    (re.compile(r"(?<!\w)(?:~|\.{1,2})?/?(?:[\w.@+-]+/)+[\w.@+*-]*"), "{path}"),
    (re.compile(r"\b[0-9a-f]{7,40}\b(?<!\b[a-f]{7})"), "{id}"),
    (re.compile(r"(?<![\w{])[-+]?\d+(?:[.,]\d+)*"), "{number}"),
)
"""Episode-specific parts of a step, and the slots that replace them."""


def steps_of(transcript: str) -> list[str]:
    """The actions in order, at most 60; if none are marked, each line is one."""
    if acts := acts_of(transcript):
        return acts
    lines = [step for line in transcript.splitlines() if (step := " ".join(line.split()))]
    return [line for i, line in enumerate(lines) if i == 0 or line != lines[i - 1]][:MOST_ACTS]


def abstracted(step: str) -> str:
    """The step without its specific values: ``open "a.txt" 3`` is ``open {text} {number}``."""
    program = _PROGRAM.match(step)  # a command's program is the step itself, not a value
    head, rest = (step[: program.end()], step[program.end() :]) if program else ("", step)
    for pattern, slot in _VALUES:
        rest = pattern.sub(slot, rest)
    return " ".join((head + rest).split())


def ending_of(transcript: str) -> str:
    """The last non-empty line: how the episode ended, in its own words."""
    return next((line.strip() for line in reversed(transcript.splitlines()) if line.strip()), "")
