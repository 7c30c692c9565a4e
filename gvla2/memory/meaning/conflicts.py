"""Whether two lessons contradict each other: in a number, in a direction, by forbidding, in order, or by typed effects.

Decisions on plain data; the same two lessons always get the same answer. A word of negation alone is no conflict.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal, NamedTuple

from gvla2.memory.contracts import RecordType
from gvla2.memory.meaning.clauses import Clause, Order, named
from gvla2.memory.meaning.prefixes import reverses
from gvla2.memory.meaning.quantities import Quantity
from gvla2.memory.meaning.statements import Statement, read
from gvla2.memory.meaning.swaps import swapped
from gvla2.memory.meaning.tasks import other_tasks, same_task
from gvla2.memory.meaning.word_forms import Language, common, split_alike, starts_of

ConflictKind = Literal["number", "opposite", "forbidden", "order", "effect"]

TOLERANCE: Mapping[str, float] = {"temperature": 0.15, "times": 0.34, "": 0.2}
"""How far two figures of a dimension may lie apart, as a share of the larger one, and still agree."""
OTHERWISE = 0.2
EXACT = frozenset(
    ("port", "version", "pin", "channel", "python", "node", "java", "baud", "id", "index", "seed")
)
"""Bare numbers after these words agree only when they are equal."""
_VAGUE = frozenset(("", "time", "times"))
"""Figures of these may be said of anything; a length or a force tells what is spoken of."""
LIGHT = frozenset(("place", "go", "belong", "come", "sit", "lie", "stand", "look", "find", "happen"))
"""Acts that say little where two lessons agree in all the rest: "put it left" and "it goes right"."""
_KINDRED = {"vertical": "amount", "amount": "vertical"}
"""Axes whose words are said of one another's things: "raise the limit", 降低机械臂."""
_LIGHT_STARTS = starts_of(LIGHT)
MOST_DETAILS = 5
"""A lesson with more words of its own than this speaks of a special case of the other."""


_FAILURE = re.compile(
    r"\b(?:fail|slip|collid|crash|stuck|missed|error|broke|did not|was not|could not"
    r"|scheiter|fehlgeschlag|échou|fall[óo]\b)"
    r"|失败|滑落|碰撞"
)


@dataclass(frozen=True)
class Conflict:
    """How two lessons contradict each other, and ``why`` in a few words."""

    kind: ConflictKind
    why: str


class Said(NamedTuple):
    """What a lesson says, for comparison: its type, words, skill ("" for any), typed effect and object ("" for any),
    and the instructions that it comes from, one a line ("" for any).
    """

    type: RecordType
    content: str
    skill: str = ""
    effect: Mapping[str, Any] | None = None
    query: str = ""


def conflict(first: Said, second: Said) -> Conflict | None:
    """How two lessons contradict each other, None when they don't.

    Lessons of different skills never do, nor such of tasks about different things. Where both have effects on the same
    parameter those decide, else the words. A constraint tells what failed: against a hint, only forbidding counts, and
    two accounts of failures agree.
    """
    if first.skill and second.skill and first.skill != second.skill:
        return None
    if first.effect and second.effect and _same_parameter(first.effect, second.effect):
        return effects_conflict(first.effect, second.effect)
    if first.effect and second.effect:
        return None
    failed = [said.type == "failure_avoidance" for said in (first, second)]
    if all(failed) and _tells_of_failure(first.content) and _tells_of_failure(second.content):
        return None  # what failed at 5 cm may fail at 30 cm as well
    found = contradiction(first.content, second.content, one_task=same_task(first.query, second.query))
    if found is None or (found.kind != "forbidden" and any(failed) and not all(failed)):
        return None
    return None if other_tasks(first.query, first.content, second.query, second.content) else found


@lru_cache(maxsize=8192)
def _tells_of_failure(content: str) -> bool:
    return _FAILURE.search(content.casefold()) is not None


