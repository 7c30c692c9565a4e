"""The answers of `gvla2 memory`, for people and for programs."""

from __future__ import annotations

import dataclasses
import json
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from typing import Any, TypeVar

from rich.table import Table
from rich.text import Text

from gvla2.commands.tables import Listing, console
from gvla2.io.files import plain
from gvla2.memory.records import Record
from gvla2.record.text import one_line, printable

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
        text = json.dumps(plain(answer.data), indent=2, ensure_ascii=False, allow_nan=False)
        sys.stdout.write(text.encode("utf-8", "replace").decode() + "\n")
        return answer.status
    out = console()
    for part in answer.shown:
        if isinstance(part, str):
            out.print(Text(printable(part)), soft_wrap=True)
        else:
            out.print(part.laid_out(out.width) if isinstance(part, Listing) else part)
    return answer.status


def record_data(record: Record) -> dict[str, Any]:
    """A record with its JSON columns read."""
    return read_columns(record, "verifier", "signature", "effect", "provenance")


def read_columns(thing: Any, *columns: str) -> dict[str, Any]:
    """A row's fields with JSON parsed; a damaged one stays text."""
    data: dict[str, Any] = {f.name: getattr(thing, f.name) for f in dataclasses.fields(thing)}
    for name in columns:
        with suppress(ValueError):
            data[name] = json.loads(data[name]) if data[name] else None
    return data


def records_listing(records: Sequence[Record]) -> Listing:
    """One row per record."""
    columns = ("id", "type", "state", "outcome", "conf.", "count", "used", "content")
    rows = [
        (r.id, r.type, r.state, r.outcome, f"{r.confidence:.2f}", str(r.count), str(r.usage),
         one_line(r.content))
        for r in records
    ]  # fmt: skip
    return Listing(columns, rows, prose=("content",))


def clock(seconds: float) -> str:
    """Local date and time."""
    try:
        return datetime.fromtimestamp(seconds).astimezone().strftime("%Y-%m-%d %H:%M:%S")
    except (OverflowError, OSError, ValueError):
        return str(seconds)


def shortened(items: Sequence[T], limit: int) -> tuple[Sequence[T], str]:
    """At most ``limit`` items (0: all), and a note on the others."""
    if not limit or len(items) <= limit:
        return items, ""
    return items[:limit], f"{limit} of {len(items)} are shown; limit=0 shows all."
