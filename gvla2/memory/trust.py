"""Trust by the origin of a text, never by what it says about itself.

Each event that brings evidence for a record stores an :class:`Origin` in the hash chain; a record's trust follows from
its origins (:func:`trust_of`). Claims of a record, a file or a text about its own origin are ignored.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import get_args

from gvla2.memory.records import Trust

LEVELS: tuple[Trust, ...] = get_args(Trust)
"""From the least trusted to the most."""
CONFIRMING = 2
"""Number of independent sources whose verified episodes make a foreign text believed."""
_SCHEME = re.compile(r"^[a-z][a-z0-9+.-]*://")
_MEMBER = re.compile(r"[/:#@?]")


@dataclass(frozen=True)
class Origin:
    """The origin of one piece of evidence: ``own`` for a verified episode of ours, and the ``source`` it names."""

    own: bool
    source: str

    def __str__(self) -> str:
        """As an event stores it."""
        return f"{'own' if self.own else 'foreign'}:{self.source}"

    @classmethod
    def read(cls, text: str) -> Origin | None:
        """The origin that an event stores, None for an event that brings no evidence."""
        kind, colon, source = text.partition(":")
        return cls(kind == "own", source) if colon and kind in ("own", "foreign") else None

    @property
    def witness(self) -> str:
        """The witness: equal for all names that one source uses ("lab/1", "lab/2", "lab#3").

        For an address it is the host; all unnamed sources are one witness.
        """
        name = _SCHEME.sub("", " ".join(self.source.casefold().split()))
        return _MEMBER.split(name, maxsplit=1)[0]


def trust_of(origins: Iterable[Origin]) -> Trust:
    """The trust of a text with these verified origins.

    One verified episode of ours makes a text ours. Foreign sources are counted once each, only by their names: ten
    episodes of one are one.
    """
    known = list(origins)
    if any(origin.own for origin in known):
        return "own"
    return "confirmed" if len({origin.witness for origin in known}) >= CONFIRMING else "foreign"


def adds(origins: Iterable[Origin], origin: Origin) -> bool:
    """Whether one more origin adds evidence: ours needs no confirmation from outside, and an outside witness counts
    once, whatever episodes it names.
    """
    if origin.own:
        return True
    return all(not other.own and other.witness != origin.witness for other in origins)


def least(trusts: Iterable[Trust]) -> Trust:
    """The trust of a text made from several (a summary, a lesson induced with them in view)."""
    return min(trusts, key=LEVELS.index, default="own")


def believed(trust: Trust) -> bool:
    """Whether a verified text of this trust may be active and shown to a planner."""
    return trust != "foreign"
