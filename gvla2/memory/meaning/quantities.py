"""Numbers with units in a text, as intervals in base units: "at least 5 cm" is a length in [0.05, inf)."""

from __future__ import annotations

import math
import re
from typing import NamedTuple

from gvla2.memory.meaning.bounds import bound_before, bound_behind
from gvla2.memory.meaning.number_words import spelled_numbers
from gvla2.memory.meaning.units import Unit, unit_at

_DIGITS = r"\d(?:\d{0,2}(?:[ \u00a0]\d{3})+(?![\d.,])|\d*(?:[.,]\d+)*)(?:e[-+]?\d+(?!\w))?"
_NUMBER = rf"[-−+]?{_DIGITS}"
_FIGURE = re.compile(_DIGITS)
_DIGIT = re.compile(r"\d")
_THOUSANDS = re.compile(r"[-+]?\d{1,3}(,\d{3})+(\.\d+)?")
_POINTED_THOUSANDS = re.compile(r"[-+]?\d{1,3}(\.\d{3})+,\d+|[-+]?\d{1,3}(\.\d{3}){2,}")
_TO = re.compile(r"\s*(?P<word>\bto\b|–|—|-|~|and\b|±|\+/-)\s*")
_AND_A_HALF = re.compile(r"\s+and a half\b")
_FRACTION = re.compile(r"/(?P<under>\d+)(?![\d/.])")
_ATTACHED = re.compile(r"(?P<size>k)(?!\w)|(?P<share>x)(?!\w)|(?!x\d)[a-z]")
SAME_SIDE = 0.6
"""Two upper (or two lower) bounds disagree when they lie apart by more than this share of the larger one."""


class Quantity(NamedTuple):
    """What a text says about a number: it lies in [low, high] of the base unit of ``dimension``.

    ``about`` marks a rough figure; ``dimension`` is "" for a bare number.
    """

    dimension: str
    low: float
    high: float
    about: bool = False

    @property
    def one_sided(self) -> bool:
        """Whether it is a bound rather than a figure."""
        return math.isinf(self.low) or math.isinf(self.high)

    def inverted(self) -> Quantity:
        """The other side of a bound: what "never above 5" leaves."""
        if math.isinf(self.high):
            return Quantity(self.dimension, -math.inf, self.low, self.about)
        return Quantity(self.dimension, self.high, math.inf, self.about)

    def disagrees(self, other: Quantity, tolerance: float) -> bool:
        """Whether no number satisfies both, beyond ``tolerance`` (a share of the larger figure)."""
        gap = max(self.low, other.low) - min(self.high, other.high)
        if not gap > 0:
            return self.one_sided and other.one_sided and self._far_bounds(other)
        scale = max(
            (abs(v) for v in (self.low, self.high, other.low, other.high) if math.isfinite(v)), default=0.0
        )
        # Who gives a bound or a range means it; single figures vary from one episode to the next.
        figures = self.low == self.high and other.low == other.high
        slack = tolerance * (2.0 if self.about or other.about else 1.0) if figures else 0.02
        return gap > slack * scale

    def _far_bounds(self, other: Quantity) -> bool:
        """Whether two bounds on one side are so far apart that whoever keeps the one knows nothing of the other."""
        for a, b in ((self.low, other.low), (self.high, other.high)):
            if math.isfinite(a) and math.isfinite(b) and a * b > 0:
                return abs(a - b) > SAME_SIDE * max(abs(a), abs(b))
        return False


class Found(NamedTuple):
    """A quantity and where it stands in the text, ``start`` to ``end``."""

    quantity: Quantity
    start: int
    end: int


def quantities(text: str) -> list[Found]:
    """All quantities of a casefolded text, in reading order; names are to be joined before, see
    :func:`gvla2.memory.meaning.plain_text.name_things`.
    """
    atoms = _atoms(text)
    found: list[Found] = []
    last = index = 0
    while index < len(atoms):
        made, index, end = _read(text, atoms, index, last)
        if made:
            found += made
            last = end
    return found


class _Atom(NamedTuple):
    value: float
    start: int
    end: int
    dimension: str = ""
    share: bool = False
    spelled: bool = False


