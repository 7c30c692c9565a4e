"""How alike two lessons are, and whether they are one: in words, and in what they are about."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from difflib import SequenceMatcher
from functools import lru_cache
from typing import Any, NamedTuple

from gvla2.memory.meaning.conflicts import contradiction
from gvla2.memory.meaning.idle_words import telling
from gvla2.memory.meaning.quantities import Quantity
from gvla2.memory.meaning.statements import read
from gvla2.memory.meaning.swaps import swapped
from gvla2.memory.meaning.word_forms import Language, common, split_alike, starts_of
from gvla2.memory.meaning.words import topic_words
from gvla2.memory.records import Record, load_object
from gvla2.memory.retrieval.scoring import signature_distance

MAX_COMPARED = 1000
"""Characters of two texts that are aligned with one another."""
COMPARABLE, HELD = 0.3, 0.6
"""Shares of words from which two texts may say the same or the opposite, see :class:`Likeness`."""


class Likeness(NamedTuple):
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

    def scores(self) -> dict[str, float]:
        """The numbers by name, for the event of a decision."""
        return {"query": self.query, "content": self.content, "scene": self.scene}


_NOTHING = Likeness(0.0, 0.0, 0.0, 0.0)


def overlap(first: frozenset[str], second: frozenset[str]) -> tuple[float, float]:
    """``content`` and ``held`` of a :class:`Likeness` by the words of two contents: quick, for many."""
    shared = len(first & second)
    if not shared:
        return 0.0, 0.0
    mine, theirs = len(first), len(second)
    return shared / (mine + theirs - shared), shared / (mine if mine < theirs else theirs)


def likeness(first: Record, second: Record) -> Likeness:
    """Compare two records."""
    content, held = overlap(words_of(first.content), words_of(second.content))
    if not content:
        return _NOTHING
    if content < COMPARABLE and held < HELD:
        return Likeness(0.0, content, held, 0.0)  # about something else, whatever else it shares
    query = max([jaccard(a, b) for a in _lines(first.query) for b in _lines(second.query)], default=0.0)
    distance = None
    if first.signature != "{}" and second.signature != "{}":
        distance = signature_distance(_scene(first.signature), _scene(second.signature))
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


@lru_cache(maxsize=16384)
def words_of(text: str) -> frozenset[str]:
    """The topic words of a text, numbers with them."""
    return frozenset(topic_words(text))


@lru_cache(maxsize=8192)
def _lines(query: str) -> tuple[frozenset[str], ...]:
    return tuple(words_of(line) for line in query.split("\n")[:4] if line)


@lru_cache(maxsize=8192)
def _scene(signature: str) -> Mapping[str, float]:
    return {name: float(value) for name, value in load_object(signature).items()}


def same_subject(first: Record, second: Record) -> bool:
    """Whether two records may be merged at all: of one type and skill, about the same things, acts, sides, numbers.

    They may differ in the order of words, their forms, and idle words (:data:`~gvla2.memory.meaning.idle_words.IDLE`:
    "always", "the"); never in a name, in any other small word ("on" and "off", "and" and "or"), in what comes before
    what, or in what is put on what. Where there is no telling they stay apart, for what is merged is lost.
    """
    if first.type != second.type or first.skill != second.skill:
        return False
    one, two = about(first.content), about(second.content)
    if (
        one.item_starts != two.item_starts
        or one.telling != two.telling
        or bool(one.forbidden) != bool(two.forbidden)
    ):
        return False
    if not _same_effect(_effect(first.effect), _effect(second.effect)):
        return False
    # "Before adding oil" and "add oil after" tell of one act, be it a circumstance here and what is done there.
    if one.ordered != two.ordered or (not one.ordered and one.sides != two.sides):
        return False
    mine, theirs = (one.items, two.items) if one.ordered else (one.words, two.words)
    language = common(one.language, two.language)
    _, left, right = split_alike(mine, theirs, language)
    if left or right or not one.items:
        return False  # one word more may be another object, and there is no telling
    _, left, right = split_alike(one.forbidden, two.forbidden, language)
    if left or right:
        return False
    if not _figures_agree(one.figures, two.figures) or swapped(first.content, second.content):
        return False
    return contradiction(first.content, second.content) is None


@dataclass(frozen=True)
class About:
    """What a text is about, its clauses taken together; ``ordered`` is how many orders it gives.

    ``telling`` are the small words that are not idle.
    """

    words: frozenset[str]
    items: frozenset[str]
    item_starts: frozenset[str]
    sides: frozenset[tuple[str, frozenset[int]]]
    figures: tuple[Quantity, ...]
    forbidden: frozenset[str]
    telling: frozenset[str]
    ordered: int
    language: Language


@lru_cache(maxsize=16384)
def about(text: str) -> About:
    """The subject of a text."""
    said = read(text)
    return About(
        frozenset(word for clause in said.clauses for word in clause.matter),
        said.items,
        starts_of(said.items),
        frozenset(side for clause in said.clauses for side in clause.sides.items()),
        tuple(figure for clause in said.clauses for figure in clause.figures),
        frozenset(item for clause in said.clauses if clause.forbidden for item in clause.items),
        telling(said.soft),
        len(said.orders),
        said.language,
    )


def _figures_agree(first: tuple[Quantity, ...], second: tuple[Quantity, ...]) -> bool:
    """Whether two rows of figures are the same but for their units."""
    return len(first) == len(second) and all(
        a.dimension == b.dimension
        and math.isclose(a.low, b.low, rel_tol=1e-6)
        and math.isclose(a.high, b.high, rel_tol=1e-6)
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
    ) and (first.get("scale") or "") == (second.get("scale") or "")
