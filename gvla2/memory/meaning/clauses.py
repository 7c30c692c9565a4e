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
    BEFORE_VERBS,
    CONCEPTS,
    CONDITIONS,
    DETERMINERS,
    FIRST,
    IDENTIFIERS,
    NEGATORS,
    NOUNS,
    PARTICLE_VERBS,
    PLACES,
    POLES,
    SOFT,
    STAYING,
    TURNING,
)
from gvla2.memory.meaning.phrases import join_phrases
from gvla2.memory.meaning.quantities import Quantity, quantities
from gvla2.memory.meaning.word_forms import Language, starts_of
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
_STATE_ENDS = CONDITIONS | BEFORE | AFTER | {",", "and", "or", "then"}
_ONLY = word_set("only erst seulement solo sólo")
"""Before "after" these change nothing: "only after it is dry"."""
_BEING = word_set("is are was were be been being")
_PREFIXES = ("un", "non", "mis", "dis", "de", "dé", "in", "im", "il", "ir", "ent", "不", "未", "非", "无")
_WHERE = word_set(
    "in into on onto at to from ins im in auf am an zum zur dans sur en à aux del al sobre 在 到"
)
_PRONOUNS = word_set("it them they es ihn ihm sie le la lo les los las l ça eso esto ello 它 它们 他")
_OWNERS = DETERMINERS | word_set("its their his her your our my")
_INDEFINITE = word_set("a an ein eine einen un una une")
_USING = word_set(
    "use take choose pick select with verwende nimm benutze mit utiliser utilise utilisez avec usa usar con"
)
_SOFT = SOFT | FUNCTION_WORDS | FIRST | {"erst", "only", "seulement", "solo", "sólo", "once", "才", "先"}

MANNERS = word_set("speed force tilt timing sequence lateness locality")
"""Axes of how something is done."""
_ENGLISH = word_set("pour bin die van ton hat son pan fin par met dan mine sin con net mit dal col")
"""English words that say nothing in some other language."""

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
        if word in _STATES and _is_state(words, index):
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
            if word in _BEHIND and _ends_a_time(words, index) and not relation:
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
                if index + 1 < len(words) and not relation and _temporal(word, words, index):
                    relation, within = "before" if word in BEFORE else "after", True
                    noun_only = word in ("vor", "nach")
                else:
                    clause.soft.add(word)
                continue
            if word in _UNTIL and not relation and clause.forbidden and _until(words, index):
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
        if concept in POLES and not _is_noun(word, words, index, clause.language):
            if _particle(word, words, index):
                clause.soft.add(word)
                continue
            if within and side and noun_only:
                within = False  # German puts what is done behind "vor der Messung"
            if in_condition or within or _names_a_thing(word, words, index):
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
        elif is_soft(word, clause.language) and not _is_ordinal(word, words, index):
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


def _ends_a_time(words: Sequence[str], index: int) -> bool:
    """Whether a Chinese "before" or "after" closes what comes before or after: an act follows."""
    if not 0 < index < len(words) - 1:
        return False
    if len(words[index]) > 1:
        return True
    return words[index - 1] not in ("向", "往", "从", "朝", ",") and words[index + 1] not in (
        "边",
        "面",
        "侧",
    )


def _until(words: Sequence[str], index: int) -> bool:
    following = words[index + 1] if index + 1 < len(words) else ""
    if words[index] == "hasta":
        return following == "que"
    return bool(following) and following not in ("zu", "zum", "zur")


def is_soft(word: str, language: Language = "") -> bool:
    """Whether a word says nothing about who does what."""
    if language in ("en", "") and word in _ENGLISH:
        return False
    return word in _SOFT or (len(word) == 1 and word.isascii())


def _is_ordinal(word: str, words: Sequence[str], index: int) -> bool:
    """Whether "first" tells which thing is meant ("the first layer") rather than when."""
    return word == "first" and 0 < index < len(words) - 1 and words[index - 1] in DETERMINERS


def _is_noun(word: str, words: Sequence[str], index: int, language: Language) -> bool:
    """Whether an English act stands as a thing: "at the start", "the clamp"."""
    if not index or language not in ("en", "") or not (word in NOUNS or word.removesuffix("s") in NOUNS):
        return False
    before = words[index - 1]
    if before in DETERMINERS or index + 1 == len(words):
        return before not in BEFORE_VERBS
    return before not in BEFORE_VERBS and not before.endswith("ly") and words[index + 1] not in DETERMINERS


def _particle(word: str, words: Sequence[str], index: int) -> bool:
    """Whether a word is none of direction or act: "up" in "pick up", "close" in "close to"."""
    if word in ("up", "down", "over", "back", "under"):
        if index and words[index - 1] in DETERMINERS:
            return False
        return any(
            w in PARTICLE_VERBS or stem_of(w) in PARTICLE_VERBS for w in words[max(0, index - 3) : index]
        )
    return (
        word in ("close", "more", "less", "mehr", "más", "moins", "menos")
        and index + 1 < len(words)
        and (words[index + 1] in ("to", "than", "als", "que", "de"))
    )


def _temporal(word: str, words: Sequence[str], index: int) -> bool:
    """German "vor" and "nach", French "avant": of time before an act or a thing, of place before a side."""
    following = words[index + 1] if index + 1 < len(words) else ""
    return not (
        word in ("nach", "vor")
        and POLES.get(CONCEPTS.get(following, ""), ("",))[0] in ("side", "height", "depth")
    )


def _names_a_thing(word: str, words: Sequence[str], index: int) -> bool:
    """Whether an opposing word tells which thing is meant ("the left drawer") rather than which way."""
    before = words[index - 1] if index else ""
    after = words[index + 1] if index + 1 < len(words) else ""
    if after in PLACES or before in PLACES:
        return False
    if before in _INDEFINITE and index > 1 and (words[0] in _USING or words[index - 2] in _USING):
        return False  # "use a wet sponge" tells what to choose
    if word in ("izquierdo", "derecho"):
        return True
    if word in ("gauche", "droite", "izquierda", "derecha"):
        return before not in ("la", "à", "a", "vers", "hacia")
    if word in ("左", "右", "上", "下", "前", "后"):
        return before not in ("向", "往", "从", "朝") and after not in ("边", "侧")
    is_last = not after or after in FUNCTION_WORDS or is_soft(after) or after in NEGATORS
    return before in DETERMINERS and not is_last


def _is_state(words: Sequence[str], index: int) -> bool:
    """Whether "on" or "off" tells of a state, "while it is off", "with the motor on", and of no place."""
    if index + 1 < len(words) and words[index + 1] not in _STATE_ENDS:
        return False
    before = words[index - 1] if index else ""
    if before in _BEING:
        return True
    return "with" in words[max(0, index - 4) : index - 1] and before not in FUNCTION_WORDS


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
