"""Durable write speed of a bank, one by one and in batches, and of its store alone."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from statistics import median
from typing import TypeVar

import numpy as np

from gvla2.evaluation.memory.figure import Figure
from gvla2.evaluation.memory.plain_peer import PeerLesson
from gvla2.evaluation.memory.setting import NOW, Admission, Setting, admissions, once, spent
from gvla2.memory.audit import audit
from gvla2.memory.bank import KnowledgeBank
from gvla2.memory.records import Record
from gvla2.memory.store import Store
from gvla2.memory.writing import Put

PATIENCE = 8.0
"""Time limit of the peer for one rate, seconds."""
BATCH = 2000
Thing = TypeVar("Thing")


def admits(setting: Setting, size: int, on: str) -> Mapping[str, Figure]:
    """Lessons through the whole of admission and consolidation, each on disk before the next, or many at a time."""
    batched = on == "in batches"
    items = admissions(size + 20, setting.seed + 1)
    with KnowledgeBank(setting.url(f"admits-{batched}"), clock=lambda: NOW) as bank:

        def admit(part: Sequence[Admission]) -> None:
            if batched:
                bank.admit_many(part, trusted=True)
            else:
                ((lesson, verdict, task, source),) = part
                bank.admit(lesson, verdict, task=task, source=source, trusted=True)

        bank.admit_many(items[size:], trusted=True)  # compiles and opens what the first admit needs
        rate, _ = _rate(admit, items[:size], size if batched else 1)
    peer, folder = setting.plain, setting.folder / f"admitting-{batched}"
    peer.fill(folder, [])
    lessons, patience = setting.peer_lessons(size), PATIENCE * max(setting.scale, 0.05)
    theirs, admitted = _rate(partial(peer.admit, folder), lessons, 100 if batched else 1, patience)
    note = f"the peer: its first {admitted:,}, not flushed to disk"
    return {"admits_batched" if batched else "admits_single": Figure(rate, peer.name, theirs, note)}


def puts(setting: Setting, size: int, on: str) -> Mapping[str, Figure]:
    """Records with vectors and events straight into the store, without deciding anything.

    The peer appends lines, flushed and synchronised after each batch.
    """
    vector = np.random.default_rng(setting.seed).normal(size=512).astype(np.float32)
    records = setting.records(9 * size)
    ways = {"puts_single": (records[:size], 1), "puts_batched": (records[size:-1], BATCH)}
    note = "the peer appends lines, without vectors, history or readers"
    figures: dict[str, Figure] = {}
    problems: list[object] = []
    appended = setting.folder / "appended.jsonl"
    with Store.open(setting.url("puts")) as store, appended.open("a", encoding="utf-8") as file:

        def put(part: Sequence[Record]) -> None:
            with store.writing("default", actor="bench", now=NOW) as transaction:
                transaction.put_many([Put(record, "add", vector, "m") for record in part])

        def append(part: Sequence[PeerLesson]) -> None:
            file.writelines(json.dumps(asdict(lesson), ensure_ascii=False) + "\n" for lesson in part)
            file.flush()
            os.fsync(file.fileno())

        put(records[-1:])
        for name, (part, batch) in ways.items():
            ours, many = _rate(put, part, batch)
            theirs, _ = _rate(append, [PeerLesson.of(record) for record in part], batch)
            figures[name] = Figure(ours, "JSONL, flushed to disk", theirs, note, many)
        rev = median(spent(store.rev, ["default"] * setting.count(5000, 500)))
        with store.reading("default") as view:
            verified = once(lambda: problems.extend(audit(view)))
    told = f"{len(problems)} problems; chain, payloads, rows against events"
    figures["rev"] = Figure(1e6 * rev, note="what each query asks first", n=len(records))
    figures["verify"] = Figure(verified, note=told, n=len(records))
    return figures


def _rate(
    work: Callable[[Sequence[Thing]], object], things: Sequence[Thing], batch: int, patience: float = math.inf
) -> tuple[float, int]:
    """How many a second ``work`` takes in batches, and how many it got before ``patience`` seconds were over."""
    done, seconds = 0, 0.0
    while done < len(things) and seconds < patience:
        part = things[done : done + batch]
        seconds += once(partial(work, part))
        done += len(part)
    return done / seconds, done