def contradiction(first: str, second: str, *, one_task: bool = False) -> Conflict | None:
    """How two texts contradict each other, in words of any of the lexicon's languages and numbers of any.

    In ``one_task`` a thing has one place: what goes into the left tray does not go into the right one.
    """
    one, two = read(first), read(second)
    reversals = _reversed_order(one, two) if one.orders and two.orders else None
    # In a text of several sentences, "wait" alone may be said of anything.
    needed = 1 if len(one.clauses) < 3 and len(two.clauses) < 3 else 2
    chosen = bool(one.choices and two.choices)
    left_out: set[bool] = set()
    for a in one.clauses:
        for b in two.clauses:
            if a.forbidden == b.forbidden and _each_its_own(a, b):
                continue  # and so it is with most pairs
            found = _clauses(a, b, needed, one_task)
            if found is not None and found.kind == "forbidden" and chosen:
                # A hammer for pliers and pliers for scissors agree: each has to leave out what the other takes.
                left_out.add(a.forbidden)
                found = found if len(left_out) == 2 else None
            if found is None or (found.kind == "opposite" and (reversals or _says_both(one, two, a, b))):
                continue
            return found
    if reversals is None and chosen:
        return _reversed_choice(one, two)
    if reversals is None and one_task and one.items == two.items and swapped(first, second, one_way=True):
        return Conflict("order", "things are in each other's place")
    return reversals


def _says_both(one: Statement, two: Statement, a: Clause, b: Clause) -> bool:
    """Whether a text says elsewhere what the other says here: to open, and later to close, is no contradiction."""
    for axis in _turned(a, b):
        for text, own, other in ((one, a, b), (two, b, a)):
            if any(
                clause is not own
                and clause.sides.get(axis) == other.sides[axis]
                and not clause.forbidden
                and not (clause.matter and clause.starts.isdisjoint(other.starts))
                for clause in text.clauses
            ):
                return True
    return False


def _clauses(first: Clause, second: Clause, needed: int, one_task: bool) -> Conflict | None:
    if first.open or second.open:
        return None
    if first.forbidden != second.forbidden:
        rule, act = (first, second) if first.forbidden else (second, first)
        return _forbidding(rule, act, needed)
    if (first.prefixed or second.prefixed) and (found := _reversed_word(first, second)) is not None:
        return found
    both, left, right = split_alike(first.matter, second.matter, common(first.language, second.language))
    left, right = [word for word in left if word not in LIGHT], [word for word in right if word not in LIGHT]
    agreed = _agreed(first, second)
    if max(len(left), len(right)) > MOST_DETAILS or not (both or agreed):
        return None
    if first.phase and second.phase and starts_of(first.phase).isdisjoint(starts_of(second.phase)):
        return None  # to close before lifting and to open before approaching are two moments
    turned = [] if first.forbidden else _turned(first, second)
    if one_task and not first.forbidden:
        elsewhere = [mark for mark in left if mark in first.places and _other_side(mark) in second.places]
        turned += [mark[:-1] for mark in elsewhere]
        left = [mark for mark in left if mark not in elsewhere]
        right = [mark for mark in right if _other_side(mark) not in elsewhere]
    less, more = ("", "") if turned or first.forbidden else _undone(first, second)
    turned += [less] if less else []
    if (left or first.does_more(second, less)) and (right or second.does_more(first, more)):
        return None  # each does something of its own: lifting is not the opposite of pushing
    numbers = _numbers(first, second)
    if len(turned) + (numbers is not None) != 1:
        return None  # what differs in two respects is another case, not the opposite
    measured = numbers is not None and not _VAGUE.issuperset(figure.dimension for figure in first.figures)
    if len(both) + agreed + (first.pronoun or second.pronoun) + measured < needed:
        return None
    if turned:
        return Conflict("opposite", f"they differ in {turned[0]}{_sides(first, second, turned[0])}")
    if first.forbidden:
        return None
    if first.bounded != second.bounded:
        return Conflict("forbidden", f"one forbids what the other does: {numbers}")
    return Conflict("number", numbers or "")


def _each_its_own(first: Clause, second: Clause) -> bool:
    """Whether each has words that begin like none of the other's, nor can any be the reverse of one."""
    mine, theirs = first.starts, second.starts
    if mine <= theirs or theirs <= mine or first.prefixed or second.prefixed:
        return False
    return not (mine - _LIGHT_STARTS <= theirs or theirs - _LIGHT_STARTS <= mine)


def _reversed_word(first: Clause, second: Clause) -> Conflict | None:
    """Two clauses that are equal but for a word and its reverse, "encrypted" and "unencrypted"."""
    if len(first.matter) != len(second.matter) or first.sides != second.sides or first.forbidden:
        return None
    _, left, right = split_alike(first.matter, second.matter, common(first.language, second.language))
    if len(left) != 1 or len(right) != 1 or not reverses(left[0], right[0]) or _numbers(first, second):
        return None
    return Conflict("opposite", f"one is the reverse of the other: {left[0]} against {right[0]}")


