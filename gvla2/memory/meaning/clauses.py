"""One clause of a lesson: who does what, how much, which way, or not at all, and what comes before or after it."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

from gvla2.memory.meaning.concepts import WORD, concept_of, stem_of, words_in
from gvla2.memory.meaning.function_words import FUNCTION_WORDS
from gvla2.memory.meaning.lexicon import (
    AFTER,
    BEFORE,
    CONDITIONS,
    DETERMINERS,
    IDENTIFIERS,
    NEGATORS,
    POLES,
    STAYING,
    TURNING,
)
from gvla2.memory.meaning.phrases import join_phrases
from gvla2.memory.meaning.quantities import Quantity, quantities
from gvla2.memory.meaning.word_forms import Language, starts_of
from gvla2.memory.meaning.word_roles import (
    ends_a_time,
    is_noun,
    is_ordinal,
    is_particle,
    is_soft,
    is_state,
    is_temporal,
    names_a_thing,
    until_an_act,
)
from gvla2.memory.meaning.word_sets import word_set

_INSTEAD = (
    r"\b(?:instead of|rather than|anstatt|statt|au lieu d|plutôt qu|en (?:lugar|vez) de|em vez de|invece di|anziché"
    r"|zamiast|вместо|in plaats van)|而不是"
)
INSTEAD = re.compile(_INSTEAD)
BEFORE_INSTEAD = re.compile(rf"(?={_INSTEAD})")
REPLACING = word_set(
    "instead rather statt anstatt lieu plutôt lugar vez invece anziché zamiast вместо plaats"
)
"""What any text has that says what is replaced."""
ORDERED = "#order"
_FAR_BOUND = re.compile(r"(?P<low>至少|最少|不少于|不低于)|至多|最多|不超过|不高于")
_UNTIL = frozenset(("until", "till", "bis", "hasta", "jusqu"))
_UNLESS = frozenset(("unless", "außer", "sauf", "salvo", "除非"))
_BEHIND = frozenset(("之前", "以前", "之后", "以后", "前", "后"))
"""Chinese puts these behind what comes before or after."""
_STAYING = STAYING | word_set("take takes taken put puts")
_JOINTS = NEGATORS | _BEHIND | BEFORE | AFTER | _UNTIL | CONDITIONS | _UNLESS | {","}
_APART = {"ein": 1, "an": 1, "aus": -1, "ab": -1}
"""What German puts at the end for switching on and off."""
_STATES = {"on": "enabled", "off": "disabled"}
_ONLY = word_set("only erst seulement solo sólo")
"""Before "after" these change nothing: "only after it is dry"."""
_PREFIXES = ("un", "non", "mis", "dis", "de", "dé", "in", "im", "il", "ir", "ent", "不", "未", "非", "无")
_WHERE = word_set(
    "in into on onto at to from ins im in auf am an zum zur dans sur en à aux del al sobre 在 到"
)
_PRONOUNS = word_set("it them they es ihn ihm sie le la lo les los las l ça eso esto ello 它 它们 他")
_OWNERS = DETERMINERS | word_set("its their his her your our my")

MANNERS = word_set("speed force tilt timing sequence lateness locality")
"""Axes of how something is done."""

Order = tuple[frozenset[str], frozenset[str]]
"""What comes before, and what after."""


@dataclass
class Clause:
    """One act: its ``words`` (concepts), ``context`` (circumstances), ``poles`` (axis -> sides), ``figures``.

    ``forbidden`` when the text says not to; ``open`` when it need not be done, or when it only tells why; ``bounded``
    when a prohibition left a bound ("never above 5"); ``pronoun`` when it speaks of what is named elsewhere ("lift it",
    "..., not with pip"). ``phase`` are the acts that tell when this one is done.
    ``places`` are the sides that tell where something is or goes ("into the left tray"), a part of the context.
    ``soft`` are the words that say nothing about who does what: articles, prepositions, conditions.
    """

    words: set[str] = field(default_factory=set)
    context: set[str] = field(default_factory=set)
    poles: dict[str, list[int]] = field(default_factory=dict)
    figures: list[Quantity] = field(default_factory=list)
    labels: set[str] = field(default_factory=set)
    forbidden: bool = False
    open: bool = False
    bounded: bool = False
    pronoun: bool = False
    language: Language = ""
    phase: frozenset[str] = frozenset()
    places: set[str] = field(default_factory=set)
    soft: set[str] = field(default_factory=set)

    @cached_property
    def matter(self) -> frozenset[str]:
        """Words and circumstances together; to be asked for when the clause is complete."""
        return frozenset(self.words | self.context)

    @cached_property
    def starts(self) -> frozenset[str]:
        """How the words of the complete clause begin, see :func:`gvla2.memory.meaning.word_forms.starts_of`."""
        return starts_of(self.matter)

    @cached_property
    def prefixed(self) -> bool:
        """Whether some word of the complete clause may be the reverse of another, as "unsealed" is."""
        return any(word.startswith(_PREFIXES) for word in self.matter)

    @cached_property
    def sides(self) -> dict[str, frozenset[int]]:
        """The clause's sides by axis, without the order of its parts; when the clause is complete."""
        return {axis: frozenset(signs) for axis, signs in self.poles.items() if axis != ORDERED}

    @cached_property
    def acts(self) -> tuple[tuple[str, frozenset[str]], ...]:
        """What the clause does or measures, as axes and concepts; how it is done is left out ("gently", "upright")."""
        return tuple(
            (axis, frozenset([named(axis, sign) for sign in signs]))
            for axis, signs in self.sides.items()
            if axis not in MANNERS
        )

    def does_more(self, other: Clause, undone: str = "") -> bool:
        """Whether the clause does something that the other neither does, nor undoes (on the axis ``undone``, by another
        word), nor names.
        """
        return any(
            axis not in other.sides and axis != undone and not names <= other.context
            for axis, names in self.acts
        )

    @cached_property
    def items(self) -> frozenset[str]:
        """Words, circumstances and sides as one set."""
        return self.matter.union([named(axis, sign) for axis, signs in self.sides.items() for sign in signs])


