"""The cost of maintaining a bank: one candidate among many records, and a pass of governance."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from statistics import median

from gvla2.evaluation.memory.corpus import lessons
from gvla2.evaluation.memory.figure import Figure
from gvla2.evaluation.memory.plain_peer import PeerLesson
from gvla2.evaluation.memory.setting import NOW, Setting, admissions, high, once, spent
from gvla2.memory.bank import BankOptions
from gvla2.memory.governance import Governed

PEER_GOVERNS = 1_000
"""Records up to which the peer's pass is run: it compares each with each."""


def consolidation(setting: Setting, size: int, on: str) -> Mapping[str, Figure]:
    """One durable admit among the bank's records: compared, decided, written; the peer only decides."""
    count = setting.count(200, 20)
    items = admissions(count + 5, setting.seed + 3)
    with setting.copied(size, BankOptions(active_budget=10 * size)) as bank:
        for lesson, verdict, task, _ in items[count:]:
            bank.admit(lesson, verdict, task=task, trusted=True)
        times = spent(lambda item: bank.admit(item[0], item[1], task=item[2], trusted=True), items[:count])
    few = [PeerLesson.of(record) for record in lessons(3, setting.seed + 3, now=NOW)]
    peer, known = setting.plain, setting.peer_lessons(size)
    theirs = median(spent(lambda lesson: peer.place(lesson, known), few))
    note = f"p95 of {count} durable admits, p50 {1e3 * median(times):.1f} ms; the peer decides {len(few)}, in memory"
    return {"consolidation": Figure(1e3 * high(times), peer.name, 1e3 * theirs, note)}


def governance(setting: Setting, size: int, on: str) -> Mapping[str, Figure]:
    """A whole pass over a bank that has never been governed, with a budget of nine tenths of it."""
    budget = max(1, 9 * size // 10)
    with setting.copied(size, BankOptions(active_budget=budget)) as bank:
        bank.recall("warm up")  # build the index, as in a bank in use
        done: list[Governed] = []
        seconds = once(lambda: done.append(bank.govern()))
        active = bank.stats()["states"].get("active", 0)
    note = f"{done[0].changes:,} changes, {active:,} active afterwards"
    if size > PEER_GOVERNS:
        return {
            "governance": Figure(seconds, note=f"{note}; the peer is not run: it compares each with each")
        }
    peer = setting.plain
    theirs = once(partial(peer.govern, setting.peer_lessons(size), budget, NOW))
    return {"governance": Figure(seconds, peer.name, theirs, note)}