def _other_side(mark: str) -> str:
    return mark[:-1] + {"+": "-", "-": "+"}.get(mark[-1], "")


def _agreed(first: Clause, second: Clause) -> int:
    return sum(signs == second.sides.get(axis) for axis, signs in first.sides.items())


def _turned(first: Clause, second: Clause) -> list[str]:
    """The axes on which two clauses take opposite sides; both sides in another sequence count as well."""
    if not first.sides or not second.sides:
        return []
    found = []
    for axis in sorted(first.sides.keys() & second.sides.keys()):
        one, two = first.poles[axis], second.poles[axis]
        if any(named(axis, sign) in second.context for sign in one) or any(
            named(axis, sign) in first.context for sign in two
        ):
            continue  # the other names this act as well, as something that comes before or after
        if len(set(one)) == len(set(two)) == 1:
            if one[0] != two[0]:
                found.append(axis)
        elif sorted(one) == sorted(two) and one != two:
            found.append(axis)
    return found


def _undone(first: Clause, second: Clause) -> tuple[str, str]:
    """The axes on which two clauses do and undo one thing in other words ("raise it", "reduce it"), "" for none."""
    for axis in first.sides.keys() - second.sides.keys():
        other = _KINDRED.get(axis, "")
        if other in second.sides and other not in first.sides:
            one, two = set(first.poles[axis]), set(second.poles[other])
            if len(one) == len(two) == 1 and one != two:
                return axis, other
    return "", ""


def _sides(first: Clause, second: Clause, axis: str) -> str:
    if axis not in first.poles or axis not in second.poles:
        return ""
    return ": " + " against ".join("+" if clause.poles[axis][0] > 0 else "-" for clause in (first, second))


def _forbidding(rule: Clause, act: Clause, needed: int) -> Conflict | None:
    """A rule, "never do X", against an act, "do X": all that the rule names is in the act, on the
    same sides, with the same figures.
    """
    if (
        not rule.words
        or not rule.starts <= act.starts
        or len(rule.matter) + len(rule.sides) + rule.pronoun < needed
    ):
        return None
    language = common(rule.language, act.language)
    missing = split_alike(rule.matter, act.matter, language)[1]
    wanted, given = rule.sides, act.sides
    for axis, signs in wanted.items():
        if given.get(axis) != signs and not act.context.issuperset(named(axis, sign) for sign in signs):
            return None
    if missing:
        return None
    if len(act.matter) - len(rule.matter) > MOST_DETAILS:
        return None
    for figure in rule.figures:
        fitting = [other for other in act.figures if other.dimension == figure.dimension]
        if not fitting or all(figure.disagrees(other, 0.05) for other in fitting):
            return None
    return Conflict("forbidden", "one forbids what the other does")


def _numbers(first: Clause, second: Clause) -> str | None:
    """The disagreement of two clauses' figures, taken in turn; None when they agree or cannot be compared."""
    if not first.figures or not second.figures:
        return None
    for dimension in sorted({figure.dimension for figure in first.figures}):
        one = [figure for figure in first.figures if figure.dimension == dimension]
        two = _comparable(second.figures, dimension)
        if len(one) != len(two):
            continue
        if not dimension and len(one) > 1 and sum(a != b for a, b in zip(one, two, strict=True)) > 1:
            continue  # which of them are compared with which, nobody can tell
        exact = not dimension and bool((first.matter | first.labels | second.labels) & EXACT)
        tolerance = 0.0 if exact else TOLERANCE.get(dimension, OTHERWISE)
        for a, b in zip(one, two, strict=True):
            if a.disagrees(b, tolerance):
                return f"{_figure(a)} against {_figure(b)}"
    return None


def _comparable(figures: list[Quantity], dimension: str) -> list[Quantity]:
    found = [figure for figure in figures if figure.dimension == dimension]
    other = {"angle": "temperature", "temperature": "angle"}.get(dimension)  # "180 degrees" may be either
    return found or [figure for figure in figures if other and figure.dimension == other]


