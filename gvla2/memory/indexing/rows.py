"""The records of one bank in RAM, as columns: what retrieval ranks. It knows nothing of where they are stored."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gvla2.memory.contracts import OUTCOMES, TYPES
from gvla2.memory.indexing.growing import grown
from gvla2.memory.indexing.heap import Heap
from gvla2.memory.indexing.postings import Postings
from gvla2.memory.indexing.vectors import Vectors
from gvla2.memory.meaning.words import read_once, text_of, topic_words
from gvla2.memory.records import Record

STATES = ("provisional", "active", "summary")
"""The states held in RAM; a record of any other is dropped."""
MAX_NUMBERS = 256
"""How many names of signature numbers are compared; further ones are kept with their records and not ranked by."""
COLUMNS: dict[str, type[np.generic]] = {
    "state": np.int8,  # place in STATES, -1 for a dead row
    "type": np.int8,
    "outcome": np.int8,
    "skill": np.int32,
    "confidence": np.float64,
    "updated": np.float64,
    "usage": np.int64,
    "conflicts": np.int64,
    "wording": np.int64,
}
_DEAD = 1024


@dataclass(frozen=True)
class Entry:
    """A record with what belongs to it: its unit (D,) embedding or zero, and how many others contradict it."""

    record: Record
    vector: NDArray[np.float32]
    conflicts: int = 0


class Rows:
    """Growable columns; a changed text gets a new row, dead rows go when they are too many.

    Row numbers hold until the next change. ``epoch`` counts the changes.
    """

    def __init__(self, dimension: int) -> None:
        self.size = 0
        self.dead = 0
        self.epoch = 0
        self.ids: list[str] = []
        self.row_of: dict[str, int] = {}
        self.skills: dict[str, int] = {"": 0}
        self.columns: dict[str, NDArray[Any]] = {name: np.zeros(0, kind) for name, kind in COLUMNS.items()}
        self.numbers: dict[str, NDArray[np.float64]] = {}
        self.heap = Heap()
        self.postings = Postings()
        self.vectors = Vectors(dimension)

    def __len__(self) -> int:
        return len(self.row_of)

    def put(self, entries: Sequence[Entry]) -> None:
        """Add records, or bring them up to date; those of no served state are dropped. Each id comes once."""
        new: list[Entry] = []
        for entry in entries:
            row = self.row_of.get(entry.record.id)
            if entry.record.state not in STATES:
                self.drop([entry.record.id])
            elif row is None:
                new.append(entry)
            else:
                old = self.heap.get(row)
                if (old.query, old.content) != (entry.record.query, entry.record.content):
                    self.drop([old.id])
                    new.append(entry)
                else:
                    self._update(row, entry)
        self._append(new)
        self.epoch += 1
        if self.dead > _DEAD + len(self) // 2:
            self.compact()

    def drop(self, ids: Sequence[str]) -> None:
        """Forget these records; unknown ids are passed over."""
        for id in ids:
            row = self.row_of.pop(id, None)
            if row is not None:
                self.postings.remove(self._words(self.heap.get(row)), int(self.columns["state"][row]))
                self.columns["state"][row] = -1
                self.dead += 1
        self.epoch += 1

    def compact(self) -> None:
        """Rid all columns of dead rows; the others keep their order."""
        kept = np.flatnonzero(self.columns["state"][: self.size] >= 0)
        new_row = np.full(self.size, -1, np.int32)
        new_row[kept] = np.arange(len(kept), dtype=np.int32)
        self.postings.compact(new_row, len(kept))
        self.vectors.compact(kept)
        self.heap.compact(kept)
        self.columns = {name: column[kept] for name, column in self.columns.items()}
        numbers = {name: column[kept] for name, column in self.numbers.items()}
        self.numbers = {name: column for name, column in numbers.items() if not np.isnan(column).all()}
        self.ids = [self.ids[row] for row in kept.tolist()]
        self.row_of = {id: row for row, id in enumerate(self.ids)}
        self.size, self.dead = len(kept), 0
        self.epoch += 1

    def record(self, row: int) -> Record:
        """The record of a row."""
        return self.heap.get(row)

    def column(self, name: str) -> NDArray[Any]:
        """(N,) a column, dead rows included."""
        return self.columns[name][: self.size]

    def _append(self, new: Sequence[Entry]) -> None:
        if not new:
            return
        read = [read_once(entry.record.query, entry.record.content) for entry in new]
        first, last = self.size, self.size + len(new)
        self.columns = {name: grown(column, last) for name, column in self.columns.items()}
        self.numbers = {name: grown(column, last, math.nan) for name, column in self.numbers.items()}
        self.postings.add(
            first, [words for words, _ in read], [STATES.index(entry.record.state) for entry in new]
        )
        self.vectors.put(first, np.stack([entry.vector for entry in new]))
        self.columns["wording"][first:last] = [number for _, number in read]
        for row, entry in enumerate(new, first):
            self.ids.append(entry.record.id)
            self.row_of[entry.record.id] = row
            self.heap.put(row, entry.record)
            self._describe(row, entry)
        self.size = last

    def _update(self, row: int, entry: Entry) -> None:
        """The text stays, so only what describes it changes."""
        before, after = int(self.columns["state"][row]), STATES.index(entry.record.state)
        if before != after:
            self.postings.move(self._words(entry.record), before, after)
        if not np.array_equal(self.vectors.exact[row], entry.vector):
            self.vectors.put(row, entry.vector[None])
        self.heap.put(row, entry.record)
        self._describe(row, entry)

    def _describe(self, row: int, entry: Entry) -> None:
        record, columns = entry.record, self.columns
        columns["state"][row] = STATES.index(record.state)
        columns["type"][row] = TYPES.index(record.record_type)
        columns["outcome"][row] = OUTCOMES.index(record.verified_as)
        columns["skill"][row] = self.skills.setdefault(record.skill, len(self.skills))
        columns["confidence"][row] = record.confidence
        columns["updated"][row] = record.updated
        columns["usage"][row] = record.usage
        columns["conflicts"][row] = entry.conflicts
        for column in self.numbers.values():
            column[row] = math.nan
        for name, value in record.signature_json().items() if record.signature != "{}" else ():
            if name not in self.numbers and len(self.numbers) < MAX_NUMBERS:
                self.numbers[name] = np.full(len(columns["state"]), math.nan)
            if name in self.numbers:
                self.numbers[name][row] = value

    @staticmethod
    def _words(record: Record) -> list[str]:
        return topic_words(text_of(record.query, record.content))
