"""The handlers and formats of a run's log, as the logging configurations in ``conf/hydra`` name them."""

from __future__ import annotations

import logging
import sys
from pathlib import Path
from typing import Any

from gvla2.io.files import own_file
from gvla2.record.text import printable


class RunLog(logging.FileHandler):
    """The log in a run's folder: appended to, but never through a link or into a pipe that lies at its place.

    A full disk is reported once, not with a traceback for each message.
    """

    def __init__(self, filename: str, **options: Any) -> None:
        place = Path(filename)
        if place.is_symlink() or (place.exists() and not place.is_file()):
            place.unlink()
        self._full = False
        super().__init__(filename, **options)

    def _open(self) -> Any:
        return open(self.baseFilename, self.mode, encoding=self.encoding, opener=own_file)

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802 - logging's name
        """Called by logging when a message could not be written."""
        if not self._full:
            self._full = True
            print(
                f"gvla2: {printable(self.baseFilename)} cannot be written: {sys.exc_info()[1]}.",
                file=sys.stderr,
            )


class TerminalFormatter(logging.Formatter):
    """Messages and tracebacks without characters that would control the terminal."""

    def format(self, record: logging.LogRecord) -> str:
        """The message as printable text."""
        return printable(super().format(record))
