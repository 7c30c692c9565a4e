"""An episode's sentence, and which of several coloured things it names."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gvla2.planning.colours import colours_in


def sentence_of(rng: np.random.Generator, templates: Sequence[str], given: str | None, **words: str) -> str:
    """One of the templates with the words filled in; a ``given`` sentence wins, after the same draw."""
    drawn = templates[int(rng.integers(len(templates)))].format(**words)
    return drawn if given is None else given


def named_by_colour(given: str | None, colours: Sequence[str], default: int) -> tuple[int, str]:
    """Which of ``colours`` a given sentence names, and a remark for the goal when it names no single one."""
    if given is None:
        return default, ""
    said = colours_in(given)
    named = [i for i, colour in enumerate(colours) if colour in said]
    if len(named) == 1:
        return named[0], ""
    return default, "; the sentence names none by its colour alone, so the seed's own target is judged"
