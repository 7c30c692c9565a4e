"""What becomes of a bank that was damaged on disk: the sound records are served, the damage is named."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Mapping, Sequence, Set
from contextlib import closing
from pathlib import Path

import numpy as np
from figure import Figure, FigureRow, Test
from plain_peer import FILE
from setting import NOW, Setting, whole_copy

from gvla2.memory.bank import KnowledgeBank
from gvla2.memory.embedding import StaticEmbedder
from gvla2.memory.index import Index
from gvla2.memory.records import Record
from gvla2.memory.store import Store

KINDS = ("corrupt JSON", "not a number", "NaN vector", "short vector", "no vector at all")
_ROWS = frozenset(KINDS[:2])
"""Kinds that spoil the record itself: it must not be served. A spoilt vector is made anew from the text."""


def quarantine(setting: Setting, size: int, on: str) -> Mapping[str, Figure]:
    """Every tenth record is damaged in one of five ways, behind the store's back."""
    records = setting.records(size)
    damaged = {record.id: KINDS[i % len(KINDS)] for i, record in enumerate(records[::10])}
    path = setting.folder / "damaged.db"
    whole_copy(setting.filled(size), path)
    with closing(sqlite3.connect(path)) as connection, connection:
        for id, kind in damaged.items():
            _spoil(connection, id, kind)
    spoilt = {id for id, kind in damaged.items() if kind in _ROWS}
    sound = [record for record in records if record.id not in spoilt]
    with KnowledgeBank(f"sqlite:///{path}", clock=lambda: NOW) as bank:
        shown = [hit for record in records for hit in bank.search(record.content, 5)]
        wrong = sum(hit.record.id in spoilt or not np.isfinite(hit.score) for hit in shown)
        named = {problem.id for problem in bank.verify()}
    served = _found(path, sound)
    path.unlink()
    found = len(named & damaged.keys())
    theirs = _peer_serves(setting, size, spoilt)
    note = f"{len(damaged)} of {size:,} records damaged: " + ", ".join(KINDS)
    return {
        "quarantine_served": Figure(100 * served / len(sound), setting.plain.name, theirs, note),
        "quarantine_shown": Figure(100 * wrong / max(len(shown), 1), note=note, n=len(shown)),
        "quarantine_named": Figure(100 * found / len(damaged), note=note, n=len(damaged)),
    }


def _found(path: Path, sound: Sequence[Record]) -> int:
    """How many of these a new index offers, each as the nearest to its own words."""
    embedder = StaticEmbedder()
    vectors = embedder.embed([record.text for record in sound])
    with Store.open(f"sqlite:///{path}") as store:
        index = Index(store, "default", embedder)
        index.refresh()
        nearest = (index.nearest(vector, 1) for vector in vectors)
        return sum(
            bool(near) and near[0][0].id == record.id for near, record in zip(nearest, sound, strict=True)
        )


def _spoil(connection: sqlite3.Connection, id: str, kind: str) -> None:
    if kind == "corrupt JSON":
        connection.execute("UPDATE memory SET provenance = '{\"sources\": [' WHERE id = ?", (id,))
    elif kind == "not a number":
        connection.execute("UPDATE memory SET confidence = 'high' WHERE id = ?", (id,))
    elif kind == "NaN vector":
        (old,) = connection.execute("SELECT vector FROM memory_vector WHERE id = ?", (id,)).fetchone()
        spoilt = np.full(len(old) // 4, np.nan, np.float32).tobytes()
        connection.execute("UPDATE memory_vector SET vector = ? WHERE id = ?", (spoilt, id))
    elif kind == "short vector":
        short = np.ones(7, np.float32).tobytes()
        connection.execute("UPDATE memory_vector SET vector = ?, dimension = 7 WHERE id = ?", (short, id))
    else:
        connection.execute("UPDATE memory_vector SET vector = x'' WHERE id = ?", (id,))


def _peer_serves(setting: Setting, size: int, spoilt: Set[str]) -> float:
    """Per cent of the sound records that the peer still reads with as many lines of its file damaged."""
    peer, folder = setting.plain, setting.folder / "damaged"
    peer.fill(folder, setting.peer_lessons(size))
    lines = (folder / FILE).read_text(encoding="utf-8").splitlines()
    lines = [line[: len(line) // 2] if json.loads(line)["id"] in spoilt else line for line in lines]
    (folder / FILE).write_text("\n".join(lines) + "\n", encoding="utf-8")
    try:
        return 100 * len(peer.load(folder)) / (size - len(spoilt))
    except ValueError:
        return 0.0


def tests() -> list[Test]:
    """The tests of this file."""
    rows = (
        FigureRow("quarantine_served", "Damaged bank: sound records found", "%", "higher", 100.0, 1),
        FigureRow("quarantine_shown", "Damaged bank: damage shown", "%", "lower", 0.0, 1),
        FigureRow("quarantine_named", "Damaged bank: damage named", "%", "higher", 100.0, 1),
    )
    return [Test("quarantine", rows, quarantine, 1000, least=50)]
