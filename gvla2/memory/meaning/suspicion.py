"""How likely two English texts contradict each other: a small logistic regression on features of the two.

p = max over the ways k in which they may (:func:`gvla2.memory.meaning.suspicion.candidates`) of sigmoid(w . x_k + b).
The weights are beside this file; ``tests/benchmarks/memory/train_suspicion.py`` trains them, and documents the data.
The result is a suspicion, never a decision.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from functools import cache, lru_cache
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

from gvla2.memory.meaning.clauses import Clause, Order, Words, read
from gvla2.memory.meaning.english import Side, is_english

CROSSED = 0.2
"""Above this, two orders count as each other's reverse."""
SIGNS = ("number", "bare", "side", "case_side", "forbids", "rules_out", "order", "choice")
"""How two clauses may contradict each other: in a measure, in a bare number, in what is done, in which case; one
forbids what the other may do, or does without what it needs; what comes first, what is taken.
"""
FEATURES = (
    *SIGNS, "like", "held", "own_words", "same_task", "like_task", "when", "two_signs", "steps", "shared",
)  # fmt: skip
"""The signs; how much of their words two clauses share; what each has of its own; whether their tasks are one; which
cases they name; in how many respects they differ.
"""


def candidates(first: str, second: str, first_query: str = "", second_query: str = "") -> NDArray[np.float64]:
    """(K, F) the :data:`FEATURES` of each way in which two English texts may contradict each other.

    K is 0 if no sign of it was found, or if their tasks are about different things: what is right for one may be wrong
    for the other. The texts may be exchanged.
    """
    same = _same_task(first_query, second_query)
    if same < 0:
        return np.empty((0, len(FEATURES)))
    one, two = read(first), read(second)
    shared = len(one.words & two.words)
    context = {
        "same_task": same,
        "steps": min(max(len(one.clauses), len(two.clauses)) - 1, 4) / 4,
        "shared": shared / max(min(len(one.words), len(two.words)), 1),
    }
    found: list[dict[str, float]] = []
    for a in one.clauses:
        for b in two.clauses:
            if signs := _signs(a, b):
                found.append({**context, **signs, **_compared(a, b)})
    like = shared / max(len(one.words | two.words), 1)
    for name, mine, theirs in (("order", one.orders, two.orders), ("choice", one.choices, two.choices)):
        if (crossed := _crossed(mine, theirs)) > CROSSED:
            found.append({**context, "like": like, "held": context["shared"], name: crossed})
    for way in found:
        way["like_task"] = way["like"] * same
    return np.array([[way.get(name, 0.0) for name in FEATURES] for way in found]).reshape(-1, len(FEATURES))


def _compared(a: Clause, b: Clause) -> dict[str, float]:
    """How far two clauses are about one thing in one case."""
    mine, theirs = a.topics, b.topics
    shared = len(mine & theirs)
    cases = bool(a.when - b.when), bool(b.when - a.when)
    return {
        # A clause without a topic ("use 4 N") may be about anything.
        "like": shared / len(mine | theirs) if mine and theirs else 0.5,
        "held": shared / min(len(mine), len(theirs)) if mine and theirs else 1.0,
        "own_words": min(len(mine - theirs), len(theirs - mine), 4) / 4,
        "when": 1.0 if all(cases) else 0.4 * any(cases),
    }


def _signs(a: Clause, b: Clause) -> dict[str, float]:
    """The :data:`SIGNS` of two clauses, before checking whether they are about one thing."""
    found: dict[str, float] = {}
    differ = _differing_figure(a, b)
    if differ is not None:
        found["number" if differ else "bare"] = 1.0
    # "Off before it docks" and "on after it docks" are two cases.
    apart = a.ahead != b.ahead and not a.when.isdisjoint(b.when)
    opposed = [] if apart else turned(a.sides, b.sides)
    cases = turned(a.sides, _sides_in(b.when)) or turned(_sides_in(a.when), b.sides)
    if a.forbidden != b.forbidden and not opposed and not cases:  # "don't leave it open" and "close it" agree
        found["forbids"] = 1.0
    elif a.forbidden == b.forbidden and (opposed or cases):
        found["side" if opposed else "case_side"] = 1.0
    if any(x.lacks and not y.lacks and x.lacks <= y.words for x, y in ((a, b), (b, a))):
        found["rules_out"] = 1.0
    if found:
        found["two_signs"] = float(
            len(opposed) + len(found.keys() & {"number", "bare", "forbids", "rules_out"}) > 1
        )
    return found


