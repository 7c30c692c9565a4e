"""Whether anything is lost: many processes that write at once, and processes that are killed while they write."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import numpy as np
from crash_harness import BANK, SHARED, in_processes, lesson, whole_lines
from figure import Figure, FigureRow, Test
from plain_peer import FILE
from postgres_server import postgres
from setting import NOW, Setting

from gvla2.memory.audit import audit
from gvla2.memory.records import Record
from gvla2.memory.store import Store

PROCESSES = 8
PEER_EACH = 100
"""Writes of each of the plain peer's processes: each of them writes its whole file."""


def writers(setting: Setting, size: int, on: str) -> Mapping[str, Figure]:
    """All processes write records of their own, and raise one shared count; acknowledged writes must all be there."""
    with _database(setting, on, "crowd") as url:
        with (
            Store.open(url, busy_seconds=60) as store,
            store.writing(BANK, actor="bench", now=NOW) as transaction,
        ):
            transaction.put(lesson(SHARED), action="add")
        job = {"do": "crowd", "kind": "bank", "place": url, "processes": PROCESSES, "each": size}
        answer = in_processes(job)
        with Store.open(url) as store:
            stored, problems = stored_and_problems(store)
    ids = [id for id, _ in answer["said"]]
    raised = stored.pop(SHARED).count - 1
    lost = len(set(ids) - stored.keys()) + max(len(ids) - raised, 0)
    twice = len(stored) - len({record.rev for record in stored.values()}) + max(raised - len(ids), 0)
    rate = f"{len(ids) / answer['seconds']:,.0f}/s"
    note = f"{len(ids):,} of {PROCESSES * size:,} acknowledged, {rate}; {problems} problems"
    peer = _plain_crowd(setting, min(size, PEER_EACH))
    waited = [seconds for _, seconds in answer["said"]]
    return {
        "writers_lost": _of(setting, lost + PROCESSES * size - len(ids), PROCESSES * size, peer[0], note),
        "writers_duplicated": _of(setting, twice, len(ids), peer[1], note),
        "writers_p99": Figure(
            float(np.percentile(waited, 99)), setting.plain.name, peer[2], note=note, n=PROCESSES * size
        ),
    }


def stored_and_problems(store: Store) -> tuple[dict[str, Record], int]:
    """What is stored, by id, and how many problems an audit finds."""
    with store.reading(BANK) as view:
        return {record.id: record for record in view.records()}, len(audit(view))


def _of(setting: Setting, count: int, whole: int, peer: float, note: str) -> Figure:
    return Figure(100 * count / max(whole, 1), setting.plain.name, peer, note=note, n=whole)


def _plain_crowd(setting: Setting, each: int) -> tuple[float, float, float]:
    """Per cent lost, per cent duplicated, and p99 of the plain peer."""
    folder = setting.folder / "plain-crowd"
    folder.mkdir(exist_ok=True)
    answer = in_processes(
        {"do": "crowd", "kind": "plain", "place": str(folder), "processes": PROCESSES, "each": each}
    )
    ids = [id for id, _ in answer["said"]]
    kept = Counter(record.id for record in whole_lines(folder / FILE))
    lost, twice = len(set(ids) - kept.keys()), sum(kept.values()) - len(kept)
    return (
        100 * lost / len(ids),
        100 * twice / len(ids),
        float(np.percentile([seconds for _, seconds in answer["said"]], 99)),
    )


def kills(setting: Setting, size: int, on: str) -> Mapping[str, Figure]:
    """Writers are killed with SIGKILL at random instants, one after the other."""
    with _database(setting, on, "kills") as url:
        Store.open(url).close()
        job = {"do": "kills", "kind": "bank", "place": url, "times": size, "seed": setting.seed}
        said = {id for id, _ in in_processes(job)["said"]}
        with Store.open(url) as store:
            stored, problems = stored_and_problems(store)
    folder = setting.folder / "plain-kills"
    folder.mkdir(exist_ok=True)
    job = {"do": "kills", "kind": "plain", "place": str(folder), "times": size, "seed": setting.seed}
    peers = {id for id, _ in in_processes(job)["said"]}
    kept = {record.id for record in whole_lines(folder / FILE)}
    note = f"{len(said):,} acknowledged by {size} writers, the peer's {len(peers):,}; {problems} problems afterwards"
    return {
        "kills_lost": Figure(
            float(len(said - stored.keys())), setting.plain.name, float(len(peers - kept)), note=note
        )
    }


@contextmanager
def _database(setting: Setting, on: str, name: str) -> Iterator[str]:
    if on == "postgresql":
        with postgres() as url:
            yield url
    else:
        yield setting.url(name)


def tests() -> list[Test]:
    """The tests of this file."""
    crowd = (
        FigureRow("writers_lost", f"{PROCESSES} processes write: lost", "%", "lower", 0.0),
        FigureRow("writers_duplicated", f"{PROCESSES} processes write: duplicated", "%", "lower", 0.0),
        FigureRow("writers_p99", f"{PROCESSES} processes write: p99", "s", "lower", 1.0, 3),
    )
    killed = (FigureRow("kills_lost", "kill -9: acknowledged and lost", "records", "lower", 0.0, 0),)
    made = []
    for on in ("sqlite", "postgresql"):
        made.append(Test("writers", crowd, writers, 1000, least=10, on=on))
        made.append(Test("kills", killed, kills, 200, least=4, on=on))
    return made
