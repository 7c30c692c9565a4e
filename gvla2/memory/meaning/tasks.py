"""Whether two instructions are about different things, so that what is right for the one may be wrong for the other."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from gvla2.memory.meaning.clauses import Clause, named
from gvla2.memory.meaning.concepts import concept_of, words_in
from gvla2.memory.meaning.lexicon import DETERMINERS, POLES
from gvla2.memory.meaning.plain_text import plain_text
from gvla2.memory.meaning.statements import read
from gvla2.memory.meaning.word_forms import Language, alike, common, may_be_alike, split_alike
from gvla2.memory.meaning.word_roles import is_soft
from gvla2.memory.meaning.word_sets import word_set

MOST_LINES = 8


_SCENE = word_set(
    """on off at from near next beside behind between under above below over along across around against past through
    auf neben bei hinter zwischen unter über an am von vom aus entlang sur sous près derrière devant entre chez
    sobre bajo junto cerca detrás delante desde entre"""
)
"""Behind these come where the thing is and what lies about it."""
_BOUND = word_set(
    """to into onto for in inside with without during while when if using as after before of
    zu zum zur nach in im ins für mit ohne während wenn als vor à au aux dans pour avec sans pendant quand
    a al en para con sin durante cuando"""
)
"""Behind these come a goal or circumstances, which tell one task from another where nothing else does."""
PREPOSITIONS = _SCENE | _BOUND
_HANDLING = word_set(
    "put place go grasp get bring pick fetch carry hand mettre prendre poner tomar nehmen bringen holen"
)
"""Acts that differ in little but the word: a thing is taken, and put somewhere."""
_ACTS = word_set("grasp turn place go check touch press wait cook run descend")
"""Concepts that are acts wherever they stand; any other act is known by standing first."""
_IDLE = word_set("please task job thing things way again")


@dataclass(frozen=True)
class Task:
    """An instruction taken apart: its ``act``, the ``things`` it acts on, the ``goal`` and circumstances, the ``scene``
    about it, and its opposing words by axis, what is done in ``sides`` and what is only named in ``marks``.
    """

    act: frozenset[str]
    things: frozenset[str]
    goal: frozenset[str]
    scene: frozenset[str]
    sides: frozenset[tuple[str, int]]
    marks: frozenset[str]
    language: Language

    @property
    def all(self) -> frozenset[str]:
        """All words but the opposing ones."""
        return self.act | self.things | self.goal | self.scene


def other_tasks(first_query: str, first: str, second_query: str, second: str) -> bool:
    """Whether two lessons come from tasks about different things: opposite acts, other objects, other circumstances.

    The queries have one instruction a line; an empty one may be about anything, and one line in common is enough.
    Different words are no different things as long as the lessons themselves name what they are about.
    """
    if first_query == second_query or not first_query.strip() or not second_query.strip():
        return False
    mine = _tasks(first_query)
    theirs = _tasks(second_query)
    return all(_other(one, two, first, second) for one in mine for two in theirs)


def same_task(first_query: str, second_query: str) -> bool:
    """Whether two lessons have an instruction in common."""
    if first_query == second_query:
        return bool(first_query.strip())
    one, two = (set(query.casefold().split("\n")) for query in (first_query, second_query))
    return any(line.strip() for line in one & two)


@lru_cache(maxsize=4096)
def _tasks(query: str) -> tuple[Task, ...]:
    lines = [line for line in query.split("\n") if line.strip()]
    return tuple(task_of(line) for line in lines[:MOST_LINES])


def _other(one: Task, two: Task, first: str, second: str) -> bool:
    if _opposed(one, two):
        return True
    if one.language and two.language and one.language != two.language:
        return False  # their words cannot be compared
    language = common(one.language, two.language)
    shared, mine, theirs = split_alike(one.things, two.things, language)
    if (mine or one.marks - two.marks) and (theirs or two.marks - one.marks):
        own = (frozenset(mine) | (one.marks - two.marks), frozenset(theirs) | (two.marks - one.marks))
        return not _both_name(own, first, second, language)
    acts_alike = (
        not one.act
        or not two.act
        or one.act | two.act <= _HANDLING
        or bool(split_alike(one.act, two.act, language)[0])
    )
    same_acts = one.sides == two.sides or not one.sides or not two.sides
    _, my_goal, their_goal = split_alike(one.goal, two.goal, language)
    if shared and acts_alike and same_acts and not (my_goal and their_goal):
        return False
    named, mine, theirs = split_alike(one.all, two.all, language)
    if not (mine or one.sides - two.sides) or not (theirs or two.sides - one.sides):
        return False  # the one only says more than the other
    named = [word for word in named if word not in one.act and word not in two.act]
    if named:
        return not _both_name((frozenset(named),), first, second, language)
    return not _both_name((one.all, two.all), first, second, language)


def _opposed(one: Task, two: Task) -> bool:
    """Whether the tasks take opposite sides of an axis, or name opposite things ("the full jug", "the empty jug")."""
    # "Unlock the door" and "open the locked door" name what is undone.
    if any(
        (axis, -sign) in two.sides
        and (axis, sign) not in two.sides
        and (axis, -sign) not in one.sides
        and named(axis, sign) not in two.marks
        and named(axis, -sign) not in one.marks
        for axis, sign in one.sides
    ):
        return True
    for mark in one.marks:
        other = mark[:-1] + ("-" if mark[-1] == "+" else "+")
        if other in two.marks and mark not in two.marks and other not in one.marks:
            return True
    return False


def _both_name(things: tuple[frozenset[str], ...], first: str, second: str, language: Language) -> bool:
    """Whether both lessons name what one of the tasks is about."""
    one, two = read(first).items, read(second).items
    for names in things:
        if any(_stands(word, one, names, language) and _stands(word, two, names, language) for word in names):
            return True
    return False


def _stands(word: str, content: frozenset[str], names: frozenset[str], language: Language) -> bool:
    """Whether one of the names stands in a content, be it in another form."""
    return word in content or any(
        may_be_alike(word, other) and other not in names and alike(word, other, language) for other in content
    )


@lru_cache(maxsize=8192)
def task_of(line: str) -> Task:
    """The task of one instruction."""
    said = read(line)
    act: set[str] = set()
    parts: dict[str, set[str]] = {"things": set(), "goal": set(), "scene": set()}
    part, before = "things", ""
    for index, word in enumerate(words_in(plain_text(line))):
        if parts["things"] and word in PREPOSITIONS:
            if before not in PREPOSITIONS:  # "next to" tells of the scene, too
                part = "scene" if word in _SCENE else "goal"
        elif _tells(word, said.language):
            concept = concept_of(word)
            verb = index == 0 or concept in _ACTS
            if verb and not act and not parts["things"] and before not in DETERMINERS:
                act.add(concept)
            else:
                # The version and the number of a thing tell it from others wherever they stand.
                parts["goal" if not concept.isalpha() else part].add(concept)
        before = word
    return Task(
        frozenset(act),
        frozenset(parts["things"]),
        frozenset(parts["goal"]),
        frozenset(parts["scene"]),
        frozenset((axis, sign) for clause in said.clauses for axis, sign in _done(clause)),
        frozenset(word for clause in said.clauses for word in clause.context if word[-1] in "+-"),
        said.language,
    )


def _done(clause: Clause) -> list[tuple[str, int]]:
    return [(axis, sign) for axis, signs in clause.sides.items() for sign in signs]


def _tells(word: str, language: Language) -> bool:
    """Whether a word names an act or a thing."""
    if word == "," or word[0].isdigit() or word in DETERMINERS or word in _IDLE or is_soft(word, language):
        return False
    return concept_of(word) not in POLES
