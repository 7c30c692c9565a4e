"""The right to command an arm: one writer per bus, a log of all it sends, and a priority that a busy computer respects.

The log is append-only, one JSON object a line, of the kind ``session`` (bus, settings), ``frame`` (id and bytes,
written before sending) or ``event`` (armed, hold, refused, stop). ``t`` is ``time.time()``, ``m`` the monotonic clock,
both in seconds.
"""

from __future__ import annotations

import contextlib
import json
import os
import socket
import stat
import threading
import time
from pathlib import Path
from typing import Any, Literal

from gvla2.errors import RobotError


class WriterLock:
    """The right of one process of this machine to command an arm; it ends with the process at the latest.

    It is a Linux abstract socket's name: no file that could be linked elsewhere, no folder that programs could choose
    differently. It binds programs that use gvla2. Others are noticed by their frames and by what the arm does.
    """

    def __init__(self, bus: str, channel: str) -> None:
        self._channel, self._name = channel, f"\0gvla2-piper-{_device(bus, channel)}"
        self._socket: socket.socket | None = None

    def acquire(self) -> None:
        """Take the lock; raises :class:`RobotError` when another program has it."""
        self._socket = socket.socket(socket.AF_UNIX)
        try:
            self._socket.bind(self._name)
        except OSError as error:
            self.release()
            raise RobotError(
                f"The arm on '{self._channel}' is already commanded by another program or user ({error.strerror}). "
                "One program at a time may move an arm: end that one first. Nothing was sent."
            ) from error

    def release(self) -> None:
        """Release the lock; safe to call twice."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None


def _device(bus: str, channel: str) -> str:
    """The device behind a channel, the same for all of its names: a serial port's number, a CAN interface's index."""
    path = channel.partition("@")[0]  # slcan: PORT@BAUD
    with contextlib.suppress(OSError, ValueError):
        if stat.S_ISCHR((found := Path(path).stat()).st_mode):
            return f"{os.major(found.st_rdev)}-{os.minor(found.st_rdev)}"
    with contextlib.suppress(OSError, ValueError):
        return f"can-{socket.if_nametoindex(channel)}"
    return f"{bus}-{os.path.realpath(path) if '/' in path else path}"[:80]


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
            self._file = path.open("ab", buffering=0)
        except OSError as error:
            raise RobotError(
                f"The command log {path} can't be written ({error.strerror}). Choose another: robot.log=FILE."
            ) from error

    def write(self, kind: Literal["session", "frame", "event"], **fields: Any) -> None:
        """Append an entry."""
        entry = {"t": time.time(), "m": time.monotonic(), "kind": kind, **fields}
        line = (json.dumps(entry, separators=(",", ":")) + "\n").encode()
        with self._lock:
            try:
                complete = self._file.write(line) == len(line)
            except (OSError, ValueError) as error:  # the latter for a closed file
                raise RobotError(f"The command log {self.path} can't be written: {error}.") from error
        if not complete:
            raise RobotError(f"The command log {self.path} could not be written in full: is the disk full?")

    def close(self) -> None:
        """Close the file; safe to call twice."""
        with self._lock:
            if not self._file.closed:
                os.fsync(self._file.fileno())
                self._file.close()


def be_urgent() -> None:
    """Real-time priority (round robin, the lowest) for the calling thread; without the right to it, nothing changes.

    On Linux the right is ``rtprio`` in ``/etc/security/limits.d`` or the capability ``CAP_SYS_NICE``. A busy
    computer then delays the control loop no more than an idle one.
    """
    with contextlib.suppress(OSError, AttributeError):
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
