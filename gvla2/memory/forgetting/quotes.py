"""Which texts quote a forgotten record: they name it as a reason, or repeat its words."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass

from gvla2.memory.records import Record
from gvla2.memory.storage.events import Link

SHORTEST = 12
"""Characters from which the same words are a quotation."""
_SHORTEST_ID = 6
"""Shorter ones are words or numbers as well."""
_LONGEST = 60
"""Characters that are compared: reasons may quote the beginning alone."""
_WORD = re.compile(r"[^\s,;:()'\"\[\]{}<>]+")
_POINTER = re.compile(r"(?:merged into|replaced by|summed up in) (\S+)")


@dataclass(frozen=True, slots=True)
class Gone:
    """What a forgotten record said, and the links that named it; ``record`` is None for a damaged one.

    ``seq`` is the number of the last event before it was forgotten.
    """

    id: str
    query: str
    content: str
    links: tuple[Link, ...]
    record: Record | None
    seq: int = 0

    @property
    def lines(self) -> tuple[str, ...]:
        """The instructions it came from."""
        return tuple(line for line in self.query.split("\n") if line)


class Quotes:
    """Finds quotations of any of the forgotten records in short texts; in time of the text, however many they are."""

    def __init__(self, gone: Iterable[Gone]) -> None:
        gone = list(gone)
        ids = {one.id for one in gone if len(one.id) >= _SHORTEST_ID}
        self._plain = {id for id in ids if _WORD.fullmatch(id)}
        self._odd = sorted(ids - self._plain)
        self._words: dict[str, list[str]] = defaultdict(list)
        for one in gone:
            said = " ".join(one.content.split())
            if len(said) >= SHORTEST:
                self._words[said[:SHORTEST]].append(said[:_LONGEST])

    def named_in(self, text: str) -> bool:
        """Whether the text names one."""
        words = {part for word in _WORD.findall(text) for part in (word, word.rstrip("."))}
        return not self._plain.isdisjoint(words) or any(id in text for id in self._odd)

    def repeated_in(self, text: str) -> bool:
        """Whether the text repeats what one said."""
        text = " ".join(text.split())
        for place in range(len(text) - SHORTEST + 1):
            said = self._words.get(text[place : place + SHORTEST])
            if said and any(text.startswith(words, place) for words in said):
                return True
        return False

    def in_reason(self, text: str) -> bool:
        """Whether a reason tells of one: most that name another record go on with its numbers or words."""
        return self.named_in(text) or self.repeated_in(text)

    def in_note(self, text: str) -> bool:
        """The same for a record's note; one that says where a record went, and no more, tells nothing."""
        pointer = _POINTER.fullmatch(text)
        return self.repeated_in(text) if pointer else self.in_reason(text)
