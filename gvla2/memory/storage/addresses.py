"""Locations of memories, and valid names of banks."""

from __future__ import annotations

import unicodedata
from collections.abc import Mapping
from pathlib import Path

from gvla2.errors import ConfigurationError
from gvla2.io.database_url import parsed

LONGEST_NAME = 200


def settled(address: str, environment: Mapping[str, str]) -> str:
    """The absolute address to open for ``address``, since a run may change its working directory later.

    "" is ``memory.db`` in ``$GVLA2_HOME``, else in ``$XDG_DATA_HOME/gvla2``, else in ``~/.local/share/gvla2``.
    """
    if not address:
        data = environment.get("XDG_DATA_HOME") or "~/.local/share"
        folder = environment.get("GVLA2_HOME") or f"{data}/gvla2"
        address = f"sqlite:///{(Path(folder).expanduser() / 'memory.db').absolute()}"
    url = parsed(address)
    return f"sqlite:///{url.database}" if url.drivername == "sqlite" else address


def check_bank(name: str) -> None:
    """Raises :class:`~gvla2.errors.ConfigurationError` where a memory's option ``bank`` cannot be a bank's name."""
    if wrong := wrong_bank_name(name):
        raise ConfigurationError(f"The option 'memory.bank' is wrong: {wrong}")


def wrong_bank_name(name: str) -> str:
    """Why ``name`` is not a valid bank name, as a sentence; "" if it is.

    Letters and digits of any language and ``. _ - /``, the first a letter or digit, composed (NFC), so that
    equal-looking names are equal. Spaces, quotes, control characters and direction marks would be misread in a shell, a
    message or a file name.
    """
    if (
        name
        and len(name) <= LONGEST_NAME
        and name[0].isalnum()
        and all(c in "._-/" or unicodedata.category(c)[0] in "LMN" for c in name)
        and unicodedata.is_normalized("NFC", name)
    ):
        return ""
    printed = "".join(c if c.isprintable() else f"\\u{ord(c):04x}" for c in name[:LONGEST_NAME])
    return (
        f"'{printed}' cannot be the name of a bank: a name begins with a letter or digit, continues with letters and "
        f"digits of any language and . _ - /, and has at most {LONGEST_NAME} characters."
    )
