"""Text for terminals and pages: foreign text must not control a terminal, and stays on its line."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable


def printable(text: str) -> str:
    """Text without control characters, which a terminal would execute; line ends stay."""
    return "".join(" " if c != "\n" and _controls(unicodedata.category(c)) else c for c in text)


def _controls(category: str) -> bool:
    return category[0] == "C" or category in ("Zl", "Zp")


def one_line(text: str, limit: int = 160) -> str:
    """Printable text on one line of at most ``limit`` characters."""
    line = " ".join(printable(text[: 4 * limit]).split())
    return line if len(line) <= limit else f"{line[: limit - 1].rstrip()}…"


def count(number: int, one: str, many: str = "") -> str:
    """A number with its noun: "1 waypoint", "8 waypoints"."""
    return f"{number} {one if number == 1 else many or one + 's'}"


def listing(words: Iterable[str], limit: int = 4) -> str:
    """The first few words and how many more there are."""
    given = list(words)
    more = f" and {len(given) - limit} more" if len(given) > limit else ""
    return ", ".join(given[:limit]) + more
