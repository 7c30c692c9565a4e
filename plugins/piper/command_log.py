"""The append-only log of everything that was sent to an arm, and of everything that stopped it.

One JSON object a line: ``session`` (who, which bus, settings), ``frame`` (id and bytes, written before sending),
``event`` (armed, hold, refused, ended) and ``joints`` (measured, radians, some times a second). ``t`` is
``time.time()``, ``m`` the monotonic clock, both in seconds.
"""

from __future__ import annotations

import json
import os
import threading
import time
from pathlib import Path
from typing import Any

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
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file: int | None = os.open(
                path, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC, 0o644
            )
        except OSError as error:
            raise RobotError(
                f"The command log {path} can't be written ({error.strerror}). Choose another: robot.log=FILE."
            ) from error

    def session(self, **settings: Any) -> None:
        """Begin a session."""
        self._write({"kind": "session", "pid": os.getpid(), **settings})

    def frame(self, arbitration_id: int, data: bytes) -> None:
        """A frame that is about to be sent."""
        self._write({"kind": "frame", "id": f"{arbitration_id:03X}", "data": bytes(data).hex()})

    def event(self, name: str, **details: Any) -> None:
        """Something that happened."""
        self._write({"kind": "event", "event": name, **details})

    def joints(self, measured: list[float]) -> None:
        """Measured joints, radians."""
        self._write({"kind": "joints", "joints": [round(v, 6) for v in measured]})

    def _write(self, entry: dict[str, Any]) -> None:
        entry = {"t": time.time(), "m": time.monotonic(), **entry}
        line = (json.dumps(entry, separators=(",", ":")) + "\n").encode()
        with self._lock:
            if self._file is None:
                raise RobotError(f"The command log {self.path} is closed.")
            try:
                written = os.write(self._file, line)
            except OSError as error:
                raise RobotError(
                    f"The command log {self.path} can't be written: {error.strerror}."
                ) from error
        if written != len(line):
            raise RobotError(f"The command log {self.path} could not be written in full: is the disk full?")

    def close(self) -> None:
        """Close the file; safe to call twice."""
        with self._lock:
            if self._file is not None:
                os.fsync(self._file)
                os.close(self._file)
                self._file = None
