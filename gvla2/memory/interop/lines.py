"""JSON lines from anybody: a broken one is named, the others are read."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gvla2.errors import Gvla2Error, MemoryStoreError
from gvla2.memory.records import clean, load_object

LONGEST_TEXT = 100_000
"""Characters of a field."""
_LINE_ENDS = {0x85: "\\u0085", 0x2028: "\\u2028", 0x2029: "\\u2029"}


class LineError(Gvla2Error):
    """A line that is no record of its layout; the message says why."""


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


def text_field(fields: Mapping[str, Any], name: str, *, needed: bool = False) -> str:
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
