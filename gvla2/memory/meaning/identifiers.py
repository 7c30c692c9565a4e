"""Names in a text, "bin B", "cam-0", "#44", "x-axis", "--fix": where they differ, two texts speak of two things."""

from __future__ import annotations

import re

from gvla2.memory.meaning.function_words import FUNCTION_WORDS

_JOINED = re.compile(
    r"#\s?\d+|(?<![\w-])--[A-Za-z][\w-]*"
    r"|(?<![\w.,-])(?!(?i:utf|sha|aes|md|rsa)-)[^\W\d_]+(?:[-_/][^\W\d_]+)*[-_/]\d[\w/-]*(?:\.\w+)*"
    r"|(?<=[^\W_]-)[A-Za-z](?![\w'’])"
    r"|(?<![\w'’])[A-Za-z](?=-[^\W_])"
    r"|(?<=\s-)[A-Za-z](?![\w'’])"
)
"""What hyphens, slashes and "#" join: "build-07", "release/1.4", "USB-A", "x-axis", "-j", "--fix". Not "UTF-8" and its
like: they are chosen by their number.
"""
_ALONE = re.compile(r"(?<=[a-zß-ÿ] )(?:[A-HJ-Zbcdfghjkpqrvwxz]|[A-Z]{2,4})(?![\w'’%°/]|\.\s?\w)")
"""A letter that stands alone within a sentence, "bin B", "along z", or a short name, "in CI"."""
_PLAIN = re.compile(r"[\W_]+")


def marked(text: str) -> str:
    """The text with such names as words of their own that no other word resembles."""
    if "-" in text or "/" in text or "#" in text or "_" in text:
        text = _JOINED.sub(_word, text)
    return _ALONE.sub(_alone, text)


def _alone(found: re.Match[str]) -> str:
    text = found.group()
    return _word(found) if len(text) == 1 or text.casefold() in FUNCTION_WORDS else text


def _word(found: re.Match[str]) -> str:
    # The separators stay: "release/1.4" is not "release/14".
    return f" nr{_PLAIN.sub('_', found.group()).strip('_')}0 "
