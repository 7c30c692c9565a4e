"""What a verb of `gvla2 memory` answers, for people and for programs."""

from __future__ import annotations

import dataclasses
import json
import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any, TypeVar

from rich.table import Table
from rich.text import Text

from gvla2.commands.memory_listing import Column, Listing
from gvla2.commands.printable import one_line, printable
from gvla2.commands.tables import console
from gvla2.memory.records import Record

T = TypeVar("T")


@dataclass(frozen=True)
class Answer:
    """``data`` is one JSON document; ``shown`` the same as listings and lines; ``status`` the exit status."""

    data: Any
    shown: Sequence[Listing | Table | str] = ()
    status: int = 0


def give(answer: Answer, *, as_json: bool) -> int:
    """Print the answer; the exit status."""
    if as_json:
        sys.stdout.write(json.dumps(plain(answer.data), indent=2, ensure_ascii=False, allow_nan=False) + "\n")
        return answer.status
    out = console()
    for part in answer.shown:
        if isinstance(part, str):
            out.print(Text(part), soft_wrap=True)
        else:
            out.print(part.laid_out(out.width) if isinstance(part, Listing) else part)
    return answer.status


def plain(data: Any) -> Any:
    """As JSON takes it: dataclasses as objects, bytes as hexadecimal, what is no finite number as null."""
    match data:
        case bool() | int() | None:
            return data
        case str():
            return data.encode("utf-8", "replace").decode()
        case float():
            return data if math.isfinite(data) else None
        case bytes():
            return data.hex()
        case Mapping():
            return {str(key): plain(value) for key, value in data.items()}
        case Sequence() | set() | frozenset():
            return [plain(value) for value in data]
    if dataclasses.is_dataclass(data) and not isinstance(data, type):
        return {f.name: plain(getattr(data, f.name)) for f in dataclasses.fields(data)}
    if callable(getattr(data, "item", None)):  # a number of numpy
        return plain(data.item())
    return str(data)


def record_data(record: Record) -> dict[str, Any]:
    """A record with its JSON columns read; one that is damaged stays text."""
    data: dict[str, Any] = {f.name: getattr(record, f.name) for f in dataclasses.fields(record)}
    for name in ("verifier", "signature", "effect", "provenance"):
        try:
            data[name] = json.loads(data[name]) if data[name] else None
        except ValueError:
            continue
    return data


def records_listing(records: Sequence[Record]) -> Listing:
    """One row a record."""
    columns = (
        Column("id"),
        Column("type", spare=3),
        Column("state"),
        Column("outcome", spare=2),
        Column("conf.", spare=1),
        Column("count", spare=4),
        Column("used", spare=5),
        Column("content", prose=True),
    )
    rows = [
        (
            printable(record.id),
            record.type,
            record.state,
            record.outcome,
            f"{record.confidence:.2f}",
            str(record.count),
            str(record.usage),
            one_line(record.content, 160),
        )
        for record in records
    ]
    return Listing(columns, rows)


def clock(seconds: float) -> str:
    """Local date and time."""
    try:
        return datetime.fromtimestamp(seconds).astimezone().strftime("%Y-%m-%d %H:%M:%S")
    except (OverflowError, OSError, ValueError):
        return str(seconds)


def shortened(items: Sequence[T], limit: int) -> tuple[Sequence[T], str]:
    """At most ``limit`` items (0: all), and what to say of the others."""
    if not limit or len(items) <= limit:
        return items, ""
    return items[:limit], f"{limit} of {len(items)} are shown; limit=0 shows all."
