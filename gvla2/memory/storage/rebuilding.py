"""From events alone to the rows they made: what a bank was at any time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from gvla2.memory.records import COLUMNS, FORGOTTEN, Record
from gvla2.memory.storage.events import Event, Link

_FIELDS = set(COLUMNS)


@dataclass(frozen=True)
class Rebuilt:
    """What the events of a bank amount to: its records and links, sorted; ``episodes`` digests by source."""

    records: tuple[Record, ...]
    links: tuple[Link, ...]
    episodes: Mapping[str, str]
    tombstones: tuple[Record, ...] = ()


@dataclass
class Folding:
    """A bank while its events are applied one by one. ``wrong`` are sentences about those that do not fit."""

    rows: dict[str, dict[str, Any]] = field(default_factory=dict)
    links: dict[tuple[str, str, str], float] = field(default_factory=dict)
    linked: dict[str, set[tuple[str, str, str]]] = field(default_factory=dict)
    episodes: dict[str, str] = field(default_factory=dict)
    sources: dict[str, str] = field(default_factory=dict)
    blurred: set[str] = field(default_factory=set)
    """Records of which an event was erased: what comes after it need not fit, until one has the whole record."""

    def apply(self, event: Event) -> str:
        """Apply the next event; says what does not fit, "" for nothing."""
        verb, _, kind = event.action.partition(":")
        if verb in ("link", "unlink"):
            self._link(verb, (event.record, kind, event.target), event)
            return ""
        if verb == "forget" and not kind:  # even if it was erased, as forgetting the same id once more does
            for key in sorted(self.linked.get(event.record, ())):
                self._link("unlink", key, event)
        if event.erased:
            self.blurred.add(event.record)
            return ""
        try:
            change = event.change_json()
        except (ValueError, RecursionError):
            return "what changed is no sound JSON"
        if verb == "episode":
            source = self.sources[event.record] = str(change.get("source", event.record))
            self.episodes[source] = str(change.get("episode"))
            return ""
        if verb == "forget" and not change:
            self.episodes.pop(self.sources.get(event.record, event.record), None)
            return ""
        if not event.change:
            return ""
        return self._change(event, change)

    def _link(self, verb: str, key: tuple[str, str, str], event: Event) -> None:
        """Both ends count as changed; an end that is not there (forgotten) does not."""
        if verb == "link":
            self.links[key] = event.at
        else:
            self.links.pop(key, None)
        for end in (key[0], key[2]):
            if verb == "link":
                self.linked.setdefault(end, set()).add(key)
            else:
                self.linked.get(end, set()).discard(key)
            row = self.rows.get(end)
            if row is not None and row["state"] != FORGOTTEN:
                row["rev"] = event.rev

    def _change(self, event: Event, change: dict[str, Any]) -> str:
        if isinstance(change.get("id"), str):
            self.rows[event.record] = change
            self.blurred.discard(event.record)
            return ""
        row, blurred = self.rows.get(event.record), event.record in self.blurred
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

    def rebuilt(self) -> Rebuilt:
        """Where the events have led up to now."""
        records = [Record(**row) for _, row in sorted(self.rows.items()) if set(row) == _FIELDS]
        return Rebuilt(
            tuple(record for record in records if record.state != FORGOTTEN),
            tuple(Link(*key, at) for key, at in sorted(self.links.items())),
            dict(self.episodes),
            tuple(record for record in records if record.state == FORGOTTEN),
        )


def rebuild(events: Iterable[Event]) -> Rebuilt:
    """Fold events, oldest first."""
    folding = Folding()
    for event in events:
        folding.apply(event)
    return folding.rebuilt()
