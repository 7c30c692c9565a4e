"""Forgetting for good: rows, vectors, links, episodes' text, and what events say.

What other records took over goes with it: a summary that tells it is forgotten, too, and its other members are
active again; a record that it was merged into loses its instructions and sources. Reasons and notes name other
records by id alone, never by their words, so that nothing else has to be searched.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, cast

from sqlalchemy import Row, delete, select

from gvla2.errors import MemoryStoreError
from gvla2.memory.records import FORGOTTEN, Record, as_json, dump, load_object, numbered
from gvla2.memory.storage.chain import Chain
from gvla2.memory.storage.database import Database, upsert
from gvla2.memory.storage.events import Link
from gvla2.memory.storage.putting import Put, put_many, replace_rows
from gvla2.memory.storage.tables import EPISODE, LINK, META, TAUGHT, VECTOR
from gvla2.memory.storage.view import View

PENDING = "scrub"
"""Key of ``memory_meta`` while bytes of something forgotten may be left in the files: a random token."""
SUMMED_UP = "summed up in "
"""How the note of an archived record begins whose words a summary tells."""


@dataclass
class Forgotten:
    """What a transaction forgot: ``ids``, sentences on what ``also`` changed, and whether files are ``to_scrub``."""

    ids: list[str] = field(default_factory=list)
    also: list[str] = field(default_factory=list)
    to_scrub: bool = False


def forget_many(chain: Chain, ids: Collection[str], why: str, done: Forgotten) -> list[str]:
    """Take records out of all tables of a bank; the ids of those that were there. See :meth:`Transaction.forget`."""
    rows = {row.id: row for row in chain.view.rows(chain.bank, ids=ids) if row.state != FORGOTTEN}
    # Asked again after the files could not be cleaned: then they are now.
    done.to_scrub = done.to_scrub or bool(rows) or bool(ids and chain.view.meta(PENDING))
    if not rows:
        return []
    links = chain.view.links(chain.bank, rows)
    chain.touch({end for link in links for end in (link.source, link.target)} - rows.keys())
    for end in ("source", "target"):
        chain.delete(LINK, end, rows)
    chain.delete(VECTOR, "id", rows)
    chain.erase(naming=rows)
    tombstones = [_tombstone(chain, row) for row in rows.values()]
    replace_rows(chain, tombstones)
    for tombstone in tombstones:
        chain.event("forget", tombstone.id, why=why, change=dump(as_json(tombstone)))
    chain.written -= rows.keys()
    _forget_episodes(chain, rows)
    chain.sql.execute(upsert(chain.sql, META, ("key",)), {"key": PENDING, "value": os.urandom(8).hex()})
    done.ids += rows
    _free_heirs(chain, rows, links, done)
    _forget_summaries(chain, {x.source for x in links if x.kind == "summary_of" and x.target in rows}, done)
    kept = {x.target for x in links if x.source in rows and x.kind in ("merged", "summary_of")}
    if left := [record.id for record in chain.view.records(chain.bank, ids=kept)]:
        done.also.append(f"What it had taken in is kept with words of its own: {', '.join(left)}.")
    return list(rows)


def _tombstone(chain: Chain, row: Row[Any]) -> Record:
    """What is left of a forgotten record: that it was."""
    return Record(
        id=row.id,
        bank=chain.bank,
        query="",
        content="",
        type=cast(Any, ""),
        state=cast(Any, FORGOTTEN),
        outcome=cast(Any, ""),
        confidence=0.0,
        quality=0.0,
        dedup_key=f"{FORGOTTEN}:{row.id}",
        created=chain.now,
        updated=chain.now,
        count=0,
        version=(row.version if type(row.version) is int else 0) + 1,
        rev=chain.rev,
    )


def _forget_episodes(chain: Chain, rows: dict[str, Row[Any]]) -> None:
    """The episodes that taught them: their rows, and what events say of them."""
    listed = {source for row in rows.values() for source in _sources(row.provenance)}
    for start in range(0, len(rows), 500):
        some = TAUGHT.c.record.in_(list(rows)[start : start + 500])
        query = select(TAUGHT.c.source).where(TAUGHT.c.bank == chain.bank, some)
        listed |= set(chain.sql.execute(query).scalars())
    found = {row.source: row.name for row in chain.view.episode_rows(chain.bank, listed)}
    for table in (EPISODE, TAUGHT):
        chain.delete(table, "source", found)
    chain.erase(naming=list(found.values()))
    for name in found.values():
        chain.event("forget", name)


def _sources(provenance: object) -> list[str]:
    """The episodes that a record says it comes from."""
    try:
        return [str(source) for source in load_object(str(provenance)).get("sources", [])]
    except (ValueError, TypeError):
        return []


# What others took over ----------------------------------------------------------------------------------------------


def _free_heirs(chain: Chain, rows: dict[str, Row[Any]], links: Iterable[Link], done: Forgotten) -> None:
    """Take instructions and sources that came with a merged record out of the one that took it in, and on."""
    due = [
        (x.source, x.target)
        for x in links
        if x.kind == "merged" and x.target in rows and x.source not in rows
    ]
    given = {
        id: (str(row.query).split("\n"), _sources(row.provenance), row.verifier) for id, row in rows.items()
    }
    seen: set[str] = set()
    while due:
        heir, taken = due.pop()
        record = chain.view.get(chain.bank, heir)
        if record is None or heir in seen:
            continue
        seen.add(heir)
        mine = chain.view.links(chain.bank, [heir])
        others = [x.target for x in mine if x.kind == "merged" and x.source == heir]
        freed, texts = _freed(record, *given[taken], chain.view.records(chain.bank, ids=others))
        if not texts:
            continue
        told = [*texts, *(dump(text)[1:-1] for text in texts)]
        events = chain.view.history(chain.bank, heir)
        gone = [e for e in events if any(text in said for text in told for said in e.payload)]
        chain.erase(seqs=[event.seq for event in gone])
        rewritten = numbered(freed, record.version + 1, chain.rev)
        replace_rows(chain, [rewritten])
        chain.delete(VECTOR, "id", [heir])
        chain.event("forget:part", heir, why="it told of what was forgotten", change=dump(as_json(rewritten)))
        for origin in sorted({event.origin for event in gone if event.origin}):
            if not any(text in origin for text in texts):
                chain.event("forget:part", heir, why="the evidence that it still rests on", origin=origin)
        done.also.append(f"{heir} had taken it in: it was freed of its wording.")
        given[heir] = given[taken]
        due += [(x.source, heir) for x in mine if x.kind == "merged" and x.target == heir]
        _forget_summaries(
            chain, {x.source for x in mine if x.kind == "summary_of" and x.target == heir}, done
        )


def _freed(
    record: Record, lines: Sequence[str], sources: Sequence[str], verifier: str, others: Sequence[Record]
) -> tuple[Record, list[str]]:
    """The record without what came with another, and the texts that its events must not show any more.

    Its first instruction and source are its own; what the ``others`` that it took in have as well stays, too.
    """
    kept = {line for one in others for line in one.query.split("\n")} | {record.query.split("\n")[0]}
    gone = [line for line in lines if line and line not in kept]
    told, left = _sources(record.provenance), {s for one in others for s in _sources(one.provenance)}
    dropped = [s for s in sources if s in told[1:] and s not in left]
    asked = [line for line in record.query.split("\n") if line not in gone]
    texts = [line for line in record.query.split("\n") if line in gone] + dropped
    freed = replace(record, query="\n".join(asked))
    if dropped:
        whole = {**load_object(record.provenance), "sources": [s for s in told if s not in dropped]}
        freed = replace(freed, provenance=dump(whole))
    if verifier == record.verifier and texts and (reasons := record.verifier_json().get("reasons")):
        freed = replace(freed, verifier=dump({**record.verifier_json(), "reasons": []}))
        texts += [str(reason) for reason in reasons]
    return freed, texts


def _forget_summaries(chain: Chain, ids: Collection[str], done: Forgotten) -> None:
    """Forget summaries that tell what was forgotten; their other members speak for themselves again."""
    for id in sorted(ids):
        held = [
            x.target for x in chain.view.links(chain.bank, [id]) if x.kind == "summary_of" and x.source == id
        ]
        also = len(done.also)
        if not forget_many(chain, [id], "it told what was forgotten", done):
            continue
        del done.also[also:]
        members = [
            r for r in chain.view.records(chain.bank, ["archive"], held) if r.note == f"{SUMMED_UP}{id}"
        ]
        why = "no summary tells it any more"
        put_many(chain, [Put(replace(one, state="active", note=""), "RESTORE", why=why) for one in members])
        back = f"; active again: {', '.join(member.id for member in members)}" if members else ""
        done.also.append(f"The summary {id} told it and was forgotten{back}.")


# Files --------------------------------------------------------------------------------------------------------------


def scrub(database: Database, forgotten: Sequence[str] = ()) -> None:
    """Clean the database's files of what was forgotten, to the last byte; ``forgotten`` are those of just now.

    Raises :class:`~gvla2.errors.MemoryStoreError` where that cannot be done now: it stays noted, and the next time
    tries again.
    """
    with database.reading() as sql:
        asked = View(sql).meta(PENDING)
    try:
        database.scrub()
        if asked:
            with database.writing(
                ""
            ) as sql:  # unless somebody has forgotten something since: he will clean, too
                sql.execute(delete(META).where(META.c.key == PENDING, META.c.value == asked))
    except MemoryStoreError as error:
        if not asked:
            raise
        what = f"{', '.join(forgotten)}: forgotten, and no longer in the bank. " if forgotten else ""
        cause = getattr(error.__cause__, "orig", None) or error.__cause__ or error
        raise MemoryStoreError(
            f"{what}Bytes of what was forgotten may be left in {database.name} ({cause}). When that "
            "is out of the way, run `gvla2 memory compact` (Store.compact), or forget something else."
        ) from error
