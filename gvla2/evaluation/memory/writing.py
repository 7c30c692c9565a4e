"""Durable write speed of a bank, one by one and in batches, and of its store alone."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np

from gvla2.evaluation.memory.figure import Figure, FigureRow, Test
from gvla2.evaluation.memory.plain_peer import PeerLesson
from gvla2.evaluation.memory.setting import NOW, Setting, admissions
from gvla2.evaluation.memory.timing import middle, spent
from gvla2.memory.bank import KnowledgeBank
from gvla2.memory.records import Record
from gvla2.memory.storage.audit import audit
from gvla2.memory.storage.store import Store
from gvla2.memory.storage.writing import Put

PATIENCE = 8.0
"""Time limit of the peer for one rate, seconds."""
BATCH = 2000
Thing = TypeVar("Thing")


def admits(setting: Setting, size: int, on: str) -> Mapping[str, Figure]:
    """Lessons through the whole of admission and consolidation, each on disk before the next, or many at a time."""
    batched = on == "in batches"
    items = admissions(size + 20, setting.seed + 1)
    with KnowledgeBank(setting.url(f"admits-{batched}"), clock=lambda: NOW) as bank:
        bank.admit_many(items[size:], trusted=True)  # compiles and opens what the first admit needs
        began = time.perf_counter()
        if batched:
            bank.admit_many(items[:size], trusted=True)
        else:
            for lesson, verdict, task, source in items[:size]:
                bank.admit(lesson, verdict, task=task, source=source, trusted=True)
        rate = size / (time.perf_counter() - began)
    lessons, step = setting.peer_lessons(size), 100 if batched else 1
    peer, folder = setting.plain, setting.folder / f"admitting-{batched}"
    peer.fill(folder, [])
    parts = [lessons[i : i + step] for i in range(0, size, step)]
    done, seconds = _until(partial(peer.admit, folder), parts, PATIENCE * max(setting.scale, 0.05))
    admitted = min(done * step, size)
    note = f"the peer: its first {admitted:,}, not flushed to disk"
    name = "admits_batched" if batched else "admits_single"
    return {name: Figure(rate, peer.name, admitted / seconds, note)}


def puts(setting: Setting, size: int, on: str) -> Mapping[str, Figure]:
    """Records with vectors and events straight into the store, without deciding anything."""
    vector = np.random.default_rng(setting.seed).normal(size=512).astype(np.float32)
    records = setting.records(9 * size)
    with Store.open(setting.url("puts")) as store:

        def put(record: Record) -> None:
            with store.writing("default", actor="bench", now=NOW) as transaction:
                transaction.put(record, vector, model="m", action="add")

        put(records[-1])
        single = size / sum(spent(put, records[:size]))
        many = records[size:-1]
        began = time.perf_counter()
        for start in range(0, len(many), BATCH):
            with store.writing("default", actor="bench", now=NOW) as transaction:
                transaction.put_many(
                    [Put(record, "add", vector, "m") for record in many[start : start + BATCH]]
                )
        batched = len(many) / (time.perf_counter() - began)
        rev = middle(spent(store.rev, ["default"] * setting.count(5000, 500)))
        began = time.perf_counter()
        with store.reading("default") as view:
            problems = len(audit(view))
        verified = time.perf_counter() - began
    lessons = [PeerLesson.of(record) for record in records]
    appended = [_append(setting.folder / "appended.jsonl", lessons[:size], 1)]
    appended.append(_append(setting.folder / "appended.jsonl", lessons[size:-1], BATCH))
    peer, note = "JSONL, flushed to disk", "the peer appends lines, without vectors, history or readers"
    total = len(records)
    return {
        "puts_single": Figure(single, peer, appended[0], note=note),
        "puts_batched": Figure(batched, peer, appended[1], note=note, n=len(many)),
        "rev": Figure(1e6 * rev, note="what each query asks first", n=total),
        "verify": Figure(
            verified, note=f"{problems} problems; chain, payloads, rows against events", n=total
        ),
    }


def _append(path: Path, lessons: Sequence[PeerLesson], batch: int) -> float:
    """Lines a second, flushed and synchronised after each batch."""
    began = time.perf_counter()
    with path.open("a", encoding="utf-8") as file:
        for start in range(0, len(lessons), batch):
            part = lessons[start : start + batch]
            file.writelines(json.dumps(asdict(lesson), ensure_ascii=False) + "\n" for lesson in part)
            file.flush()
            os.fsync(file.fileno())
    return len(lessons) / (time.perf_counter() - began)


def _until(work: Callable[[Thing], object], things: Sequence[Thing], seconds: float) -> tuple[int, float]:
    """The number processed within the time limit, and the time taken."""
    began = time.perf_counter()
    done = 0
    for thing in things:
        work(thing)
        done += 1
        if time.perf_counter() - began > seconds:
            break
    return done, time.perf_counter() - began


def tests() -> list[Test]:
    """The tests of this file."""
    single = FigureRow("admits_single", "Durable admits", "/s", "higher", 1000.0, 0)
    batched = FigureRow("admits_batched", "Durable admits", "/s", "higher", 5000.0, 0)
    store = (
        FigureRow("puts_single", "Store alone, one by one", "/s", "higher", 1300.0, 0),
        FigureRow("puts_batched", "Store alone, in batches", "/s", "higher", 8000.0, 0),
        FigureRow("rev", "Checking the store for changes", "us", "lower", 40.0, 1),
        FigureRow("verify", "Verifying a whole bank", "s", "lower", None, 2),
    )
    return [
        Test("admits", (single,), admits, 2000, least=30, on="one by one"),
        Test("admits", (batched,), admits, 10_000, least=60, on="in batches"),
        Test("store", store, puts, 2000, least=30),
    ]
