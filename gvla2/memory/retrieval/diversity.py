"""Which of the best records are told: each thing once, however many records say it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gvla2.memory.contracts import Candidates
from gvla2.memory.meaning.words import tokens
from gvla2.memory.retrieval.options import HybridOptions
from gvla2.memory.retrieval.score_tables import CONSTRAINT

_AT_ONCE = 12
"""Rows whose vectors are looked up together: about as many as are looked at."""


class _Offered(NamedTuple):
    row: int
    wording: int
    vector: NDArray[np.float32]


class Chosen:
    """Fills the places for constraints and for hints from rows that are offered best first."""

    def __init__(self, candidates: Candidates, options: HybridOptions) -> None:
        self.rows: list[int] = []
        self._candidates, self._options = candidates, options
        self._places = {True: options.top_k_constraints, False: options.top_k}
        self._taken: dict[bool, list[_Offered]] = {True: [], False: []}
        self._words: dict[int, frozenset[str]] = {}
        self._about: dict[int, tuple[str, ...]] = {}

    @property
    def full(self) -> bool:
        """Whether no place is left."""
        return all(len(self._taken[kind]) >= places for kind, places in self._places.items())

    def offer(self, rows: Sequence[int]) -> None:
        """Take the rows whose kind has a place left and that say the same as none of those taken, in their order."""
        for first in range(0, len(rows), _AT_ONCE):
            if self.full:
                return
            some = rows[first : first + _AT_ONCE]
            places = np.array(some)
            types = self._candidates.types[places].tolist()
            wordings = self._candidates.wordings[places].tolist()
            vectors = self._candidates.vectors(places)
            for k, row in enumerate(some):
                binding = types[k] == CONSTRAINT
                if len(self._taken[binding]) < self._places[binding]:
                    self._offer(_Offered(row, wordings[k], vectors[k]), self._taken[binding])

    def _offer(self, offered: _Offered, taken: list[_Offered]) -> None:
        for other in taken:
            if self._same(offered, other):
                return
        taken.append(offered)
        self.rows.append(offered.row)

    def _same(self, one: _Offered, other: _Offered) -> bool:
        """Whether two records say the same; the numbers of their effects aside, which one of them wins with."""
        if one.wording != other.wording:
            if float(one.vector @ other.vector) <= self._options.same_cosine:
                return False
            mine, theirs = self._wording(one.row), self._wording(other.row)
            if len(mine & theirs) < self._options.same_words * len(mine | theirs):
                return False
        return self._parameter(one.row) == self._parameter(other.row)

    def _wording(self, row: int) -> frozenset[str]:
        if row not in self._words:
            self._words[row] = frozenset(tokens(self._candidates.content(row)))
        return self._words[row]

    def _parameter(self, row: int) -> tuple[str, ...]:
        if row not in self._about:
            effect = self._candidates.effect(row) or {}
            self._about[row] = tuple(
                str(effect.get(name, "")) for name in ("kind", "parameter", "op", "skill")
            )
        return self._about[row]