def _figure(quantity: Quantity) -> str:
    low, high = quantity.low, quantity.high
    unit = f" ({quantity.dimension})" if quantity.dimension else ""
    if low == high:
        return f"{low:.4g}{unit}"
    if math.isinf(high):
        return f"at least {low:.4g}{unit}"
    return f"at most {high:.4g}{unit}" if math.isinf(low) else f"{low:.4g} to {high:.4g}{unit}"


def _reversed_order(first: Statement, second: Statement) -> Conflict | None:
    """One says A before B, the other B before A. What is said of both A and B tells nothing of their order, and a
    thing may move with whatever is named first ("rebase the branch before merging it").
    """
    for turned, kept in _crossed(first.orders, second.orders, common(first.language, second.language)):
        if all(turned) and (not all(kept) or sum(turned) > sum(kept)):
            return Conflict("order", "one puts first what the other puts last")
    return None


def _reversed_choice(first: Statement, second: Statement) -> Conflict | None:
    """One takes A rather than B, the other B rather than A."""
    for turned, _ in _crossed(first.choices, second.choices, common(first.language, second.language)):
        if all(turned):
            return Conflict("opposite", "one takes what the other leaves out")
    return None


def _crossed(
    first: Sequence[Order], second: Sequence[Order], language: Language
) -> Iterator[tuple[tuple[int, int], tuple[int, int]]]:
    """For two pairs (A, B) and (C, D) that speak of the same: how much A shares with D and B with C, and how much A
    with C and B with D. What stands in both parts of a pair is left out.
    """
    for one, two in first:
        for three, four in second:
            _, left, right = split_alike((one | two) - LIGHT, (three | four) - LIGHT, language)
            if left and right:
                continue
            a, b = _apart(one, two, language)
            c, d = _apart(three, four, language)
            yield (
                (_shared(a, d, language), _shared(b, c, language)),
                (_shared(a, c, language), _shared(b, d, language)),
            )


def _apart(
    first: frozenset[str], second: frozenset[str], language: Language
) -> tuple[frozenset[str], frozenset[str]]:
    _, left, right = split_alike(first, second, language)
    return frozenset(left), frozenset(right)


def _shared(first: frozenset[str], second: frozenset[str], language: Language) -> int:
    return len(split_alike(first, second, language)[0])


def effects_conflict(first: Mapping[str, Any], second: Mapping[str, Any]) -> Conflict | None:
    """How two typed effects contradict each other: bounds that leave nothing between them, means too far apart for
    their deviations (or by half, where single successes have none), an approach both forbidden and successful.
    """
    if not _same_parameter(first, second):
        return None
    kinds = (first.get("kind"), second.get("kind"))
    name = str(first.get("parameter"))
    if "forbid" in kinds:
        return Conflict("effect", f"{name} is forbidden and succeeded") if "prior" in kinds else None
    try:
        a, b = float(first.get("value", math.nan)), float(second.get("value", math.nan))
        deviations = [float(effect.get("sd", 0.0)) for effect in (first, second)]
        counts = [max(int(effect.get("count", 1)), 1) for effect in (first, second)]
    except (TypeError, ValueError, OverflowError):
        return None
    if not all(map(math.isfinite, (a, b, *deviations))):
        return None
    scale = max(abs(a), abs(b))
    if kinds == ("bound", "bound"):
        ops = (first.get("op", ">="), second.get("op", ">="))
        low, high = (a, b) if ops[0] == ">=" else (b, a)
        if set(ops) == {">=", "<="} and low - high > 1e-9 * scale:
            return Conflict("effect", f"{name} at least {low:.4g} against at most {high:.4g}")
    if kinds == ("prior", "prior"):
        weights = [count - 1 for count in counts]
        pooled = math.sqrt(
            sum(w * sd**2 for w, sd in zip(weights, deviations, strict=True)) / max(sum(weights), 1)
        )
        if abs(a - b) > max(3.0 * pooled, (0.5 if min(counts) < 3 else 0.25) * scale):
            return Conflict("effect", f"{name} {a:.4g} against {b:.4g}")
    return None


def _same_parameter(first: Mapping[str, Any], second: Mapping[str, Any]) -> bool:
    """Whether both are about one parameter of one skill and object, where these are given."""
    if str(first.get("parameter", "")) != str(second.get("parameter", "")):
        return False
    if (first.get("scale") or "") != (second.get("scale") or ""):
        return False  # metres and shares of a side do not compare
    return all(
        not first.get(name) or not second.get(name) or first[name] == second[name]
        for name in ("skill", "object")
    )
