"""Consolidation by whoever can write: the paper's four edits (ADD, MERGE, REPLACE, DISCARD), in the background.

An answer is applied as far as it can be trusted: a text that lost a number, or that reads like orders, gives way to the
rules' own.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from gvla2.errors import Gvla2Error
from gvla2.memory.bank_options import BankOptions
from gvla2.memory.contracts import ConsolidationEdit, Consolidator
from gvla2.memory.curation.evidence import standing
from gvla2.memory.curation.governance import Governing
from gvla2.memory.curation.ledger import Ledger, deciding
from gvla2.memory.curation.summaries import LENGTH, numbers_in
from gvla2.memory.indexing.index import Index
from gvla2.memory.injection_patterns import screen
from gvla2.memory.records import Record

if TYPE_CHECKING:
    from gvla2.memory.bank import KnowledgeBank

CONSIDERED = "CONSIDERED"
"""The event that says that a writer has looked at a record."""
NEAREST = 4


@dataclass
class Rewritten:
    """What a pass did: ids by edit, how many records were looked at, and notes on what could not be done."""

    merged: list[str] = field(default_factory=list)
    replaced: list[str] = field(default_factory=list)
    discarded: list[str] = field(default_factory=list)
    considered: int = 0
    notes: list[str] = field(default_factory=list)


def rewrite(bank: KnowledgeBank, writer: Consolidator, *, limit: int | None = None) -> Rewritten:
    """Let lessons be merged, replaced or discarded by who can write, at most ``limit``; he works outside any
    transaction.
    """
    done, answers = Rewritten(), []
    bank.index.refresh()
    with bank.store.reading(bank.bank) as view:
        considered = view.decided(CONSIDERED)
    for record, near in asked(bank.index, considered, bank.options, limit):
        try:
            answers.append((record, near, writer.consolidate(record, near)))
        except Gvla2Error as error:
            done.notes += [str(error)] if str(error) not in done.notes else []
    if answers:
        with deciding(bank, "consolidate") as ledger:
            for record, near, edit in answers:
                _carry_out(ledger, record, near, edit, done)
    return done


def asked(
    index: Index, considered: Collection[str], options: BankOptions, limit: int | None
) -> Iterator[tuple[Record, list[Record]]]:
    """Lessons in words that nobody has considered, the latest first, each with those near it; those alone left out."""
    given = 0
    for record in sorted(index.records("active"), key=lambda r: (-r.updated, r.id)):
        if record.effect or record.id in considered:
            continue
        if limit is not None and given >= limit:
            break
        vector = index.vector(record.id)
        near = [
            other
            for other, cosine in (
                index.nearest(vector, NEAREST + 1, ("active",)) if vector is not None else ()
            )
            if cosine >= options.match
            and other.id != record.id
            and not other.effect
            and (other.type, other.skill) == (record.type, record.skill)
        ]
        if near:
            given += 1
            yield record, near


def _carry_out(
    ledger: Ledger, candidate: Record, near: Sequence[Record], edit: ConsolidationEdit, done: Rewritten
) -> None:
    """Apply an edit to records that are still what the writer was shown; else it is passed over."""
    target = next((record for record in near if record.id == edit.target), None)
    for shown in (candidate, target):
        now = ledger.get(shown.id) if shown else None
        if shown and (now is None or now.version != shown.version):
            return  # changed meanwhile: the next pass asks again
    done.considered += 1
    if target is None or edit.action == "ADD":
        ledger.decide(CONSIDERED, candidate.id, "it says something of its own")
    elif edit.action == "MERGE":
        text = " ".join(edit.content.split())
        missing = (numbers_in(candidate.content) | numbers_in(target.content)) - numbers_in(text)
        why = f"it lost {', '.join(sorted(missing))}" if missing else screen(text)
        if why or not text or len(text) > LENGTH:
            done.notes.append(
                f"What was written of {candidate.id} and {target.id} was not taken: {why or 'its length'}."
            )
            text = ""
        done.merged.append(Governing(ledger).write([candidate, target], text).id)
    elif edit.action == "REPLACE" and standing(candidate) < standing(target):
        ledger.replace(candidate, target, "REPLACED", f"replaced by {candidate.id}", edit.reason)
        done.replaced.append(target.id)
    elif edit.action == "DISCARD":
        count = target.count + candidate.count
        quality = (target.quality * target.count + candidate.quality * candidate.count) / count
        pooled = replace(target, count=count, quality=quality, confidence=2 * abs(quality - 0.5))
        ledger.put(pooled, "MERGE", "it says the same")
        note = f"merged into {target.id}"
        ledger.put(replace(candidate, state="archive", note=note), "MERGED", note)
        ledger.link(target.id, "merged", candidate.id, edit.reason)
        done.discarded.append(candidate.id)
    else:
        ledger.decide(CONSIDERED, candidate.id, "it has less behind it than what it was to replace")
