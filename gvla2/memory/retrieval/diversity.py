"""Which of the best records are told: each thing once, however many records say it."""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache

from gvla2.memory.contracts import TYPES, Candidates
from gvla2.memory.indexing.terms import words
from gvla2.memory.records import dump
from gvla2.memory.retrieval.options import HybridOptions

_CONSTRAINT = TYPES.index("failure_avoidance")


def chosen(ranked: Iterable[int], candidates: Candidates, options: HybridOptions) -> list[int]:
    """Of rows that come best first, those that fill the places for constraints and for hints, in the same order.

    A row that says the same as one taken before it is passed over.
    """
    places = {True: options.top_k_constraints, False: options.top_k}
    taken: dict[bool, list[int]] = {True: [], False: []}
    rows: list[int] = []
    for row in ranked:
        binding = bool(candidates.types[row] == _CONSTRAINT)
        if len(taken[binding]) < places[binding] and not any(
            _same(row, other, candidates, options) for other in taken[binding]
        ):
            taken[binding].append(row)
            rows.append(row)
        if all(len(taken[kind]) >= places[kind] for kind in places):
            break
    return rows


def _same(one: int, other: int, candidates: Candidates, options: HybridOptions) -> bool:
    """Whether two records say the same; the numbers of their effects aside, which one of them wins with."""
    mine, theirs = _wording(candidates.content(one)), _wording(candidates.content(other))
    if len(mine & theirs) < options.same_words * len(mine | theirs):
        return False
    return _parameter(candidates, one) == _parameter(candidates, other)


@lru_cache(maxsize=1024)
def _wording(content: str) -> frozenset[str]:
    return frozenset(words(content))


def _parameter(candidates: Candidates, row: int) -> str:
    """What an effect is about; a program is about nothing but itself."""
    effect = candidates.effect(row) or {}
    if effect.get("kind") == "program":
        return dump(dict(effect))
    return dump([str(effect.get(name, "")) for name in ("kind", "parameter", "op", "skill")])
