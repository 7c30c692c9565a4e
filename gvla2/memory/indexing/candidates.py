"""What a bank offers to its retriever: columns over the rows of the states that it serves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gvla2.memory.indexing.rows import Rows
from gvla2.memory.indexing.terms import questions
from gvla2.memory.records import Record

SECONDS_PER_DAY = 86_400.0


class Candidates:
    """The N records that a retriever ranks, as parallel columns; row i is the same record in each of them.

    ``confidence``: kappa in [0, 1]; ``ages``: days since the last update, never negative; ``usage``: credited uses;
    ``conflicts``: how many records contradict each; ``outcomes``: places in ``OUTCOMES``, how each was verified;
    ``types``: places in ``TYPES``; ``programs``: which carry a program as their effect.

    Columns are read-only and hold until the index behind them changes: use them within one call of ``rank``, keep
    none. What costs time to look up for every record (texts, signatures) comes by row, on demand.
    :func:`gvla2.testing.candidates` builds small ones for the tests of a retriever. ``now`` is in seconds since the
    epoch.
    """

    def __init__(self, rows: Rows, states: Sequence[str], now: float) -> None:
        self._rows = rows
        self._served = rows.in_states(states)  # (all rows,)
        # None where every row is served: then columns need no copying.
        self._order: NDArray[np.intp] | None = None if self._served.all() else np.flatnonzero(self._served)
        self._asked: tuple[str, NDArray[np.float64]] | None = None
        self.confidence: NDArray[np.float64] = self._column("confidence")  # (N,)
        self.ages: NDArray[np.float64] = (
            np.maximum(now - self._column("updated"), 0.0) / SECONDS_PER_DAY
        )  # (N,)
        self.usage: NDArray[np.int64] = self._column("usage")  # (N,)
        self.conflicts: NDArray[np.int64] = self._column("conflicts")  # (N,)
        self.outcomes: NDArray[np.int8] = self._column("outcome")  # (N,)
        self.types: NDArray[np.int8] = self._column("type")  # (N,)
        self.programs: NDArray[np.bool_] = self._column("program")  # (N,)

    def __len__(self) -> int:
        return len(self._served) if self._order is None else len(self._order)

    def of_skill(self, skill: str) -> NDArray[np.bool_]:
        """(N,) the records of this skill or of none; all of them for ""."""
        if not skill:
            return np.ones(len(self), np.bool_)
        skills = self._column("skill")
        return np.asarray((skills == self._rows.skills.get(skill, -1)) | (skills == 0))

    def lexical(self, query: str) -> NDArray[np.float64]:
        """(N,) share of the information of the query, or of a sentence of it, that each record's words hold."""
        if self._asked is None or self._asked[0] != query:
            found = np.zeros(len(self._served))
            for asked in questions(query):
                np.maximum(found, self._rows.postings.coverage(asked, self._served), out=found)
            self._asked = query, self._pick(found)
        return self._asked[1]

    def cosine(self, vector: NDArray[np.float32]) -> NDArray[np.float64]:
        """(N,) cosine with a unit (D,) vector, 0 where a record has none of this model."""
        return self._pick(self._rows.vectors @ vector).astype(np.float64)

    def numbers(self, name: str) -> NDArray[np.float64]:
        """(N,) a number of the signatures, nan where there is none."""
        if name not in self._rows.numbers:
            return np.full(len(self), np.nan)
        return self._pick(self._rows.numbers[name][: len(self._served)])

    def record(self, row: int) -> Record:
        """The whole record of a row."""
        return self._rows.records[row if self._order is None else int(self._order[row])]

    def content(self, row: int) -> str:
        """What the record says."""
        return self.record(row).content

    def query(self, row: int) -> str:
        """The instructions that it came from."""
        return self.record(row).query

    def effect(self, row: int) -> Mapping[str, Any] | None:
        """The typed effect of the record."""
        return self.record(row).effect_json()

    def _column(self, name: str) -> NDArray[Any]:
        column = self._pick(self._rows.column(name)).view()
        column.setflags(write=False)
        return column

    def _pick(self, column: NDArray[Any]) -> NDArray[Any]:
        """(N,) of a column over all rows."""
        return column if self._order is None else column.take(self._order)
