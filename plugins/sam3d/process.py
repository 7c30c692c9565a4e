"""Running a program to its end or time limit, without leaving processes behind."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

from gvla2.errors import Gvla2Error, MissingDependencyError

_TAIL = 15  # lines of the log in a message
_GRACE_S = 5.0  # between asking a program to end and ending it


class ExternalRunError(Gvla2Error):
    """An external program failed, exceeded its time or left no result; the message ends with its last output."""


def run_program(
    title: str,
    command: Sequence[str],
    folder: Path,
    environment: Mapping[str, str],
    log: Path,
    timeout_s: float,
) -> None:
    """Run ``command`` in ``folder`` with its output in ``log``; it and its children end within the time or are ended.

    Raises :class:`ExternalRunError`, and :class:`MissingDependencyError` when the command does not exist.
    """
    with log.open("wb") as stream:
        try:
            process = subprocess.Popen(
                list(command),
                cwd=folder,
                env=dict(environment),
                stdin=subprocess.DEVNULL,
                stdout=stream,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        except (OSError, ValueError) as error:
            raise MissingDependencyError(
                f"'{command[0]}' ({error})", title, f"reconstructor.python=PATH of {title}'s environment"
            ) from error
        try:
            code = process.wait(timeout=timeout_s)
        except subprocess.TimeoutExpired:
            raise ExternalRunError(
                f"{title} was ended after {timeout_s:g} s; reconstructor.timeout_s sets the limit.{_last_words(log)}"
            ) from None
        finally:
            _end(process)
    if code != 0:
        how = f"by signal {-code}" if code < 0 else f"with exit status {code}"
        raise ExternalRunError(f"{title} ended {how}: {' '.join(command)}{_last_words(log)}")


def _end(process: subprocess.Popen[bytes]) -> None:
    """End the process and its children: the whole group, gently first."""
    for sign in (signal.SIGTERM, signal.SIGKILL):
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, sign)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(timeout=_GRACE_S)
            if sign is signal.SIGTERM and not _group_lives(process.pid):
                return


def _group_lives(group: int) -> bool:
    try:
        os.killpg(group, 0)
    except (ProcessLookupError, PermissionError):
        return False
    return True


def _last_words(log: Path) -> str:
    lines = log.read_text("utf-8", errors="replace").strip().splitlines()[-_TAIL:]
    return "\nIts last words:\n  " + "\n  ".join(lines) if lines else " It said nothing."
