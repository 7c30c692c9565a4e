"""Text for a terminal: what others wrote must not make it do things."""

from __future__ import annotations

import unicodedata


def printable(text: str) -> str:
    """Text without control characters, which could make a terminal do things; line ends stay."""
    return "".join(c if c == "\n" or unicodedata.category(c)[0] != "C" else " " for c in text)


def one_line(text: str, limit: int) -> str:
    """Printable text on one line of at most ``limit`` characters."""
    line = " ".join(printable(text[: 4 * limit]).split())
    return line if len(line) <= limit else f"{line[: limit - 1]}…"


def counted(count: int, thing: str) -> str:
    """A number with its noun: "1 line", "2 lines"."""
    return f"{count} {thing}" if count == 1 else f"{count} {thing}s"
