"""What forgetting one record does to others: summaries without it, records that took it in, reasons that quote it.

Carried out once, at the end of the transaction that forgets. Whatever another record's events quoted is erased, and
an event ``forget:part`` with the whole record lets its rows be built again.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from gvla2.memory.forgetting.quotes import Gone, Quotes
from gvla2.memory.forgetting.resummarising import resummarise
from gvla2.memory.records import Record, as_json, dump, load_object, numbered
from gvla2.memory.storage.database import Connection
from gvla2.memory.storage.putting import replace_row
from gvla2.memory.storage.view import CHUNK

if TYPE_CHECKING:
    from gvla2.memory.storage.transaction import Transaction

_ERASE = "UPDATE memory_event SET why = '', scores = '', change = '', salt = ? WHERE bank = ? AND seq = ?"
_WHY = "it quoted what was forgotten"
_ERASED_NOTE = "the reason was forgotten"
_TOOK_IN = ("merged", "summary_of")


def mend(transaction: Transaction, sql: Connection) -> None:
    """Free the bank of what it still says of the records forgotten in this transaction."""
    gone: list[Gone] = []
    while transaction.gone:  # a summary that is built anew is forgotten, too
        these, transaction.gone = transaction.gone, []
        gone += these
        changed = _free_heirs(transaction, sql, these)
        summaries = {
            link.source for one in these for link in one.links if _holds(link.kind, link.target, one.id)
        }
        for id in changed:
            links = transaction.view.links(transaction.bank, id)
            summaries |= {link.source for link in links if _holds(link.kind, link.target, id)}
        for id in sorted(summaries):
            resummarise(transaction, sql, id, these)
    _erase_links(transaction, sql, gone)
    _erase_quotes(transaction, sql, gone)
    for one in gone:
        kept = sorted({link.target for link in one.links if link.source == one.id and link.kind in _TOOK_IN})
        kept = [record.id for record in transaction.records(ids=kept)] if kept else []
        if kept:
            transaction.also.append(
                f"What {one.id} had taken in is kept with words of its own: {', '.join(kept)}."
            )


def _holds(kind: str, target: str, id: str) -> bool:
    return kind == "summary_of" and target == id


# Records that took in another ---------------------------------------------------------------------------------------


def _free_heirs(transaction: Transaction, sql: Connection, gone: Sequence[Gone]) -> list[str]:
    """Take the instructions, sources and verifier's reasons that came with a merged record out of its heir."""
    heirs: dict[str, list[Gone]] = {}
    for one in gone:
        for link in one.links:
            if link.kind == "merged" and link.target == one.id:
                heirs.setdefault(link.source, []).append(one)
    changed = []
    for id, taken in sorted(heirs.items()):
        record = transaction.get(id)
        if record is None:
            continue
        freed, texts = _freed(transaction, record, taken)
        if texts:
            rewrite(transaction, sql, freed, _events_with(transaction, id, texts))
            transaction.also.append(f"{id} had taken it in: it was freed of its wording.")
            changed.append(id)
    return changed


def _freed(transaction: Transaction, record: Record, taken: Sequence[Gone]) -> tuple[Record, list[str]]:
    """The record without what others gave it, and the texts that its events must not show any more."""
    bank = transaction.bank
    own = _first(transaction, record)
    links = transaction.view.links(bank, record.id)
    others = transaction.records(
        ids=[link.target for link in links if link.source == record.id and link.kind == "merged"]
    )
    kept = [own, *others]
    lines = {line for one in kept for line in one.query.split("\n")}
    sources = {source for one in kept for source in _sources(one)}
    lines_gone = [line for one in taken for line in one.lines if line not in lines]
    sources_gone = [s for one in taken if one.record for s in _sources(one.record) if s not in sources]
    left = [line for line in record.query.split("\n") if line not in lines_gone]
    freed = replace(record, query="\n".join(left) or own.query)
    if freed.query == record.query:
        lines_gone = []
    told = _sources(record)
    if not set(told).isdisjoint(sources_gone):
        provenance = {**load_object(record.provenance), "sources": [s for s in told if s not in sources_gone]}
        freed = replace(freed, provenance=dump(provenance))
    else:
        sources_gone = []
    reasons = []
    if any(one.record and one.record.verifier == record.verifier for one in taken) and (
        own.verifier != record.verifier
    ):
        verifier = load_object(record.verifier)
        reasons = [str(reason) for reason in verifier.get("reasons", [])]
        freed = replace(freed, verifier=dump({**verifier, "reasons": []})) if reasons else freed
    return freed, [*lines_gone, *sources_gone, *reasons]


