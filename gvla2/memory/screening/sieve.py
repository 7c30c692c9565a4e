"""Which signs a text can show at all, by the beginnings of its words: most lessons can show none."""

from __future__ import annotations

import re
from collections.abc import Iterable
from functools import cache

from gvla2.memory.screening.frames import FRAMES
from gvla2.memory.screening.signs import SIGNS, TABLES, Sign
from gvla2.memory.screening.stance import STANCES

_WORD = re.compile(r"[^\W_]+")
_STEM = re.compile(r"\b\w{1,4}")
_MARK = re.compile(r'[<\[\]#`"|{]')


class Sieve:
    """The signs by what a text must have in it for them to match.

    A sign is asked for by the first four letters of a word, by a mark of markup, or by any letter beyond ASCII.
    """

    def __init__(self, signs: Iterable[Sign]) -> None:
        self.signs = tuple(signs)
        self._by_stem: dict[str, set[Sign]] = {}
        self._marked: list[Sign] = []
        self._foreign: list[Sign] = []
        for sign in self.signs:
            for need in sign.words:
                self._file(sign, need)

    def _file(self, sign: Sign, need: str) -> None:
        word = _WORD.search(need)
        if not need.isascii():
            self._foreign.append(sign)
        elif word is None or _MARK.search(need):
            self._marked.append(sign)
        else:
            for stem in {word[0][:4], (word[0] + "s")[:4]}:
                self._by_stem.setdefault(stem, set()).add(sign)

    def passing(self, text: str, stems: frozenset[str]) -> list[Sign]:
        """The signs that the text, of these ``stems``, may show, in no order that matters."""
        found: set[Sign] = set()
        for stem in self._by_stem.keys() & stems:
            found |= self._by_stem[stem]
        if self._marked and _MARK.search(text):
            found.update(self._marked)
        if self._foreign and not text.isascii():
            found.update(self._foreign)
        return [sign for sign in found if any(map(text.__contains__, sign.words))] if found else []


def stems_of(text: str) -> frozenset[str]:
    """The beginnings of a text's words."""
    return frozenset(_STEM.findall(text))


@cache
def sieves() -> tuple[Sieve, Sieve]:
    """One for the frames, looked for in the text with its marks, and one for what its words say."""
    return Sieve(FRAMES), Sieve((*SIGNS, *STANCES))


@cache
def run_together() -> re.Pattern[str]:
    """The plainest orders without a gap in them, for texts that tear words apart or leave no spaces."""
    drop, frame = TABLES["DROP"].replace(" ", ""), f"{TABLES['FRAME']}|{TABLES['MATTER']}".replace(" ", "")
    scope = f"{TABLES['DET']}|{TABLES['WHOLE']}"
    return re.compile(
        rf"(?:{drop})(?:{scope})++(?:{frame})|youarenow(?:an?|my|the)?\w{{0,12}}(?:robot|assistant|model"
        rf"|admin|agent|free|unrestricted)|obey(?:only)?(?:me|this)|(?:print|output|reveal)(?:the"
        rf"|your)systemprompt"
    )
