"""A bank in RAM: columns, an inverted index and vectors, which follow the store.

:class:`Index` reads the bank's ``rev`` and applies newer changes; :class:`Candidates` is what a retriever ranks.
"""

from __future__ import annotations

import logging
import math
import time
from array import array
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import MemoryStoreError
from gvla2.memory.contracts import OUTCOMES, TYPES, Embedder
from gvla2.memory.embedding import record_vectors
from gvla2.memory.records import Record
from gvla2.memory.text import questions, terms

if TYPE_CHECKING:
    from gvla2.memory.store import Store
    from gvla2.memory.view import RecordChange

STATES = ("provisional", "active", "summary")
"""The states held in RAM; a record of any other is dropped."""
SERVED = ("active", "summary")
"""The states shown to planners by default."""
MAX_NUMBERS = 256
"""Most signature numbers that are compared; further ones are stored but not used for ranking."""
_NAMES = "state", "type", "outcome", "skill", "confidence", "updated", "usage", "conflicts", "program"
_KINDS = "i1", "i1", "i1", "i4", "f8", "f8", "i8", "i8", "?"
ROW = np.dtype(list(zip(_NAMES, _KINDS, strict=True)), align=True)
"""The ranking columns. ``state`` is an index into STATES, -1 for a dead row."""
_DEAD = 1024
UNSEEN = 10
"""Pseudo-records added to a bank's count: in a small bank every word would be rare."""
SECONDS_PER_DAY = 86_400.0
_MANY = 200
"""Number of texts that may take a model more than a second."""
log = logging.getLogger(__name__)
T = TypeVar("T", bound=np.generic)


HeldRecord = tuple[Record, NDArray[np.float32], int]
"""A record with its unit (D,) embedding or zero, and how many others contradict it."""


class Postings:
    """An inverted index of sets of terms; rows are numbered by the caller, and each is added once.

    It computes BM25 with k1 = 0: each term of the query that a row has counts by its idf, once. A lesson or a turn of a
    conversation is a sentence or two, in which repetition adds nothing and length means little: on LoCoMo's evidence
    turns, recall@10 of half BM25 and half cosine is .64 with k1 = 0 and .56 to .60 with k1 = 1.2 (static vectors; both
    divided by the query's maximum, so that scores of different queries are comparable).
    """

    def __init__(self) -> None:
        self._rows: defaultdict[str, array[int]] = defaultdict(lambda: array("i"))

    def add(self, row: int, terms: Iterable[str]) -> None:
        """Add a row with these distinct terms."""
        for term in terms:
            self._rows[term].append(row)

    def coverage(self, query: Iterable[str], served: NDArray[np.bool_]) -> NDArray[np.float64]:
        """(N,) share in [0, 1] of the query's information in each row: the sum of idf of its terms.

        Statistics are those of the ``served`` rows (N,); values of the others are meaningless.
        """
        found = np.zeros(len(served))
        documents = int(np.count_nonzero(served)) + UNSEEN
        total = 0.0
        for term in query:
            held = self._rows.get(term)
            # A view of an array keeps it from growing, so it must not outlive this call.
            rows = np.frombuffer(held, np.int32) if held else np.zeros(0, np.int32)
            holders = int(np.count_nonzero(served[rows]))
            idf = math.log(1 + (documents - holders + 0.5) / (holders + 0.5))
            total += idf
            found[rows] += idf
        return found / total if total else found


