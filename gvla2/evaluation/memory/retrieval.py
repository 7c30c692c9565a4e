"""How long recall takes from end to end, and how soon a bank is ready."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path

from gvla2.evaluation.memory.corpus import tasks
from gvla2.evaluation.memory.figure import Figure, FigureRow, Test
from gvla2.evaluation.memory.peers import Peer
from gvla2.evaluation.memory.setting import NOW, Setting
from gvla2.evaluation.memory.timing import high, once, spent
from gvla2.memory.bank import KnowledgeBank
from gvla2.memory.indexing.index import Index
from gvla2.memory.retrieval.static_embedding import StaticEmbedder
from gvla2.memory.storage.store import Store

QUERIES = 300
PEER_LOOKS = 100_000
"""Most records that a peer scans for one figure; at least three queries are asked."""


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


def start(setting: Setting, size: int, on: str) -> Mapping[str, Figure]:
    """The wait before a new process's first query; the peer reads its file each time."""
    with Store.open(setting.filled(size)) as store:
        ours = once(Index(store, "default", StaticEmbedder()).refresh)
    lessons, theirs = setting.peer_lessons(size), dict[str, float]()
    for place, peer in enumerate(setting.peers()):
        folder = setting.folder / f"peer-{place}-{size}"
        peer.fill(folder, lessons)
        theirs[peer.name] = once(partial(peer.load, folder))
    return {"start": Figure.beside(ours, theirs, note="the peer reads its file for each query")}


def tests() -> list[Test]:
    """The tests of this file."""
    made = [
        Test(
            "retrieval",
            (FigureRow("retrieval_p95", "Recall, end to end, p95", "ms", "lower", goal, 3),),
            recall_times,
            size,
            least=least,
            seconds=seconds,
        )
        for size, least, goal, seconds in (
            (1_000, 50, 2.0, 6.0),
            (10_000, 100, 5.0, 45.0),
            (100_000, 200, 40.0, 100.0),
        )
    ]
    row = FigureRow("start", "Start of a bank within its budget", "s", "lower", 1.0, 3)
    made.append(Test("start", (row,), start, 10_000, least=200, seconds=15.0))
    return made
