"""The base of every suite of ``gvla2 bench``: known rows, shared work, stored rows."""

from __future__ import annotations

import logging
import multiprocessing
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from gvla2.catalog import Registry, load_plugins
from gvla2.commands.bench_config import BenchConfig
from gvla2.commands.bench_progress import BenchProgress
from gvla2.commands.bench_workers import in_processes, workers_for
from gvla2.discovery import closest
from gvla2.errors import ConfigurationError, Gvla2Error
from gvla2.record.files import write_bytes

if TYPE_CHECKING:
    from gvla2.evaluation.results import Cell, Results

Unit = TypeVar("Unit")
Made = TypeVar("Made")

log = logging.getLogger(__name__)


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
        """Store rows immediately, so that an interrupted bench resumes where it was; returns them by key."""
        self.results.add(self.run_id, suite or self.config.suite, cells)
        return {cell.key: cell for cell in cells}

    def pictured(self, cell: Cell, picture: bytes | None, name: str) -> Cell:
        """The row with the path of its picture (PNG), written into ``folder/pictures``; as it is for None."""
        if picture is None:
            return cell
        path = write_bytes(self.folder / "pictures" / f"{name}.png", picture)
        return replace(cell, notes={**cell.notes, "picture": str(path.absolute())})

    def progress(self, total: int) -> BenchProgress:
        """The bench's progress display, for so many rows."""
        return BenchProgress(total, self.config.quiet)

    def measured(
        self, work: Callable[[Unit, Registry], Made], units: Sequence[Unit], tries: int = 1
    ) -> Iterator[tuple[Unit, Made]]:
        """Each unit with a module function's result for it: computed here, or in processes as ``workers`` says."""
        workers = workers_for(self.config.workers, len(units))
        if workers == 1:
            for unit in units:
                yield unit, work(unit, self.registry)
            return
        for (_, unit), made in in_processes(_there, [(work, unit) for unit in units], workers, tries):
            yield unit, made


def _there(task: tuple[Callable[[Any, Registry], Made], Any]) -> Made:
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


def in_a_worker() -> bool:
    """Whether this is a worker process."""
    return multiprocessing.parent_process() is not None


def code_of(typed: Iterable[object], *modules: str) -> str:
    """A digest of the code whose change outdates rows: these modules, and those of the typed options."""
    from gvla2.evaluation.provenance import code_digest

    return code_digest((*modules, *sorted({type(one).__module__ for one in typed})))


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
                f"{place}.{option}: {owner} has no such option.{closest(str(option), known)} "
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
