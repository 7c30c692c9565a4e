"""Calling code that may never answer."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable
from types import FrameType
from typing import TypeVar

from gvla2.errors import Gvla2Error

T = TypeVar("T")

AGAIN = 0.5
"""Seconds after which code that swallowed the interrupt is interrupted again."""


class DeadlineError(Gvla2Error):
    """The time limit was reached before an answer."""


class _TimeUp(BaseException):
    """A BaseException, so that code catching Exception cannot swallow it."""


def within(seconds: float, function: Callable[[], T]) -> T:
    """The result of ``function``; raises :class:`DeadlineError` when it takes longer. 0 waits for ever.

    In the main thread, if the system has alarms, the function is interrupted, whether computing in Python or waiting;
    compiled code is interrupted once it returns to Python. Elsewhere it runs in its own thread, which is abandoned
    after the limit.
    """
    if seconds <= 0:
        return function()
    if threading.current_thread() is threading.main_thread() and hasattr(signal, "setitimer"):
        return _by_alarm(seconds, function)
    return _in_thread(seconds, function)


def _by_alarm(seconds: float, function: Callable[[], T]) -> T:
    armed = True

    def ring(_signal: int, _frame: FrameType | None) -> None:
        if armed:
            raise _TimeUp

    began = time.monotonic()
    before = signal.signal(signal.SIGALRM, ring)
    left, interval = signal.setitimer(signal.ITIMER_REAL, seconds, AGAIN)
    try:
        try:
            return function()
        finally:
            armed = False
    except _TimeUp:
        raise DeadlineError(f"There was no answer within {seconds:g} s.") from None
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
        if left:  # another alarm continues
            remaining = max(1e-3, left - (time.monotonic() - began))
            signal.setitimer(signal.ITIMER_REAL, remaining, interval)


def _in_thread(seconds: float, function: Callable[[], T]) -> T:
    answer: list[T] = []
    failed: list[BaseException] = []

    def run() -> None:
        try:
            answer.append(function())
        except BaseException as error:
            failed.append(error)

    thread = threading.Thread(target=run, name="gvla2-deadline", daemon=True)
    thread.start()
    thread.join(seconds)
    if failed:
        raise failed[0]
    if not answer:
        raise DeadlineError(f"There was no answer within {seconds:g} s.")
    return answer[0]