class RecordRows:
    """Growable columns; a changed text gets a new row, dead rows are removed when there are too many.

    Row numbers are valid until the next change.
    """

    def __init__(self, dimension: int) -> None:
        self._dimension = dimension
        self.clear()

    def clear(self) -> None:
        """Remove all rows."""
        self.records: list[Record] = []  # dead ones, too
        self.row_of: dict[str, int] = {}
        self.skills: dict[str, int] = {"": 0}
        self._table = np.zeros(0, ROW)
        self.numbers: dict[str, NDArray[np.float64]] = {}
        self.postings = Postings()
        self._vectors = np.zeros((0, self._dimension), np.float32)

    def __len__(self) -> int:
        return len(self.row_of)

    def put(self, entries: Sequence[HeldRecord]) -> None:
        """Add or update records of held states. Each id comes once."""
        new: list[HeldRecord] = []
        for entry in entries:
            row = self.row_of.get(entry[0].id)
            if row is not None and self.records[row].text == entry[0].text:
                self._describe(row, entry)
            else:
                self.drop([entry[0].id])
                new.append(entry)
        self._append(new)
        if len(self.records) - len(self) > _DEAD + len(self) // 2:
            rows, conflicts = sorted(self.row_of.values()), self._table["conflicts"]
            kept = [(self.records[row], self._vectors[row], int(conflicts[row])) for row in rows]
            self.clear()
            self._append(kept)

    def drop(self, ids: Sequence[str]) -> None:
        """Drop these records; unknown ids are ignored."""
        for id in ids:
            row = self.row_of.pop(id, None)
            if row is not None:
                self._table["state"][row] = -1

    def column(self, name: str) -> NDArray[Any]:
        """(N,) a column, dead rows included."""
        return self._table[name][: len(self.records)]

    @property
    def vectors(self) -> NDArray[np.float32]:
        """(N, D) embeddings, dead rows included."""
        return self._vectors[: len(self.records)]

    def in_states(self, states: Sequence[str]) -> NDArray[np.bool_]:
        """(N,) which rows are in one of these states."""
        wanted = np.zeros(len(STATES) + 1, np.bool_)  # dead rows are -1, which is the last
        wanted[[STATES.index(state) for state in states if state in STATES]] = True
        return np.asarray(wanted[self.column("state")])

    def _append(self, new: Sequence[HeldRecord]) -> None:
        last = len(self.records) + len(new)
        self._table, self._vectors = _grown(self._table, last), _grown(self._vectors, last)
        self.numbers = {name: _grown(column, last, math.nan) for name, column in self.numbers.items()}
        for row, entry in enumerate(new, len(self.records)):
            record = entry[0]
            self.records.append(record)
            self.row_of[record.id] = row
            self.postings.add(row, terms(record.text))
            self._describe(row, entry)

    def _describe(self, row: int, entry: HeldRecord) -> None:
        record, self._vectors[row], conflicts = entry
        self.records[row] = record
        # Most records have no effect: their texts are not parsed for one.
        program = "program" in record.effect and (record.effect_json() or {}).get("kind") == "program"
        kinds = STATES.index(record.state), TYPES.index(record.type), OUTCOMES.index(record.outcome)
        skill = self.skills.setdefault(record.skill, len(self.skills))
        self._table[row] = (
            *kinds, skill, record.confidence, record.updated, record.usage, conflicts, program
        )  # fmt: skip
        for column in self.numbers.values():
            column[row] = math.nan
        for name, value in record.signature_json().items() if record.signature != "{}" else ():
            if name not in self.numbers and len(self.numbers) < MAX_NUMBERS:
                self.numbers[name] = np.full(len(self._table), math.nan)
            if name in self.numbers:
                self.numbers[name][row] = value


