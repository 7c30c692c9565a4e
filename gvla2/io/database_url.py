"""Addresses of the memory and results databases (messages never show a password), and closing."""

from __future__ import annotations

import os
import re
from abc import ABC, abstractmethod
from pathlib import Path
from typing import Self
from urllib.parse import quote

from sqlalchemy.engine import URL, make_url
from sqlalchemy.exc import ArgumentError

from gvla2.errors import ConfigurationError

_GIVE = "Give a path, sqlite:///path/to/file, or postgresql://user@host/database"
_USER = re.compile(r"(?<=//).*@", re.DOTALL)
_PASSWORD = re.compile(r"(?<=password=)[^&]*", re.IGNORECASE)


class Closing(ABC):
    """Something that is closed at the end of a ``with`` block."""

    @abstractmethod
    def close(self) -> None:
        """Release everything; safe to call twice."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def parsed(address: str | Path) -> URL:
    """A path or URL as a URL: a SQLite file's path is absolute, symbolic links followed, so that the same file always
    has the same name; PostgreSQL uses psycopg.

    Raises :class:`~gvla2.errors.ConfigurationError` for any other address.
    """
    text = os.fspath(address)
    scheme, mark, rest = text.partition("://")
    if not mark:
        if not text or re.match(r"\w*:", text):
            raise ConfigurationError(f"Not a database address: {shown(text)!r}. {_GIVE}.")
        return _file(text)
    scheme = scheme.partition("+")[0].casefold()
    if scheme in ("postgresql", "postgres"):
        # Special characters of a password ("@", "/", ":") need no escaping.
        user, at, host = rest.partition("?")[0].rpartition("@")
        name, colon, password = user.partition(":")
        safe = f"{quote(name, safe='%')}{colon}{quote(password, safe='%')}{at}{host}"
        text = f"postgresql+psycopg://{safe}{''.join(rest.partition('?')[1:])}"
    elif scheme == "sqlite":  # a path, whatever its characters mean in URLs
        path = rest.removeprefix("/")
        if path == rest or path in ("", ":memory:") or re.search(r"\?\w+=[^/]*$", path):
            raise ConfigurationError(f"{shown(text)!r} names no file. {_GIVE}; a path follows three slashes.")
        return _file(path)
    else:
        raise ConfigurationError(f"Databases here are SQLite or PostgreSQL, not '{scheme}'. {_GIVE}.")
    try:
        return make_url(text)
    except (ArgumentError, ValueError) as error:
        raise ConfigurationError(f"Not a database address: {shown(text)!r}. {_GIVE}.") from error


def _file(path: str) -> URL:
    try:
        return URL.create("sqlite", database=os.path.realpath(Path(path).expanduser()))
    except (RuntimeError, ValueError) as error:
        raise ConfigurationError(f"The path {path!r} is not valid: {error}.") from error


def shown(url: str) -> str:
    """The address without user and password, for messages."""
    return _PASSWORD.sub("...", _USER.sub("...@", url))
