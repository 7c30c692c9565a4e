"""The records that a retriever ranks."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gvla2.memory.records import Record
from gvla2.memory.text import subqueries, terms

Array = NDArray[np.float64]
UNSEEN = 10
"""Pseudo-records added to a bank's count: in a small bank every word would be rare."""


class HeldRecord:
    """A record in RAM with its unit (D,) ``vector``, or zero, and how many others contradict it."""

    __slots__ = ("conflicts", "record", "terms", "vector")

    def __init__(self, record: Record, vector: NDArray[np.float32], conflicts: int = 0) -> None:
        self.record, self.vector, self.conflicts = record, vector, conflicts
        self.terms = terms(record.text)


class Candidates:
    """The N records that a retriever ranks, by id; row i is the same record for all methods.

    ``now`` is the reference time of ages, seconds since the epoch. :func:`gvla2.testing.candidates` makes small ones
    for the tests of a retriever.
    """

    def __init__(self, held: Sequence[HeldRecord], now: float) -> None:
        self._held, self.now = sorted(held, key=lambda one: one.record.id), now

    def __len__(self) -> int:
        return len(self._held)

    def __getitem__(self, row: int) -> HeldRecord:
        """A row with its vector and number of contradicting records."""
        return self._held[row]

    def record(self, row: int) -> Record:
        """The whole record of a row."""
        return self._held[row].record

    @cached_property
    def vectors(self) -> NDArray[np.float32]:
        """(N, D) embeddings; must not be changed."""
        return np.stack([one.vector for one in self._held]) if self._held else np.zeros((0, 0), np.float32)

    def of_skill(self, skill: str) -> NDArray[np.bool_]:
        """(N,) the records of this skill or of none; all of them for ""."""
        return np.array([not skill or one.record.skill in ("", skill) for one in self._held], np.bool_)

    def cosine(self, vector: NDArray[np.float32]) -> Array:
        """(N,) cosine with a unit (D,) vector, 0 if a record has none by this model."""
        return (self.vectors @ vector if len(self) else np.zeros(0)).astype(np.float64)

    def lexical(self, query: str) -> Array:
        """(N,) share in [0, 1] of the information of the query, or of one of its sentences, in each record's words.

        This is BM25 with k1 = 0: each term of the query that a record has counts by its idf, once. A lesson or a turn
        of a conversation is a sentence or two, in which repetition adds nothing and length means little: on LoCoMo's
        evidence turns, recall@10 of half BM25 and half cosine is .64 with k1 = 0 and .56 to .60 with k1 = 1.2 (static
        vectors; both divided by the query's maximum, so that scores of different queries are comparable).
        """
        asked = subqueries(query)
        if not asked or not self._held:
            return np.zeros(len(self))
        every = sorted(asked[0])  # the whole query's, which include those of its sentences
        has = np.array([[term in one.terms for one in self._held] for term in every])  # (T, N)
        holders = np.count_nonzero(has, axis=1)
        idf = np.log1p((len(self) + UNSEEN - holders + 0.5) / (holders + 0.5))  # (T,)
        weights = np.array([[term in some for term in every] for some in asked]) * idf  # (Q, T)
        shares = weights / weights.sum(axis=1, keepdims=True)
        return np.asarray(np.max([(some[:, None] * has).sum(axis=0) for some in shares], axis=0))
