"""What a language brings to the signs of orders to a machine: words to set aside with, and claims.

Entries are alternatives of a pattern, words or their stems, in small letters, without accents in Latin script.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Tongue:
    """The words of one language, as alternatives.

    ``drop`` and ``frame``: to set aside, and what; ``whole``: that all of it is meant, or the reader's own; ``deny``:
    what turns such an order round; ``void``: that something no longer holds; ``leak``: to hand out, and ``secret``
    what; ``phrases``: enough by themselves.
    """

    code: str
    script: str
    drop: str
    frame: str
    whole: str
    deny: str
    void: str
    leak: str
    secret: str
    phrases: str


@dataclass(frozen=True)
class Claims:
    """The words of some languages, as alternatives of patterns, folded like those of a ``Tongue``.

    ``none`` of a frame's nouns holds for the reader; ``note``: this text, ``first``: it stands above; ``off``: to
    switch off, ``guard`` what keeps safe; ``phrases``: enough by themselves.
    """

    none: str
    note: str
    first: str
    off: str
    guard: str
    phrases: str
