"""Loops compiled by numba, and how they share the cores.

A compiled loop releases the interpreter's lock, so plain threads run it on all cores. Numba's own ``parallel=True``
would do the same, but its thread layers abort the process when two threads enter at once or after a fork, and
it takes several times as long to compile.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import pairwise
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]
Real = Any  # float32 in the compiled code, for which Python has no type of its own
Ints = NDArray[np.int32] | NDArray[np.int64]
F = TypeVar("F", bound=Callable[..., Any])
T = TypeVar("T")


def compiled(function: F) -> F:
    """Compiled on the first call, kept on disk; while it runs, other threads do too.

    Sums keep their order; division by zero gives infinity, as in numpy.
    """
    return cast(F, numba.njit(cache=True, nogil=True, error_model="numpy")(function))


def fused(function: F) -> F:
    """As :func:`compiled`, but products and sums may be fused, never reordered: an answer depends on the machine at
    most in the last bit.
    """
    options: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract", "nsz"}}
    return cast(F, numba.njit(cache=True, nogil=True, **options)(function))


def cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def run_together(jobs: Sequence[Callable[[], T]]) -> list[T]:
    """Run jobs that release the interpreter's lock, one thread a core, and return their results.

    The first exception of a job is raised here after all have ended.
    """
    if min(cores(), len(jobs)) < 2:
        return [job() for job in jobs]
    with ThreadPoolExecutor(cores()) as pool:
        running = [pool.submit(job) for job in jobs]
    return [done.result() for done in running]


def run_chunks(body: Callable[[int, int], None], count: int, least: int = 20_000) -> None:
    """Call ``body(start, stop)`` over 0..count in chunks of at least ``least``, one a core."""
    pieces = max(1, min(cores(), count // least))
    if pieces == 1:
        body(0, count)
        return
    bounds = [count * k // pieces for k in range(pieces + 1)]
    run_together([partial(body, a, b) for a, b in pairwise(bounds)])
