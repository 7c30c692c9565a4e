"""JSON lines from anybody: a broken one is named, the others are read."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, NoReturn

from gvla2.errors import Gvla2Error, MemoryStoreError
from gvla2.memory.records import clean

LONGEST_TEXT = 100_000
"""Characters of a field."""
LONGEST_LINE = 16_000_000
"""Bytes; a longer line is no record of a lesson."""
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
            for number, raw in raw_lines(stream):
                try:
                    lines.append(Line(path.name, number, parse(raw)))
                except LineError as error:
                    remarks.append(Remark(path.name, number, str(error)))
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


def parse(raw: bytes) -> dict[str, Any]:
    """One JSON object; raises :class:`LineError` for anything else, NaN and infinities included."""
    if len(raw) > LONGEST_LINE:
        raise LineError(f"it is longer than {LONGEST_LINE} bytes")
    try:
        data = json.loads(raw.decode(errors="surrogatepass"), parse_constant=_no_number)
    except UnicodeDecodeError as error:
        raise LineError(f"it is not UTF-8 (byte {error.start})") from error
    except ValueError as error:
        raise LineError(f"it is no JSON: {str(error)[:100]}") from error
    except RecursionError as error:
        raise LineError("it is nested too deeply") from error
    if not isinstance(data, dict):
        raise LineError(f"it holds {kind_of(data)}, not an object")
    return data


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
        raise LineError(f"'{name}' is {kind_of(value)}, not text")
    text = clean(value or "", LONGEST_TEXT)
    if needed and not text.strip():
        raise LineError(f"'{name}' is missing" if value is None else f"'{name}' is empty")
    return text


def kind_of(value: object) -> str:
    """What a JSON value is, in words."""
    kinds = {
        type(None): "null",
        bool: "true or false",
        int: "a number",
        float: "a number",
        str: "text",
        list: "a list",
    }
    return kinds.get(type(value), "an object")


def _no_number(name: str) -> NoReturn:
    raise ValueError(f"{name} is no number")
