"""The frame of every suite of ``gvla2 bench``: units of work with keys, known and stored rows, worker processes."""

from __future__ import annotations

import logging
import multiprocessing
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields, replace
from functools import cache
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from gvla2.commands.bench_config import BenchConfig
from gvla2.commands.bench_progress import BenchProgress
from gvla2.commands.bench_workers import in_processes, workers_for
from gvla2.component import ComponentConfig, described
from gvla2.errors import ConfigurationError, Gvla2Error, did_you_mean
from gvla2.io.files import write_bytes
from gvla2.plugins.registry import Registry, load_plugins
from gvla2.robot.options import DepthNoise

if TYPE_CHECKING:
    from gvla2.evaluation.results import Cell, Results

log = logging.getLogger(__name__)


class Unit(Protocol):
    """What is measured at once, in one process: the keys of its rows, and its name on the progress line."""

    @property
    def rows(self) -> Sequence[str]:
        """The keys of the rows that it gives; there may be others besides."""

    @property
    def label(self) -> str:
        """A few words."""


UnitT = TypeVar("UnitT", bound=Unit)
Work = Callable[[UnitT, Registry], Sequence["Cell"]]
"""Measures a unit: a function of a module, where worker processes shall find it."""


@dataclass(frozen=True)
class BenchRun:
    """One call of ``gvla2 bench``, as its suite sees it; ``folder`` holds pictures and other files that rows name."""

    config: BenchConfig
    registry: Registry
    results: Results
    run_id: int
    folder: Path

    def known(self, keys: Sequence[str], *, well: bool = True) -> dict[str, Cell]:
        """The database's rows for these keys; with ``well`` only those whose status is ok."""
        found = {} if self.config.results.fresh else self.results.with_keys(keys)
        found = {key: cell for key, cell in found.items() if not well or cell.notes.get("status") == "ok"}
        if found:
            log.info("%d of %d rows are in %s already.", len(found), len(keys), self.results.url)
        return found

    def store(self, cells: Sequence[Cell], suite: str = "") -> dict[str, Cell]:
        """Store rows immediately, so that an interrupted bench resumes where it was; returns them by key.

        Rows measured by an earlier run stay that run's.
        """
        for run, some in groupby(cells, key=lambda cell: cell.run or self.run_id):
            self.results.add(run, suite or self.config.suite, some)
        return {cell.key: cell for cell in cells}

    def progress(self, total: int) -> BenchProgress:
        """The bench's progress display, for so many rows."""
        return BenchProgress(total, self.config.quiet)

    @contextmanager
    def rows(self, units: Iterable[Unit], known: dict[str, Cell] | None = None) -> Iterator[BenchRows]:
        """The rows of the whole design, with a progress display for those that are not ``known``, by default to the
        database.
        """
        keys = list(dict.fromkeys(key for unit in units for key in unit.rows))
        known = self.known(keys) if known is None else known
        with self.progress(len(keys) - len(known.keys() & set(keys))) as progress:
            yield BenchRows(self, known, progress)


@dataclass(frozen=True)
class BenchRows:
    """The rows of a design by key: ``known`` ones, to which measured ones are added."""

    bench: BenchRun
    known: dict[str, Cell]
    progress: BenchProgress

    def lacking(self, units: Iterable[UnitT]) -> list[UnitT]:
        """The units with an unknown row, each once."""
        once = {tuple(unit.rows): unit for unit in units}
        return [unit for keys, unit in once.items() if not self.known.keys() >= set(keys)]

    def fill(
        self,
        units: Iterable[UnitT],
        work: Work[UnitT],
        suite: str = "",
        *,
        workers: int | None = None,
        tries: int = 1,
    ) -> None:
        """Measure the units with unknown rows, here or in ``workers`` processes (by default as configured), and store
        the rows of each when it is done, under ``suite`` (by default the bench's).

        Work whose process died is repeated, ``tries`` times in all.
        """
        bench, lacking = self.bench, self.lacking(units)
        workers = workers_for(bench.config.workers if workers is None else workers, len(lacking))
        tasks = [(work, unit) for unit in lacking]
        made: Iterable[tuple[Any, Sequence[Cell]]] = (
            ((task, work(task[1], bench.registry)) for task in tasks)
            if workers == 1
            else in_processes(_there, tasks, workers, tries)
        )
        for (_, unit), cells in made:
            new = set(unit.rows) - self.known.keys()
            self.known.update(bench.store(cells, suite))
            self.progress.done(len(new), unit.label)

    def of(self, units: Iterable[Unit]) -> list[Cell]:
        """The rows of these units, in their order."""
        return [self.known[key] for unit in units for key in unit.rows]


