"""What a text may say besides what it shows: the readings behind look-alikes, gaps, codes and invisible characters."""

from __future__ import annotations

import base64
import binascii
import codecs
import html
import re
import unicodedata
from collections.abc import Iterator
from functools import cache
from urllib.parse import unquote

KEYWORDS = [
    "ignore",
    "disregard",
    "forget",
    "override",
    "bypass",
    "instructions",
    "instruction",
    "previous",
    "earlier",
    "system",
    "prompt",
    "constraints",
    "guidelines",
    "everything",
    "planner",
    "assistant",
    "verifier",
    "restrictions",
    "password",
]
"""Words whose misspellings are read as the word: one letter lost, doubled or swapped with its neighbour."""

_TELLING = ("ignore", "disregard", "forget", "override", "bypass", "obey", "instruct", "prompt", "youarenow")
_BACKWARDS = tuple(sign[::-1] for sign in _TELLING if len(sign) > 4)
_ROTATED = tuple(codecs.encode(sign, "rot13") for sign in _TELLING)
_LONG = 16
_WORD = 24
_TORN = re.compile(r"[^a-z\s.,;:](?<=[a-z].)[a-z]| [a-z] [a-z] |[.,;:][a-z][.,;:]")
_DEPTH = 2

_LEET = re.compile(r"[013457$@!|](?:(?<=[a-z].)[013457$@!|]*[a-z]|(?<!\w.)[a-z]{3})")
_LEET_I = str.maketrans("013457$@!|", "oieastsaii")
_LEET_L = str.maketrans("013457$@!|", "oleastsail")
_FLAG = re.compile("\U0001f3f4[\U000e0061-\U000e007a]+\U000e007f")
_HIDDEN = re.compile("[\U000e0000-\U000e007f\u202d\u202e]|[\ufe00-\ufe0f\U000e0100-\U000e01ef]{2}")

_CODED = re.compile(r"[A-Za-z0-9+/_-]{16,}={0,6}")
_HEX = re.compile(r"(?:(?:0x|\\x)?[0-9a-fA-F]{2}[\s:,]{0,2}){12,}")
_BITS = re.compile(r"(?:[01]{8}[\s,]{0,2}){8,}")
_CODES = re.compile(r"(?:\b\d{2,3}\b[\s,;]{1,2}){11,}\d{2,3}\b")
_ESCAPES = re.compile(r"\\u\{?([0-9a-fA-F]{4,5})\}?|\\x([0-9a-fA-F]{2})")

_BLANKS = frozenset([0x34F, 0x115F, 0x1160, 0x17B4, 0x17B5, 0x180B, 0x180C, 0x180D, 0x2800, 0x3164, 0xFFA0])
_OTHERS = {
    "‹": "<", "›": ">", "«": "<", "»": ">", "〈": "<", "〉": ">", "⟨": "<", "⟩": ">", "【": "[", "】": "]",
    "❲": "[", "❳": "]", "ł": "l", "ø": "o", "đ": "d", "ð": "d", "ß": "ss", "æ": "ae", "œ": "oe", "ı": "i",
    "ħ": "h", "ŧ": "t", "’": "'", "‘": "'", "“": '"', "”": '"', "–": "-", "—": "-", "‐": "-", "\n": "\n",
    "\u2028": "\n", "\u2029": "\n", "\x85": "\n", "\x0b": "\n", "\x0c": "\n", "\r": "\n",
}  # fmt: skip
# Letters of other scripts that look like Latin ones; capitals look like others than their small ones do.
_CAPITALS = str.maketrans("АВЕЗКМНОРСТУХІЈЅΑΒΕΖΗΙΚΜΝΟΡΤΥΧ", "abe3kmhopctyxijsabezhikmnoptyx")
_SMALL = str.maketrans(
    "авеёкмнорстухіїјѕԁԛԝһӏьпгανκοιρτυχγεωηβμոսցօ", "abeekmhopctyxiijsdqwhlbnravkoiptuxyewnbunugo"
)
_SMALL_CAPITAL = "LATIN LETTER SMALL CAPITAL "


class _Folded(dict[int, str | None]):
    """What each lowered character is read as: Latin letters bare, blanks as spaces, invisible ones not at all."""

    def __missing__(self, code: int) -> str | None:
        read = self._read(chr(code))
        if len(self) < 20_000:
            self[code] = read
        return read

    def _read(self, letter: str) -> str | None:
        if (other := _OTHERS.get(letter)) is not None:
            return other
        if letter.isspace():
            return " "
        if invisible(letter) or 0x300 <= ord(letter) <= 0x36F or 0x20D0 <= ord(letter) <= 0x20FF:
            return None
        name = unicodedata.name(letter, "")
        if name.startswith(_SMALL_CAPITAL) and len(name) == len(_SMALL_CAPITAL) + 1:
            return name[-1].lower()
        if name.startswith(("LATIN", "GREEK")):
            return unicodedata.normalize("NFKD", letter)[0].lower()
        return letter


_FOLDED = _Folded()


class _Letters(dict[int, int | None]):
    def __missing__(self, code: int) -> int | None:
        kept = code if chr(code).isalpha() else None
        if len(self) < 20_000:
            self[code] = kept
        return kept


