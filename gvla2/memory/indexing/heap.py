"""Records as bytes in one piece of memory: a tenth of the cost of as many objects, and no work for the collector."""

from __future__ import annotations

import json
from operator import attrgetter

import numpy as np
from numpy.typing import NDArray

from gvla2.memory.indexing.growing import grown
from gvla2.memory.records import COLUMNS, Record

_SPARE = 1 << 20
_READ = 4096
_DECODER = json.JSONDecoder()
_VALUES = attrgetter(*COLUMNS)


class Heap:
    """One record a row; a row that is set again leaves its old bytes behind until there are too many of them."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.start = np.zeros(0, np.int64)  # (N,)
        self.size = np.zeros(0, np.int64)  # (N,) bytes, 0 for none
        self.waste = 0
        self._read: dict[int, Record] = {}

    def put(self, row: int, record: Record) -> None:
        """Set a row."""
        self._read.pop(row, None)
        stored = json.dumps(_VALUES(record)).encode()
        self.start, self.size = grown(self.start, row + 1), grown(self.size, row + 1)
        self.waste += int(self.size[row])
        self.start[row], self.size[row] = len(self.data), len(stored)
        self.data += stored
        if self.waste > _SPARE + len(self.data) // 2:
            self._tidy()

    def get(self, row: int) -> Record:
        """The record of a row; the few that are asked for again and again are kept read."""
        record = self._read.get(row)
        if record is None:
            record = self.read(row)
            if len(self._read) >= _READ:
                self._read.clear()
            self._read[row] = record
        return record

    def read(self, row: int) -> Record:
        """The record of a row, read and not kept."""
        start = int(self.start[row])
        return Record(*_DECODER.raw_decode(self.data[start : start + int(self.size[row])].decode())[0])

    def compact(self, kept: NDArray[np.int64]) -> None:
        """Keep these rows alone, in this order."""
        self._read.clear()
        self.start, self.size = self.start[kept], self.size[kept]
        self._tidy()

    def _tidy(self) -> None:
        tidy = bytearray()
        for row, (start, size) in enumerate(zip(self.start.tolist(), self.size.tolist(), strict=True)):
            self.start[row] = len(tidy)
            tidy += self.data[start : start + size]
        self.data, self.waste = tidy, 0

    @classmethod
    def restored(cls, data: bytearray, start: NDArray[np.int64], size: NDArray[np.int64]) -> Heap:
        """A heap from its three parts."""
        made = cls()
        made.data, made.start, made.size = data, start, size
        made.waste = len(data) - int(size.sum())
        return made
