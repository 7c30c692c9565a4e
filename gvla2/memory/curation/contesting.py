"""Whether two lessons contradict each other, or are one.

Typed effects decide exactly. Texts give a suspicion: both stay, linked by "suspicion" and ranked lower, until a judge
has decided (:mod:`gvla2.memory.curation.judging`). Nothing is archived for a suspicion.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import lru_cache

from gvla2.memory.indexing.terms import stem
from gvla2.memory.meaning.effects import effects_conflict, same_parameter
from gvla2.memory.meaning.english import PREPOSITIONS, is_english, word_set
from gvla2.memory.meaning.plain_text import plain_text
from gvla2.memory.meaning.quantities import quantities
from gvla2.memory.meaning.suspicion import suspicion, threshold
from gvla2.memory.records import Record

SUSPECT: float = threshold()
"""The suspicion from which on two records are linked."""
_FAILURE = re.compile(
    r"\b(?:fail|slip|collid|crash|stuck|missed|error|broke|did not|was not|could not)|\bdropped\b"
)
_IDLE = word_set(
    """the a an its s you is are be been being has have always please just simply really ensure sure must should
    carefully properly"""
)
_ORDERING = frozenset(
    map(stem, word_set("and then before after first next later last afterwards until once"))
)
_FRONT = frozenset(map(stem, PREPOSITIONS | word_set("before after when while if")))
"""What may stand in front, up to a comma, as well as behind."""
_TOKEN = re.compile(r"\w+(?:[./:-]\w+)*")


@dataclass(frozen=True)
class Compared:
    """How two typed effects contradict each other ("" for not), and how likely two texts do: 0 to 1, None where there
    is no telling (another language than English).
    """

    effect: str = ""
    suspicion: float | None = None


def compare(first: Record, second: Record) -> Compared:
    """Compare two records; of different skills they are never compared.

    Where both have typed effects those alone decide. A constraint tells what failed, and two accounts of failures
    agree: what failed at 5 cm may fail at 30 cm as well.
    """
    if first.skill and second.skill and first.skill != second.skill:
        return Compared(suspicion=0.0)
    mine, theirs = first.effect_json(), second.effect_json()
    if mine and theirs:
        return Compared(effects_conflict(mine, theirs), 0.0)
    failed = [record.type == "failure_avoidance" for record in (first, second)]
    if all(failed) and all(_FAILURE.search(record.content.casefold()) for record in (first, second)):
        return Compared(suspicion=0.0)
    return Compared(suspicion=suspicion(first.content, second.content, first.query, second.query))


def same_lesson(first: Record, second: Record) -> bool:
    """Whether two records may be merged: of one type and skill, about one parameter, saying the same.

    They may differ in the order and the forms of their words, in units, and in words that say nothing. Where there is
    no telling they stay apart, for what is merged is lost: one word more may be another object.
    """
    if first.type != second.type or first.skill != second.skill:
        return False
    mine, theirs = first.effect_json() or {}, second.effect_json() or {}
    if bool(mine) != bool(theirs) or "program" in (mine.get("kind"), theirs.get("kind")):
        return False
    if mine and not (
        same_parameter(mine, theirs)
        and all(mine.get(name) == theirs.get(name) for name in ("kind", "op", "skill", "object", "region"))
    ):
        return False
    return first.content == second.content or same_words(first.content, second.content)


def same_words(first: str, second: str) -> bool:
    """Whether two texts say the same in the same words: their forms, units and words that say nothing aside.

    When or where it holds may stand in front or behind ("in the tunnel, slow down"); otherwise the order of the words
    is kept, for "wrap it and pack it" is not "pack it and wrap it".
    """
    one, two = _said(first), _said(second)
    if len(one) != len(two) or not one:
        return False
    if one == two:
        return True
    return any(
        turned[i:] + turned[:i] == kept
        for turned, kept in ((one, two), (two, one))
        if turned[0] in _FRONT and _ORDERING.isdisjoint(turned[1:])
        for i in range(2, len(one))
    )


@lru_cache(maxsize=16384)
def _said(text: str) -> tuple[str, ...]:
    """The telling words of a text: English ones by their stem, figures in base units."""
    plain = plain_text(text)
    parts: list[str] = []
    last = 0
    for found in quantities(plain):
        parts += _TOKEN.findall(plain[last : found.start])
        figure = found.quantity
        parts.append(f"{figure.low:.6g}~{figure.high:.6g} {figure.dimension}")
        last = found.end
    parts += _TOKEN.findall(plain[last:])
    english = is_english(text)
    return tuple(stem(part) if english else part for part in parts if part not in _IDLE)
