"""Whether a perceived label matches a person's words."""

from __future__ import annotations

import re
from dataclasses import dataclass

from gvla2.planning.colours import SYNONYMS, colours_in

PILE = "pile"
PILES = ("heap", "stack", "tower")
"""Words for several things that look like one; the choice is a matter of taste."""


@dataclass(frozen=True)
class Words:
    """How a label compares with the true one; None if the true one does not mention it.

    ``colour``: the same colour words. ``noun``: the same head noun, the last word ("mustard bottle" is a bottle).
    ``label``: both.
    """

    label: bool | None
    colour: bool | None
    noun: bool | None


def compare(true: str, perceived: str) -> Words:
    """The perceived label against the true one; an empty true label is not judged."""
    colours = colours_in(true)
    colour = set(colours) == set(colours_in(perceived)) if colours else None
    wanted = head_noun(true)
    noun = wanted == head_noun(perceived) if wanted else None
    judged = [one for one in (colour, noun) if one is not None]
    return Words(all(judged) if judged else None, colour, noun)


def head_noun(label: str) -> str:
    """The last word that is not a colour, in lower case, one word for all piles; "" if there is none."""
    words = re.findall(r"[a-z]+", label.lower())
    colours = {*colours_in(label), *SYNONYMS}
    noun = next((word for word in reversed(words) if word not in colours), "")
    return PILE if noun in PILES else noun
