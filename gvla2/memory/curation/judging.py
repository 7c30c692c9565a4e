"""Deciding suspicions in the background: what to ask a judge, and what its answer means.

Of two lessons of one type that contradict each other the less trusted is archived; of equally trusted ones the one with
less evidence. A hint and a constraint both stay, linked.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from gvla2.memory.contracts import Judge, Judgement, Suspects
from gvla2.memory.curation.contesting import compare
from gvla2.memory.curation.evidence import standing
from gvla2.memory.curation.ledger import deciding
from gvla2.memory.indexing.candidates import SERVED
from gvla2.memory.records import Record
from gvla2.memory.storage.view import pairs_of

if TYPE_CHECKING:
    from gvla2.memory.bank import KnowledgeBank

BATCH = 16
"""Pairs per request to a judge."""

Pair = tuple[str, str]


@dataclass
class Judged:
    """The result of judging: pairs of ids by decision, those left open, costs by name, and errors."""

    conflicts: list[Pair] = field(default_factory=list)
    dismissed: list[Pair] = field(default_factory=list)
    open: int = 0
    archived: list[str] = field(default_factory=list)
    usage: Counter[str] = field(default_factory=Counter)
    notes: list[str] = field(default_factory=list)


def judge(bank: KnowledgeBank, judge: Judge, *, limit: int | None = None) -> Judged:
    """Have at most ``limit`` suspicions decided; the judge works outside any transaction."""
    done = Judged()
    with bank.store.reading(bank.bank) as view:
        linked = pairs_of(view.links())
        pairs = sorted(linked["suspicion"] - linked["conflict"] - linked["dismissed"])
        records = {one.id: one for one in view.records(SERVED, {id for pair in pairs for id in pair})}
    answers = decide(judge, pairs, records, done, limit)
    if not answers:
        return done
    with deciding(bank, "judge") as ledger:
        for pair, answer in answers:
            first, second = (ledger.get(id) for id in pair)
            if first is None or second is None or not {first.state, second.state} <= {*SERVED}:
                continue  # changed meanwhile
            why = f"{answer.judge}: {answer.reason} (p = {answer.probability:.2f})"
            ledger.link(first.id, "conflict" if answer.contradicts else "dismissed", second.id, why)
            if answer.contradicts and first.type == second.type:
                winner, loser = sorted((first, second), key=standing)
                ledger.replace(winner, loser, "JUDGED", f"contradicted by {winner.id}", why)
                done.archived.append(loser.id)
    return done


def decide(
    judge: Judge, pairs: Sequence[Pair], records: Mapping[str, Record], done: Judged, limit: int | None = None
) -> list[tuple[Pair, Judgement]]:
    """A judge's confident decisions on ``pairs`` of served ``records``, at most ``limit``, asked in batches."""
    asked = [pair for pair in pairs if records.keys() >= {*pair}][:limit]
    decided: list[tuple[Pair, Judgement]] = []
    for start in range(0, len(asked), BATCH):
        batch = asked[start : start + BATCH]
        shown = []
        for one, two in ((records[first], records[second]) for first, second in batch):
            found = compare(one, two).suspicion
            sure = 0.5 if found is None else found
            shown.append(Suspects(one.content, two.content, one.query, two.query, sure))
        for pair, answer in zip(batch, judge.judge(shown), strict=True):
            done.usage.update(answer.usage)
            if answer.contradicts is None:
                done.open += 1
                if answer.reason and answer.reason not in done.notes:
                    done.notes.append(answer.reason)
            else:
                (done.conflicts if answer.contradicts else done.dismissed).append(pair)
                decided.append((pair, answer))
    return decided
