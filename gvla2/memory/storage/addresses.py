"""What an address may be: a SQLite file or a PostgreSQL server. What is said of it never shows a password."""

from __future__ import annotations

import os
import re
from pathlib import Path
from urllib.parse import quote

from sqlalchemy.engine import make_url
from sqlalchemy.exc import ArgumentError

from gvla2.errors import ConfigurationError

_GIVE = "Give sqlite:///path/to/file, or postgresql://user@host/database"
_USER = re.compile(r"(?<=//).*@", re.DOTALL)
_PASSWORD = re.compile(r"(password=)[^&]*", re.IGNORECASE)


def scheme_of(url: str) -> str:
    """``sqlite`` or ``postgresql``; raises :class:`~gvla2.errors.ConfigurationError` for any other address."""
    scheme, colon, _ = url.partition(":")
    scheme = scheme.partition("+")[0].casefold()
    if scheme in ("postgresql", "postgres"):
        return "postgresql"
    if scheme == "sqlite":
        return scheme
    if not colon or "://" not in url:
        path = url if url.startswith(("/", "~", ".")) else "path/to/file"
        raise ConfigurationError(
            f"Not a database address: {shown(url)!r}. {_GIVE} (for that file, sqlite:///{path})."
        )
    raise ConfigurationError(f"The memory is in SQLite or PostgreSQL, not in '{scheme}'. {_GIVE}.")


def database_path(url: str) -> Path:
    """The file of ``sqlite:///path``, symbolic links followed: the same file has the same name, whoever opens it.

    Raises :class:`~gvla2.errors.ConfigurationError` for anything else.
    """
    if scheme_of(url) != "sqlite":
        raise ConfigurationError(
            f"{shown(url)!r} is no file. Give an address such as sqlite:///path/to/file."
        )
    try:
        parsed = make_url(url)
    except (ArgumentError, ValueError) as error:
        raise ConfigurationError(f"Not a database address: {shown(url)!r}. {_GIVE}.") from error
    if parsed.host:
        path = "/".join([parsed.host, *([parsed.database] if parsed.database else [])])
        raise ConfigurationError(
            f"{shown(url)!r} names a host, which no file has. A path follows three slashes: sqlite:///{path} from "
            f"the working directory, sqlite:////{path} from the root."
        )
    if not parsed.database or parsed.database == ":memory:" or parsed.query:
        raise ConfigurationError(
            f"{shown(url)!r} names no file: give an address such as sqlite:///path/to/file."
        )
    try:
        return Path(os.path.realpath(Path(parsed.database).expanduser()))
    except (RuntimeError, ValueError) as error:
        raise ConfigurationError(f"The path in {shown(url)!r} cannot be: {error}.") from error


def server_address(url: str) -> str:
    """A PostgreSQL address as the driver reads it: what is special in a password is escaped ("@", "/", ":")."""
    scheme, _, rest = url.partition(":")
    place, mark, options = rest.partition("?")
    user, at, host = place.removeprefix("//").rpartition("@")
    name, colon, password = user.partition(":")
    safe = f"{quote(name, safe='%')}{colon}{quote(password, safe='%')}{at}{host}"
    return f"{scheme.partition('+')[0]}://{safe}{mark}{options}"


def shown(url: str) -> str:
    """The address without user and password, for messages."""
    return _PASSWORD.sub(r"\1...", _USER.sub("...@", url))
