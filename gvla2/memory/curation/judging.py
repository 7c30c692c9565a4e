"""Suspicions decided in the background: what to ask a judge, and what its answer means. Decisions on plain data.

``decide`` is called outside of any transaction, for judging may take its time; its rulings are carried out within one.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from gvla2.memory.contracts import Judge, Judgement, Suspects
from gvla2.memory.curation.evidence import standing
from gvla2.memory.records import Record

SUSPICION, CONFLICT, DISMISSED = "suspicion", "conflict", "dismissed"
"""Kinds of links between two records that may contradict each other, that do, and that a judge found not to."""
BATCH = 16
"""Pairs that are put to a judge at a time."""
LIVE = ("active", "summary")

Pair = tuple[str, str]


@dataclass
class Judged:
    """What judging did: pairs of ids by decision, those left open, what it cost by name, and what went wrong."""

    conflicts: list[Pair] = field(default_factory=list)
    dismissed: list[Pair] = field(default_factory=list)
    open: int = 0
    archived: list[str] = field(default_factory=list)
    usage: Counter[str] = field(default_factory=Counter)
    notes: list[str] = field(default_factory=list)
    degraded: str = ""


@dataclass(frozen=True)
class Ruling:
    """A judge's decision on two records: a link of ``kind``, the ``loser`` to be archived ("" for none),
    and the reason.
    """

    first: str
    second: str
    kind: str
    why: str
    loser: str = ""


def open_suspicions(links: Iterable[tuple[str, str, str]]) -> list[Pair]:
    """The pairs of (source, kind, target) ``links`` that are suspected and that nobody has decided, sorted."""
    suspected: set[Pair] = set()
    decided: set[Pair] = set()
    for source, kind, target in links:
        pair = (source, target) if source < target else (target, source)
        if kind == SUSPICION:
            suspected.add(pair)
        elif kind in (CONFLICT, DISMISSED):
            decided.add(pair)
    return sorted(suspected - decided)


def decide(
    judge: Judge,
    pairs: Sequence[Pair],
    records: Mapping[str, Record],
    done: Judged,
    *,
    limit: int | None = None,
) -> list[Ruling]:
    """What a judge makes of ``pairs``, in batches; of those with two live records, at most ``limit``."""
    asked = [
        (records[one], records[two])
        for one, two in pairs
        if one in records and two in records and all(records[id].state in LIVE for id in (one, two))
    ][:limit]
    rulings: list[Ruling] = []
    for start in range(0, len(asked), BATCH):
        batch = asked[start : start + BATCH]
        for (first, second), answer in zip(batch, judge.judge([_suspects(*p) for p in batch]), strict=True):
            done.usage.update(answer.usage)
            ruling = ruled(first, second, answer)
            if ruling is None:
                done.open += 1
                if answer.reason and answer.reason not in done.notes:
                    done.notes.append(answer.reason)
            else:
                listed = done.conflicts if ruling.kind == CONFLICT else done.dismissed
                listed.append((first.id, second.id))
                rulings.append(ruling)
    return rulings


def ruled(first: Record, second: Record, answer: Judgement) -> Ruling | None:
    """What an answer means; None where it leaves the suspicion one.

    Of two lessons of one type that contradict each other the less trusted is archived; of equally trusted ones the one
    with less evidence. A hint and a constraint both stay, linked.
    """
    if answer.contradicts is None:
        return None
    why = f"{answer.judge}: {answer.reason} (p = {answer.probability:.2f})"
    if not answer.contradicts:
        return Ruling(first.id, second.id, DISMISSED, why)
    if first.type != second.type:
        return Ruling(first.id, second.id, CONFLICT, why)
    return Ruling(first.id, second.id, CONFLICT, why, loser=max(first, second, key=standing).id)


def _suspects(first: Record, second: Record) -> Suspects:
    return Suspects(first.content, second.content, first.query, second.query)
