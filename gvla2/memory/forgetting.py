"""Permanent forgetting: a record's row, vector, links and episodes, and the payloads of all events about it.

A summary that includes a forgotten record is forgotten too, and its other members are active again. Reasons and notes
refer to other records only by id, never by their words, so nothing else has to be searched.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Any, cast

from sqlalchemy import Connection, Row, select, update

from gvla2.memory.events import EPISODE, EVENT, LINK, RECORD, VECTOR
from gvla2.memory.records import FORGOTTEN, Record, as_json, dump, load_object, numbered
from gvla2.memory.view import batches
from gvla2.memory.writing import Writing

ERASED = {"why": "", "scores": "", "change": "", "origin": "", "state": "", "salt": b""}
"""The erased payload of an event about something forgotten."""
SUMMED_UP = "summed up in "
"""Prefix of the note of an archived record that a summary includes."""


class Transaction(Writing):
    """All changes to a bank: :class:`Writing`, and forgetting.

    ``forgotten`` are the forgotten ids, ``also`` sentences on further changes; if there are any, the store cleans the
    database's files after the commit.
    """

    def __init__(self, sql: Connection, bank: str, actor: str, now: float) -> None:
        super().__init__(sql, bank, actor, now)
        self.forgotten: list[str] = []
        self.also: list[str] = []

    def forget(self, *ids: str, why: str = "") -> list[str]:
        """Forget records permanently. Returns the ids of those that existed.

        Their ids, and the fact that they were forgotten, stay.
        """
        rows = {row.id: row for row in self.rows(ids=ids) if row.state != FORGOTTEN}
        if not rows:
            return []
        notes = [str(row.note) for row in rows.values() if str(row.note).startswith(SUMMED_UP)]
        ends = {end for link in self.links(rows) for end in (link.source, link.target)}
        self.touch(ends - rows.keys())
        for table, column in ((LINK, "source"), (LINK, "target"), (VECTOR, "id")):
            self.delete(table, column, rows)
        for column in ("record", "target"):
            self._erase(column, rows)
        tombstones = [self._tombstone(row) for row in rows.values()]
        self.replace_rows(tombstones)
        self.tell(self.event("forget", one.id, why=why, change=as_json(one), row=one) for one in tombstones)
        self._forget_episodes(rows)
        self.forgotten += rows
        self._forget_summaries({note.removeprefix(SUMMED_UP) for note in notes} - rows.keys())
        return list(rows)

    def _tombstone(self, row: Row[Any]) -> Record:
        """What is left of a forgotten record."""
        blank, version = cast(Any, ""), row.version if type(row.version) is int else 0
        made = Record(
            id=row.id,
            bank=self.bank,
            query="",
            content="",
            type=blank,
            state=cast(Any, FORGOTTEN),
            outcome=blank,
            confidence=0.0,
            quality=0.0,
            dedup_key=f"{FORGOTTEN}:{row.id}",
            created=self.now,
            updated=self.now,
            count=0,
        )
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
        for some in batches(values):
            where = (EVENT.c.bank == self.bank) & EVENT.c[column].in_(some)
            self._do(update(EVENT).where(where).values(ERASED))

    def _forget_summaries(self, ids: Collection[str]) -> None:
        """Forget summaries that include forgotten records; their other members become active again."""
        for id in sorted(ids):
            members = select(RECORD.c.id).where(
                RECORD.c.bank == self.bank, RECORD.c.state == "archive", RECORD.c.note == f"{SUMMED_UP}{id}"
            )
            held = self.records(["archive"], [str(one) for one in self.sql.execute(members).scalars()])
            if not self.forget(id, why="it included something forgotten"):
                continue
            for one in held:
                self.put(
                    replace(one, state="active", note=""), "RESTORE", why="no summary includes it any more"
                )
            back = f"; active again: {', '.join(member.id for member in held)}" if held else ""
            self.also.append(f"The summary {id} included it and was forgotten{back}.")


def _listed(text: object, name: str, wanted: Collection[str] = ()) -> list[str]:
    """A named list of a JSON object; for a damaged one the ``wanted`` strings that it contains anywhere."""
    try:
        return [str(one) for one in load_object(str(text)).get(name, [])]
    except (ValueError, TypeError):
        return [one for one in wanted if dump(one) in str(text)]
