"""The candidates that a bank offers to its retriever: columns over the rows of the states that it serves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from gvla2.memory.indexing.postings_kernels import shares
from gvla2.memory.indexing.rows import STATES, Rows
from gvla2.memory.meaning.words import distinct_topics, distinct_topics_by_sentence
from gvla2.memory.records import Record
from gvla2.memory.retrieval.kernels import days_since

_ALL = np.zeros(0, np.int64)


class Served:
    """The rows of some states (and one skill), and their columns, until the next change of the rows."""

    def __init__(self, rows: Rows, states: Sequence[str], skill: str = "") -> None:
        self.rows = rows
        self.epoch = rows.epoch
        self.groups = [i for i, state in enumerate(STATES) if state in states]
        wanted = np.zeros(len(STATES) + 1, np.bool_)  # dead rows are -1, which is the last
        wanted[self.groups] = True
        mask = wanted[rows.column("state")]
        if skill:
            mask &= np.isin(rows.column("skill"), [0, rows.skills.get(skill, -1)])
        # None where every row is served: then columns need no copying.
        self.order: NDArray[np.int64] | None = None if mask.all() else np.flatnonzero(mask)
        self.count = rows.size if self.order is None else len(self.order)
        self._columns: dict[str, NDArray[Any]] = {}

    def column(self, name: str) -> NDArray[Any]:
        """(N,) a column of the rows served."""
        if name not in self._columns:
            column = self.pick(self.rows.column(name)).view()
            column.setflags(write=False)
            self._columns[name] = column
        return self._columns[name]

    def pick(self, column: NDArray[Any]) -> NDArray[Any]:
        """(N,) of a column over all rows."""
        return column if self.order is None else column.take(self.order)

    def physical(self, rows: NDArray[np.int64]) -> NDArray[np.int64]:
        """Where these candidates are among all rows."""
        return rows if self.order is None else self.order[rows]


class RowCandidates:
    """:class:`gvla2.memory.contracts.Candidates` over rows in RAM; ``now`` is in seconds since the epoch."""

    def __init__(self, served: Served, now: float) -> None:
        self._served, self._rows, self._now = served, served.rows, now
        self._asked: str | None = None
        self._found: tuple[NDArray[np.float64], NDArray[np.float64]]

    @property
    def ids(self) -> Sequence[str]:
        """N ids, each once."""
        return _Ids(self._served)

    @property
    def confidence(self) -> NDArray[np.float64]:
        """(N,) kappa in [0, 1]."""
        return self._served.column("confidence")

    @cached_property
    def ages(self) -> NDArray[np.float64]:
        """(N,) days since the last update; never negative."""
        ages = np.empty(self._served.count)
        days_since(self._served.column("updated"), self._now, ages)
        return ages

    @property
    def usage(self) -> NDArray[np.int64]:
        """(N,) credited uses."""
        return self._served.column("usage")

    @property
    def conflicts(self) -> NDArray[np.int64]:
        """(N,) how many records contradict each."""
        return self._served.column("conflicts")

    @property
    def outcomes(self) -> NDArray[np.int8]:
        """(N,) places in ``OUTCOMES``."""
        return self._served.column("outcome")

    @property
    def types(self) -> NDArray[np.int8]:
        """(N,) places in ``TYPES``."""
        return self._served.column("type")

    @property
    def wordings(self) -> NDArray[np.int64]:
        """(N,) numbers, equal where contents have the same words."""
        return self._served.column("wording")

    def of_skill(self, skill: str) -> NDArray[np.bool_]:
        """(N,) the records of this skill or of none; all of them for ""."""
        if not skill:
            return np.ones(self._served.count, np.bool_)
        skills = self._served.column("skill")
        return np.asarray((skills == self._rows.skills.get(skill, -1)) | (skills == 0))

    def lexical(self, query: str) -> NDArray[np.float64]:
        """(N,) BM25 divided by its largest value."""
        return self._search(query)[0]

    def coverage(self, query: str) -> NDArray[np.float64]:
        """(N,) share of the distinct topic words of the query, or of a sentence of it."""
        return self._search(query)[1]

    def cosine(
        self, vector: NDArray[np.float32], rows: NDArray[np.int64] | None = None
    ) -> NDArray[np.float64]:
        """(N,) to within :meth:`slack`, or exact for the (K,) ``rows``."""
        if rows is None:
            return self._served.pick(self._rows.vectors.near(vector, self._rows.size))
        return self._rows.vectors.cosines(vector, self._served.physical(rows))

    def slack(self, vector: NDArray[np.float32]) -> float:
        """How far the cosines of all records may be off."""
        return self._rows.vectors.slack(vector)

    def vectors(self, rows: NDArray[np.int64]) -> NDArray[np.float32]:
        """(K, D) embeddings of these rows."""
        return self._rows.vectors.exact[self._served.physical(rows)]

    def numbers(self, name: str, rows: NDArray[np.int64] | None = None) -> NDArray[np.float64]:
        """(N,), or (K,) of ``rows``: a number of the signatures, nan where there is none."""
        if name not in self._rows.numbers:
            return np.full(self._served.count if rows is None else len(rows), np.nan)
        column = self._rows.numbers[name][: self._rows.size]
        return self._served.pick(column) if rows is None else column[self._served.physical(rows)]

    def record(self, row: int) -> Record:
        """The whole record of a row."""
        return self._rows.record(row if self._served.order is None else int(self._served.order[row]))

    def content(self, row: int) -> str:
        """What the record says."""
        return self.record(row).content

    def query(self, row: int) -> str:
        """The instructions that it came from."""
        return self.record(row).query

    def effect(self, row: int) -> Mapping[str, Any] | None:
        """The typed effect of the record."""
        return self.record(row).effect_json()

    def signature(self, row: int) -> Mapping[str, float]:
        """The geometry of the record's scene."""
        return self.record(row).signature_json()

    def _search(self, query: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        if self._asked != query:
            words, served = distinct_topics(query), self._served
            found, hits = self._rows.postings.search(words, served.groups, self._rows.size)
            self._found = np.empty(served.count), np.empty(served.count)
            order = _ALL if served.order is None else served.order
            shares(found, hits, order, max(len(words), 1), *self._found)
            for sentence in distinct_topics_by_sentence(query):
                _, hits = self._rows.postings.search(sentence, served.groups, self._rows.size)
                np.maximum(self._found[1], served.pick(hits) / len(sentence), out=self._found[1])
            self._asked = query
        return self._found


class _Ids(Sequence[str]):
    """Ids by row, without a list of all of them."""

    def __init__(self, served: Served) -> None:
        self._served = served

    def __len__(self) -> int:
        return self._served.count

    @overload
    def __getitem__(self, row: int) -> str: ...
    @overload
    def __getitem__(self, row: slice) -> list[str]: ...
    def __getitem__(self, row: int | slice) -> str | list[str]:
        if isinstance(row, slice):
            return [self[i] for i in range(*row.indices(len(self)))]
        if not -len(self) <= row < len(self):
            raise IndexError(row)
        row = int(row) % len(self)
        order = self._served.order
        return self._served.rows.ids[row if order is None else int(order[row])]