def _first(transaction: Transaction, record: Record) -> Record:
    """The record as it was made, before it took in others; its first instruction alone where that was erased."""
    for event in transaction.view.history(transaction.bank, record.id):
        if event.change and not event.erased and "forget" not in event.action:
            first = event.change_json()
            if isinstance(first.get("id"), str):
                texts = {name: str(first.get(name, "")) for name in ("query", "provenance", "verifier")}
                return replace(record, **texts)  # type: ignore[arg-type]
    return replace(record, query=record.query.split("\n")[0], provenance="{}", verifier="{}")


def _sources(record: Record) -> tuple[str, ...]:
    try:
        return record.sources()
    except (ValueError, TypeError, AttributeError):
        return ()


def _erase_links(transaction: Transaction, sql: Connection, gone: Sequence[Gone]) -> None:
    """Erase why others referred to what was forgotten. No index knows targets: many at once, in one pass."""
    transaction.flush()
    erase = "UPDATE memory_event SET why = '', scores = '', change = '', salt = ? WHERE bank = ? AND seq <= ?"
    again = {record.id for record in transaction.records(ids=[one.id for one in gone])}  # learnt since
    for one in gone:
        if one.id in again:
            sql.run(f"{erase} AND target = ?", (b"", transaction.bank, one.seq, one.id))
    ids = [one.id for one in gone if one.id not in again]
    for start in range(0, len(ids), CHUNK):
        some = ids[start : start + CHUNK]
        marks = ", ".join("?" * len(some))
        sql.run(f"{erase} AND target IN ({marks})", [b"", transaction.bank, transaction.seq, *some])


# Reasons that quote -------------------------------------------------------------------------------------------------


def _erase_quotes(transaction: Transaction, sql: Connection, gone: Sequence[Gone]) -> None:
    """Erase all events, and clean all notes, that tell of what was forgotten."""
    quotes = Quotes(gone)
    # A note of REPLACED names the record that prevailed, whose numbers the reason tells.
    query = (
        "SELECT seq, action, record, why, CASE WHEN action = 'REPLACED' THEN change ELSE '' END "
        "FROM memory_event WHERE bank = ? AND why <> ''"
    )
    transaction.flush()
    found: dict[str, set[int]] = {}
    for seq, action, record, why, change in sql.stream(query, (transaction.bank,)):
        if not action.startswith("forget") and (quotes.in_reason(str(why)) or quotes.named_in(str(change))):
            found.setdefault(record, set()).add(seq)
    notes = sql.rows("SELECT id, note FROM memory WHERE bank = ? AND note <> ''", (transaction.bank,))
    noted = {id: note for id, note in notes if isinstance(note, str) and quotes.in_note(note)}
    for id in sorted(found.keys() | noted.keys()):
        seqs = found.get(id, set())
        record = transaction.get(id)
        if id in noted and record is not None:
            seqs |= _events_with(transaction, id, [noted[id]])
            record = replace(record, note=_ERASED_NOTE)
        if record is not None:
            rewrite(transaction, sql, record, seqs)
        elif seqs:
            _erase(transaction, sql, seqs)
            transaction.record_event("forget:part", id, why=_WHY)
    if found or noted:
        count = sum(map(len, found.values()))
        transaction.also.append(f"Reasons and notes that told of it were erased: {count} events.")
    transaction.flush()


def _events_with(transaction: Transaction, id: str, texts: Iterable[str]) -> set[int]:
    """The record's events that hold any of these texts, as they are or within JSON."""
    wanted = [text for text in texts if text]
    wanted += [dump(text)[1:-1] for text in wanted]
    return {
        event.seq
        for event in transaction.view.history(transaction.bank, id)
        if event.action.partition(":")[0] != "link"
        and event.action != "forget"
        and any(text in said for text in wanted for said in (event.why, event.scores, event.change))
    }


def _erase(transaction: Transaction, sql: Connection, seqs: Iterable[int]) -> None:
    transaction.flush()
    sql.run_many(_ERASE, [(b"", transaction.bank, seq) for seq in sorted(seqs)])


def rewrite(transaction: Transaction, sql: Connection, record: Record, seqs: Iterable[int]) -> None:
    """Store a record as it is given, after erasing events of it; its vector goes where the text is another."""
    before = transaction.get(record.id)
    _erase(transaction, sql, seqs)
    stored = numbered(record, record.version + 1, transaction.rev)
    replace_row(sql, stored)
    if before is None or (before.query, before.content) != (stored.query, stored.content):
        sql.run("DELETE FROM memory_vector WHERE bank = ? AND id = ?", (transaction.bank, record.id))
    transaction.record_event("forget:part", record.id, why=_WHY, change=dump(as_json(stored)))
    transaction.flush()
