"""Which of the best records are told: each thing once, however many records say it."""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from gvla2.memory.contracts import TYPES
from gvla2.memory.indexing.candidates import Candidates
from gvla2.memory.indexing.terms import words
from gvla2.memory.records import dump
from gvla2.memory.retrieval.options import HybridOptions

_CONSTRAINT = TYPES.index("failure_avoidance")
_MOST_KINDS = 6
"""Constraints, hints, and programs of four languages: what names a fifth is passed over, so that recall is bounded."""
_FARTHEST = 256
"""So many rows are looked at for programs once the other places are filled."""


def chosen(
    ranked: Iterable[int], reliable: NDArray[np.intp], candidates: Candidates, options: HybridOptions
) -> list[int]:
    """Of the ``reliable`` rows (K,), ``ranked`` best first, those that fill the places of their kind, in that order.

    Constraints, hints and the programs of each language have places of their own: a planner reads programs of one
    language, which those of another must not crowd out. A row that says the same as one taken before is passed over.
    """
    programs = candidates.programs
    constraints = (candidates.types == _CONSTRAINT) & ~programs
    left = {"program": int(programs[reliable].sum()), "constraint": int(constraints[reliable].sum())}
    left["hint"] = len(reliable) - sum(left.values())
    places = {"constraint": options.top_k_constraints, "hint": options.top_k}
    taken: dict[str, list[int]] = {kind: [] for kind in places}
    rows: list[int] = []
    for number, row in enumerate(ranked):
        if (not left["program"] or number >= _FARTHEST) and all(
            not left[kind] or len(taken[kind]) >= places[kind] for kind in ("constraint", "hint")
        ):
            break
        kind = "program" if programs[row] else "constraint" if constraints[row] else "hint"
        left[kind] -= 1
        if kind == "program":
            kind = f"program {(candidates.effect(row) or {}).get('language')}"
            if kind not in taken and len(taken) == _MOST_KINDS:
                continue
            places[kind] = options.programs
        others = taken.setdefault(kind, [])
        if len(others) < places[kind] and not any(_same(row, other, candidates, options) for other in others):
            others.append(row)
            rows.append(row)
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
