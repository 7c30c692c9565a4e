"""Where memories lie: what an address and a bank may be called. Nothing said of an address shows a password."""

from __future__ import annotations

import os
import re
import unicodedata
from collections.abc import Mapping
from pathlib import Path
from urllib.parse import quote

from sqlalchemy.engine import URL, make_url
from sqlalchemy.exc import ArgumentError

from gvla2.errors import ConfigurationError

LONGEST_NAME = 200
_GIVE = "Give a path, sqlite:///path/to/file, or postgresql://user@host/database"
_USER = re.compile(r"(?<=//).*@", re.DOTALL)
_PASSWORD = re.compile(r"(?<=password=)[^&]*", re.IGNORECASE)


def parsed(address: str | Path) -> URL:
    """A path or URL as a URL: a SQLite file's path is absolute, symbolic links followed, so that the same file has
    the same name whoever opens it; PostgreSQL goes by psycopg.

    Raises :class:`~gvla2.errors.ConfigurationError` for what can be no database of memories.
    """
    text = os.fspath(address)
    scheme, mark, rest = text.partition("://")
    if not mark:
        if not text or re.match(r"\w*:", text):
            raise ConfigurationError(f"Not a database address: {shown(text)!r}. {_GIVE}.")
        return _file(text)
    scheme = scheme.partition("+")[0].casefold()
    if scheme in ("postgresql", "postgres"):
        # What is special in a password ("@", "/", ":") may stand in it as it is.
        user, at, host = rest.partition("?")[0].rpartition("@")
        name, colon, password = user.partition(":")
        safe = f"{quote(name, safe='%')}{colon}{quote(password, safe='%')}{at}{host}"
        text = f"postgresql+psycopg://{safe}{''.join(rest.partition('?')[1:])}"
    elif scheme != "sqlite":
        raise ConfigurationError(f"The memory is in SQLite or PostgreSQL, not in '{scheme}'. {_GIVE}.")
    try:
        url = make_url(text)
    except (ArgumentError, ValueError) as error:
        raise ConfigurationError(f"Not a database address: {shown(text)!r}. {_GIVE}.") from error
    if scheme != "sqlite":
        return url
    if url.host:
        path = "/".join([url.host, *([url.database] if url.database else [])])
        raise ConfigurationError(
            f"{shown(text)!r} names a host, which no file has. A path follows three slashes: sqlite:///{path} from "
            f"the working directory, sqlite:////{path} from the root."
        )
    if not url.database or url.database == ":memory:" or url.query:
        raise ConfigurationError(f"{shown(text)!r} names no file. {_GIVE}.")
    return _file(url.database)


def _file(path: str) -> URL:
    try:
        return URL.create("sqlite", database=os.path.realpath(Path(path).expanduser()))
    except (RuntimeError, ValueError) as error:
        raise ConfigurationError(f"The path {path!r} cannot be: {error}.") from error


def settled(address: str, environment: Mapping[str, str]) -> str:
    """The address to open for ``address``, absolute, as a run may change its working directory later.

    "" is ``memory.db`` in ``$GVLA2_HOME``, else in ``$XDG_DATA_HOME/gvla2``, else in ``~/.local/share/gvla2``.
    """
    if not address:
        data = environment.get("XDG_DATA_HOME") or "~/.local/share"
        folder = environment.get("GVLA2_HOME") or f"{data}/gvla2"
        address = f"sqlite:///{(Path(folder).expanduser() / 'memory.db').absolute()}"
    url = parsed(address)
    return f"sqlite:///{url.database}" if url.drivername == "sqlite" else address


def shown(url: str) -> str:
    """The address without user and password, for messages."""
    return _PASSWORD.sub("...", _USER.sub("...@", url))


def wrong_bank_name(name: str) -> str:
    """Why ``name`` can be no bank's, as a sentence; "" for one that can.

    Letters and digits of any language and ``. _ - /``, the first a letter or digit, composed (NFC), so that what
    looks the same is the same. Spaces, quotes, control characters and such that turn the direction of writing
    would read as something else in a shell, a message or a file's name.
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
        f"'{printed}' cannot be the name of a bank: a name begins with a letter or digit, goes on with letters and "
        f"digits of any language and . _ - /, and has at most {LONGEST_NAME} characters."
    )
