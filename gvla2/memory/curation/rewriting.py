"""Consolidation by a writer: the paper's four edits (ADD, MERGE, REPLACE, DISCARD), in the background.

An answer is applied as far as it can be trusted: a text that lost a number, or that reads like orders, is replaced by
the rules' own.
"""

from __future__ import annotations

import logging
from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from itertools import islice
from typing import TYPE_CHECKING

from gvla2.errors import Gvla2Error
from gvla2.memory.bank_options import BankOptions
from gvla2.memory.contracts import ConsolidationEdit, Consolidator
from gvla2.memory.curation.evidence import standing
from gvla2.memory.curation.governance import Governed, Governing
from gvla2.memory.curation.ledger import BankLedger, deciding
from gvla2.memory.curation.summaries import LENGTH, fitting, numbers_in
from gvla2.memory.indexing.index import Index
from gvla2.memory.injection_patterns import screen
from gvla2.memory.records import Record

if TYPE_CHECKING:
    from gvla2.memory.bank import KnowledgeBank

log = logging.getLogger(__name__)
CONSIDERED = "CONSIDERED"
"""The event that says that a writer has looked at a record."""
NEAREST = 4


def rewrite(bank: KnowledgeBank, writer: Consolidator, done: Governed, *, limit: int | None = None) -> None:
    """Have a writer merge, replace or discard at most ``limit`` lessons, and add that to ``done``; it works outside any
    transaction.
    """
    answers = []
    bank.index.refresh()
    with bank.store.reading(bank.bank) as view:
        considered = view.decided(CONSIDERED)
    for record, near in islice(asked(bank.index, considered, bank.options), limit):
        try:
            answers.append((record, near, writer.consolidate(record, near)))
        except Gvla2Error as error:
            log.warning("A lesson was not consolidated: %s", error)
    if answers:
        with deciding(bank, "consolidate") as ledger:
            for record, near, edit in answers:
                _carry_out(ledger, record, near, edit, done)


def asked(
    index: Index, considered: Collection[str], options: BankOptions
) -> Iterator[tuple[Record, list[Record]]]:
    """Lessons in words not yet considered, the latest first, each with those near it; isolated ones are left out."""
    for record in sorted(index.records("active"), key=lambda r: (-r.updated, r.id)):
        if record.effect or record.id in considered:
            continue
        vector = index.vector(record.id)
        found = [] if vector is None else index.nearest(vector, NEAREST + 1, ("active",))
        near = [
            other
            for other, cosine in found
            if cosine >= options.match
            and other.id != record.id
            and not other.effect
            and (other.type, other.skill) == (record.type, record.skill)
        ]
        if near:
            yield record, near


def _carry_out(
    ledger: BankLedger, candidate: Record, near: Sequence[Record], edit: ConsolidationEdit, done: Governed
) -> None:
    """Apply an edit if its records are still what the writer was shown; else skip it."""
    target = next((record for record in near if record.id == edit.target), None)
    for shown in (candidate, target):
        now = ledger.get(shown.id) if shown else None
        if shown and (now is None or now.version != shown.version):
            return  # changed meanwhile: the next pass asks again
    if target is None or edit.action == "ADD":
        ledger.decide(CONSIDERED, candidate.id, "it says something of its own")
    elif edit.action == "MERGE":
        text = " ".join(edit.content.split())
        missing = (numbers_in(candidate.content) | numbers_in(target.content)) - numbers_in(text)
        why = f"it lost {', '.join(sorted(missing))}" if missing else screen(text)
        if why := why or ("its length" if not 0 < len(text) <= LENGTH else ""):
            log.info("The merged text of %s and %s was rejected: %s.", candidate.id, target.id, why)
            text = ""
        if text or len(fitting([candidate, target])) == 2:
            Governing(ledger, done).write([candidate, target], text)
        else:
            ledger.decide(CONSIDERED, candidate.id, "a summary could not show its numbers beside the other's")
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
        done.archived.append(candidate.id)
    else:
        ledger.decide(CONSIDERED, candidate.id, "it has less evidence than its target")
