"""Who is believed: trust by where a text comes from, never by what it says of itself.

An :class:`Origin` stands with each event that brings evidence for a record, in the hash chain; a record's trust is
what its origins amount to (:func:`trust_of`). Whatever a record, a file or a text claims about its own descent is not
looked at.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import get_args

from gvla2.memory.contracts import Trust

LEVELS: tuple[Trust, ...] = get_args(Trust)
"""From the least trusted to the most."""
CONFIRMING = 2
"""Independent sources whose verified episodes make a foreign text believed."""
_SCHEME = re.compile(r"^[a-z][a-z0-9+.-]*://")
_MEMBER = re.compile(r"[/:#@?]")


@dataclass(frozen=True)
class Origin:
    """Where one piece of evidence comes from: ``own`` for a verified episode of ours, and the ``source`` it names."""

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
        """Who speaks: equal for all that one source sends under names of its own ("lab/1", "lab/2", "lab#3").

        Of an address it is the host; what comes without a name is one witness, however often.
        """
        name = _SCHEME.sub("", " ".join(self.source.casefold().split()))
        return _MEMBER.split(name, maxsplit=1)[0]


def trust_of(origins: Iterable[Origin], *, screened: bool = False) -> Trust:
    """What a text with these verified origins is trusted; ``screened`` (it reads like orders) takes a level off.

    One verified episode of ours makes a text ours; a screened one needs two. Foreign sources are counted once each, and
    only by their names: ten episodes of one are one. What is screened and foreign is never believed, however many
    repeat it.
    """
    known = list(origins)
    ours = {origin.source for origin in known if origin.own}
    if ours:
        return "own" if not screened else "confirmed" if len(ours) >= CONFIRMING else "foreign"
    if screened:
        return "screened"
    named = {origin.witness for origin in known}
    return "confirmed" if len(named) >= CONFIRMING else "foreign"


def adds(origins: Iterable[Origin], origin: Origin) -> bool:
    """Whether one more origin says anything that the others did not: what is ours needs nobody from outside to bear it
    out, and a witness from outside is heard once, whatever the episodes it names.
    """
    known = list(origins)
    if origin.own:
        return True
    return all(not other.own and other.witness != origin.witness for other in known)


def least(trusts: Iterable[Trust]) -> Trust:
    """The trust of what is made of several texts (a merge, a summary, a lesson induced with them in sight)."""
    return min(trusts, key=LEVELS.index, default="own")


def believed(trust: Trust) -> bool:
    """Whether a verified text of this trust may be active and shown to a planner."""
    return LEVELS.index(trust) >= LEVELS.index("confirmed")
