"""Consolidation by whoever can write: the paper's four edits (ADD, MERGE, REPLACE, DISCARD), in the background.

``asked`` picks what to ask about; the writer answers outside of any transaction; ``carry_out`` applies an answer within
one, as far as it can be trusted: a text that lost a number, or that reads like orders, gives way to the rules' own.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace

from gvla2.memory.bank_options import BankOptions
from gvla2.memory.contracts import ConsolidationEdit, Near
from gvla2.memory.curation.evidence import standing
from gvla2.memory.curation.governance import Governing
from gvla2.memory.curation.ledger import Ledger
from gvla2.memory.curation.summaries import LENGTH, numbers_in
from gvla2.memory.indexing.index import Index
from gvla2.memory.injection_patterns import screen
from gvla2.memory.records import Record

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


def asked(
    index: Index, considered: Collection[str], options: BankOptions, limit: int | None
) -> list[tuple[Record, list[Record]]]:
    """Lessons in words that nobody has considered, the latest first, each with those near it; those alone left out."""
    found: list[tuple[Record, list[Record]]] = []
    for record in sorted(index.records("active"), key=lambda r: (-r.updated, r.id)):
        if limit is not None and len(found) >= limit:
            break
        if record.effect or record.id in considered:
            continue
        (row,) = index.rows([record.id])
        rows, cosines = index.nearest(index.vector(row), NEAREST + 1, ("active",))
        near = [
            other
            for other, cosine in zip(map(index.record, rows.tolist()), cosines.tolist(), strict=True)
            if cosine >= options.match
            and other.id != record.id
            and not other.effect
            and (other.type, other.skill) == (record.type, record.skill)
        ]
        if near:
            found.append((record, near))
    return found


def told(records: Sequence[Record]) -> tuple[Near, ...]:
    """Records as a writer is shown them."""
    return tuple(Near(record.id, record.content, record.query.split("\n")[0]) for record in records)


def carry_out(
    ledger: Ledger,
    options: BankOptions,
    candidate: Record,
    near: Sequence[Record],
    edit: ConsolidationEdit,
    done: Rewritten,
) -> None:
    """Apply an edit to records that are still what the writer was shown; else it is passed over."""
    target = next((record for record in near if record.id == edit.target), None)
    now = [ledger.get(record.id) for record in (candidate, *([target] if target else []))]
    if any(
        one is None or one.version != was.version
        for one, was in zip(now, (candidate, target), strict=False)
        if was
    ):
        return  # changed meanwhile: the next pass asks again
    done.considered += 1
    if target is None or edit.action == "ADD":
        ledger.decide(CONSIDERED, candidate.id, "it says something of its own")
    elif edit.action == "MERGE":
        text = " ".join(edit.content.split())
        missing = numbers_in(candidate.content) | numbers_in(target.content)
        missing -= numbers_in(text)
        why = f"it lost {', '.join(sorted(missing))}" if missing else screen(text)
        if why or not text or len(text) > LENGTH:
            done.notes.append(
                f"What was written of {candidate.id} and {target.id} was not taken: {why or 'its length'}."
            )
            text = ""
        done.merged.append(Governing(ledger, options).write([candidate, target], text).id)
    elif edit.action == "REPLACE" and standing(candidate) < standing(target):
        note = f"replaced by {candidate.id}"
        ledger.put(replace(target, state="archive", note=note), "REPLACED", note)
        ledger.link(candidate.id, "replaces", target.id, edit.reason)
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
