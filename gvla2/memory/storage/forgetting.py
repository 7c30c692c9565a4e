"""Permanent forgetting: rows, vectors, links, episodes' text, and events' payloads.

Copies in other records are removed with it: a summary that includes it is forgotten too, and its other members are
active again; a record that it was merged into loses its instructions and sources. Reasons and notes refer to other
records only by id, never by their words, so nothing else has to be searched.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any, cast

from sqlalchemy import Connection, Row, update

from gvla2.memory.records import FORGOTTEN, Record, as_json, dump, load_object, numbered
from gvla2.memory.storage.database import upsert
from gvla2.memory.storage.tables import EPISODE, EVENT, LINK, META, PENDING, VECTOR
from gvla2.memory.storage.view import parts
from gvla2.memory.storage.writing import Writing

ERASED = {"why": "", "scores": "", "change": "", "origin": "", "salt": b""}
"""The erased payload of an event about something forgotten."""
SUMMED_UP = "summed up in "
"""Prefix of the note of an archived record that a summary includes."""


class Transaction(Writing):
    """All changes to a bank: :class:`Writing`, and forgetting.

    ``forgotten`` are the forgotten ids, ``also`` sentences on further changes; if ``to_scrub``, the store cleans the
    database's files after the commit.
    """

    def __init__(self, sql: Connection, bank: str, actor: str, now: float) -> None:
        super().__init__(sql, bank, actor, now)
        self.forgotten: list[str] = []
        self.also: list[str] = []
        self.to_scrub = False

    def forget(self, *ids: str, why: str = "") -> list[str]:
        """Forget records permanently: row, vector, links, their episodes' text, and events' payloads about them.

        Their ids, and the fact that they were forgotten, stay. Returns the ids of those that existed.
        """
        rows = {row.id: row for row in self.rows(ids=ids) if row.state != FORGOTTEN}
        # Repeated after the files could not be cleaned: clean them now.
        self.to_scrub = self.to_scrub or bool(rows) or bool(ids and self.meta(PENDING))
        if not rows:
            return []
        links = self.links(rows)
        self.touch({end for link in links for end in (link.source, link.target)} - rows.keys())
        for table, column in ((LINK, "source"), (LINK, "target"), (VECTOR, "id")):
            self.delete(table, column, rows)
        for column in ("record", "target"):
            self._erase(column, rows)
        tombstones = [self._tombstone(row) for row in rows.values()]
        self.replace_rows(tombstones)
        self.tell(self.event("forget", one.id, "", why, change=dump(as_json(one))) for one in tombstones)
        self._forget_episodes(rows)
        self._do(upsert(self.sql, META, ("key",)), [{"key": PENDING, "value": os.urandom(8).hex()}])
        self.forgotten += rows
        for link in links:
            if link.kind == "merged" and link.target in rows and link.source not in rows:
                self._free(link.source, rows[link.target], set())
        self._forget_summaries({x.source for x in links if x.kind == "summary_of" and x.target in rows})
        kept = {x.target for x in links if x.source in rows and x.kind in ("merged", "summary_of")}
        if left := [record.id for record in self.records(ids=kept)]:
            self.also.append(f"Records merged into it are kept with their own words: {', '.join(left)}.")
        return list(rows)

    def _tombstone(self, row: Row[Any]) -> Record:
        """The tombstone of a forgotten record."""
        blank, version = cast(Any, ""), row.version if type(row.version) is int else 0
        made = Record(
            row.id, self.bank, "", "", blank, cast(Any, FORGOTTEN), blank, 0.0, 0.0, f"{FORGOTTEN}:{row.id}",
            self.now, self.now, count=0,
        )  # fmt: skip
        return numbered(made, version + 1, self.rev)

    def _forget_episodes(self, rows: Mapping[str, Row[Any]]) -> None:
        """Forget the episodes that taught them: their rows, and the events' payloads about them."""
        named = {source for row in rows.values() for source in _listed(row.provenance, "sources")}
        found = {
            row.source: row.name
            for row in self.episode_rows()
            if row.source in named or not rows.keys().isdisjoint(_listed(row.data, "records", rows))
        }
        self.delete(EPISODE, "source", found)
        self._erase("record", found.values())
        self.tell(self.event("forget", name) for name in found.values())

    def _erase(self, column: str, values: Collection[Any]) -> None:
        """Erase the payloads of events whose column has one of these values.

        An event of the forgetting must follow: an erased one without it counts as damage.
        """
        for some in parts(values):
            where = (EVENT.c.bank == self.bank) & EVENT.c[column].in_(some)
            self._do(update(EVENT).where(where).values(ERASED))

    # Copies in other records ----------------------------------------------------------------------------------------

    def _free(self, id: str, taken: Row[Any], seen: set[str]) -> None:
        """Remove a merged record's instructions and sources from the record it was merged into, and onwards."""
        record = self.get(id)
        if record is None or id in seen:
            return
        seen.add(id)
        links = self.links([id])
        others = self.records(ids=[x.target for x in links if x.kind == "merged" and x.source == id])
        freed, texts = _freed(record, taken, others)
        if not texts:
            return
        told = [*texts, *(dump(text)[1:-1] for text in texts)]
        gone = [e for e in self.history(id) if any(text in said for text in told for said in e.payload)]
        self._erase("seq", [event.seq for event in gone])
        rewritten = numbered(freed, record.version + 1, self.rev)
        self.replace_rows([rewritten])
        self.delete(VECTOR, "id", [id])
        change, why = dump(as_json(rewritten)), "it mentioned something forgotten"
        self.tell([self.event("forget:part", id, "", why, change=change)])
        origins = {e.origin for e in gone if e.origin and not any(text in e.origin for text in texts)}
        why = "the evidence that it still rests on"
        self.tell(self.event("forget:part", id, "", why, origin=origin) for origin in sorted(origins))
        self.also.append(f"It had been merged into {id}: its wording was removed there.")
        for link in links:
            if link.kind == "merged" and link.target == id:
                self._free(link.source, taken, seen)
        self._forget_summaries({x.source for x in links if x.kind == "summary_of" and x.target == id})

    def _forget_summaries(self, ids: Collection[str]) -> None:
        """Forget summaries that include forgotten records; their other members become active again."""
        for id in sorted(ids):
            held = [x.target for x in self.links([id]) if x.kind == "summary_of" and x.source == id]
            also = len(self.also)
            if not self.forget(id, why="it included something forgotten"):
                continue
            del self.also[also:]
            members = [one for one in self.records(["archive"], held) if one.note == f"{SUMMED_UP}{id}"]
            why = "no summary includes it any more"
            for one in members:
                self.put(replace(one, state="active", note=""), action="RESTORE", why=why)
            back = f"; active again: {', '.join(member.id for member in members)}" if members else ""
            self.also.append(f"The summary {id} included it and was forgotten{back}.")