_LETTERS = _Letters()


def invisible(letter: str) -> bool:
    """Whether a character shows nothing: controls, formats, private and unassigned ones, selectors, fillers."""
    code = ord(letter)
    return (
        unicodedata.category(letter)[0] == "C"
        or code in _BLANKS
        or 0xFE00 <= code <= 0xFE0F
        or 0xE0100 <= code <= 0xE01EF
    )


def hides_text(text: str) -> bool:
    """Whether a text carries characters whose only use in a lesson is to hide words: tags, overrides, selectors."""
    return not text.isascii() and _HIDDEN.search(_FLAG.sub("", text)) is not None


def folded(text: str) -> str:
    """The text lowered, on its lines, as a reader sees it: compatibility forms, accents and disguises resolved."""
    if text.isascii():
        low = text.lower()
        return low if low.isprintable() else low.translate(_FOLDED)
    return unicodedata.normalize("NFKC", text).lower().translate(_FOLDED)


def readings(text: str, depth: int = 0) -> Iterator[str]:
    """Everything a text may be read as, the plain reading first; most texts have no other."""
    low = folded(text)
    yield low
    if not low.isascii():
        yield from _unmasked(text, low)
    words = low.split()
    if _typos().keys() & words:
        yield " ".join([_typos().get(word, word) for word in words])
    if _LEET.search(low):
        yield low.translate(_LEET_I)
        yield low.translate(_LEET_L)
    if any(map(low.__contains__, _BACKWARDS)):
        yield low[::-1]
        yield " ".join([word[::-1] for word in words])
    if any(map(low.__contains__, _ROTATED)):
        yield codecs.encode(low, "rot13")
    if depth < _DEPTH and words and ("&" in low or "%" in low or "\\" in low or _may_be_coded(low, words)):
        for plain in _decoded(text):
            yield from readings(plain, depth + 1)


def squeezed(low: str) -> str:
    """The letters of a reading without any gap, where gaps tear its words apart; "" where they don't."""
    long = max(map(len, low.split()), default=0) > _WORD
    packed = low.replace(" ", "")
    if (
        not long
        and not _TORN.search(low)
        and not any(sign in packed and sign not in low for sign in _TELLING)
    ):
        return ""
    letters = low.translate(_LETTERS)
    if long:
        return letters
    for sign in _TELLING:
        if sign in letters and sign not in low and (sign != "youarenow" or "you are now" not in low):
            return letters
    return ""


def _unmasked(text: str, low: str) -> Iterator[str]:
    plain = (
        unicodedata.normalize("NFKC", text).translate(_CAPITALS).lower().translate(_FOLDED).translate(_SMALL)
    )
    if plain != low:
        yield plain


def _may_be_coded(low: str, words: list[str]) -> bool:
    # Pairs and triples of digits with spaces between are shorter than words are.
    return max(map(len, words)) >= _LONG or len(low) < 4.3 * len(words) or "0101" in low or "0110" in low


def _decoded(text: str) -> Iterator[str]:
    """The texts that codes within the text stand for, where they stand for any."""
    if "&" in text and (plain := html.unescape(text)) != text:
        yield plain
    if "%" in text and (plain := unquote(text)) != text:
        yield plain
    if "\\" in text and (plain := _ESCAPES.sub(_character, text)) != text:
        yield plain
    for pattern, decode in (
        (_CODED, _base64),
        (_CODED, _base32),
        (_HEX, _hex),
        (_BITS, _bits),
        (_CODES, _codes),
    ):
        for match in pattern.finditer(text):
            try:
                plain = decode(match[0]).decode()
            except (ValueError, binascii.Error):
                continue
            if len(plain) >= 8 and plain.isprintable():
                yield plain


def _character(match: re.Match[str]) -> str:
    return chr(int(match[1] or match[2], 16))


def _base64(run: str) -> bytes:
    run = run.rstrip("=").replace("-", "+").replace("_", "/")
    return base64.b64decode(run + "=" * (-len(run) % 4), validate=True)


def _base32(run: str) -> bytes:
    run = run.rstrip("=")
    return base64.b32decode(run + "=" * (-len(run) % 8))


def _hex(run: str) -> bytes:
    return bytes.fromhex(re.sub(r"0x|\\x|[\s:,]", "", run))


def _bits(run: str) -> bytes:
    return bytes(int(byte, 2) for byte in re.findall("[01]{8}", run))


def _codes(run: str) -> bytes:
    return bytes(map(int, re.findall(r"\d+", run)))


@cache
def _typos() -> dict[str, str]:
    """The misspellings of the keywords, by themselves."""
    found: dict[str, str] = {}
    for word in KEYWORDS:
        for i in range(1, len(word)):
            found.setdefault(word[:i] + word[i + 1 :], word)
            found.setdefault(word[:i] + word[i] + word[i:], word)
            found.setdefault(word[: i - 1] + word[i] + word[i - 1] + word[i + 1 :], word)
    for word in (*KEYWORDS, "forge", "plane", "planer"):
        found.pop(word, None)
    return found
