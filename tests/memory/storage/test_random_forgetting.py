"""Merges, contradictions and forgetting in any order: the chain holds, and the rows are what it says."""

import os
import random
import tempfile
from collections.abc import Callable
from dataclasses import replace

import pytest

from gvla2.memory.contracts import MemoryTask
from gvla2.memory.events import StoredEpisode
from gvla2.memory.records import Record
from gvla2.memory.store import Store
from gvla2.memory.transaction import Transaction
from tests.memory.looking import look

NOW = 1.8e9
MEMORY_DISK = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
IDS = ("alpha-1", "beta-22", "gamma-3", "delta-4", "omega-5")
TASKS = ("do one", "do two", "do three")
WORDS = ("lift the cup gently by its handle", "turn the big wheel slowly", "press the red lamp twice")
KINDS = ("dismissed", "conflict")
OPERATIONS = ("put", "put", "put", "link", "link", "forget", "decide", "episode")


def link(t: Transaction, source: str, kind: str, target: str) -> None:
    known = {(k.source, k.kind, k.target) for k in t.links([source])}
    if (source, kind, target) not in known and t.get(source) and t.get(target):
        t.link(source, kind, target, f"as {target} says")


def do(t: Transaction, draw: random.Random, make: Callable[..., Record]) -> None:
    operation, (id, other) = draw.choice(OPERATIONS), draw.sample(IDS, 2)
    known, kind, task = t.get(id), draw.choice(KINDS), draw.choice(TASKS)
    if operation == "put":
        sources = f'{{"sources":["run/{draw.randrange(3)}"]}}'
        record = known or make(id, query=task, content=f"{draw.choice(WORDS)} {id[0]}", provenance=sources)
        notes = ("", f"replaced by {other}", f"it contradicts {other}")
        t.put(
            replace(
                record,
                query="\n".join(dict.fromkeys([*record.query.split("\n"), task])),
                note=draw.choice(notes),
                state=draw.choice(["active", "archive"]),
                count=record.count + 1,
            ),
            action=draw.choice(["ADD", "REPLACED", "MERGE"]),
            why=draw.choice(["", f"outweighs {other}"]),
        )
    elif operation == "link":
        link(t, id, kind, other)
    elif operation == "forget":
        t.forget(id)
    elif operation == "decide":
        t.decide("DISCARD", draw.choice(["", id]), why=f"{other} says it already")
    elif operation == "episode":
        t.save_episode(StoredEpisode(f"run/{draw.randrange(3)}", t.now, MemoryTask("q"), records=(id,)))


@pytest.mark.parametrize("seed", range(24))
def test_any_order(seed: int, record: Callable[..., Record]) -> None:
    draw = random.Random(seed)
    with (
        tempfile.TemporaryDirectory(dir=MEMORY_DISK) as folder,
        Store.open(f"sqlite:///{folder}/m.db") as store,
    ):
        for step in range(draw.randint(2, 8)):
            with store.writing("b", actor="random", now=NOW + step) as t:
                for _ in range(draw.randint(1, 6)):
                    do(t, draw, record)
            assert look(store, "b").verify() == []
            living = {r.id for r in look(store, "b").records()}
            gone = set(t.forgotten) - living
            assert not [
                e for e in look(store, "b").events() if e.record in gone and e.change and e.action != "forget"
            ]
