"""JSON lines from anybody: a broken one is named, the others are read."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, NoReturn

from gvla2.errors import Gvla2Error, MemoryStoreError
from gvla2.memory.records import clean

LONGEST_TEXT = 100_000
"""Characters of a field; the rest of a longer one stays in what is kept of its line."""
LONGEST_LINE = 16_000_000
"""Bytes; a longer line is no record of a lesson."""
_LARGE = re.compile(r"[eE]\+?\d{3}|\d{200}")
"""What a number beyond all floats has in it; most lines have no such thing, and need no second look."""
_LINE_ENDS = {0x85: "\\u0085", 0x2028: "\\u2028", 0x2029: "\\u2029"}


class LineError(Gvla2Error):
    """A line that is no record of its layout; the message says why."""


@dataclass(frozen=True)
class Line:
    """One line that holds a JSON object: ``fields`` in their order, ``number`` from 1, ``file`` by name."""

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


def read_lines(path: Path, name: str = "") -> tuple[list[Line], list[Remark]]:
    """The JSON objects of a file and what is wrong with its other lines; empty lines are passed over.

    ``name`` is what to call the file. Raises :class:`MemoryStoreError` when the file cannot be read at all.
    """
    name = name or path.name
    lines: list[Line] = []
    remarks: list[Remark] = []
    try:
        with path.open("rb") as stream:
            for number, raw in raw_lines(stream):
                try:
                    lines.append(Line(name, number, parse(raw)))
                except LineError as error:
                    remarks.append(Remark(name, number, str(error)))
    except OSError as error:
        raise MemoryStoreError(f"Cannot read {path}: {error.strerror or error}.") from error
    return lines, remarks


def raw_lines(stream: BinaryIO) -> Iterator[tuple[int, bytes]]:
    """The lines that say anything, numbered from 1, without the mark of byte order.

    Of one that is too long, only as much is held as shows it.
    """
    number = 0
    while raw := stream.readline(LONGEST_LINE + 1):
        number += 1
        rest = raw
        while len(rest) > LONGEST_LINE and not rest.endswith(b"\n"):
            rest = stream.readline(LONGEST_LINE + 1)
        text = raw.removeprefix(b"\xef\xbb\xbf") if number == 1 else raw
        if text.strip():
            yield number, text


def parse(raw: bytes | str) -> dict[str, Any]:
    """One JSON object; raises :class:`LineError` for anything else.

    NaN, infinities and numbers beyond all floats (1e999, or 400 digits) are no numbers here.
    """
    if len(raw) > LONGEST_LINE:
        raise LineError(f"it is longer than {LONGEST_LINE} bytes")
    try:
        text = raw if isinstance(raw, str) else raw.decode(errors="surrogatepass")
        if _LARGE.search(text):
            data = json.loads(text, parse_constant=_no_number, parse_int=_whole, parse_float=_fraction)
        else:
            data = json.loads(text, parse_constant=_no_number)
    except UnicodeDecodeError as error:
        raise LineError(f"it is not UTF-8 (byte {error.start})") from error
    except ValueError as error:
        raise LineError(f"it is no JSON: {error}") from error
    except RecursionError as error:
        raise LineError("it is nested too deeply") from error
    if not isinstance(data, dict):
        raise LineError(f"it holds {_kind(data)}, not an object")
    return data


def to_text(fields: Mapping[str, Any]) -> str:
    """One line, without its end: the spelling that the released code uses.

    Text that UTF-8 cannot hold (half a surrogate pair) is escaped, so that the line can always be written; so are
    the Unicode line ends, at which the released readers would cut the line.
    """
    text = json.dumps(fields, ensure_ascii=False, allow_nan=False).translate(_LINE_ENDS)
    try:
        text.encode()
    except UnicodeEncodeError:
        return json.dumps(fields, allow_nan=False)
    return text


def to_bytes(rows: Iterable[Mapping[str, Any]]) -> bytes:
    """A whole file."""
    return "".join(f"{to_text(row)}\n" for row in rows).encode()


def text_field(fields: Mapping[str, Any], name: str, *, needed: bool = False) -> str:
    """A field that is text, as a database takes it; "" where it is absent or null. Numbers (ids) become their text.

    Raises :class:`LineError` when it is ``needed`` and says nothing, or when it is something else.
    """
    value = fields.get(name)
    if isinstance(value, int | float) and not isinstance(value, bool):
        value = str(value)
    if value is not None and not isinstance(value, str):
        raise LineError(f"'{name}' is {_kind(value)}, not text")
    text = clean(value or "", LONGEST_TEXT)
    if needed and not text.strip():
        raise LineError(f"'{name}' is missing" if value is None else f"'{name}' is empty")
    return text


def _no_number(name: str) -> NoReturn:
    raise ValueError(f"{name} is no number")


def _fraction(digits: str) -> float:
    """A float as JSON writes it; ``ValueError`` for one beyond the largest."""
    value = float(digits)
    if not math.isfinite(value):
        raise ValueError(f"{_some(digits)} is too large a number")
    return value


def _whole(digits: str) -> int:
    _fraction(digits)
    return int(digits)


def _some(digits: str) -> str:
    return digits if len(digits) <= 20 else f"{digits[:12]}... ({len(digits)} digits)"


def _kind(value: object) -> str:
    match value:
        case None:
            return "null"
        case bool():
            return "true or false"
        case int() | float():
            return "a number"
        case str():
            return "text"
        case list():
            return "a list"
    return "an object"
