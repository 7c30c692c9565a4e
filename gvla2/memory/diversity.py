"""Which of the best records are told: each thing once, however many records say it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from gvla2.memory.contracts import Candidates
from gvla2.memory.retrieval_options import HybridOptions
from gvla2.memory.words import tokens


class Chosen:
    """Fills the places for constraints and for hints from rows that are offered best first."""

    def __init__(self, candidates: Candidates, places: Mapping[bool, int], options: HybridOptions) -> None:
        self.rows: list[int] = []
        self._candidates, self._options = candidates, options
        self._left = dict(places)
        self._kept: dict[bool, list[int]] = {True: [], False: []}
        self._vectors: dict[int, NDArray[np.float32]] = {}
        self._words: dict[int, frozenset[str]] = {}
        self._about: dict[int, tuple[str, ...]] = {}

    @property
    def full(self) -> bool:
        """Whether no place is left."""
        return not any(left > 0 for left in self._left.values())

    def offer(self, row: int, *, binding: bool) -> bool:
        """Take the row where its kind has a place left and none of the rows taken says the same."""
        if self._left[binding] <= 0 or any(self._same(row, other) for other in self._kept[binding]):
            return False
        self._left[binding] -= 1
        self._kept[binding].append(row)
        self.rows.append(row)
        return True

    def _same(self, row: int, other: int) -> bool:
        """Whether two records say the same; the numbers of their effects aside, which one of them wins with."""
        wordings = self._candidates.wordings
        if wordings[row] != wordings[other]:
            if float(self._vector(row) @ self._vector(other)) <= self._options.same_cosine:
                return False
            mine, theirs = self._wording(row), self._wording(other)
            if len(mine & theirs) < self._options.same_words * len(mine | theirs):
                return False
        return self._parameter(row) == self._parameter(other)

    def _vector(self, row: int) -> NDArray[np.float32]:
        if row not in self._vectors:
            self._vectors[row] = self._candidates.vectors(np.array([row]))[0]
        return self._vectors[row]

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
