"""The rights of a process over an arm: one writer per bus, and a thread priority that a busy computer respects."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import re
import tempfile
from pathlib import Path

from gvla2.errors import RobotError


class WriterLock:
    """Holds an advisory lock on a file that all users of this machine share; released with the process at the latest.

    It binds programs that use gvla2. Others are noticed by their frames and by what the arm does.
    """

    def __init__(self, bus: str, channel: str, folder: Path | None = None) -> None:
        name = re.sub(r"[^\w.-]+", "-", f"gvla2-piper-{bus}-{channel}.lock")
        self.path = (folder or Path(tempfile.gettempdir())) / name
        self._channel = channel
        self._file: int | None = None

    def acquire(self) -> None:
        """Take the lock; raises :class:`RobotError` that names the process which has it."""
        if self._file is not None:
            return
        try:
            file = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
        except OSError as error:
            raise RobotError(
                f"The lock file {self.path} of the arm on '{self._channel}' can't be opened ({error.strerror}): "
                "another user may own it. Nothing was sent."
            ) from error
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            holder = self._holder(file)
            os.close(file)
            raise RobotError(
                f"The arm on '{self._channel}' is already commanded by {holder}. One program at a time may move "
                "an arm: end that one first. Nothing was sent."
            ) from error
        os.ftruncate(file, 0)
        os.pwrite(file, json.dumps({"pid": os.getpid()}).encode(), 0)
        with contextlib.suppress(OSError):  # owned by another user: it is open to all already
            os.fchmod(file, 0o666)
        self._file = file

    def release(self) -> None:
        """Release the lock; safe to call twice."""
        if self._file is not None:
            os.close(self._file)
            self._file = None

    @staticmethod
    def _holder(file: int) -> str:
        try:
            return f"process {json.loads(os.pread(file, 200, 0))['pid']}"
        except (OSError, ValueError, KeyError, TypeError):
            return "another process"


def be_urgent() -> None:
    """Real-time priority (round robin, the lowest) for the calling thread; without the right to it, nothing changes.

    On Linux the right is ``rtprio`` in ``/etc/security/limits.d`` or the capability ``CAP_SYS_NICE``. A busy
    computer then delays the control loop no more than an idle one.
    """
    with contextlib.suppress(OSError, AttributeError):
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
