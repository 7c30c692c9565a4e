"""The score of one criterion from a model's answer and its token probabilities (paper, eq. R_t).

Twenty letters, A (best) to T (worst), stand for phi = (19 - i) / 19. The answer ends in ``<score>X</score>``; the
score is the expectation of phi over what the model might have said in X's place.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from string import ascii_uppercase
from typing import Literal

from gvla2.language.contracts import Token

LETTERS = ascii_uppercase[:20]
ENOUGH_MASS = 0.5
"""Below this probability of valid letters, the distribution does not reflect the answer given."""

_TAG = re.compile(r"<score>([^<]{0,32}?)(?:</score>|\Z)", re.IGNORECASE | re.ASCII)
_CLOSING = "</score>"
_AROUND = " \t\r\n\v\f\"'`*"
"""What models put around the letter."""

Source = Literal["distribution", "tag", "midpoint"]


@dataclass(frozen=True)
class TokenScore:
    """``value`` in [0, 1] and where it comes from.

    ``mass`` is the total probability of valid letters in X's place, 0 without log-probabilities. ``source``:
    "distribution" (mass of at least one half), "tag" (the letter as written), "midpoint" (.5: the model answered, but
    with no valid letter).
    """

    value: float
    mass: float
    source: Source


def phi(letter: str) -> float:
    """The value of a valid letter: A 1, T 0."""
    return (len(LETTERS) - 1 - LETTERS.index(letter)) / (len(LETTERS) - 1)


def reason_of(text: str) -> str:
    """What an answer says before its last tag; all of it without one."""
    tag = text.lower().rfind("<score>")
    return text[:tag] if tag >= 0 else text


def score_answer(text: str, tokens: Sequence[Token] = ()) -> TokenScore:
    """The score in an answer's last tag; ``tokens`` as :class:`gvla2.language.Completion` has them."""
    tags = list(_TAG.finditer(text))
    if not tags:
        return TokenScore(0.5, 0.0, "midpoint")
    inside = tags[-1].group(1)
    start = tags[-1].start(1) + len(inside) - len(inside.lstrip(_AROUND))
    written = inside.strip(_AROUND)
    letters = _letters(tokens, len(text[:start].encode(errors="replace")))
    mass = min(math.fsum(letters.values()), 1.0)
    if mass >= ENOUGH_MASS:
        expected = math.fsum(p * phi(v) for v, p in letters.items()) / math.fsum(letters.values())
        return TokenScore(min(max(expected, 0.0), 1.0), mass, "distribution")
    if len(written) == 1 and written.isascii() and written.upper() in LETTERS:
        return TokenScore(phi(written.upper()), mass, "tag")
    return TokenScore(0.5, mass, "midpoint")


def _letters(tokens: Sequence[Token], at: int) -> dict[str, float]:
    """Probabilities of the valid letters in the token that holds byte ``at``; variants of one letter are summed."""
    token = next((t for t in tokens if t.start <= at < t.start + len(t.raw)), None)
    if token is None:
        return {}
    before = token.raw[: at - token.start].decode(errors="replace")
    found: dict[str, float] = {}
    for alternative, logprob in token.alternatives:
        letter = _letter(alternative, before.strip(_AROUND))
        if letter and logprob < 1e-3:  # servers may round to slightly above zero; NaN compares false
            found[letter] = found.get(letter, 0.0) + math.exp(min(logprob, 0.0))
    return found


def _letter(alternative: str, before: str) -> str:
    """The letter that a token would put in X's place, "" when it would put something else there.

    A token may hold what stands ``before`` X too (">A"), and some of what follows ("A</"); in "All" or "A+" the A is
    no score.
    """
    rest = alternative.strip(_AROUND)
    if not rest.casefold().startswith(before.casefold()):
        return ""
    rest = rest[len(before) :].lstrip(_AROUND)
    letter, after = rest[:1].upper(), rest[1:].lstrip(_AROUND).casefold()
    if not rest[:1].isascii() or not letter or letter not in LETTERS:
        return ""
    return letter if after.startswith(_CLOSING) or _CLOSING.startswith(after) else ""
