"""How long recall takes from end to end, and how soon a bank is ready."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

from gvla2.evaluation.memory.corpus import tasks
from gvla2.evaluation.memory.figure import Figure
from gvla2.evaluation.memory.setting import NOW, Setting, high, once, spent
from gvla2.memory.bank import KnowledgeBank
from gvla2.memory.embedding import StaticEmbedder
from gvla2.memory.index import Index
from gvla2.memory.store import Store

QUERIES = 300
PEER_LOOKS = 100_000
"""Most records that the peer scans for one figure; at least three queries are asked."""


def recall_times(setting: Setting, size: int, on: str) -> Mapping[str, Figure]:
    """Rev check, embedding, ranking, rendering: ``KnowledgeBank.recall`` as planners call it."""
    asked = tasks(setting.count(QUERIES, 50))
    few = asked[: min(len(asked), max(3, min(20, PEER_LOOKS // size)))]
    with KnowledgeBank(setting.filled(size), clock=lambda: NOW) as bank:
        for task in asked[:5]:
            bank.recall(task)
        ours = high(spent(bank.recall, asked))
    peer, folder = setting.plain, setting.peer_filled(size)
    theirs = high(spent(lambda task: peer.retrieve(folder, task.query, 3, NOW), few))
    note = f"{len(asked)} queries, the peer {len(few)}"
    return {"retrieval_p95": Figure(1e3 * ours, peer.name, 1e3 * theirs, note)}


def start(setting: Setting, size: int, on: str) -> Mapping[str, Figure]:
    """The wait before a new process's first query; the peer reads its file each time."""
    with Store.open(setting.filled(size)) as store:
        ours = once(Index(store, "default", StaticEmbedder()).refresh)
    theirs = once(partial(setting.plain.load, setting.peer_filled(size)))
    return {"start": Figure(ours, setting.plain.name, theirs, "the peer reads its file for each query")}