def _listed(text: object, name: str, wanted: Collection[str] = ()) -> list[str]:
    """A named list of a JSON object; for a damaged one the ``wanted`` strings that it contains anywhere."""
    try:
        return [str(one) for one in load_object(str(text)).get(name, [])]
    except (ValueError, TypeError):
        return [one for one in wanted if dump(one) in str(text)]


def _freed(record: Record, taken: Row[Any], others: Sequence[Record]) -> tuple[Record, list[str]]:
    """The record without what came from another, and the texts that its events must not show any more.

    Its first instruction and source are its own; those shared with ``others`` merged into it stay too.
    """
    lines, sources = record.query.split("\n"), list(record.sources())
    kept = {line for one in others for line in one.query.split("\n")} | {lines[0], ""}
    asked = {line for line in str(taken.query).split("\n") if line in lines} - kept
    left = {source for one in others for source in one.sources()} | {*sources[:1]}
    named = {source for source in _listed(taken.provenance, "sources") if source in sources} - left
    texts = sorted(asked | named)
    freed = replace(record, query="\n".join(line for line in lines if line not in asked))
    if named:
        whole = {**record.provenance_json(), "sources": [s for s in sources if s not in named]}
        freed = replace(freed, provenance=dump(whole))
    reasons = record.verifier_json().get("reasons")
    if taken.verifier == record.verifier and texts and reasons:
        freed = replace(freed, verifier=dump({**record.verifier_json(), "reasons": []}))
        texts += [str(reason) for reason in reasons]
    return freed, texts
