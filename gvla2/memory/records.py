"""A stored lesson: m = (i, q, c, y, s, z, kappa, R, u, d, L, v) of the paper, and more."""

from __future__ import annotations

import hashlib
import json
import math
import re
import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass, fields
from operator import attrgetter
from typing import Any, Literal, get_args

RecordType = Literal["procedural_hint", "failure_avoidance", "tool_usage"]
LifecycleState = Literal["provisional", "active", "archive"]
Outcome = Literal["verified_success", "verified_fail", "uncertain", "unavailable"]
Trust = Literal["foreign", "own"]
"""A text comes from outside, or from a verified episode of ours (or the user vouches for it)."""

TYPES: tuple[RecordType, ...] = get_args(RecordType)
"""The types in a fixed order: numeric columns hold indices into it."""
OUTCOMES: tuple[Outcome, ...] = get_args(Outcome)
"""The outcomes in a fixed order: numeric columns hold indices into it."""

FORGOTTEN = "forgotten"
"""The state of a tombstone: the record was forgotten, and only its id and number of changes are left."""
SECONDS_PER_DAY = 86_400.0
MAX_SOURCE = 200
"""Maximum length of a source's name, characters."""
MAX_QUERY, MAX_PHRASINGS = 1000, 8
"""Maximum length of one instruction in a record, characters, and maximum number of instructions."""


@dataclass(frozen=True, slots=True)
class Record:
    """One lesson in a bank. Links and the embedding are kept apart, see :class:`~gvla2.memory.tables.Link` and
    :class:`~gvla2.memory.view.Embedded`.

    ``query`` are the instructions it came from, one per line; ``count`` how many episodes say the same; ``usage`` how
    often it was recalled for an episode that was then verified as a success, ``recalled`` how often for one that was
    verified as either. Times are seconds since the epoch: ``created``, ``updated`` (last evidence) and
    ``used`` (last credit, 0 for never). ``verifier`` and ``provenance`` are JSON objects, ``effect`` one or "".
    ``trust`` follows from the origins of its events. Only the store sets ``version``, which counts the changes
    of this record (0: not stored yet), and ``rev``, the number of the bank's transaction that last changed it.
    """

    id: str
    bank: str
    query: str
    content: str
    type: RecordType
    state: LifecycleState
    outcome: Outcome
    confidence: float
    quality: float
    dedup_key: str
    created: float
    updated: float
    used: float = 0.0
    count: int = 1
    usage: int = 0
    recalled: int = 0
    verifier: str = "{}"
    skill: str = ""
    effect: str = ""
    provenance: str = "{}"
    note: str = ""
    trust: Trust = "own"
    # The store's own; the last two columns of the table, too.
    version: int = 0
    rev: int = 0

    @property
    def text(self) -> str:
        """The text that is searched and embedded: its instructions and content."""
        return f"{self.query} {self.content}"

    def effect_json(self) -> dict[str, Any] | None:
        """The typed effect, or None."""
        return load_object(self.effect) if self.effect else None

    def provenance_json(self) -> dict[str, Any]:
        """The record's provenance: ``made_by`` and ``sources``, the ids of its episodes."""
        return load_object(self.provenance)

    def sources(self) -> tuple[str, ...]:
        """Ids of the episodes that the record comes from."""
        listed = self.provenance_json().get("sources", [])
        return tuple(str(source) for source in listed) if isinstance(listed, list) else ()


COLUMNS: tuple[str, ...] = tuple(field.name for field in fields(Record))
"""The columns of a record, in the order of :class:`Record` and of its table."""

_JSON_COLUMNS = ("verifier", "effect", "provenance")
_VALUES = attrgetter(*COLUMNS)
COLUMN_TYPES = tuple({"float": float, "int": int}.get(str(field.type), str) for field in fields(Record))
_CODEC = json.JSONEncoder(sort_keys=True, ensure_ascii=False, separators=(",", ":"), allow_nan=False)


def _no_constant(name: str) -> float:
    raise ValueError(f"{name} is not a JSON number")


