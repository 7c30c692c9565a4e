"""What is taken in at once is decided as if it came one by one; and an index that is brought up to date is like one
that was read anew."""

import json
import random
import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import Any

from gvla2.memory.bank import BankOptions, KnowledgeBank
from gvla2.memory.contracts import Lesson, MemoryTask, Verdict
from gvla2.memory.indexing.candidates import STATES
from gvla2.memory.indexing.index import Index
from gvla2.memory.retrieval.static_embedding import StaticEmbedder
from gvla2.memory.storage.store import Store
from tests.memory.looking import ids_of, look

Open = Callable[..., KnowledgeBank]
GOOD = Verdict.from_criteria({"done": 0.9}, verifier="v")
UNSURE = Verdict.from_criteria({"done": 0.5}, verifier="v")
Item = tuple[Lesson, Verdict, MemoryTask | str, str]


def stream(count: int) -> list[Item]:
    """Lessons of which many say the same, in other words, or the opposite, some of them from one source."""
    rng = random.Random(5)
    words = [
        "valve",
        "hinge",
        "crate",
        "lever",
        "bottle",
        "wrench",
        "panel",
        "socket",
        "basket",
        "ladle",
        "ribbon",
    ]
    items: list[Item] = []
    for i in range(count):
        thing, side = ("mug", "drawer", "lamp")[i % 3], ("left", "right")[i % 7 // 4]
        own = f"Check the {' '.join(rng.sample(words, 3))} before the {rng.choice(words)}."
        said = (
            own,
            f"Turn the {thing} to the {side} before you lift it.",
            f"Lift the {thing} {(5, 40)[i % 5 // 3]} cm, then wait.",
            f"Always lift the {thing} {(5, 40)[i % 5 // 3]} cm, then wait!",
        )[i % 4]
        kind, verdict = (("procedural_hint", GOOD), ("tool_usage", GOOD), ("tool_usage", UNSURE))[
            (i % 11) // 4
        ]
        about = MemoryTask(f"use the {thing}" if i % 4 else f"work with {rng.choice(words)}")
        items.append((Lesson(kind, said), verdict, about, f"run/{i // 9}" if i % 2 else ""))
    return items


def columns(index: Index) -> dict[str, Any]:
    """All that an index holds of each record."""
    index.refresh()
    held = index.candidates(STATES, now=2e9)
    return {
        id: (
            index.get(id),
            index.vector(id).tobytes(),  # type: ignore[union-attr]
            [column[place].item() for column in (held.confidence, held.ages, held.usage, held.conflicts)],
        )
        for place, id in enumerate(ids_of(held))
    }


def decisions(path: Path) -> list[tuple[Any, ...]]:
    """What was decided, without what tells transactions apart: within one, decisions on rows come first."""
    with sqlite3.connect(path) as connection:
        found = connection.execute(
            "SELECT action, record, target, why FROM memory_event WHERE action <> 'episode'"
            " ORDER BY record, target, seq"
        ).fetchall()
    connection.close()
    return sorted(found)


def test_many_at_once_are_decided_like_one_by_one(tmp_path: Path) -> None:
    items = stream(120)
    found = []
    for size in (1, 23):
        path = tmp_path / f"{size}.db"
        options = BankOptions(summary_size=1000)
        with KnowledgeBank(f"sqlite:///{path}", options=options, clock=lambda: 1.8e9) as bank:
            for start in range(0, len(items), size):
                bank.admit_many(items[start : start + size], trusted=True)
            assert bank.verify() == []
            links = {(link.source, link.kind, link.target) for link in look(bank.store, bank.bank).links()}
            states = {record.id: (record.state, record.count, record.note) for record in bank.records()}
        found.append((links, states, decisions(path)))
    assert found[0] == found[1]
    actions = {row[0] for row in found[0][2]}
    assert {"ADD", "MERGE", "MERGED", "link:suspicion", "link:merged"} <= actions


def test_an_index_follows_what_was_decided_as_if_it_were_read_anew(tmp_path: Path) -> None:
    url, items = f"sqlite:///{tmp_path / 'memory.db'}", stream(150)
    options = BankOptions(active_budget=40, provisional_budget=5)
    now = [1.8e9]
    with KnowledgeBank(url, options=options, clock=lambda: now[0]) as bank, Store.open(url) as store:
        for place, start in enumerate((0, 1, 2, 40, 41, 80, 81, 120)):
            end = (1, 2, 40, 41, 80, 81, 120, 150)[place]
            bank.admit_many(items[start:end], trusted=True)
            now[0] += 86400
            if place % 3 == 2:
                bank.govern()
            assert columns(bank.index) == columns(Index(store, "default", StaticEmbedder()))
        states = store.stats("default")["states"]
        assert states["archive"] > 0
        assert states["active"] <= 40


def test_links_are_made_once_and_events_follow_their_order(open_bank: Open, verdicts: Any, url: str) -> None:
    bank = open_bank()
    hint = Lesson("procedural_hint", "Lift the cup 5 cm.")
    other = Lesson("failure_avoidance", "Never lift the cup 5 cm.")
    task = "lift the cup"
    bank.admit_many(
        [(hint, verdicts["success"], task, ""), (other, verdicts["fail"], task, "")], trusted=True
    )
    assert [link.kind for link in look(bank.store, bank.bank).links()] == ["suspicion"]
    with Store.open(url) as store:
        first, second = (record.id for record in bank.records())
        with store.writing("default", actor="test", now=1.9e9) as transaction:
            link = look(bank.store, bank.bank).links()[0]
            assert not transaction.link_many({(link.source, "suspicion", link.target): ""})
            assert transaction.link_many({(first, "noted", second): "one"})
            assert not transaction.link_many({(first, "noted", second): ""})
            transaction.decide("LOOKED", first)
            assert [event.action for event in transaction.history(first)][-2:] == [
                "link:noted", "LOOKED",
            ]  # fmt: skip
        assert look(store, "default").verify() == []
        assert json.loads(look(store, "default").events()[-1].scores) == {}
