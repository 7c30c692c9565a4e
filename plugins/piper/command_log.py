"""The append-only log of everything that was sent to an arm, and of everything that stopped it.

One JSON object a line, of the kind ``session`` (bus, settings), ``frame`` (id and bytes, written before sending),
``event`` (armed, hold, refused, stop) or ``joints`` (measured, radians, at 10 Hz). ``t`` is ``time.time()``,
``m`` the monotonic clock, both in seconds.
"""

from __future__ import annotations

import json
import os
import threading
import time
from pathlib import Path
from typing import Any, Literal

from gvla2.errors import RobotError


def default_log(bus: str, channel: str) -> Path:
    """The default path of an arm's log, unless ``robot.log`` is set."""
    state = os.environ.get("XDG_STATE_HOME") or str(Path.home() / ".local" / "state")
    name = "".join(c if c.isalnum() else "-" for c in f"{bus}-{channel}")
    return Path(state) / "gvla2" / "piper" / f"{name}.jsonl"


class CommandLog:
    """Appends lines, each in one write; nothing is ever rewritten. Safe to use from several threads.

    A line that can't be written raises :class:`RobotError`: a command that can't be logged is not sent.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = threading.Lock()
        flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file: int | None = os.open(path, flags, 0o644)
        except OSError as error:
            raise RobotError(
                f"The command log {path} can't be written ({error.strerror}). Choose another: robot.log=FILE."
            ) from error

    def write(self, kind: Literal["session", "frame", "event", "joints"], **fields: Any) -> None:
        """Append an entry."""
        entry = {"t": time.time(), "m": time.monotonic(), "kind": kind, **fields}
        line = (json.dumps(entry, separators=(",", ":")) + "\n").encode()
        with self._lock:
            if self._file is None:
                raise RobotError(f"The command log {self.path} is closed.")
            try:
                complete = os.write(self._file, line) == len(line)
            except OSError as error:
                raise RobotError(
                    f"The command log {self.path} can't be written: {error.strerror}."
                ) from error
        if not complete:
            raise RobotError(f"The command log {self.path} could not be written in full: is the disk full?")

    def close(self) -> None:
        """Close the file; safe to call twice."""
        with self._lock:
            if self._file is not None:
                os.fsync(self._file)
                os.close(self._file)
                self._file = None
