"""A record as one line of JSON: the fields of the released code, and under ``gvla2`` what it has no field for.

Lines come from anybody: a broken one is named, the others are read.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from gvla2.errors import Gvla2Error, MemoryStoreError
from gvla2.memory.contracts import TYPES, LifecycleState, Outcome, RecordType
from gvla2.memory.curation.trust import LEVELS, Origin, believed, trust_of
from gvla2.memory.injection_patterns import screen
from gvla2.memory.records import Record, clean, dedup_key, dump, finite, load_object, record_id

STATES: tuple[LifecycleState, ...] = ("active", "provisional", "summary", "archive")
"""The lifecycle states in the order of their files."""
LONGEST_TEXT = 100_000
"""Characters of a field."""
_LINE_ENDS = {0x85: "\\u0085", 0x2028: "\\u2028", 0x2029: "\\u2029"}
_SPELT: Mapping[Outcome, str] = {
    "verified_success": "success succeeded verified_success pass passed true",
    "verified_fail": "fail failed failure verified_fail verified_failure false",
    "uncertain": "uncertain unknown unverified none",
    "unavailable": "unavailable",
}
"""Every spelling of a status that the releases have used."""
_OUTCOMES: Mapping[str, Outcome] = {
    "": "uncertain",
    **{word: outcome for outcome, words in _SPELT.items() for word in words.split()},
}
_QUALITIES: Mapping[Outcome, float] = {"verified_success": 0.8, "verified_fail": 0.2}
"""Quality R of a line that has a verdict and no score, else .5; its confidence follows as 2|R - .5|."""


class LineError(Gvla2Error):
    """A line that is no record; the message says why."""


@dataclass(frozen=True)
class Line:
    """One line that holds a JSON object: its ``fields``, ``number`` from 1, ``file`` by name."""

    file: str
    number: int
    fields: Mapping[str, Any]


@dataclass(frozen=True)
class Remark:
    """What is to be said of a line. ``broken`` when it could not be read, else it was read as ``why`` says."""

    file: str
    line: int
    why: str
    broken: bool = True

    def __str__(self) -> str:
        return f"{self.file}, line {self.line}: {self.why}"


@dataclass(frozen=True)
class Entry:
    """What a line says: a record, the ``key`` that names it in its source, keys of others, and ``notes`` on what was
    understood how.
    """

    key: str
    record: Record
    supersedes: tuple[str, ...]
    conflicts: tuple[str, ...]
    notes: tuple[str, ...]


def read_lines(path: Path) -> tuple[list[Line], list[Remark]]:
    """The JSON objects of a file and what is wrong with its other lines; empty lines are passed over.

    Raises :class:`MemoryStoreError` when the file cannot be read at all.
    """
    lines: list[Line] = []
    remarks: list[Remark] = []
    try:
        with path.open("rb") as stream:
            for number, raw in enumerate(stream, 1):
                text = raw.removeprefix(b"\xef\xbb\xbf") if number == 1 else raw
                if not text.strip():
                    continue
                try:
                    lines.append(Line(path.name, number, parse(text)))
                except LineError as error:
                    remarks.append(Remark(path.name, number, str(error)))
    except OSError as error:
        raise MemoryStoreError(f"Cannot read {path}: {error.strerror or error}.") from error
    return lines, remarks


def parse(raw: bytes) -> dict[str, Any]:
    """One JSON object; raises :class:`LineError` for anything else, NaN and infinities included."""
    try:
        return load_object(raw.decode(errors="surrogatepass").strip())
    except UnicodeDecodeError as error:
        raise LineError(f"it is not UTF-8 (byte {error.start})") from error
    except (ValueError, RecursionError) as error:
        raise LineError(f"it is no JSON object: {str(error)[:100]}") from error


def to_bytes(rows: Iterable[Mapping[str, Any]]) -> bytes:
    """A whole file, in the spelling that the released code uses.

    Unicode's own line ends are escaped: the released readers would cut the line there.
    """
    texts = (json.dumps(row, ensure_ascii=False, allow_nan=False).translate(_LINE_ENDS) for row in rows)
    return "".join(f"{text}\n" for text in texts).encode()


def read_record(line: Line, bank: str, now: float, origin: Origin) -> Entry:
    """The record of a line as ``bank`` takes it; raises :class:`LineError` when it has no id or says nothing.

    The file's name tells the state, or else the line's own word; but what is not believed by its ``origin`` is
    provisional, whatever the line says of it.
    """
    fields, notes = line.fields, list[str]()
    told = _text(fields, "state")
    state = next((s for word in (line.file.removesuffix(".jsonl"), told) for s in STATES if s == word), None)
    if state is None:
        raise LineError(f"neither the file's name nor 'state' ('{told}') is one of {', '.join(STATES)}")
    said = _text(fields, "verifier_label") or fields.get("source_status")
    status = "" if said is None else str(said)
    outcome = _OUTCOMES.get(status.strip().casefold())
    if outcome is None:
        notes.append(f"its status '{status[:40]}' is not known")
        outcome = "uncertain"
    kind = _type(_text(fields, "memory_type"), outcome, notes)
    name, content = _text(fields, "memory_id", needed=True)[:1000], _text(fields, "content", needed=True)
    query, task = _text(fields, "query"), clean(_text(fields, "task_id"), 200)
    quality = share(fields.get("quality_score"))
    quality = _QUALITIES.get(outcome, 0.5) if quality is None else quality
    confidence = share(fields.get("confidence"))
    ours = _mapping(fields.get("gvla2"))
    effect, skill = _mapping(ours.get("effect")), clean(str(ours.get("skill") or ""), 64)
    signature = {k: v for k, v in _mapping(ours.get("signature")).items() if isinstance(v, int | float)}
    key = dedup_key(kind, content, skill, effect or None)
    screened = screen(f"{query}\n{content}")
    trust = trust_of([origin], screened=bool(screened))
    if origin.own and ours.get("trust") in LEVELS:
        trust = min(trust, ours["trust"], key=LEVELS.index)
    note = ""
    if not believed(trust) and state != "archive":
        state, note = "provisional", screened or "it was imported, and nobody here has borne it out yet"
    created, used = _when(fields.get("created_at")), min(_when(fields.get("last_used_at")) or 0.0, now)
    created = now if created is None else min(created, now)
    usage = count(fields.get("use_count"))
    criteria = {
        str(k): n
        for k, v in _mapping(fields.get("verifier_criteria")).items()
        if (n := number(v)) is not None
    }
    provenance = {"made_by": {"import": "states"}, "sources": [task] if task else [], "key": name}
    record = Record(
        id=record_id(kind, bank, key),
        bank=bank,
        query=query,
        content=content,
        type=kind,
        state=state,
        outcome=outcome,
        confidence=2 * abs(quality - 0.5) if confidence is None else confidence,
        quality=quality,
        dedup_key=key,
        created=created,
        updated=max(created, used),
        used=used,
        count=max(count(ours.get("count")), 1),
        usage=usage,
        recalled=max(usage, count(ours.get("recalled"))),
        verifier=dump({"verifier": _text(fields, "verifier_model"), "criteria": criteria, "reasons": []}),
        signature=dump(finite(signature)),
        skill=skill,
        effect=dump(dict(effect)) if effect else "",
        provenance=dump(provenance),
        note=note,
        trust=trust,
    )
    return Entry(
        name, record, _names(fields.get("supersedes")), _names(fields.get("conflicts_with")), tuple(notes)
    )


def write_record(record: Record, replaces: Sequence[str], conflicts: Sequence[str]) -> dict[str, Any]:
    """The fields of a line."""
    judged = record.outcome in ("verified_success", "verified_fail", "uncertain")
    verifier = record.verifier_json()
    return {
        "memory_id": record.id,
        "task_id": next(iter(record.sources()), ""),
        "query": record.query,
        "content": record.content,
        "memory_type": record.type,
        "source_status": record.outcome if judged else "uncertain",
        "state": record.state,
        "confidence": record.confidence,
        "quality_score": record.quality,
        "created_at": _date(record.created),
        "last_used_at": _date(record.used) if record.usage and record.used else None,
        "use_count": record.usage,
        "dedup_key": f"{record.type}:{record.id}",
        "supersedes": list(replaces),
        "conflicts_with": list(conflicts),
        "embedding": None,
        "verifier_score": record.quality if judged else None,
        "verifier_confidence": record.confidence if judged else None,
        "verifier_label": record.outcome if judged else None,
        "verifier_criteria": finite(verifier.get("criteria") or {}),
        "verifier_model": verifier.get("verifier") or None,
        "gvla2": {
            "skill": record.skill,
            "effect": record.effect_json(),
            "signature": record.signature_json(),
            "count": record.count,
            "recalled": record.recalled,
            "trust": record.trust,
        },
    }


def _type(told: str, outcome: Outcome, notes: list[str]) -> RecordType:
    """The type of a lesson that calls itself ``told``: a recipe from a failure is a thing to avoid."""
    kind = next((known for known in TYPES if known == told), None)
    if told and kind is None:
        notes.append(f"its type '{told}' is not known")
    if outcome == "verified_fail" and kind in (None, "procedural_hint"):
        return "failure_avoidance"
    return kind or "procedural_hint"


def _text(fields: Mapping[str, Any], name: str, *, needed: bool = False) -> str:
    """A field that is text, as a database takes it; "" where it is absent or null. Numbers (ids) become their text.

    Raises :class:`LineError` when it is ``needed`` and says nothing, or when it is something else.
    """
    value = fields.get(name)
    if isinstance(value, int | float) and not isinstance(value, bool):
        value = str(value)
    if value is not None and not isinstance(value, str):
        raise LineError(f"'{name}' is no text")
    text = clean(value or "", LONGEST_TEXT)
    if needed and not text.strip():
        raise LineError(f"'{name}' is missing or empty")
    return text


def _mapping(value: object) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}


def _names(value: object) -> tuple[str, ...]:
    """A list of ids; what is no text in it is left out."""
    return tuple(clean(v, 1000) for v in value if isinstance(v, str)) if isinstance(value, list) else ()


def _when(value: object) -> float | None:
    """Seconds since the epoch of a number or an ISO date (UTC where it names no zone); None if it is neither."""
    if isinstance(value, str):
        try:
            date = datetime.fromisoformat(value.strip())
            value = (date if date.tzinfo else date.replace(tzinfo=UTC)).timestamp()
        except (ValueError, OverflowError):
            return None
    found = number(value)
    return found if found is not None and 0 <= found < 4e11 else None


def _date(seconds: float) -> str | None:
    """The ISO date in UTC; None for a time that no calendar has, as a clock gone wrong gives it."""
    try:
        return datetime.fromtimestamp(seconds, UTC).isoformat()
    except (ValueError, OverflowError, OSError):
        return None


def number(value: object) -> float | None:
    """A number as a finite float; None for what is no number, or beyond all floats."""
    try:
        found = float(value) if isinstance(value, int | float) and not isinstance(value, bool) else math.nan
    except OverflowError:  # JSON's whole numbers have no bound
        return None
    return found if math.isfinite(found) else None


def share(value: object) -> float | None:
    """A number held to [0, 1]; None for what is no number."""
    found = number(value)
    return None if found is None else min(max(found, 0.0), 1.0)


def count(value: object) -> int:
    """A count; 0 for what is none."""
    return int(min(max(number(value) or 0.0, 0.0), 2.0**53))
