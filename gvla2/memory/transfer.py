"""A bank as JSON lines: one record a line, its fields by name, with its links.

Lines of a file are untrusted: a broken one is reported, the others are read, and what a line says about its own state
and trust counts only in the user's own backup.
"""

from __future__ import annotations

import json
import os
import time
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, get_args

from gvla2.errors import Gvla2Error, MemoryStoreError, OutputError
from gvla2.io.files import write_whole
from gvla2.memory.admission import invalid
from gvla2.memory.contracts import OUTCOMES, TYPES, Lesson, LifecycleState
from gvla2.memory.records import COLUMNS, Record, clean, damage_of, dedup_key, dump, load_object, record_id
from gvla2.memory.store import Store
from gvla2.memory.trust import LEVELS, Origin, believed, trust_of

STATES: tuple[LifecycleState, ...] = get_args(LifecycleState)
LONGEST_TEXT = 100_000
"""Characters of a field."""
_OBJECTS = ("verifier", "signature", "effect", "provenance")
"""Fields that are JSON objects."""
_REQUIRED = ("id", "content")


@dataclass(frozen=True)
class Exported:
    """The file written, its lines (one per record), and how many records of other states were left out."""

    file: Path
    records: int
    left_out: int


@dataclass(frozen=True)
class Imported:
    """The result for a file: ids of the new records, how many lessons were already ``known`` to the bank, how many of
    the new ones are ``held_back`` as provisional, and the ``broken`` lines with their numbers.
    """

    added: tuple[str, ...]
    known: int
    held_back: int
    broken: tuple[str, ...]


class LineError(Gvla2Error):
    """A line that is not a record; the message says why."""


def export_jsonl(store: Store, bank: str, path: Path, *, states: Sequence[str] | None = None) -> Exported:
    """Write the records of a bank, those in ``states`` (all by default), to a new file.

    Raises :class:`OutputError` when the path is taken or cannot be written; nothing is left there then.
    """
    with store.reading(bank) as view:
        everything, links = view.records(), view.links()
    shown = [record for record in everything if states is None or record.state in states]
    targets: dict[str, dict[str, list[str]]] = defaultdict(lambda: defaultdict(list))
    for link in links:
        targets[link.source][link.kind].append(link.target)
    lines = []
    for record in sorted(shown, key=lambda r: (r.created, r.id)):
        fields: dict[str, Any] = {name: getattr(record, name) for name in COLUMNS[:-2] if name != "bank"}
        fields |= {name: load_object(fields[name]) if fields[name] else None for name in _OBJECTS}
        lines.append(json.dumps({**fields, "links": targets[record.id]}, ensure_ascii=True, allow_nan=False))
    try:
        if path.exists() or path.is_symlink():
            raise OutputError(
                f"{path} already exists, and an export never replaces anything. Choose another path."
            )
        write_whole(path, "".join(f"{line}\n" for line in lines).encode())
    except (OSError, RuntimeError) as error:  # RuntimeError: a circular link
        raise OutputError(f"Cannot write {path}: {getattr(error, 'strerror', '') or error}.") from error
    return Exported(path, len(shown), len(everything) - len(shown))


def import_jsonl(
    store: Store,
    bank: str,
    path: Path,
    *,
    trusted: bool = False,
    source: str = "import",
    actor: str = "import",
    now: float | None = None,
) -> Imported:
    """Read a file into ``bank``, in one transaction; a file that was imported before adds nothing.

    Records from others are provisional until verified episodes of two independent sources confirm them, whatever a file
    says about itself; an import is one ``source``. ``trusted`` is for the user's own backup: records keep their
    lifecycle state and trust. The bank embeds new records at its next query. Raises :class:`MemoryStoreError` when the
    file or the store cannot be read; nothing is stored then.
    """
    at, origin = time.time() if now is None else now, Origin(trusted, source)
    entries: list[tuple[str, Record, dict[str, Any]]] = []
    broken: list[str] = []
    for number, raw in _lines(path):
        try:
            fields = _fields(raw)
            entries.append((str(fields["id"]), _record(fields, bank, at, origin), fields))
        except (LineError, ValueError, TypeError, OverflowError, RecursionError) as error:
            broken.append(f"{path.name}, line {number}: {error}")
    if broken and not entries:
        raise MemoryStoreError(f"{path} is not an export of a memory: {broken[0]}.")
    new: dict[str, tuple[Record, dict[str, Any]]] = {}
    ids: dict[str, str] = {}
    with store.writing(bank, actor=actor, now=at) as transaction:
        stored = transaction.by_keys({record.dedup_key for _, record, _ in entries})
        for key, record, fields in entries:
            there = stored.get(record.dedup_key)
            ids.setdefault(key, record.id if there is None else there.id)
            if there is None:
                new.setdefault(record.id, (record, fields))
        for record, _ in new.values():
            note = " ".join(ids.get(word, word) for word in record.note.split(" "))
            judged = record.outcome in ("verified_success", "verified_fail")
            evidence = str(origin) if judged else ""
            transaction.put(replace(record, note=note), "import", origin=evidence)
        for id, (_, fields) in new.items():
            links = fields.get("links") if trusted else None
            for kind, targets in (links if isinstance(links, dict) else {}).items():
                for target in map(str, targets):
                    if kind and ids.get(target, id) != id:
                        transaction.link(id, str(kind), ids[target], "imported")
    held = sum(record.state == "provisional" for record, _ in new.values())
    return Imported(tuple(new), len(entries) - len(new), held, tuple(broken))


