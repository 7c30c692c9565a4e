"""Raising a thread's priority, if the system allows it."""

from __future__ import annotations

import contextlib
import os


def be_urgent() -> None:
    """Real-time priority (round robin, the lowest) for the calling thread; without the right to it, nothing changes.

    On Linux the right is ``rtprio`` in ``/etc/security/limits.d`` or the capability ``CAP_SYS_NICE``. A busy
    computer then delays the control loop no more than an idle one.
    """
    with contextlib.suppress(OSError, AttributeError):
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
