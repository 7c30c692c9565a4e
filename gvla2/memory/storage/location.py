"""Where memories are kept unless told otherwise, and what is kept beside them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from gvla2.memory.storage.addresses import database_path, scheme_of


def default_url(environment: Mapping[str, str]) -> str:
    """``memory.db`` in ``$GVLA2_HOME``, else in ``$XDG_DATA_HOME/gvla2``, else in ``~/.local/share/gvla2``."""
    if environment.get("GVLA2_HOME"):
        folder = Path(environment["GVLA2_HOME"])
    elif environment.get("XDG_DATA_HOME"):
        folder = Path(environment["XDG_DATA_HOME"]) / "gvla2"
    else:
        folder = Path("~/.local/share/gvla2")
    return f"sqlite:///{(folder.expanduser() / 'memory.db').absolute()}"


def settled(url: str, environment: Mapping[str, str]) -> str:
    """The address to open for ``url`` ("" is the default): a file's path is made absolute.

    A run may change its working directory later. Raises :class:`~gvla2.errors.ConfigurationError` for an address
    that can be no database at all.
    """
    address = url or default_url(environment)
    if scheme_of(address) == "postgresql":
        return address
    return f"sqlite:///{database_path(address)}"
