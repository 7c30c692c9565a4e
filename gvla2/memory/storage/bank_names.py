"""What a bank may be called: one rule for the library and the command line."""

from __future__ import annotations

import unicodedata

LONGEST = 200
_MARKS = "._-/"


def wrong_bank_name(name: str) -> str:
    """Why ``name`` can be no bank's, as a sentence; "" for one that can.

    Letters and digits of any language and ``. _ - /``, the first a letter or digit, composed (NFC), so that what
    looks the same is the same. Spaces, quotes, control characters and such that turn the direction of writing
    would read as something else in a shell, a message or a file's name.
    """
    if (
        name
        and len(name) <= LONGEST
        and name[0].isalnum()
        and all(c in _MARKS or unicodedata.category(c)[0] in "LMN" for c in name)
        and unicodedata.is_normalized("NFC", name)
    ):
        return ""
    shown = "".join(c if c.isprintable() else f"\\u{ord(c):04x}" for c in name[:LONGEST])
    return (
        f"'{shown}' cannot be the name of a bank: a name begins with a letter or digit, goes on with letters and "
        f"digits of any language and . _ - /, and has at most {LONGEST} characters."
    )
