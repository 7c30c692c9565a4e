"""The setting of a run's tests: a scratch folder, banks of any size, a plain peer, a clock."""

from __future__ import annotations

import gc
import sqlite3
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from timeit import timeit
from typing import TypeVar

import numpy as np
from corpus import lessons
from plain_peer import PeerLesson, PlainPeer

from gvla2.memory.bank import BankOptions, KnowledgeBank
from gvla2.memory.contracts import Lesson, MemoryTask, Verdict
from gvla2.memory.embedding import StaticEmbedder
from gvla2.memory.records import Record
from gvla2.memory.store import Store
from gvla2.memory.writing import Put

NOW = 1.8e9
"""The time at which everything happens, in seconds since the epoch: ages do not depend on the time of measurement."""
CHUNK = 5000

Admission = tuple[Lesson, Verdict, MemoryTask | str, str]
Item = TypeVar("Item")


@dataclass
class Setting:
    """What tests share; ``folder`` is deleted after the run."""

    folder: Path
    scale: float = 1.0
    seed: int = 0
    plain: PlainPeer = field(default_factory=PlainPeer)
    _records: list[Record] = field(default_factory=list)

    def count(self, number: int, least: int) -> int:
        """A number of repetitions at this scale."""
        return min(number, max(least, round(number * self.scale)))

    def records(self, count: int) -> list[Record]:
        """Random lessons, the same for the same count; the latest are cached."""
        if len(self._records) != count:
            self._records = lessons(count, self.seed, now=NOW)
        return self._records

    def url(self, name: str) -> str:
        """Address of a SQLite database in the scratch folder."""
        return f"sqlite:///{self.folder / name}.db"

    def filled(self, count: int) -> str:
        """Address of a bank with that many records; made once, read-only: see :meth:`copied`."""
        path = self.folder / f"filled-{count}.db"
        if not path.exists():
            records, embedder = self.records(count), StaticEmbedder()
            made = self.folder / f"filling-{count}.db"
            with Store.open(f"sqlite:///{made}") as store:
                for start in range(0, count, CHUNK):
                    part = records[start : start + CHUNK]
                    vectors = embedder.embed([record.text for record in part])
                    with store.writing("default", actor="bench", now=NOW) as transaction:
                        transaction.put_many(
                            [
                                Put(record, "add", vector, embedder.model)
                                for record, vector in zip(part, vectors, strict=True)
                            ]
                        )
            whole_copy(str(made), path)
            for left in self.folder.glob(f"filling-{count}.db*"):
                left.unlink()
        return f"sqlite:///{path}"

    @contextmanager
    def copied(self, count: int, options: BankOptions | None = None) -> Iterator[KnowledgeBank]:
        """An open bank with that many records, which may be changed; deleted afterwards."""
        copy = self.folder / f"copy-{count}.db"
        whole_copy(self.filled(count), copy)
        try:
            with KnowledgeBank(f"sqlite:///{copy}", options=options, clock=lambda: NOW) as bank:
                yield bank
        finally:
            for left in self.folder.glob(f"copy-{count}.db*"):
                left.unlink()

    def peer_lessons(self, count: int) -> list[PeerLesson]:
        """The lessons of :meth:`records` as the peer knows them."""
        return [PeerLesson.of(record) for record in self.records(count)]

    def peer_filled(self, count: int) -> Path:
        """The peer's folder with :meth:`peer_lessons`."""
        folder = self.folder / f"peer-{count}"
        self.plain.fill(folder, self.peer_lessons(count))
        return folder


def once(work: Callable[[], object]) -> float:
    """Seconds of one call, ours or the peer's; no garbage is collected in it."""
    return timeit(work, number=1)


def spent(work: Callable[[Item], object], items: Iterable[Item]) -> list[float]:
    """Seconds of each call; garbage is collected before them."""
    gc.collect()
    return [once(partial(work, item)) for item in items]


def high(times: list[float]) -> float:
    """The 95th percentile."""
    return float(np.percentile(times, 95))


def whole_copy(url: str, path: Path) -> None:
    """Write a consistent copy of a SQLite database, without its log."""
    with closing(sqlite3.connect(url.removeprefix("sqlite:///"))) as connection:
        connection.execute("VACUUM INTO ?", (str(path),))


def admissions(count: int, seed: int) -> list[Admission]:
    """Random lessons with varied verdicts, as :meth:`KnowledgeBank.admit_many` takes them."""
    return [admission(record, i) for i, record in enumerate(lessons(count, seed, now=NOW))]


def admission(record: Record, number: int) -> Admission:
    """The lesson of a record, with a verdict that fits its type; ``number`` varies the score a little."""
    failed = record.type == "failure_avoidance"
    score = 0.05 + 0.002 * (number % 97)
    criteria = {"completion": score if failed else 1 - score, "safety": 0.2 if failed else 0.9}
    task = MemoryTask(record.query, record.signature_json(), record.skill)
    lesson = Lesson(record.type, record.content)
    return lesson, Verdict.from_criteria(criteria, verifier="bench"), task, ""
