"""Text that talks to a machine rather than about a task: orders, imitated markup, requests for secrets.

A lesson speaks to whoever does the task, about the task's objects. Suspicious is what speaks of the reader's own
instructions, memory or verdicts and what to do with them, what imitates the frame around what machines read, what
sends secrets away, and what overrides the task or its safety as a whole.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

from gvla2.memory.screening.disguises import hides_text, readings, squeezed
from gvla2.memory.screening.sieve import run_together, sieves, stems_of
from gvla2.memory.screening.signs import ENOUGH, Sign
from gvla2.memory.screening.speech import spoken_weight

MAX_READ = 20_000
MAX_STRINGS = 200
MAX_DEPTH = 8

_MARKED = re.compile(r"[*~`\"_’\n]")
_MARKS = str.maketrans({"*": None, "~": None, "`": None, '"': None, "_": " ", "’": "'", "\n": " \n "})
_DENIED = re.compile(
    r"(?:\b(?:never|not|cannot|avoid|without|nor|neither|don't|doesn't|mustn't|shouldn't|can't|refuse to"
    r"|forbid(?:den)? to"
    r"|prohibited to|prevents? \w+ from|instead of|rather than|if|when|once|after|unless|until|whether|in "
    r"case)"
    r"(?: (?!then\b)\w+){0,3}|n't) ?$"
)
_CASED = re.compile(
    r"\b(?:if|when|whenever|once|after|as soon as|unless|until|in case)\b(?! you (?:have )?read| "
    r"reading)[^.;!?]*$"
)
_INSISTED = re.compile(r"\b(?:hesitate|fail|forget|neglect|afraid|stop) (?:to )?$")
_CLAUSE = re.compile(r"[.,;:!?\n][^.,;:!?\n]*$")


def reads_like_instructions(text: str) -> bool:
    """Whether a text gives orders to a machine or imitates the markup around what machines read.

    Errs on the careful side. Look-alike letters, gaps, codes and invisible characters don't hide anything: every
    reading of the text is judged, the first ``MAX_READ`` characters of it.
    """
    text = text[:MAX_READ]
    return hides_text(text) or any(map(_suspicious, readings(text)))


def effect_reads_like_instructions(effect: Mapping[str, Any] | None) -> bool:
    """Whether any name or word in a typed effect reads like instructions, by itself or all of them in a row.

    Underscores count as spaces. An effect of more than ``MAX_STRINGS`` strings, or nested deeper than ``MAX_DEPTH``,
    is no sound effect and counts as suspicious.
    """
    if not effect:
        return False
    strings: list[str] = []
    for string in _strings(effect, MAX_DEPTH):
        if string is None or len(strings) == MAX_STRINGS:
            return True
        strings.append(string)
    words = [re.sub(r"[_\-.]+", " ", string) for string in strings if string]
    return any(map(reads_like_instructions, {*strings, *words})) or reads_like_instructions(" ".join(words))


def _strings(value: Any, depth: int) -> Iterator[str | None]:
    """The strings within a value, None where it goes too deep."""
    match value:
        case str():
            yield value
        case Mapping() if depth:
            for key, inner in value.items():
                yield from _strings(key, depth - 1)
                yield from _strings(inner, depth - 1)
        case list() | tuple() if depth:
            for inner in value:
                yield from _strings(inner, depth - 1)
        case Mapping() | list() | tuple():
            yield None


def _suspicious(low: str) -> bool:
    frames, signs = sieves()
    words = " ".join((low.translate(_MARKS) if _MARKED.search(low) else low).split())
    stems = stems_of(words)
    if any(_found(sign, low) for sign in frames.passing(low, stems)):
        return True
    weight = sum(sign.weight for sign in signs.passing(words, stems) if _found(sign, words))
    if weight >= ENOUGH or weight + spoken_weight(words, stems) >= ENOUGH:
        return True
    letters = squeezed(low)
    return bool(letters) and run_together().search(letters) is not None


def _found(sign: Sign, text: str) -> bool:
    for match in sign.regex.finditer(text):
        at = match.start()
        if not (
            (sign.denied and denied(text, at)) or (sign.cased and _CASED.search(text[max(0, at - 120) : at]))
        ):
            return True
    return False


def denied(text: str, at: int) -> bool:
    """Whether what begins at ``at`` is denied, or only a case, by the words before it in its clause."""
    before = text[max(0, at - 40) : at]
    if clause := _CLAUSE.search(before):
        before = clause[0][1:]
    return _DENIED.search(before) is not None and _INSISTED.search(before) is None
