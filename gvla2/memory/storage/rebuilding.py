"""From events alone to the rows they made: what a bank was at any time."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from gvla2.memory.records import COLUMNS, FORGOTTEN, Record
from gvla2.memory.storage.events import Event, Link

_FIELDS = set(COLUMNS)


@dataclass
class Folding:
    """A bank while its events are applied one by one; ``episodes`` are the digests of its episodes by source."""

    rows: dict[str, dict[str, Any]] = field(default_factory=dict)
    ties: dict[tuple[str, str, str], float] = field(default_factory=dict)
    episodes: dict[str, str] = field(default_factory=dict)
    _tied: dict[str, set[tuple[str, str, str]]] = field(default_factory=dict)
    _sources: dict[str, str] = field(default_factory=dict)
    _blurred: set[str] = field(default_factory=set)
    """Records of which an event was erased: what comes after it need not fit, until one has the whole record."""

    @property
    def records(self) -> tuple[Record, ...]:
        """The records where the events have led up to now, by id."""
        return tuple(record for record in self.whole() if record.state != FORGOTTEN)

    @property
    def links(self) -> tuple[Link, ...]:
        """The links, by source, kind and target."""
        return tuple(Link(*key, at) for key, at in sorted(self.ties.items()))

    def whole(self) -> list[Record]:
        """The records, tombstones too, by id."""
        return [Record(**row) for _, row in sorted(self.rows.items()) if set(row) == _FIELDS]

    def apply(self, event: Event) -> str:
        """Apply the next event; says what does not fit, "" for nothing."""
        verb, _, kind = event.action.partition(":")
        if verb == "link":
            key = (event.record, kind, event.target)
            self.ties[key] = event.at
            for end in (event.record, event.target):
                self._tied.setdefault(end, set()).add(key)
                self._touch(end, event.rev)
            return ""
        if verb == "forget" and not kind:  # even if it was erased, as forgetting the same id once more does
            for key in self._tied.pop(event.record, ()):
                self.ties.pop(key, None)
                for end in {key[0], key[2]} - {event.record}:
                    self._tied[end].discard(key)
                    self._touch(end, event.rev)
        if event.erased:
            self._blurred.add(event.record)
            return ""
        try:
            change = event.change_json()
        except (ValueError, RecursionError):
            return "what changed is no sound JSON"
        if verb == "episode":
            source = self._sources[event.record] = str(change.get("source", event.record))
            self.episodes[source] = str(change.get("episode"))
            return ""
        if verb == "forget" and not change:
            self.episodes.pop(self._sources.get(event.record, event.record), None)
            return ""
        return self._change(event, change) if event.change else ""

    def _touch(self, end: str, rev: int) -> None:
        """An end of a link counts as changed; one that is not there (forgotten) does not."""
        row = self.rows.get(end)
        if row is not None and row["state"] != FORGOTTEN:
            row["rev"] = rev

    def _change(self, event: Event, change: dict[str, Any]) -> str:
        if isinstance(change.get("id"), str):
            self.rows[event.record] = change
            self._blurred.discard(event.record)
            return ""
        row, blurred = self.rows.get(event.record), event.record in self._blurred
        if row is None:
            return "" if blurred else "it changes a record that was never created"
        wrong = ""
        for name, pair in change.items():
            if name not in row or not isinstance(pair, list) or len(pair) != 2:
                return "it does not say from what to what"
            if row[name] != pair[0] and not blurred:
                wrong = f"{name} was not what it says before"
            row[name] = pair[1]
        row["version"] += 1
        row["rev"] = event.rev
        return wrong