def _lines(path: Path) -> list[tuple[int, bytes]]:
    """The numbered lines of a file that are not empty; a pipe works like a file."""
    try:
        if not os.path.exists(path) or path.is_dir():  # noqa: PTH110  # Path.exists raises for names no system takes
            raise MemoryStoreError(
                f"There is no file at {path}: give a .jsonl file of `gvla2 memory export`."
            )
        with path.open("rb") as stream:
            return [(number, raw) for number, raw in enumerate(stream, 1) if raw.strip()]
    except OSError as error:
        raise MemoryStoreError(f"Cannot read {path}: {error.strerror or error}.") from error


def _fields(raw: bytes) -> dict[str, Any]:
    try:
        fields = load_object(raw.decode("utf-8-sig").strip())
    except UnicodeDecodeError as error:
        raise LineError(f"it is not UTF-8 (byte {error.start})") from error
    except (ValueError, RecursionError) as error:
        raise LineError(f"it is not a JSON object: {str(error)[:100]}") from error
    for name in _REQUIRED:
        if not isinstance(fields.get(name), str) or not fields[name].strip():
            raise LineError(f"'{name}' is missing or empty")
    return fields


def _record(fields: Mapping[str, Any], bank: str, now: float, origin: Origin) -> Record:
    """The record of a line for ``bank``; one that its ``origin`` does not vouch for is provisional or archived.

    It then has no note, sources, trust, counts of use or summary's lines of its own.
    """
    kind = _one_of(fields, "type", TYPES, "procedural_hint")
    state = _one_of(fields, "state", STATES, "provisional")
    outcome = _one_of(fields, "outcome", OUTCOMES, "uncertain")
    texts = {name: clean(str(fields.get(name) or ""), LONGEST_TEXT) for name in ("query", "content", "skill")}
    objects = {name: fields.get(name) or {} for name in _OBJECTS}
    if wrong := next((name for name, value in objects.items() if not isinstance(value, dict)), ""):
        raise LineError(f"'{wrong}' is not an object")
    if wrong := invalid(Lesson(kind, texts["content"], objects["effect"])):
        raise LineError(wrong)
    own, trust = origin.own, trust_of([origin])
    if own and fields.get("trust") in LEVELS:
        trust = min(trust, fields["trust"], key=LEVELS.index)
    note = clean(str(fields.get("note") or ""), 1000) if own else ""
    if not believed(trust) and state != "archive":
        state, note = "provisional", note or "it was imported, and is not yet confirmed here"
    summary = own and str(fields["id"]).startswith("summary-")
    key = dedup_key(kind, texts["content"], texts["skill"], objects["effect"])
    key = clean(str(fields.get("dedup_key") or key), 64) if summary else key
    record = Record(
        id=record_id("summary" if summary else kind, bank, key),
        bank=bank,
        query=texts["query"],
        content=texts["content"],
        skill=texts["skill"],
        type=kind,
        state=state,
        outcome=outcome,
        confidence=_number(fields, "confidence", 0.0, 1.0),
        quality=_number(fields, "quality", 0.5, 1.0),
        dedup_key=key,
        created=min(_number(fields, "created", now), now),
        updated=min(_number(fields, "updated", now), now),
        used=min(_number(fields, "used", 0.0), now) if own else 0.0,
        count=max(int(_number(fields, "count", 1.0)), 1) if own else 1,
        usage=int(_number(fields, "usage", 0.0)) if own else 0,
        recalled=int(_number(fields, "recalled", 0.0)) if own else 0,
        verifier=dump(objects["verifier"]),
        signature=dump(objects["signature"]),
        effect=dump(objects["effect"]) if objects["effect"] else "",
        provenance=dump(objects["provenance"] if own else {"made_by": {"import": origin.source}}),
        note=note,
        trust=trust,
    )
    if damage := damage_of(tuple(getattr(record, name) for name in COLUMNS)):
        raise LineError(damage)
    return record


def _one_of(fields: Mapping[str, Any], name: str, known: Sequence[Any], default: str) -> Any:
    value = fields.get(name, default)
    if value not in known:
        raise LineError(f"its {name} '{str(value)[:40]}' is not one of {', '.join(known)}")
    return value


def _number(fields: Mapping[str, Any], name: str, default: float, most: float = 4e11) -> float:
    value = fields.get(name, default)
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value <= most:
        raise LineError(f"its {name} is {str(value)[:40]}, not a number from 0 to {most:g}")
    return float(value)