def named(axis: str, sign: int) -> str:
    """The concept of a side of an axis."""
    return f"{axis}{'+' if sign > 0 else '-'}"


class _Sorted(NamedTuple):
    main: set[str]
    relation: str
    side: set[str]


def clause_of(text: str, language: Language, replaces: bool = True) -> tuple[Clause, Order | None]:
    """The clause that a casefolded text makes, and which of its parts comes before which.

    ``replaces`` says whether the text may tell what is replaced ("instead of").
    """
    clause = Clause(forbidden=replaces and INSTEAD.search(text) is not None, language=language)
    words = join_phrases(words_in(_without_figures(text, clause)))
    if clause.forbidden:
        words = [word for word in words if word not in REPLACING]
    main, relation, rest = _sort(words, clause)
    order = None
    if relation:
        ahead, behind = frozenset(main), frozenset(rest)
        order = (ahead, behind) if relation == "before" else (behind, ahead)
        clause.poles.setdefault(ORDERED, []).append(1 if relation == "before" else -1)
        clause.phase = frozenset(rest)
    if clause.forbidden and any(figure.one_sided for figure in clause.figures):
        # "never above 5" says "at most 5".
        clause.figures = [figure.inverted() if figure.one_sided else figure for figure in clause.figures]
        clause.forbidden, clause.bounded = False, True
    return clause, order


def _without_figures(text: str, clause: Clause) -> str:
    """The text with quantities taken out; a number that names a thing stays a word."""
    kept, last = [], 0
    for found in quantities(text):
        before = WORD.findall(text[last : found.start])
        if before and before[-1] in IDENTIFIERS and not found.quantity.dimension:
            kept.append(f"{text[last : found.start]} nr{found.quantity.low:g}x ")
        else:
            kept.append(f"{text[last : found.start]} ")
            clause.figures.append(found.quantity)
            clause.labels |= set(before[-1:])
        last = found.end
    rest = "".join(kept) + text[last:]
    if len(clause.figures) == 1 and not clause.figures[0].one_sided and (bound := _FAR_BOUND.search(rest)):
        # Chinese puts the verb between "at least" and the number.
        exact = clause.figures[0]
        low, high = (exact.low, math.inf) if bound["low"] else (-math.inf, exact.high)
        clause.figures = [exact._replace(low=low, high=high)]
        rest = _FAR_BOUND.sub(" ", rest)
    return rest