_DECODER = json.JSONDecoder(parse_constant=_no_constant)


def dump(data: Any) -> str:
    """JSON with sorted keys: the same data give the same text. Raises ``ValueError`` for NaN and infinity."""
    return _CODEC.encode(data)


def load_object(text: str) -> dict[str, Any]:
    """A JSON object; raises ``ValueError`` for anything else."""
    data = _DECODER.decode(text)
    if not isinstance(data, dict):
        raise ValueError("not a JSON object")
    return data


def damage_of(row: tuple[Any, ...]) -> str:
    """What is wrong with a stored row (columns as in :data:`COLUMNS`), "" if nothing."""
    for name, value, kind in zip(COLUMNS, row, COLUMN_TYPES, strict=True):
        wrong = type(value) is not kind
        if wrong:
            return f"{name} of a wrong type"
        if kind is float and not math.isfinite(value):
            return f"{name} is not a finite number"
        if kind is int and not 0 <= value < 2**63:
            return f"{name} is not a count"
        if name not in _JSON_COLUMNS or value == "{}" or (name == "effect" and not value):
            continue
        try:
            load_object(value)
        except (ValueError, TypeError, RecursionError) as error:
            return f"{name} is not valid JSON ({error})"
    return ""


def as_json(record: Record) -> dict[str, Any]:
    """The record's columns by name."""
    return dict(zip(COLUMNS, _VALUES(record), strict=True))


def clean(text: str, limit: int) -> str:
    """Text that any database accepts: no NUL, no lone surrogates, at most ``limit`` characters."""
    if text.isascii() and "\x00" not in text:
        return text[:limit]
    return text[:limit].replace("\x00", "").encode("utf-8", "replace").decode("utf-8")


def source_id(source: str) -> str:
    """One name for a source that is written differently: evidence of one source counts once.

    Characters that are not seen go, and from an address its user, the case of its host and the dot behind it.
    """
    seen = (c for c in unicodedata.normalize("NFKC", source) if unicodedata.category(c)[0] != "C")
    scheme, mark, rest = clean("".join(seen).strip(), 4 * MAX_SOURCE).partition("://")
    if not mark:
        return scheme[:MAX_SOURCE]
    host, *path = re.split(r"(?=[/?#])", rest, maxsplit=1)
    host = re.sub(r"\.(?=:|$)", "", host.rpartition("@")[2].casefold())
    return f"{scheme.casefold()}://{host}{''.join(path)}"[:MAX_SOURCE]


def finite(numbers: Mapping[str, float]) -> dict[str, float]:
    """The entries that are finite numbers."""
    return {str(k): float(v) for k, v in numbers.items() if math.isfinite(float(v))}


def dedup_key(kind: RecordType, content: str, skill: str, effect: Mapping[str, Any] | None) -> str:
    """Two lessons with one key say the same: equal words (case and spacing aside) and the same parameter.

    The effect's numbers are left out: they are what merging pools.
    """
    # Not NFKC, which makes "105" of "10⁵".
    words, said = " ".join(unicodedata.normalize("NFC", content).casefold().split()), effect or {}
    about = [str(said.get(name, "")) for name in ("kind", "parameter", "op", "skill")]
    about += [str(said["scale"])] if said.get("scale") else []  # shares and metres are never pooled
    # Lessons about different objects or regions are never pooled either.
    about += [f"{name}={said[name]}" for name in ("object", "region") if said.get(name)]
    if said.get("kind") == "program":
        about += [dump([said.get(name) for name in ("language", "roles", "steps")])]
    return hashlib.blake2b(dump([kind, words, skill, about]).encode(), digest_size=16).hexdigest()


def record_id(kind: RecordType, bank: str, key: str) -> str:
    """A short, stable id: the same lesson in the same bank has the same one on every machine."""
    prefix = {"procedural_hint": "hint", "failure_avoidance": "avoid", "tool_usage": "tool"}[kind]
    return f"{prefix}-{hashlib.blake2b(dump([bank, key]).encode(), digest_size=6).hexdigest()}"
