"""Memory items in a model's own Markdown: title, description and content under a heading each."""

from __future__ import annotations

import re
from collections.abc import Mapping

from gvla2.memory.interop.lines import LONGEST_TEXT, LineError
from gvla2.memory.records import clean

_HEADING = re.compile(r"^[ \t]*#[ \t]*Memory[ \t]+Item\b[^\n]*", re.MULTILINE | re.IGNORECASE)
_FIELD = re.compile(r"^[ \t]*##[ \t]*(title|description|content)\b[ \t:]*", re.MULTILINE | re.IGNORECASE)
_FENCE = re.compile(r"^[ \t]*```\w*[ \t]*$", re.MULTILINE)


def pieces(text: str) -> list[str]:
    """``text`` cut before each item's heading, so that joining the pieces gives it back.

    A piece that says nothing (a fence, an empty item) stays with its neighbour; "" gives no piece.
    """
    cuts = [match.start() for match in _HEADING.finditer(text)][1:]
    parts = [text[a:b] for a, b in zip([0, *cuts], [*cuts, len(text)], strict=True)]
    made: list[str] = []
    for part in parts:
        if made and (not lesson_of(part) or not lesson_of(made[-1])):
            made[-1] += part
        else:
            made.append(part)
    return made if any(lesson_of(p) for p in made) else []


def lesson_of(piece: str | Mapping[str, object]) -> str:
    """What an item says, a line for each of title, description and content; "" when it says nothing.

    Text without such headings, a workflow or a whole trajectory, is the lesson as it stands.
    """
    if isinstance(piece, Mapping):
        return _joined(
            {name: clean(value, LONGEST_TEXT) for name, value in piece.items() if isinstance(value, str)}
        )
    piece = clean(piece, LONGEST_TEXT)
    if not (start := _HEADING.search(piece)):
        return _FENCE.sub("", piece).strip()
    body = _FENCE.sub("", piece[start.end() :])
    marks = list(_FIELD.finditer(body))
    if not marks:
        return body.strip()
    ends = [mark.start() for mark in marks[1:]] + [len(body)]
    return _joined({m[1].lower(): body[m.end() : e].strip() for m, e in zip(marks, ends, strict=True)})


def items_of(value: object) -> tuple[str, list[tuple[tuple[int, int], object]]]:
    """The shape of ``memory_items`` ("text" or "list") and its items with their places (element, piece).

    Raises :class:`LineError` for what is neither text nor a list of texts and objects.
    """
    if isinstance(value, str):
        return "text", [((0, i), piece) for i, piece in enumerate(pieces(value))]
    if not isinstance(value, list):
        raise LineError("'memory_items' is neither text nor a list")
    found: list[tuple[tuple[int, int], object]] = []
    for number, element in enumerate(value):
        if isinstance(element, Mapping):
            found.append(((number, 0), dict(element)))
        elif isinstance(element, str):
            found += [((number, i), piece) for i, piece in enumerate(pieces(element))]
        else:
            raise LineError(f"'memory_items[{number}]' is neither text nor an object")
    return "list", found


def _joined(fields: Mapping[str, str]) -> str:
    parts = (fields.get(name, "").strip() for name in ("title", "description", "content"))
    return "\n".join(part for part in parts if part)
