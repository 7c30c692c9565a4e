"""Growable postings: which row has which word how often, and BM25 from them.

Each word owns one stretch of a shared pool, ordered by row; a stretch that is full moves to the pool's end with
twice the room. So adding a text costs little at any size, and all of it is a few flat arrays.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from gvla2.memory.indexing.growing import grown
from gvla2.memory.indexing.postings_kernels import append, remap, score, wanted

K1 = 1.2
B = 0.75
GROUPS = 3
"""Statistics are kept for that many groups of rows (lifecycle states) apart, so that any choice of them is exact."""


class Postings:
    """An inverted index of bags of words; rows are numbered by the caller, in rising order."""

    def __init__(self) -> None:
        self.words: dict[str, int] = {}
        self.start = np.zeros(0, np.int64)  # (T,) first place of each word's stretch
        self.length = np.zeros(0, np.int64)  # (T,)
        self.room = np.zeros(0, np.int64)  # (T,)
        self.holders = np.zeros((GROUPS, 0), np.int64)  # (G, T) living rows that have the word
        self.rows = np.zeros(0, np.int32)  # (P,) the pool
        self.counts = np.zeros(0, np.uint16)  # (P,)
        self.used = 0
        self.sizes = np.zeros(0, np.int32)  # (N,) words of each row
        self.documents = np.zeros(GROUPS, np.int64)  # (G,) living rows
        self.total = np.zeros(GROUPS, np.int64)  # (G,) their words

    def add(self, first: int, texts: Sequence[Sequence[str]], groups: Sequence[int]) -> None:
        """Rows ``first``, ``first + 1``, ... with these words; each row comes later than all before it."""
        if not texts:
            return
        bags = [Counter(text) for text in texts]
        terms = np.array([self._term(word) for bag in bags for word in bag], dtype=np.int64)
        counts = np.array([min(n, 65535) for bag in bags for n in bag.values()], dtype=np.uint16)
        rows = np.repeat(
            np.arange(first, first + len(bags), dtype=np.int32), [len(bag) for bag in bags]
        )  # (P,) beside ``terms``
        self._fit_words()
        room = np.zeros(len(self.words), np.int64)
        extra = wanted(terms, self.length, self.room, room)
        self.rows = grown(self.rows, self.used + extra)
        self.counts = grown(self.counts, self.used + extra)
        self.used = append(
            terms, rows, counts, room, self.start, self.length, self.room, self.rows, self.counts, self.used
        )
        last = first + len(texts)
        self.sizes = grown(self.sizes, last)
        self.sizes[first:last] = [len(text) for text in texts]
        owners = np.asarray(groups)
        np.add.at(self.holders, (owners[rows - first], terms), 1)
        np.add.at(self.documents, owners, 1)
        np.add.at(self.total, owners, self.sizes[first:last])

    def remove(self, text: Sequence[str], group: int) -> None:
        """Take a row with these words out of the statistics; its places go at the next :meth:`compact`."""
        self._count(group, Counter(text), len(text), -1)

    def move(self, text: Sequence[str], before: int, after: int) -> None:
        """A row with these words changes its group."""
        self.remove(text, before)
        self._count(after, Counter(text), len(text), 1)

    def search(
        self, words: Sequence[str], groups: Sequence[int], rows: int
    ) -> tuple[NDArray[np.float64], NDArray[np.uint16]]:
        """((N,) Okapi BM25, (N,) how many of the distinct words each row has) of the first ``rows`` rows.

        k1 = 1.2, b = 0.75; every idf is positive; statistics are those of the living rows of ``groups``.
        """
        found = np.zeros(rows, np.float64)
        hits = np.zeros(rows, np.uint16)
        known = [self.words[word] for word in sorted(set(words)) if word in self.words]
        if known:
            score(
                np.array(known, np.int64), np.array(groups, np.int64), self.holders, self.documents, self.total,
                self.start, self.length, self.rows, self.counts, self.sizes, K1, B, found, hits,
            )  # fmt: skip
        return found, hits

    def compact(self, new_row: NDArray[np.int32], kept: int) -> None:
        """Renumber: ``new_row`` (N,) gives each row's new number in the same order, -1 for one that goes."""
        alive = new_row >= 0
        self.sizes = self.sizes[: len(new_row)][alive].copy()
        pool = int(self.length.sum())
        rows, counts = np.empty(pool, np.int32), np.empty(pool, np.uint16)
        start, length = np.zeros_like(self.start), np.zeros_like(self.length)
        self.used = remap(
            new_row, self.start, self.length, self.rows, self.counts, start, length, rows, counts
        )
        held = length[: len(self.words)] > 0
        self.words = {word: i for i, word in enumerate(w for w, h in zip(self.words, held, strict=True) if h)}
        keep = np.flatnonzero(held)
        self.start, self.length = start[keep], length[keep]
        self.room = self.length.copy()
        self.holders = self.holders[:, keep].copy()
        self.rows, self.counts = rows[: self.used].copy(), counts[: self.used].copy()

    def arrays(self) -> dict[str, NDArray[np.generic]]:
        """The state, without what is only room to grow."""
        n = len(self.words)
        return {
            "start": self.start[:n], "length": self.length[:n], "room": self.room[:n],
            "holders": self.holders[:, :n], "rows": self.rows[: self.used], "counts": self.counts[: self.used],
            "documents": self.documents, "total": self.total,
        }  # fmt: skip

    @classmethod
    def restored(
        cls, words: Sequence[str], sizes: NDArray[np.int32], arrays: Mapping[str, NDArray[np.generic]]
    ) -> Postings:
        """Postings from :meth:`arrays`, the words in order and the size of each row."""
        made = cls()
        made.words = {word: i for i, word in enumerate(words)}
        for name, array in arrays.items():
            setattr(made, name, np.array(array))
        made.used, made.sizes = len(made.rows), np.array(sizes)
        return made

    def _term(self, word: str) -> int:
        return self.words.setdefault(word, len(self.words))

    def _fit_words(self) -> None:
        n = len(self.words)
        self.start, self.length, self.room = (grown(a, n) for a in (self.start, self.length, self.room))
        if self.holders.shape[1] < n:
            wider = np.zeros((GROUPS, len(self.start)), np.int64)
            wider[:, : self.holders.shape[1]] = self.holders
            self.holders = wider

    def _count(self, group: int, bag: Mapping[str, int], size: int, sign: int) -> None:
        if bag:
            # The words of one bag differ, so each place is added to once.
            self.holders[group, [self.words[word] for word in bag]] += sign
        self.documents[group] += sign
        self.total[group] += sign * size
