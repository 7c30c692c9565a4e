"""One statement of an English text: what it is about, which way, how much, and whether it forbids."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property

from gvla2.memory.indexing.terms import STOP_WORDS, stem
from gvla2.memory.meaning.english import (
    CONDITIONS,
    DETERMINERS,
    ENDING,
    NEEDLESS,
    NEGATORS,
    PLACES,
    PREPOSITIONS,
    SOFT,
    WORD,
)
from gvla2.memory.meaning.opposites import PHRASES, SIDES
from gvla2.memory.meaning.quantities import Quantity, quantities

Words = frozenset[str]
Order = tuple[Words, Words]
Side = tuple[str, int]
Sides = tuple[Side, ...]
"""Axes and signs in reading order."""

_AHEAD = re.compile(r"\b(?:before|prior to|ahead of|until|till)\b")
_BEHIND = re.compile(r"\b(?:after|once|as soon as|following)\b")
_EVERY = re.compile(r"\b(?:every|each|per)\s*$")
_LEAVING = re.compile(r"\b(?:rather than|instead of|in place of|not|never|don't|do|avoid)\b")
_COMMA = "xcommax"
_PARTICLES = ("on", "off", "out", "alone")


@dataclass(frozen=True)
class Clause:
    """``words`` are stems of what it is about, ``names`` those of single things ("nr12"), ``sides`` its opposing words
    by axis, ``named`` those that tell which thing is meant ("the left drawer").

    ``when`` are the words of what comes before or after it (sides as "axis+"), ``things`` those behind an article or a
    preposition, ``roles`` the prepositions they stand behind, ``lacks`` what it does without. ``forbidden``: the text
    says not to; ``open``: it need not be.
    """

    words: Words
    names: Words
    sides: Sides
    named: Sides
    figures: tuple[Quantity, ...]
    when: Words
    things: Words = frozenset()
    roles: tuple[tuple[str, str], ...] = ()
    lacks: Words = frozenset()
    forbidden: bool = False
    open: bool = False

    @cached_property
    def everything(self) -> Words:
        """Words and sides together."""
        return self.words | {side_word(axis, sign) for axis, sign in self.sides + self.named}

    @cached_property
    def topics(self) -> Words:
        """What it speaks of, whichever way: words, axes, and what comes before or after it."""
        return self.words | self.when | {axis for axis, _ in self.sides + self.named}


@dataclass
class _Sorted:
    """The words of a clause, sorted as they are read."""

    words: set[str] = field(default_factory=set)
    sides: list[Side] = field(default_factory=list)
    named: list[Side] = field(default_factory=list)
    things: set[str] = field(default_factory=set)
    lacks: set[str] = field(default_factory=set)
    roles: list[tuple[str, str]] = field(default_factory=list)
    negations: int = 0


def clause_of(step: str, left: str) -> tuple[Clause, Order | None]:
    """The clause of a casefolded step, and what it says comes before what; what it leaves out (``left``) is no part of
    it.
    """
    text = _LEAVING.sub(" ", step.replace(left, " ")) if left else step
    order, main, when = _ordered(text)
    figures: list[Quantity] = []
    kept, last = [], 0
    for found in quantities(main):
        kept.append(main[last : found.start])
        every = found.quantity.dimension == "time" and _EVERY.search(kept[-1]) is not None
        figures.append(found.quantity._replace(dimension="period") if every else found.quantity)
        last = found.end
    main = " ".join([*kept, main[last:]])
    said = _sorted(main)
    open_ = NEEDLESS.search(text) is not None
    forbidden = said.negations % 2 == 1 and not open_
    if forbidden and any(figure.one_sided for figure in figures):  # "never above 5" says "at most 5"
        figures = [figure.inverted() if figure.one_sided else figure for figure in figures]
        forbidden = False
    if forbidden and _AHEAD.search(text):  # "not before it is dry" asks for it afterwards
        order, forbidden = (order[1], order[0]) if order else None, False
    if forbidden and "unless" in text:  # "not unless it is on" asks for it when it is on
        forbidden = False
    if forbidden and said.lacks:  # "don't solder without flux" asks for flux
        said.words, said.lacks, forbidden = said.words | said.lacks, set(), False
    names = frozenset(word for word in said.words if any(map(str.isdigit, word)))
    return Clause(
        words=frozenset(said.words),
        names=names,
        sides=tuple(said.sides),
        named=tuple(said.named),
        figures=tuple(figures),
        when=when,
        things=frozenset(said.things),
        roles=tuple(said.roles),
        lacks=frozenset(said.lacks | content(left)),
        forbidden=forbidden,
        open=open_,
    ), order


def content(text: str) -> Words:
    """The telling words of a text: stems, and sides as "axis+"."""
    found: set[str] = set()
    rest, last = [], 0
    for quantity in quantities(text):
        rest.append(text[last : quantity.start])
        last = quantity.end
    for word in _joined(WORD.findall(" ".join([*rest, text[last:]]))):
        if word not in NEGATORS and word not in CONDITIONS:
            _take(word, found, None)
    return frozenset(found)


def side_word(axis: str, sign: int) -> str:
    """A side as a word among others."""
    return f"{axis}{'+' if sign > 0 else '-'}"


def _sorted(main: str) -> _Sorted:
    said = _Sorted()
    lacking = noun = False
    place = ""
    words = [*_joined(WORD.findall(main.replace(",", f" {_COMMA} "))), ""]
    for before, word, behind in zip(["", *words], words, words[1:], strict=False):
        noun = word in DETERMINERS or word in PREPOSITIONS or (noun and word not in STOP_WORDS)
        if noun and word not in STOP_WORDS:
            _take(word, said.things, [])
            said.roles.append((place, word))
        place = word if word in PREPOSITIONS else place
        if word == _COMMA:
            lacking = False
        elif word == "without":
            lacking = True
        elif word in NEGATORS or (word in ENDING and behind.endswith("ing")):
            said.negations += 1
        elif lacking:
            _take(word, said.lacks, None)
        elif before in DETERMINERS and behind and behind not in STOP_WORDS | {_COMMA}:
            _take(word, said.words, said.named)
        elif before in DETERMINERS:
            _take(word, said.words, said.sides, only=PLACES)
        elif word not in CONDITIONS:
            _take(word, said.words, said.sides)
    return said


def _ordered(text: str) -> tuple[Order | None, str, Words]:
    """What a step says comes before what, its main part, and the words of the other part."""
    for pattern, ahead in ((_AHEAD, True), (_BEHIND, False)):
        found = pattern.search(text)
        if found is None:
            continue
        head, tail = text[: found.start()], text[found.end() :]
        aside, comma, rest = tail.partition(",")
        if not WORD.search(head) and not comma:
            continue
        main = head + (f" , {rest}" if rest else "") if WORD.search(head) else rest
        other, mine = content(aside), content(main)
        if quantities(aside) and (not quantities(head) or not other):
            continue  # "after 5 minutes", "they slipped until I took 8 newtons"
        if other and mine:
            return ((mine, other) if ahead else (other, mine)), main, other
    return None, text, frozenset()


def _take(word: str, words: set[str], sides: list[Side] | None, only: Words = frozenset()) -> None:
    """Sort a word in: to ``sides`` where it has some (of the axes ``only``; to ``words`` as "axis+" where ``sides`` is
    None), else to ``words`` by its stem, else nowhere.
    """
    word = word.removesuffix("'s")
    root = stem(word)
    known = [side for side in SIDES.get(root, ()) if not only or side[0] in only]
    if not known and word[:2] == "un" and len(word) > 6:
        root = "un" + stem(word[2:])
        known = [(axis, -sign) for axis, sign in SIDES.get(stem(word[2:]), ())]
    if known and sides is not None:
        sides.extend(known)
    elif known:
        words |= {side_word(axis, sign) for axis, sign in known}
    elif "-" in word:
        for part in word.split("-"):
            _take(part, words, sides, only)
    elif word not in SOFT and word not in STOP_WORDS and word != _COMMA and len(word) > 1:
        words.add(root)


def _joined(words: list[str]) -> Iterator[str]:
    """The words, those that mean something together as one; "turn the light on" is "turn on the light"."""
    i = 0
    while i < len(words):
        for rest, meant in PHRASES.get(stem(words[i]), ()):
            if tuple(words[i + 1 : i + 1 + len(rest)]) == rest:
                yield meant
                i += 1 + len(rest)
                break
            if len(rest) == 1 and rest[0] in _PARTICLES and rest[0] in words[i + 2 : i + 6]:
                yield meant
                i += 1
                break
        else:
            ends = i + 1 == len(words) or words[i + 1] == _COMMA or words[i + 1] in CONDITIONS
            yield {"on": "enabled", "off": "disabled"}.get(words[i], words[i]) if ends and i else words[i]
            i += 1