def _there(task: tuple[Work[Any], Any]) -> Sequence[Cell]:
    """Work in a worker process, which finds the plugins itself.

    Errors travel back only as their message: exceptions with constructors of their own do not survive pickling.
    """
    work, unit = task
    try:
        return work(unit, _registry())
    except Gvla2Error as error:
        plain = ConfigurationError if isinstance(error, ConfigurationError) else Gvla2Error
        raise plain(str(error)) from None


@cache
def _registry() -> Registry:
    return load_plugins()


def pictured(cell: Cell, picture: bytes | None, folder: Path, name: str) -> Cell:
    """The row with the path of its picture (PNG), written into ``folder/pictures``; as it is for None."""
    if picture is None:
        return cell
    path = write_bytes(folder / "pictures" / f"{name}.png", picture)
    return replace(cell, notes={**cell.notes, "picture": str(path.absolute())})


def in_a_worker() -> bool:
    """Whether this is a worker process."""
    return multiprocessing.parent_process() is not None


def code_of(typed: Iterable[object], *modules: str) -> str:
    """A digest of the code whose change outdates rows: these modules, and those of the typed options."""
    from gvla2.evaluation.provenance import code_digest

    return code_digest((*modules, *sorted({type(one).__module__ for one in typed})))


def noise_label(noise: DepthNoise) -> str:
    """The depth cameras' noise in a table: its kind, and its numbers where it has any."""
    numbers = asdict(noise)
    told = [f"{name}={value:g}" for name, value in numbers.items() if name != "kind" and value]
    return f"{noise.kind} ({', '.join(told)})" if told else noise.kind


def model_label(language: ComponentConfig) -> str:
    """A language model in a table: its name, or else its address, and how it is asked where that is unusual."""
    model = str(getattr(language, "model", "") or "")
    name = Path(model).name.removesuffix(".gguf") or str(getattr(language, "base_url", "") or language.name)
    return described(language, name, only=("temperature", "max_tokens", "extra"))


def options_of(registry: Registry, kind: str, name: str) -> list[str]:
    """The names of a component's options, sorted."""
    return sorted({field.name for field in fields(registry.get(kind, name).config)} - {"name"})


def given_options(place: str, given: object, owner: str, known: Collection[str]) -> dict[str, Any]:
    """The options that ``place`` on the command line gives ``owner``, which has the ``known`` ones.

    Raises :class:`ConfigurationError` if it is not a mapping of options, or for an unknown one.
    """
    if not isinstance(given, Mapping):
        raise ConfigurationError(f"{place} is {given!r}; give options: {place}.OPTION=VALUE.")
    for option in given:
        if option not in known:
            raise ConfigurationError(
                f"{place}.{option}: {owner} has no such option.{did_you_mean(str(option), known)} "
                f"It has: {', '.join(sorted(known)) or 'none'}."
            )
    return dict(given)


def require_among(place: str, given: Collection[str], known: Collection[str], what: str) -> None:
    """Raises :class:`ConfigurationError` if ``place`` uses a name that is not in this bench."""
    for name in given:
        if name not in known:
            raise ConfigurationError(
                f"{place}.{name}: '{name}' is not among the {what} of this bench ({', '.join(known)})."
            )