def _atoms(text: str) -> list[_Atom]:
    """The single numbers of a text, in digits and in words."""
    digits = []
    first = _DIGIT.search(text)  # quicker than to look for a whole figure from the start
    for match in _FIGURE.finditer(text, first.start()) if first is not None else ():
        start = _start(text, match.start())
        value = _number(text[start : match.end()]) if start >= 0 else None
        if value is not None:
            digits.append(_Atom(value, start, match.end()))
    words = [
        _Atom(spelled.value, spelled.start, spelled.end, spelled.dimension, spelled.share, True)
        for spelled in spelled_numbers(text)
    ]
    return sorted(digits + words, key=lambda atom: atom.start) if words else digits


def _start(text: str, at: int) -> int:
    """Where a number begins whose digits begin at ``at``, with its sign; -1 where the digits belong to a word."""
    before = text[at - 1] if at else " "
    if before in "-−+":
        return at if at > 1 and _in_word(text[at - 2]) else at - 1
    if _in_word(before):
        flag = at > 2 and text[at - 2] == "-" and text[at - 3].isspace()
        return at if flag and before.isalpha() else -1  # "-j8"
    return -1 if before == "." and at > 1 and _in_word(text[at - 2]) else at


def _in_word(character: str) -> bool:
    return character.isalnum() or character == "_"


def _read(text: str, atoms: list[_Atom], index: int, last: int) -> tuple[list[Found], int, int]:
    """The quantities that begin with atom ``index``, the index of the atom behind them, and where they end."""
    atom = atoms[index]
    value, end, unit = atom.value, atom.end, None
    if atom.start < last:
        return [], index + 1, last
    if not atom.spelled and (over := _FRACTION.match(text, end)) is not None and float(over["under"]) > 0:
        value, end = value / float(over["under"]), over.end()
    index += 1
    dimension = atom.dimension
    if not dimension:
        unit = unit_at(text, end, atom.spelled)
        end = unit.end if unit else end
        if unit is None and not atom.spelled and (ending := _ATTACHED.match(text, end)):
            if ending["size"] is None and ending["share"] is None:
                return [], index, last  # "2nd", "3d"
            value, end = value * (1000.0 if ending["size"] else 1.0), ending.end()
            dimension = "ratio" if ending["share"] else ""
    if unit is not None and (half := _AND_A_HALF.match(text, end)):
        value, end = value + 0.5, half.end()
        while index < len(atoms) and atoms[index].start < end:
            index += 1
    before = bound_before(text, last, atom.start)
    high, unit2, spread = value, unit, False
    to = _TO.match(text, end) if index < len(atoms) else None
    if to is not None and to.end() == atoms[index].start and (to["word"] != "and" or before.between):
        second = atoms[index]
        high, end, index = second.value, second.end, index + 1
        unit2 = unit_at(text, end, second.spelled) or unit
        end = max(end, unit2.end if unit2 else 0)
        unit, spread = unit or unit2, to["word"] in ("±", "+/-")
    sign, behind = bound_behind(text, end) if not before.sign else (before.sign, end)
    if not dimension:
        dimension = unit.dimension if unit else ("ratio" if atom.share else "")
    low, high = _scaled(value, unit), _scaled(high, unit2)
    if spread:
        low, high = low - high, low + high
    elif high == low and sign:
        low, high = (low, math.inf) if sign > 0 else (-math.inf, high)
    read = Quantity(dimension, min(low, high), max(low, high), before.about)
    return [Found(read, before.start, behind)], index, behind


def _scaled(value: float, unit: Unit | None) -> float:
    return value if unit is None else value * unit.factor + unit.offset


def _number(text: str) -> float | None:
    """``1.5``, ``1,5``, ``1,000``, ``10 000``; None for what is no single number, such as ``3.11.2``."""
    if text.isdecimal() and len(text) < 16:
        return float(text)
    plain = text.replace("−", "-").replace(" ", "").replace("\u00a0", "")
    if _THOUSANDS.fullmatch(plain):
        plain = plain.replace(",", "")
    elif _POINTED_THOUSANDS.fullmatch(plain):
        plain = plain.replace(".", "").replace(",", ".")
    try:
        value = float(plain.replace(",", "."))
    except ValueError:
        return None
    return value if math.isfinite(value) else None
