"""The engine of ``gvla2 bench``: it runs any :class:`Suite`, resumes by the keys of stored rows, and shares the work.

A suite names its units of work, each with the keys of its rows, and measures one. The engine skips units whose rows the
results database has, measures the others in worker processes, and stores each unit's rows when it is done, so that an
interrupted bench resumes where it was.
"""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeVar

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from gvla2.errors import ConfigurationError, Gvla2Error
from gvla2.evaluation.config import BenchConfig
from gvla2.evaluation.results import Cell, Results, Run
from gvla2.evaluation.tables import Sheet
from gvla2.plugins.registry import Registry, load_plugins

MOST_WORKERS = 8
"""Most processes by default: each holds its own data in memory."""
SECONDS_BETWEEN_LINES = 10.0
"""Between lines of progress, where there is no terminal."""
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Unit:
    """What is measured at once, in one process: the keys of its rows, and its name on the progress line."""

    keys: tuple[str, ...]
    label: str


ConfigT = TypeVar("ConfigT", bound=BenchConfig)
UnitT = TypeVar("UnitT", bound=Unit)
Rows = dict[str, Cell]
"""Rows by key."""


class Suite(ABC, Generic[ConfigT, UnitT]):
    """A benchmark suite; an instance belongs to one run.

    ``folder`` holds pictures and other files that rows name; ``name`` is the suite's name in the results database;
    ``tries`` is how often a unit is measured whose process died; with ``in_process`` units are measured in this
    process, one after another.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    tries: ClassVar[int] = 1
    in_process: ClassVar[bool] = False

    def __init__(
        self, config: ConfigT, registry: Registry, results: Results, run_id: int, folder: Path
    ) -> None:
        self.config, self.registry = config, registry
        self.results, self.run_id, self.folder = results, run_id, folder

    @abstractmethod
    def stages(self) -> Sequence[Sequence[UnitT]]:
        """The units in stages; a stage may use the rows of earlier ones, and the last one's rows are the result.

        Raises :class:`ConfigurationError` for names that do not exist and options that do not fit, before anything is
        measured.
        """

    @staticmethod
    @abstractmethod
    def measure(unit: Any, registry: Registry) -> Iterable[Cell]:
        """The rows of a unit, in a worker process or here."""

    @staticmethod
    @abstractmethod
    def sheets(cells: Sequence[Cell], runs: Sequence[Run] = ()) -> list[Sheet]:
        """The tables of these rows, which ``runs`` measured."""

    def known(self, keys: Sequence[str]) -> Rows:
        """The database's rows with these keys that need not be measured again."""
        return {key: cell for key, cell in self.results.with_keys(keys).items() if cell.status == "ok"}

    def stored_as(self, stage: int) -> str:
        """The name under which a stage's rows are stored."""
        return self.name

    def prepare(self, unit: UnitT, rows: Rows) -> UnitT:
        """The unit as it is measured, given the rows so far."""
        return unit

    def close(self) -> None:
        """Release what was built in this process."""


def run_suite(suite: Suite[Any, Any]) -> list[Cell]:
    """Measure the rows that the results database lacks; all rows of the suite's last stage, in order."""
    try:
        stages = suite.stages()
        keys = list(dict.fromkeys(key for units in stages for unit in units for key in unit.keys))
        rows = {} if suite.config.results.fresh else suite.known(keys)
        if rows:
            log.info("%d of %d rows are in %s already.", len(rows), len(keys), suite.results.url)
        with BenchProgress(len(keys) - len(rows), suite.config.quiet) as progress:
            for number, units in enumerate(stages):
                lacking = {unit.keys: unit for unit in units if not rows.keys() >= set(unit.keys)}
                for unit, cells in _measured(suite, [suite.prepare(unit, rows) for unit in lacking.values()]):
                    suite.results.add(suite.run_id, suite.stored_as(number), cells)
                    progress.report(len({cell.key for cell in cells} - rows.keys()), unit.label)
                    rows |= {cell.key: cell for cell in cells}
        return [rows[key] for unit in stages[-1] for key in unit.keys]
    finally:
        suite.close()


def _measured(suite: Suite[Any, Any], units: Sequence[Any]) -> Iterator[tuple[Any, Sequence[Cell]]]:
    """The units with their rows as they are measured, here or in worker processes."""
    measure = type(suite).measure
    workers = 1 if suite.in_process else workers_for(suite.config.workers, len(units))
    if workers == 1:
        for unit in units:
            for cell in measure(unit, suite.registry):
                yield unit, [cell]  # each row is stored at once
        return
    tasks = [(measure, unit) for unit in units]
    for (_, unit), cells in in_processes(_in_worker, tasks, workers, suite.tries):
        yield unit, cells


