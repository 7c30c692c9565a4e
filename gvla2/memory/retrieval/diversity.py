"""Which of the best records are told: each thing once, however many records say it."""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache

from gvla2.memory.contracts import TYPES, Candidates
from gvla2.memory.indexing.terms import words
from gvla2.memory.records import dump
from gvla2.memory.retrieval.options import HybridOptions

_CONSTRAINT = TYPES.index("failure_avoidance")
_LANGUAGES = ("calls", "waypoints")
_FARTHEST = 256
"""So many rows are looked at for programs once all other places are filled."""


def chosen(ranked: Iterable[int], candidates: Candidates, options: HybridOptions) -> list[int]:
    """Of rows that come best first, those that fill the places for constraints, for hints and for the programs of
    each language, in the same order.

    A row that says the same as one taken before it is passed over.
    """
    places = {"constraint": options.top_k_constraints, "hint": options.top_k}
    if candidates.programs.any():
        places |= dict.fromkeys(_LANGUAGES, options.top_k_programs)
    taken: dict[str, list[int]] = {kind: [] for kind in places}
    rows: list[int] = []
    for number, row in enumerate(ranked):
        kind = _kind(candidates, row)
        if len(taken[kind]) < places[kind] and not any(
            _same(row, other, candidates, options) for other in taken[kind]
        ):
            taken[kind].append(row)
            rows.append(row)
        lacking = [each for each in places if len(taken[each]) < places[each]]
        if not lacking or (number >= _FARTHEST and set(lacking) <= set(_LANGUAGES)):
            break
    return rows


def _kind(candidates: Candidates, row: int) -> str:
    """Whose place a row takes: a constraint's, a program's of its language, or a hint's."""
    if candidates.types[row] == _CONSTRAINT:
        return "constraint"
    language = (candidates.effect(row) or {}).get("language") if candidates.programs[row] else ""
    return language if language in _LANGUAGES else "hint"


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
