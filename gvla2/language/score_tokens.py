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
_OPENING, _CLOSING = b"<score>", "</score>"
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
    written = tags[-1].group(1).strip(_AROUND)
    letters = _letters(tokens, written)
    mass = min(math.fsum(letters.values()), 1.0)
    if mass >= ENOUGH_MASS:
        expected = math.fsum(p * phi(v) for v, p in letters.items()) / math.fsum(letters.values())
        return TokenScore(min(max(expected, 0.0), 1.0), mass, "distribution")
    if len(written) == 1 and written.isascii() and written.upper() in LETTERS:
        return TokenScore(phi(written.upper()), mass, "tag")
    return TokenScore(0.5, mass, "midpoint")


def _letters(tokens: Sequence[Token], written: str) -> dict[str, float]:
    """Probabilities of the valid letters in the last tag of the stream; variants of one letter are summed.

    None unless the stream has there what is ``written`` in the answer.
    """
    stream = b"".join(piece for piece, _ in tokens)
    inside = stream[stream.lower().rfind(_OPENING) + len(_OPENING) :].lstrip(_AROUND.encode())
    found, at = dict[str, float](), len(stream) - len(inside)
    if _OPENING not in stream.lower() or not written or not inside.startswith(written.encode()):
        return found
    for piece, odds in tokens:
        if 0 <= at < len(piece):
            before = piece[:at].decode(errors="replace").strip(_AROUND)
            for alternative, logprob in odds.items():
                letter = _letter(alternative, before)
                if letter and logprob < 1e-3:  # servers may round to slightly above zero; NaN compares false
                    found[letter] = found.get(letter, 0.0) + math.exp(min(logprob, 0.0))
        at -= len(piece)
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
