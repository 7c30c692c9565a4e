"""Characters that are not shown, and what a text may not bring into a prompt: frames of conversations, addresses."""

from __future__ import annotations

import re
import unicodedata
from functools import lru_cache

_BLANK = frozenset("\u00ad\u034f\u061c\u115f\u1160\u17b4\u17b5\u2800\u3164\uffa0")
"""Characters of other categories that show nothing."""
_VARIATION = re.compile("[\ufe00-\ufe0f\U000e0100-\U000e01ef\U000e0000-\U000e007f]")
_URL = re.compile(
    r"\b(?:[a-z][a-z0-9+.-]{1,12}://|www\.)[^\s<>\"'()]+|\b(?:data|javascript):[^\s]+", re.IGNORECASE
)
_FRAMES = re.compile(
    r"<\|[^|>\n]{1,40}\|>|\[/?(?:INST|SYS|SYSTEM|USER|ASSISTANT)\]|<</?SYS>>|</?(?:s|system|user|assistant|tool|memory"
    r"|instructions?|prompt|human|function_calls?|think)\b[^>\n]{0,40}>|^\s*#{2,}\s*(?:system|instructions?|user|assistant)\b:?"
    r"|^\s*(?:system|assistant|user|human|developer)\s*:\s|```+",
    re.IGNORECASE | re.MULTILINE,
)


@lru_cache(maxsize=65536)
def invisible(letter: str) -> bool:
    """Whether a character shows nothing, or changes what is shown beside it: controls, joiners, tags, fillers."""
    if letter.isascii():
        return not letter.isprintable()
    return (
        unicodedata.category(letter) in ("Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp")
        or letter in _BLANK
        or _VARIATION.match(letter) is not None
    )


def sanitised(text: str) -> str:
    """``text`` as it may stand in a prompt as data: no invisible characters, no chat frames, no addresses.

    Lines and tabs stay. What a frame held stays as well, as words; an address leaves "(link)".
    """
    plain = text
    if not (text.isascii() and text.isprintable()):
        plain = "".join(
            letter
            for letter in unicodedata.normalize("NFKC", text)
            if letter in "\n\t" or not invisible(letter)
        )
    for _ in range(3):  # a frame may be hidden in another
        stripped = _FRAMES.sub(" ", plain)
        if stripped == plain:
            break
        plain = stripped
    return _URL.sub("(link)", plain)
