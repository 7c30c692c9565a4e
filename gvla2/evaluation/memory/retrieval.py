"""How long recall takes from end to end, whether it is exact, and how soon a bank is ready."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path

import numpy as np

from gvla2.evaluation.memory.corpus import tasks
from gvla2.evaluation.memory.figure import Figure, Row, Test
from gvla2.evaluation.memory.peers import Peer
from gvla2.evaluation.memory.setting import NOW, Setting
from gvla2.evaluation.memory.timing import high, middle, once, spent
from gvla2.memory.bank import KnowledgeBank
from gvla2.memory.indexing.index import Index
from gvla2.memory.retrieval.hashing import HashEmbedder
from gvla2.memory.storage.store import Store

QUERIES = 300
PEER_LOOKS = 100_000
"""Records that a peer may look through for one figure; at least three queries are asked."""
BRUTE = "numpy, brute force"


def recall_times(setting: Setting, size: int, on: str) -> Mapping[str, Figure]:
    """Rev check, embedding, ranking, rendering: ``KnowledgeBank.recall`` as planners call it."""
    asked = tasks(setting.count(QUERIES, 50))
    few = asked[: min(len(asked), max(3, min(20, PEER_LOOKS // size)))]
    with KnowledgeBank(setting.filled(size), clock=lambda: NOW) as bank:
        for task in asked[:5]:
            bank.recall(task)
        ours = high(spent(bank.recall, asked))
    lessons, theirs = setting.peer_lessons(size), dict[str, float]()
    for place, peer in enumerate(setting.peers()):
        setting.tell(0.6 + 0.2 * place, peer.name)
        folder = setting.folder / f"peer-{place}-{size}"
        peer.fill(folder, lessons)
        theirs[peer.name] = 1e3 * high(_asked(peer, folder, [task.query for task in few]))
    note = f"{len(asked)} queries, peers {len(few)}"
    return {"retrieval_p95": Figure.beside(1e3 * ours, theirs, note=note)}


def _asked(peer: Peer, folder: Path, queries: list[str]) -> list[float]:
    return spent(lambda query: peer.retrieve(folder, query, 3, NOW), queries)


def exactness(setting: Setting, size: int, on: str) -> Mapping[str, Figure]:
    """The ten nearest by the index against those of float32 cosines over all rows."""
    embedder = HashEmbedder()
    asked = embedder.embed([task.query for task in tasks(setting.count(200, 50))])
    vectors, records = setting.vectors(size), setting.records(size)
    with Store.open(setting.filled(size)) as store:
        index = Index(store, "default", embedder)
        index.refresh()
        found: list[list[str]] = []
        quick = spent(lambda v: found.append([index.record(r).id for r in index.nearest(v, 10)[0]]), asked)
    truth: list[list[str]] = []
    slow = spent(lambda v: truth.append([records[i].id for i in _nearest(vectors, v)]), asked)
    shares = [
        len(set(mine) & set(right)) / max(len(right), 1) for mine, right in zip(found, truth, strict=True)
    ]
    note = f"{len(asked)} queries; {1e3 * middle(quick):.2f} ms, by brute force {1e3 * middle(slow):.2f} ms"
    return {"recall_at_10": Figure(float(np.mean(shares)), BRUTE, 1.0, note=note)}


def _nearest(vectors: np.ndarray, vector: np.ndarray) -> np.ndarray:
    return np.argsort(-(vectors @ vector), kind="stable")[:10]


def start(setting: Setting, size: int, on: str) -> Mapping[str, Figure]:
    """A new process's first query has to wait for this; the peer's reading of its file is what it does each time."""
    url, path = setting.filled(size), setting.folder / f"start-{size}.index"
    with Store.open(url) as store:
        first = Index(store, "default", HashEmbedder(), snapshot=path)
        whole = once(first.refresh)
        first.save()
        setting.tell(0.5, "snapshot saved")
        ours = middle(
            [once(Index(store, "default", HashEmbedder(), snapshot=path).refresh) for _ in range(3)]
        )
    path.unlink(missing_ok=True)
    lessons, theirs = setting.peer_lessons(size), dict[str, float]()
    for place, peer in enumerate(setting.peers()):
        folder = setting.folder / f"peer-{place}-{size}"
        peer.fill(folder, lessons)
        theirs[peer.name] = once(partial(peer.load, folder))
    note = f"without a snapshot {whole:.2f} s; the peer reads its file for each query"
    return {"start": Figure.beside(ours, theirs, note=note)}


def tests() -> list[Test]:
    """The tests of this file."""
    made = [
        Test(
            "retrieval",
            (Row("retrieval_p95", "Recall, end to end, p95", "ms", "lower", goal, 3),),
            recall_times,
            size,
            least=least,
            seconds=seconds,
        )
        for size, least, goal, seconds in (
            (1_000, 50, 0.3, 6.0),
            (10_000, 100, 0.5, 45.0),
            (100_000, 200, 5.0, 100.0),
        )
    ]
    row = Row("recall_at_10", "Recall@10 against brute force", "share", "higher", 1.0, 4)
    made.append(Test("exactness", (row,), exactness, 100_000, least=200, seconds=15.0))
    row = Row("start", "Start from a snapshot", "s", "lower", 1.0, 3)
    made.append(Test("start", (row,), start, 100_000, least=200, seconds=15.0))
    return made