def _sort(words: Sequence[str], clause: Clause) -> _Sorted:
    """Fill the clause; returns its main items and, after "before" or "after", the relation and its items."""
    main: set[str] = set()
    side: set[str] = set()
    relation = ""
    within = in_condition = unless = noun_only = False
    for index, word in enumerate(words):
        if word in _STATES and is_state(words, index):
            word = _STATES[word]
        if word in _JOINTS:
            if word == ",":
                if not main:  # what came first were the circumstances
                    within = in_condition = False
                continue
            if word in NEGATORS:
                if noun_only and side:
                    within = False  # "vor dem Update nicht löschen"
                clause.forbidden |= not in_condition and not within
                continue
            if word in _BEHIND and ends_a_time(words, index) and not relation:
                # All that came up to now were the circumstances.
                side, main = main, set()
                clause.context |= clause.words
                clause.context |= {
                    named(axis, sign) for axis, signs in clause.poles.items() for sign in signs
                }
                clause.words, clause.poles = set(), {}
                relation = "before" if "前" in word else "after"
                continue
            if word in BEFORE or word in AFTER:
                if index + 1 < len(words) and not relation and is_temporal(word, words, index):
                    relation, within = "before" if word in BEFORE else "after", True
                    noun_only = word in ("vor", "nach")
                else:
                    clause.soft.add(word)
                continue
            if word in _UNTIL and not relation and clause.forbidden and until_an_act(words, index):
                relation, within = "before", True
                continue
            if word in CONDITIONS or word in _UNLESS:
                in_condition = True
                clause.soft.add(word)
                unless |= word in _UNLESS
                continue
        if noun_only and within and side and word in DETERMINERS:
            within = False  # "vor dem Start den Tank leeren"
        concept = concept_of(word)
        if word == "lower" and index and words[index - 1] in _OWNERS:
            concept = "height-"
        if concept in POLES and not is_noun(word, words, index, clause.language):
            if is_particle(word, words, index):
                clause.soft.add(word)
                continue
            if within and side and noun_only:
                within = False  # German puts what is done behind "vor der Messung"
            if in_condition or within or names_a_thing(word, words, index):
                clause.context.add(concept)
                if (
                    not in_condition
                    and not within
                    and not _WHERE.isdisjoint(words[max(0, index - 3) : index])
                ):
                    clause.places.add(concept)
            else:
                name, sign = POLES[concept]
                clause.poles.setdefault(name, []).append(sign)
        elif is_soft(word, clause.language) and not is_ordinal(word, words, index):
            clause.pronoun |= word in _PRONOUNS
            if not (word in _ONLY and index + 1 < len(words) and words[index + 1] in AFTER):
                clause.soft.add(word)
            continue
        else:
            concept = concept if concept not in POLES else stem_of(word)
            (clause.context if in_condition or within else clause.words).add(concept)
        if within:
            side.add(concept)
        elif not in_condition:
            main.add(concept)
    _switches(words, clause)
    if clause.forbidden and (unless or (relation == "before" and side)):
        # "never before it touches" says "after it touches", "not unless it is on" says "when it is on".
        clause.forbidden = False
        relation = "after" if relation else ""
    return _Sorted(main, relation if side else "", side)


def _switches(words: Sequence[str], clause: Clause) -> None:
    """Sides of "on" and "off", which are prepositions everywhere but after a switching verb."""
    joined = set(words)
    if not joined.isdisjoint(TURNING):
        for word, sign in (("on", 1), ("off", -1)):
            if word in joined:
                clause.poles.setdefault("power", []).append(sign)
                clause.words.discard("turn")
    elif not joined.isdisjoint(_STAYING):
        for index, word in enumerate(words):
            ends = index + 1 == len(words) or (
                words[index + 1] in FUNCTION_WORDS and words[index + 1] not in DETERMINERS
            )
            if word in ("on", "off") and (ends or words[index + 1] in CONDITIONS):
                clause.poles.setdefault("power", []).append(1 if word == "on" else -1)
    elif words and words[-1] in _APART and any(word.startswith("schalt") for word in words):
        clause.poles.setdefault("power", []).append(_APART[words[-1]])
