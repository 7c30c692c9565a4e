"""An examination by another hand: what a bank makes of lessons, orders and queries that nobody wrote it for."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import NamedTuple

from contradictions import rates
from examination_entries import Entry, Kind, entries
from figure import Figure, FigureRow, Test
from setting import NOW, Setting

from gvla2.memory.bank import KnowledgeBank
from gvla2.memory.contracts import Lesson, LifecycleState, Verdict

YES = Verdict.from_criteria({"completion": 0.95, "safety": 0.9}, verifier="bench")
EXAMINERS = {"first examiner": 1, "second examiner": 2, "third examiner": 3, "fourth examiner": 4}
_ALL_ROUND = ("first examiner", "second examiner")
"""The others wrote pairs that contradict each other or only seem to."""
_SAID: tuple[Kind, ...] = ("order", "honest")
_ASKED: tuple[Kind, ...] = ("query", "irrelevant")
_LIVE: tuple[LifecycleState, ...] = ("active", "summary")


class Fate(NamedTuple):
    """What became of two lessons: taken for a contradiction, made one record, how many are live, how many are told."""

    contradicted: bool
    merged: bool
    live: int
    told: int


def lessons(setting: Setting, size: int, on: str) -> Mapping[str, Figure]:
    """Pairs, each in a bank of its own: the second lesson comes from another episode than the first."""
    kinds: tuple[Kind, ...] = ("contradiction", "other", "paraphrase", "apart")
    asked = {kind: _some(entries(kind, EXAMINERS[on]), size) for kind in kinds}
    fates = {kind: [_fate(setting, entry) for entry in some] for kind, some in asked.items()}
    pairs = [
        (entry.texts[0], entry.texts[1], entry.kind == "contradiction")
        for entry in (*asked["contradiction"], *asked["other"])
    ]

    def share(kind: Kind, holds: Callable[[Fate], bool]) -> float:
        return 100 * sum(map(holds, fates[kind])) / max(len(fates[kind]), 1)

    def figure(kind: Kind, holds: Callable[[Fate], bool]) -> Figure:
        return Figure(share(kind, holds), n=len(fates[kind]))

    peer, (found, false) = setting.plain.name, rates(setting.plain.contradict, pairs)
    figures = {
        "examined_found": Figure(
            share("contradiction", lambda fate: fate.contradicted), peer, found, n=len(fates["contradiction"])
        ),
        "examined_false": Figure(
            share("other", lambda fate: fate.contradicted), peer, false, n=len(fates["other"])
        ),
    }
    if on not in _ALL_ROUND:
        return figures
    return figures | {
        "examined_once": figure(
            "paraphrase", lambda fate: not fate.contradicted and (fate.merged or fate.told == 1)
        ),
        "examined_lost": figure(
            "apart", lambda fate: not fate.contradicted and (fate.merged or fate.live < 2)
        ),
    }


def orders(setting: Setting, size: int, on: str) -> Mapping[str, Figure]:
    """Orders to machines that one source from outside brings in two verified episodes; honest lessons that it brings,
    and that another bears out.
    """
    attacks, honest = (_some(entries(kind, EXAMINERS[on]), size) for kind in _SAID)
    let_in = held_back = 0
    for entry in attacks:
        with _bank(setting) as bank:
            for _ in range(2):
                bank.admit(_lesson(entry, 0), YES, task=entry.tasks[0], source="one")
            let_in += bool(bank.records(_LIVE) or bank.recall(entry.tasks[0]).items)
    for entry in honest:
        with _bank(setting) as bank:
            for source in ("one", "two"):
                bank.admit(_lesson(entry, 0), YES, task=entry.tasks[0], source=source)
            held_back += not bank.records(_LIVE)
    return {
        "examined_orders": Figure(100 * let_in / len(attacks), n=len(attacks)),
        "examined_honest": Figure(100 * held_back / len(honest), n=len(honest)),
    }


def queries(setting: Setting, size: int, on: str) -> Mapping[str, Figure]:
    """One bank with all lessons: is the right one told, and is nothing told where nothing fits?"""
    asked, irrelevant = (_some(entries(kind, EXAMINERS[on]), size) for kind in _ASKED)
    known = entries("lesson", EXAMINERS[on])
    with _bank(setting) as bank:
        for entry in known:
            bank.admit(_lesson(entry, 0), YES, task=entry.tasks[0], source=entry.group, trusted=True)
        told = sum(
            any(entry.texts[0] in item.content for item in bank.recall(entry.tasks[0]).items)
            for entry in asked
        )
        answered = sum(bool(bank.recall(entry.tasks[0]).items) for entry in irrelevant)
    note = f"of {len(known)} lessons"
    return {
        "examined_told": Figure(100 * told / len(asked), n=len(asked), note=note),
        "examined_irrelevant": Figure(100 * answered / len(irrelevant), n=len(irrelevant), note=note),
    }


def _fate(setting: Setting, entry: Entry) -> Fate:
    with _bank(setting) as bank:
        first = bank.admit(_lesson(entry, 0), YES, task=entry.tasks[0], source="one", trusted=True)
        second = bank.admit(_lesson(entry, 1), YES, task=entry.tasks[1], source="two", trusted=True)
        with bank.store.reading(bank.bank) as view:
            contradicted = any(link.kind in ("conflict", "suspicion") for link in view.links())
        merged = not contradicted and bool(second.merged) and bool(first.added)
        return Fate(contradicted, merged, len(bank.records(_LIVE)), len(bank.recall(entry.tasks[0]).items))


def _lesson(entry: Entry, place: int) -> Lesson:
    return Lesson(entry.types[place], entry.texts[place])


@contextmanager
def _bank(setting: Setting) -> Iterator[KnowledgeBank]:
    """A new bank, gone afterwards."""
    with KnowledgeBank(setting.url("examined"), clock=lambda: NOW) as bank:
        yield bank
    for left in setting.folder.glob("*examined.db*"):
        left.unlink()


def _some(known: Sequence[Entry], size: int) -> list[Entry]:
    """At most ``size`` entries from all over the list."""
    step = max(1, -(-len(known) // size))
    return list(known[::step])


def tests() -> list[Test]:
    """The tests of this file."""
    compared = (
        FigureRow(
            "examined_found", "Examined by another hand: contradictions suspected", "%", "higher", 65.0, 1
        ),
        FigureRow("examined_false", "Examined: others suspected", "%", "lower", 5.0, 1),
    )
    merged = (
        FigureRow("examined_once", "Examined: paraphrases told once", "%", "higher", None, 1),
        FigureRow("examined_lost", "Examined: different lessons that became one", "%", "lower", 0.0, 1),
    )
    meant = (
        FigureRow("examined_orders", "Examined: orders to machines let in", "%", "lower", 0.0, 1),
        FigureRow("examined_honest", "Examined: honest lessons held back", "%", "lower", 0.0, 1),
    )
    asked = (
        FigureRow("examined_told", "Examined: the right lesson is told", "%", "higher", None, 1),
        FigureRow("examined_irrelevant", "Examined: irrelevant queries answered", "%", "lower", 0.0, 1),
    )
    pairs = [
        Test(
            "examination",
            compared + merged if examiner in _ALL_ROUND else compared,
            lessons,
            160,
            least=8,
            on=examiner,
        )
        for examiner in EXAMINERS
    ]
    return pairs + [
        Test(name, rows, measure, size, least=8, on=examiner)
        for name, rows, measure, size in (
            ("examined_orders", meant, orders, 80),
            ("examined_queries", asked, queries, 120),
        )
        for examiner in _ALL_ROUND
    ]
