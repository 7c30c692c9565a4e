"""Two texts side by side, as the numbers that the head of :mod:`gvla2.memory.meaning.suspicion` weighs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from gvla2.memory.meaning.clauses import Clause, Order, Sides, Words
from gvla2.memory.meaning.reader import Reading, read

TOLERANCE: Mapping[str, float] = {"temperature": 0.15, "angle": 0.15, "times": 0.34}
"""How far two figures of a dimension may lie apart, as a share of the larger one, and still agree; else 20 %."""
CROSSED = 0.2
"""From here on two orders are taken for each other's reverse."""
EXACT = frozenset(("port", "version", "pin", "channel", "id", "seed"))
"""Bare numbers of these agree only when they are equal."""
SIGNS = ("number", "bare", "side", "named", "forbids", "rules_out", "order", "choice", "exchanged")
"""How two clauses may contradict each other: in a measure, in a bare number, in what is done, in which thing is
meant; one forbids what the other may do, or all that it does; what comes first, what is taken, what goes where.
"""
FEATURES = (
    *SIGNS, "like", "held", "contained", "replaced", "own_words", "own_things", "own_given", "same_task",
    "like_task", "contained_task", "named_task", "side_task", "number_task", "agree_number", "agree_side", "names",
    "when", "two_signs", "number_named", "steps", "shared", "one_figure",
)  # fmt: skip
"""The signs; how much of their words two clauses share; what each has of its own; whether their tasks are one; in what
they agree, and which single things and cases they name.
"""


def candidates(first: str, second: str, first_query: str = "", second_query: str = "") -> NDArray[np.float64]:
    """(K, F) the :data:`FEATURES` of each way in which two English texts may contradict each other.

    K is 0 where no sign of it was found, and where their tasks are about different things: what is right for the one
    may be wrong for the other. The texts may be exchanged.
    """
    same = _same_task(first_query, second_query)
    if same < 0:
        return np.empty((0, len(FEATURES)))
    one, two = read(first), read(second)
    # What one task is about goes without saying: whoever leaves it out means it, too.
    given = _all(read(first_query)) if same == 1.0 else frozenset()
    whole = _unshared(one.words, two.words)
    context = {
        "same_task": same,
        "names": float(bool(_names(one) - _names(two)) and bool(_names(two) - _names(one))),
        "steps": min(max(len(one.clauses), len(two.clauses)) - 1, 4) / 4,
        "shared": (len(one.words) - len(whole[0])) / max(min(len(one.words), len(two.words)), 1),
        "one_figure": float(all(sum(len(c.figures) for c in said.clauses) == 1 for said in (one, two))),
    }
    shared = len(one.words) - len(whole[0])
    like = shared / max(shared + len(whole[0]) + len(whole[1]), 1)
    found: list[dict[str, float]] = []
    for a in one.clauses:
        for b in two.clauses:
            if same == 0.0 and a.topics.isdisjoint(b.topics):
                continue  # of other tasks, and of nothing that the other speaks of
            if signs := _signs(a, b):
                found.append({**context, **signs, **_agreed(a, b), **_compared(a, b, given)})
    for name, mine, theirs in (("order", one.orders, two.orders), ("choice", one.choices, two.choices)):
        if (crossed := _crossed(mine, theirs)) > CROSSED:
            found.append({**context, "like": like, "held": context["shared"], name: crossed})
    for way in found:
        for name in ("like", "contained", "named", "side", "number"):
            way[f"{name}_task"] = way.get(name, 0.0) * same
        respects = way.get("axes", 0.0) + sum(
            name in way for name in ("number", "bare", "forbids", "rules_out")
        )
        way["two_signs"] = float(respects > 1)
        way["number_named"] = float("named" in way and ("number" in way or "bare" in way))
    return np.array([[way.get(name, 0.0) for name in FEATURES] for way in found]).reshape(-1, len(FEATURES))


def _compared(a: Clause, b: Clause, given: Words) -> dict[str, float]:
    """How far two clauses speak of one thing in one case."""
    mine, theirs = a.topics, b.topics
    left, right = _unshared(mine, theirs)
    shared = len(mine) - len(left)
    # Who says nothing of what it is about ("use 4 N") may speak of anything.
    like = shared / (shared + len(left) + len(right)) if mine and theirs else 0.5
    own = min(len(left), len(right))
    own_given = min(len(left - given), len(right - given))
    things = _unshared(a.things, b.things)
    own_things = min(len(things[0] - given), len(things[1] - given), 2)
    return {
        "like": like,
        "held": shared / min(len(mine), len(theirs)) if mine and theirs else 1.0,
        "contained": 1.0 if own == 0 else 0.3 if own == 1 else 0.0,
        "own_words": min(own, 4) / 4,
        "own_things": own_things / 2,
        "own_given": min(own_given, 4) / 4,
        "when": _cases(a, b),
        "replaced": min(own, 2) / 2 * like,
    }


