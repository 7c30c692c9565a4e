"""How alike two lessons are, and whether they are one: in words, and in what they are about."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from difflib import SequenceMatcher
from functools import lru_cache
from typing import Any

from gvla2.memory.quantities import Quantity
from gvla2.memory.records import Record
from gvla2.memory.scoring import signature_distance
from gvla2.memory.statements import read
from gvla2.memory.word_forms import begin_apart, split_alike
from gvla2.memory.words import topic_words

MAX_COMPARED = 1000
"""Characters of two texts that are aligned with one another."""
COMPARABLE, HELD = 0.3, 0.6
"""Shares of words from which two texts may say the same or the opposite, see :class:`Likeness`."""


@dataclass(frozen=True)
class Likeness:
    """``query`` and ``content``: Jaccard of topic words; ``held``: share of the shorter content's words that the other
    has; ``scene``: 1 for alike geometry down to 0, and 0 where there is none to compare.
    """

    query: float
    content: float
    held: float
    scene: float

    @property
    def match(self) -> float:
        """How relevant the one is for the other."""
        return max(self.query, self.content)

    @property
    def comparable(self) -> bool:
        """Whether enough words are shared for the two to say the same or the opposite."""
        return self.content >= COMPARABLE or self.held >= HELD

    def scores(self) -> dict[str, float]:
        """The numbers by name, for the event of a decision."""
        return {"query": self.query, "content": self.content, "scene": self.scene}


_NOTHING = Likeness(0.0, 0.0, 0.0, 0.0)


def likeness(first: Record, second: Record) -> Likeness:
    """Compare two records."""
    one, two = words_of(first.content), words_of(second.content)
    shared = len(one & two)
    if not shared:
        return _NOTHING
    content, held = shared / (len(one) + len(two) - shared), shared / min(len(one), len(two))
    if content < COMPARABLE and held < HELD:
        return Likeness(0.0, content, held, 0.0)  # about something else, whatever else it shares
    query = max((jaccard(a, b) for a in _lines(first.query) for b in _lines(second.query)), default=0.0)
    distance = None
    if first.signature != "{}" and second.signature != "{}":
        distance = signature_distance(first.signature_json(), second.signature_json())
    return Likeness(query, content, held, 0.0 if distance is None else max(0.0, 1.0 - distance))


def surface(first: str, second: str) -> float:
    """Share of two contents' characters that align, 1 for equal texts (case and spacing aside)."""
    one, two = " ".join(first.casefold().split()), " ".join(second.casefold().split())
    if one == two:
        return 1.0
    return SequenceMatcher(None, one[:MAX_COMPARED], two[:MAX_COMPARED], autojunk=False).ratio()


def jaccard(first: frozenset[str], second: frozenset[str]) -> float:
    """Shared among all words, 0 where there are none."""
    shared = len(first & second)
    return shared / (len(first) + len(second) - shared) if shared else 0.0


@lru_cache(maxsize=32768)
def words_of(text: str) -> frozenset[str]:
    """The topic words of a text, numbers with them."""
    return frozenset(topic_words(text))


def _lines(query: str) -> list[frozenset[str]]:
    return [words_of(line) for line in query.split("\n")[:4] if line]


def same_subject(first: Record, second: Record) -> bool:
    """Whether two records may be merged at all: of one type and skill, about the same things, acts, sides, numbers.

    They may differ in the order of words, their forms, and words that change nothing ("always", "the").
    """
    if first.type != second.type or first.skill != second.skill:
        return False
    one, two = about(first.content), about(second.content)
    if one.sides != two.sides or begin_apart(one.words, two.words) or begin_apart(two.words, one.words):
        return False
    if not _same_effect(_effect(first.effect), _effect(second.effect)):
        return False
    _, left, right = split_alike(one.words, two.words)
    if left or right or not (one.words or one.sides):
        return False  # one word more may be another object, and there is no telling
    return one.forbidden == two.forbidden and _figures_agree(one.figures, two.figures)


@dataclass(frozen=True)
class About:
    """What a text is about, its clauses taken together."""

    words: frozenset[str]
    sides: frozenset[tuple[str, frozenset[int]]]
    figures: tuple[Quantity, ...]
    forbidden: int


@lru_cache(maxsize=32768)
def about(text: str) -> About:
    """The subject of a text."""
    clauses = read(text).clauses
    return About(
        frozenset(word for clause in clauses for word in clause.matter) | _leftovers(text),
        frozenset(side for clause in clauses for side in clause.sides.items()),
        tuple(figure for clause in clauses for figure in clause.figures),
        sum(clause.forbidden for clause in clauses),
    )


def _leftovers(text: str) -> frozenset[str]:
    """Bare numbers and letters, which tell "way 1" from "way 2" and "lamp A" from "lamp B"."""
    return frozenset(f"nr{word}" for word in text.casefold().replace(".", " ").split() if len(word) == 1)


def _figures_agree(first: tuple[Quantity, ...], second: tuple[Quantity, ...]) -> bool:
    if len(first) != len(second):
        return False
    return all(
        a.dimension == b.dimension and a.one_sided == b.one_sided and not a.disagrees(b, 0.0)
        for a, b in zip(first, second, strict=True)
    )


def _effect(text: str) -> Mapping[str, Any]:
    try:
        effect = json.loads(text) if text else {}
    except ValueError:
        return {}
    return effect if isinstance(effect, dict) else {}


def _same_effect(first: Mapping[str, Any], second: Mapping[str, Any]) -> bool:
    if bool(first) != bool(second):
        return False
    return all(
        first.get(name) == second.get(name)
        for name in ("kind", "parameter", "op", "skill", "object", "region")
    )