def _in_worker(task: tuple[Callable[[Any, Registry], Iterable[Cell]], Any]) -> Sequence[Cell]:
    """Measure in a worker process, which finds the plugins itself.

    Errors travel back only as their message: exceptions with constructors of their own do not survive pickling.
    """
    measure, unit = task
    try:
        return list(measure(unit, _registry()))
    except Gvla2Error as error:
        plain = ConfigurationError if isinstance(error, ConfigurationError) else Gvla2Error
        raise plain(str(error)) from None


@cache
def _registry() -> Registry:
    return load_plugins()


def in_a_worker() -> bool:
    """Whether this is a worker process."""
    return multiprocessing.parent_process() is not None


def workers_for(requested: int, tasks: int) -> int:
    """How many processes to use for this number of tasks; 0 requested means one per core."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, min(requested or min(cores, MOST_WORKERS), tasks))


Task = TypeVar("Task")
Answer = TypeVar("Answer")


def in_processes(
    function: Callable[[Task], Answer], tasks: Sequence[Task], workers: int, tries: int = 1
) -> Iterator[tuple[Task, Answer]]:
    """Call a module's function on every task in fresh processes; answers come as they are ready, each task's once.

    A task's first exception cancels tasks that have not started; Ctrl-C, SIGTERM and an exception of the caller stop
    running ones too. When a process dies, the tasks without an answer are done in new processes; after ``tries`` deaths
    without an answer between them :class:`Gvla2Error` is raised.
    """
    left, deaths = dict(enumerate(tasks)), 0
    while True:
        before = len(left)
        try:
            for place, answer in _once(function, left, workers):
                yield left.pop(place), answer
            return
        except BrokenProcessPool as error:
            deaths = deaths + 1 if len(left) == before else 1
            if deaths == tries:
                raise Gvla2Error(
                    "A worker process died; it may have run out of memory. Finished measurements are kept; run again "
                    "with fewer: workers=1."
                ) from error
            log.warning("A worker process died; %d of %d tasks are repeated.", len(left), len(tasks))


def _once(
    function: Callable[[Task], Answer], tasks: dict[int, Task], workers: int
) -> Iterator[tuple[int, Answer]]:
    """The answers of numbered tasks, with their numbers; raises BrokenProcessPool when a process dies."""
    others = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), _begin)
    try:
        pending: dict[Future[Answer], int] = {pool.submit(function, task): k for k, task in tasks.items()}
        while pending:
            done, _ = wait(pending, return_when=FIRST_COMPLETED)
            # Deaths come last: no answer is lost to one.
            for future in sorted(done, key=lambda one: one.exception() is not None):
                yield pending.pop(future), future.result()
    except (KeyboardInterrupt, GeneratorExit):  # SIGTERM too: do not wait for running tasks
        for child in set(multiprocessing.active_children()) - others:
            child.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _begin() -> None:
    """In a new worker, before it loads numerical libraries: one thread for each, a quiet end on Ctrl-C (the terminal
    signals all processes), and an end with its parent.
    """
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    end_with_parent()


@cache
def end_with_parent() -> None:
    """End this worker process within a second of its parent, which SIGTERM and SIGKILL reach alone."""
    parent = os.getppid()

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


class BenchProgress(Progress):
    """A bar with the remaining time on a terminal, an occasional line elsewhere; nothing when ``quiet``.

    ``total`` counts the rows to be measured.
    """

    def __init__(self, total: int, quiet: bool = False, console: Console | None = None) -> None:
        console = console or Console(stderr=True, highlight=False)
        drawn = console.is_terminal and not console.is_dumb_terminal
        columns = (TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn())
        off = quiet or not drawn or total == 0
        super().__init__(*columns, TimeRemainingColumn(), console=console, disable=off)
        self._bar, self._lines = self.add_task("measuring", total=total), not quiet and not drawn
        self._done, self._total, self._printed = 0, total, time.monotonic()

    def report(self, amount: int, what: str) -> None:
        """Report that ``amount`` more rows, of ``what``, are measured."""
        self._done += amount
        self.update(self._bar, completed=self._done, description=what)
        now = time.monotonic()
        if self._lines and (now - self._printed >= SECONDS_BETWEEN_LINES or self._done >= self._total):
            self._printed = now
            self.console.print(f"{self._done} of {self._total} cells, {what}", markup=False)
