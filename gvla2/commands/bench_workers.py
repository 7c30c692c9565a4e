"""Sharing a benchmark's work among processes, each with one thread."""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import TypeVar

from gvla2.errors import Gvla2Error

Task = TypeVar("Task")
Answer = TypeVar("Answer")

MOST = 8
"""Most processes by default: each holds its own data in memory."""

log = logging.getLogger(__name__)

_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def workers_for(asked: int, tasks: int) -> int:
    """How many processes to use for this many tasks; ``asked`` 0 means one per core."""
    return max(1, min(asked or min(_cores(), MOST), tasks))


def in_processes(
    function: Callable[[Task], Answer], tasks: Sequence[Task], workers: int, tries: int = 1
) -> Iterator[tuple[Task, Answer]]:
    """Call a module's function on every task in fresh processes; answers come as they are ready, each task's once.

    A task's first exception cancels tasks that have not started; Ctrl-C, SIGTERM and an exception of the caller stop
    running ones too. When a process dies, the tasks without an answer are done in new processes, ``tries`` times in
    all; then :class:`Gvla2Error` is raised.
    """
    left = list(range(len(tasks)))
    for attempt in range(1, tries + 1):
        try:
            for place, answer in _once(function, tasks, left, workers):
                left.remove(place)
                yield tasks[place], answer
            return
        except BrokenProcessPool as error:
            if attempt == tries:
                raise Gvla2Error(
                    "A worker process died; it may have run out of memory. Finished measurements are kept; run again "
                    "with fewer: workers=1."
                ) from error
            log.warning("A worker process died; %d of %d parts are repeated.", len(left), len(tasks))


def _once(
    function: Callable[[Task], Answer], tasks: Sequence[Task], places: Sequence[int], workers: int
) -> Iterator[tuple[int, Answer]]:
    """The answers of the tasks at these places; raises BrokenProcessPool when a process dies."""
    context = multiprocessing.get_context("spawn")
    others = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(workers, context, _begin)
    try:
        pending: dict[Future[Answer], int] = {pool.submit(function, tasks[place]): place for place in places}
        while pending:
            done, _ = wait(pending, return_when=FIRST_COMPLETED)
            for future in done:
                yield pending.pop(future), future.result()
    except (KeyboardInterrupt, GeneratorExit):  # SIGTERM too: do not wait for running tasks
        for child in set(multiprocessing.active_children()) - others:
            child.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _begin() -> None:
    """In a new worker, before it loads numerical libraries: one thread for each, a quiet end on Ctrl-C (the terminal
    signals all processes), and an end with its parent.
    """
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()


def _end_with(parent: int) -> None:
    """End this process when its parent is gone: SIGTERM and SIGKILL reach only the bench."""
    while os.getppid() == parent:
        time.sleep(0.5)
    os._exit(1)