def _grown(column: NDArray[T], rows: int, fill: float = 0) -> NDArray[T]:
    """``column`` itself if it has at least ``rows`` rows, else with half as many more, of ``fill``."""
    room = max(rows, len(column) + len(column) // 2, 16) - len(column)
    if len(column) >= rows:
        return column
    return np.concatenate([column, np.full((room, *column.shape[1:]), fill, column.dtype)])


class Candidates:
    """The N records that a retriever ranks, as parallel columns; row i is the same record in each of them.

    ``confidence``: kappa in [0, 1]; ``ages``: days since the last update, never negative; ``usage``: credited uses;
    ``conflicts``: how many records contradict each; ``outcomes``: indices into ``OUTCOMES``, how each was verified;
    ``types``: indices into ``TYPES``; ``programs``: which carry a program as their effect.

    Columns are read-only and valid until the index behind them changes: use them within one call of ``rank`` only. Slow
    lookups (texts, signatures) are per row, on demand. :func:`gvla2.testing.candidates` builds small ones for the tests
    of a retriever. ``now`` is in seconds since the epoch.
    """

    def __init__(self, rows: RecordRows, states: Sequence[str], now: float) -> None:
        self._rows = rows
        self._served = rows.in_states(states)  # (all rows,)
        # None if every row is served: then columns need no copying.
        self._order: NDArray[np.intp] | None = None if self._served.all() else np.flatnonzero(self._served)
        self._asked: tuple[str, NDArray[np.float64]] | None = None
        self.confidence: NDArray[np.float64] = self._column("confidence")  # (N,)
        days = (now - self._column("updated")) / SECONDS_PER_DAY
        self.ages: NDArray[np.float64] = np.maximum(days, 0.0)  # (N,)
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
        """(N,) share of the information of the query, or of one of its sentences, in each record's words."""
        if self._asked is None or self._asked[0] != query:
            found = np.zeros(len(self._served))
            for asked in questions(query):
                np.maximum(found, self._rows.postings.coverage(asked, self._served), out=found)
            self._asked = query, self._pick(found)
        return self._asked[1]

    def cosine(self, vector: NDArray[np.float32]) -> NDArray[np.float64]:
        """(N,) cosine with a unit (D,) vector, 0 if a record has none by this model."""
        return self._pick(self._rows.vectors @ vector).astype(np.float64)

    def numbers(self, name: str) -> NDArray[np.float64]:
        """(N,) a number of the signatures, nan where there is none."""
        if name not in self._rows.numbers:
            return np.full(len(self), np.nan)
        return self._pick(self._rows.numbers[name][: len(self._served)])

    def record(self, row: int) -> Record:
        """The whole record of a row."""
        return self._rows.records[row if self._order is None else int(self._order[row])]

    def _column(self, name: str) -> NDArray[Any]:
        column = self._pick(self._rows.column(name)).view()
        column.setflags(write=False)
        return column

    def _pick(self, column: NDArray[Any]) -> NDArray[Any]:
        """(N,) of a column over all rows."""
        return column if self._order is None else column.take(self._order)


def largest(values: NDArray[np.floating[Any]], k: int, id_of: Callable[[int], str]) -> list[int]:
    """The indices of the ``k`` > 0 largest of (N,) values, N > 0, largest first; equal ones by id."""
    k = min(k, len(values))
    # Include all ties with the last of the k, so that ids decide which are left out.
    some = np.flatnonzero(values >= np.partition(values, len(values) - k)[len(values) - k])
    return sorted(some.tolist(), key=lambda i: (-values[i], id_of(i)))[:k]


class Index:
    """The provisional, active and summary records of one bank; archived ones stay only in the store.

    Records without a vector, and with ``replace`` those with one of another model, are embedded here and stored for
    other processes by :meth:`keep`. Row numbers are valid until the next :meth:`refresh` or :meth:`apply`. Not
    thread-safe.
    """

    def __init__(self, store: Store, bank: str, embedder: Embedder, *, replace: bool = False) -> None:
        self.bank = bank
        self.rev = 0
        self._store, self._embedder, self._replace = store, embedder, replace
        self._made: list[tuple[Record, NDArray[np.float32]]] = []
        self._dimension = int(embedder.embed([""]).shape[1])
        self._rows = RecordRows(self._dimension)

    def refresh(self) -> None:
        """Apply newer changes of the store's bank; quick when there are none.

        Raises :class:`~gvla2.errors.MemoryStoreError` when the store cannot be read; the index is then unchanged.
        """
        rev = self._store.rev(self.bank)
        if rev < self.rev:  # a different database replaced the known one
            self._rows.clear()
            self.rev = 0
        if rev > self.rev:
            with self._store.reading(self.bank) as view:
                rev, changes = view.rev, view.changes(self.rev)
            self.apply(changes)
        self.rev = rev

    def keep(self) -> None:
        """Store newly made vectors, if the bank is writable; not within a transaction."""
        made, self._made = self._made, []
        if made:
            with suppress(MemoryStoreError), self._store.writing(self.bank, actor="index", now=0.0) as t:
                t.save_vectors(self._embedder.model, made)

    def apply(self, changes: Iterable[RecordChange]) -> None:
        """Update rows; a record without a valid vector by this embedder's model is embedded here."""
        kept: list[RecordChange] = []
        gone: list[str] = []
        for one in changes:
            if one.record.state in STATES and one.record.type in TYPES and one.record.outcome in OUTCOMES:
                kept.append(one)
            else:  # archived, forgotten, or of an unknown kind
                gone.append(one.record.id)
        vectors = self._vectors(kept)
        try:
            self._rows.drop(gone)
            self._rows.put([(one.record, v, one.conflicts) for one, v in zip(kept, vectors, strict=True)])
        except BaseException:
            self._rows.clear()  # half applied: read all of it again
            self.rev = 0
            raise

    def candidates(self, states: Sequence[str] = SERVED, *, now: float | None = None) -> Candidates:
        """The records of these states, as a retriever ranks them.

        ``now`` is the reference time of ages, in seconds since the epoch (the machine's clock by default).
        """
        return Candidates(self._rows, states, time.time() if now is None else now)

    def nearest(
        self, vector: NDArray[np.float32], k: int, states: Sequence[str] = SERVED
    ) -> list[tuple[Record, float]]:
        """The at most ``k`` records with the largest cosine to a unit (D,) vector, with it; equal ones by id.

        A zero vector has no neighbours.
        """
        served = np.flatnonzero(self._rows.in_states(states))
        if k <= 0 or not len(served) or not vector.any():
            return []
        cosines = (self._rows.vectors @ vector)[served].astype(np.float64)
        records = self._rows.records
        best = largest(cosines, k, lambda i: records[served[i]].id)
        return [(records[served[i]], float(cosines[i])) for i in best]

    def get(self, id: str) -> Record | None:
        """The record, None if it is not in the index."""
        row = self._rows.row_of.get(id)
        return None if row is None else self._rows.records[row]

    def vector(self, id: str) -> NDArray[np.float32] | None:
        """(D,) the embedding of a record, None if it is not in the index."""
        row = self._rows.row_of.get(id)
        return None if row is None else np.array(self._rows.vectors[row])

    def count(self, state: str) -> int:
        """How many records are held in a state."""
        return int(np.count_nonzero(self._rows.in_states((state,))))

    def records(self, state: str) -> list[Record]:
        """The records held in a state, by id."""
        rows = np.flatnonzero(self._rows.in_states((state,)))
        return sorted((self._rows.records[row] for row in rows.tolist()), key=lambda record: record.id)

    def _vectors(self, changes: Sequence[RecordChange]) -> list[NDArray[np.float32]]:
        """The valid stored (D,) vectors by this embedder's model, new ones for the others."""
        model = self._embedder.model
        found = [change.vector if change.model == model else None for change in changes]
        missing = [i for i, vector in enumerate(found) if not _sound(vector, self._dimension)]
        if len(missing) > _MANY:
            message = "%d records of the bank '%s' have no vectors by %s: embedding them."
            log.info(message, len(missing), self.bank, model)
        texts = [(changes[i].record.query, changes[i].record.content) for i in missing]
        made = record_vectors(self._embedder, texts) if missing else ()
        for i, vector in zip(missing, made, strict=True):
            found[i] = sound = np.nan_to_num(np.asarray(vector, np.float32))
            if not changes[i].model or (self._replace and changes[i].model != model):
                self._made.append((changes[i].record, sound))
        return [vector for vector in found if vector is not None]


def _sound(vector: NDArray[np.float32] | None, dimension: int) -> bool:
    """Whether a stored vector may be used: finite, and of length 1 or 0."""
    if vector is None or vector.shape != (dimension,):
        return False
    square = float(vector.astype(np.float64) @ vector)
    return square == 0.0 or abs(square - 1.0) < 2e-2