def _signs(a: Clause, b: Clause) -> dict[str, float]:
    """The :data:`SIGNS` of two clauses, before it is asked whether they speak of one thing."""
    found: dict[str, float] = {}
    if a.open or b.open:
        return found
    differ, _ = _figures(a, b)
    if differ is not None:
        found["number" if differ else "bare"] = 1.0
    opposed = turned(a.sides, b.sides)
    mine, theirs = a.named + _sides_in(a.when), b.named + _sides_in(b.when)
    named = turned(a.named, b.named) or turned(a.sides, theirs) or turned(mine, b.sides)
    if a.forbidden != b.forbidden and not opposed and not named:  # "don't leave it open" and "close it" agree
        rule, act = (a, b) if a.forbidden else (b, a)
        missing, _ = _unshared(rule.words, act.words | act.when)
        found["forbids" if missing or not rule.words else "rules_out"] = 1.0
    elif a.forbidden == b.forbidden and (opposed or named):
        found["side" if opposed else "named"] = 1.0
    elif a.forbidden == b.forbidden and _exchanged(a, b):
        found["exchanged"] = 1.0
    if any(
        one.lacks and not other.lacks and not _unshared(one.lacks, other.words)[0]
        for one, other in ((a, b), (b, a))
    ):
        found["rules_out"] = 1.0
    return found


def _agreed(a: Clause, b: Clause) -> dict[str, float]:
    """In what two clauses agree."""
    return {
        "agree_number": float(_figures(a, b)[1]),
        "axes": float(len(turned(a.sides + a.named, b.sides + b.named))),
        "agree_side": float(not set(a.sides).isdisjoint(b.sides)),
    }


def turned(mine: Sides, theirs: Sides) -> list[str]:
    """The axes on which two rows of sides are opposed; of both in a row the first counts ("from the top down")."""
    found = []
    for axis in sorted({axis for axis, _ in mine} & {axis for axis, _ in theirs}):
        one = [sign for name, sign in mine if name == axis]
        two = [sign for name, sign in theirs if name == axis]
        if len(set(one)) == len(set(two)) and one[0] != two[0]:
            found.append(axis)
    return found


def _figures(a: Clause, b: Clause) -> tuple[str | None, bool]:
    """The dimension in which figures of two clauses disagree (None: in none), taken in turn; whether some agree."""
    differ: str | None = None
    agree = False
    exact = not EXACT.isdisjoint(a.words | b.words)
    for dimension in sorted({figure.dimension for figure in a.figures}):
        one, two = ([f for f in clause.figures if f.dimension == dimension] for clause in (a, b))
        tolerance = 0.0 if exact and not dimension else TOLERANCE.get(dimension, 0.2)
        apart = [mine.disagrees(other, tolerance) for mine, other in zip(one, two, strict=False)]
        differ = dimension if differ is None and any(apart) else differ
        agree |= bool(apart) and not any(apart)
    return differ, agree


def _sides_in(words: Words) -> Sides:
    return tuple((word[:-1], 1 if word[-1] == "+" else -1) for word in sorted(words) if word[-1] in "+-")


def _unshared(mine: Words, theirs: Words) -> tuple[Words, Words]:
    """The words of each that the other has not, words that begin alike taken for one."""
    left, right = mine - theirs, theirs - mine
    if not left or not right or {word[:4] for word in left}.isdisjoint([word[:4] for word in right]):
        return left, right
    mine_left, their_right = set(left), set(right)
    for word in sorted(left):
        for other in sorted(their_right):
            if len(word) > 3 and len(other) > 3 and (word.startswith(other) or other.startswith(word)):
                mine_left.discard(word)
                their_right.discard(other)
                break
    return frozenset(mine_left), frozenset(their_right)


def _names(said: Reading) -> set[str]:
    return {name for clause in said.clauses for name in clause.names}


def _exchanged(a: Clause, b: Clause) -> bool:
    """Whether two things took each other's place: "the acid into the water", "the water into the acid"."""
    mine, theirs = ({thing: place for place, thing in clause.roles} for clause in (a, b))
    moved = [thing for thing in mine.keys() & theirs.keys() if mine[thing] != theirs[thing]]
    return a.words == b.words and len(moved) == 2 and mine[moved[0]] == theirs[moved[1]]


def _cases(a: Clause, b: Clause) -> float:
    """Whether each clause holds in a case of its own."""
    left, right = _unshared(a.when, b.when)
    return 1.0 if left and right else 0.4 if left or right else 0.0


def _crossed(mine: Iterable[Order], theirs: Iterable[Order]) -> float:
    """How surely two orders, or two choices, are each other's reverse: 1 where both halves changed places.

    What stands on one side in both tells nothing, and neither does what stands on both sides of one.
    """
    most = 0.0
    for a, b in mine:
        for c, d in theirs:
            one, two, three, four = a - b - c, b - a - d, c - d - a, d - c - b
            if one and two and three and four:
                most = max(most, min(_held(one, four), _held(two, three)))
    return most


def _held(mine: Words, theirs: Words) -> float:
    left, _ = _unshared(mine, theirs)
    least = min(len(mine), len(theirs))
    return min((len(mine) - len(left)) / least, 1.0) if least else 0.0


@lru_cache(maxsize=16384)
def _same_task(first: str, second: str) -> float:
    """Whether two queries, one instruction a line, are one task: 1 where they share one, .5 where one is not known, 0
    where one only says more than the other, -1 where each has something of its own: another thing, another case.
    """
    if not first.strip() or not second.strip():
        return 0.5
    mine, theirs = first.casefold().split("\n"), second.casefold().split("\n")
    if set(mine) & set(theirs):
        return 1.0
    pairs = ((_all(read(line)), _all(read(other))) for line in mine for other in theirs)
    return -1.0 if all(all(_unshared(*pair)) for pair in pairs) else 0.0


def _all(said: Reading) -> Words:
    return said.words.union(*(clause.everything for clause in said.clauses))