def turned(mine: Iterable[Side], theirs: Iterable[Side]) -> list[str]:
    """The axes on which two rows of sides are opposed; of both in a row the first counts ("from the top down")."""
    found = []
    for axis in sorted({axis for axis, _ in mine} & {axis for axis, _ in theirs}):
        one = [sign for name, sign in mine if name == axis]
        two = [sign for name, sign in theirs if name == axis]
        if len(set(one)) == len(set(two)) and one[0] != two[0]:
            found.append(axis)
    return found


def _differing_figure(a: Clause, b: Clause) -> str | None:
    """The first dimension in which figures of two clauses disagree; None if they agree."""
    for dimension in sorted({figure.dimension for figure in a.figures}):
        one, two = ([f for f in clause.figures if f.dimension == dimension] for clause in (a, b))
        if any(mine.disagrees(other) for mine, other in zip(one, two, strict=False)):
            return dimension
    return None


def _sides_in(words: Words) -> tuple[Side, ...]:
    return tuple((word[:-1], 1 if word[-1] == "+" else -1) for word in sorted(words) if word[-1] in "+-")


def _crossed(mine: Iterable[Order], theirs: Iterable[Order]) -> float:
    """How surely two orders, or two choices, are each other's reverse: 1 where both halves changed places.

    Words on the same side in both, or on both sides of one, do not count.
    """
    most = 0.0
    for a, b in mine:
        for c, d in theirs:
            one, two, three, four = a - b - c, b - a - d, c - d - a, d - c - b
            undone = turned(_sides_in(a), _sides_in(d)) or turned(_sides_in(b), _sides_in(c))
            if one and two and three and four and not undone:  # "start A, then B" and "stop B, then A" agree
                most = max(most, min(_held(one, four), _held(two, three)))
    return most


def _held(mine: Words, theirs: Words) -> float:
    return len(mine & theirs) / min(len(mine), len(theirs))


@lru_cache(maxsize=16384)
def _same_task(first: str, second: str) -> float:
    """Whether two queries, one instruction a line, are one task: 1 if they share one, .5 if one is unknown, 0 if one
    only says more than the other, -1 if each has something of its own: another thing, another case.
    """
    if not first.strip() or not second.strip():
        return 0.5
    mine, theirs = first.casefold().split("\n"), second.casefold().split("\n")
    if set(mine) & set(theirs):
        return 1.0
    one, two = ([read(line).everything for line in query] for query in (mine, theirs))
    return -1.0 if all(a - b and b - a for a in one for b in two) else 0.0


@lru_cache(maxsize=16384)
def suspicion(first: str, second: str, first_query: str = "", second_query: str = "") -> float | None:
    """The probability, in [0, 1], that two texts contradict each other; None if one is not in English.

    The queries are the instructions that the texts come from, one a line, "" for unknown: what is right for one task
    may be wrong for another. The texts may be exchanged.
    """
    if (second, second_query) < (first, first_query):
        return suspicion(second, first, second_query, first_query)
    if not is_english(first) or not is_english(second):
        return None
    if first == second:
        return 0.0
    ways = candidates(first, second, first_query, second_query)
    if not len(ways):
        return 0.0
    weights, bias, _ = _head()
    return 1.0 / (1.0 + math.exp(-(float((ways @ weights).max()) + bias)))


def threshold() -> float:
    """The probability above which two texts are suspected, chosen out of fold on the training pairs."""
    return _head()[2]


@cache
def _head() -> tuple[NDArray[np.float64], float, float]:
    """Weights (F,), bias, and threshold."""
    table = json.loads((files("gvla2.memory.meaning") / "suspicion_weights.json").read_text("utf-8"))
    weights = np.array([float(table["weights"].get(name, 0.0)) for name in FEATURES])
    return weights, float(table["bias"]), float(table["threshold"])
