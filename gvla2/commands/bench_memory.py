"""``gvla2 bench suite=memory``: every figure of the memory wing, beside a plain peer measured in the same run."""

from __future__ import annotations

import logging
import os
import platform
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gvla2.commands.bench_config import BenchConfig
from gvla2.commands.bench_frame import BenchRun
from gvla2.errors import ConfigurationError, Gvla2Error
from gvla2.plugins.registry import Registry

if TYPE_CHECKING:
    from gvla2.evaluation.memory.figure import Figure, FigureRow, Test
    from gvla2.evaluation.memory.setting import Setting
    from gvla2.evaluation.results import Cell
    from gvla2.memory.contracts import Embedder

DATA = "generated"
MEASURING_CODE = ("gvla2.memory", "gvla2.evaluation.memory")
"""Code whose change outdates stored rows."""

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class PlannedTest:
    """A test with its size, the keys of its rows, and its place among all tests."""

    test: Test
    size: int
    rows: tuple[str, ...]
    order: int

    @property
    def label(self) -> str:
        """The test's."""
        return self.test.label


def run(bench: BenchRun) -> list[Cell]:
    """Measure what the database lacks, one test after another in this process.

    The rows of a finished test are stored immediately, so that an interrupted bench resumes where it stopped.
    """
    from gvla2.evaluation.memory.evidence import find_file
    from gvla2.evaluation.memory.setting import Setting
    from gvla2.evaluation.memory.suite import chosen_tests

    config, options = bench.config, bench.config.memory
    tests = chosen_tests(options.tests)
    questions = find_file(config.data.root)
    plan = [_planned(test, config, questions) for test in tests]
    with bench.rows(plan) as rows, _scratch(options.folder or str(bench.folder)) as scratch:
        embedders = _embedders(bench.registry)
        setting = Setting(
            scratch, scale=options.scale, seed=options.seed, question_file=questions, embedders=embedders
        )
        rows.fill(plan, lambda planned, _: _measure(planned, setting), workers=1)
        return rows.of(plan)


def _planned(test: Test, config: BenchConfig, questions: Path | None) -> PlannedTest:
    """The keys name what could change the numbers: the test, its size, the code, the machine, the data."""
    from gvla2.evaluation.memory.suite import SUITE, TESTS, VERSION
    from gvla2.evaluation.provenance import code_digest, versions
    from gvla2.evaluation.results import cell_key

    size = test.scaled(config.memory.scale)
    around = (VERSION, code_digest(MEASURING_CODE), versions(), platform.node(), os.cpu_count())
    data = None
    if test.name == "quality" and questions is not None:
        data = (str(questions), questions.stat().st_size)
    options = config.memory
    chosen = (size, test.on, options.scale, options.seed, options.folder, data)
    keys = tuple(cell_key(SUITE, test.name, row.name, *chosen, around) for row in test.rows)
    return PlannedTest(test, size, keys, [known.label for known in TESTS].index(test.label))


def _measure(planned: PlannedTest, setting: Setting) -> list[Cell]:
    """The cells of a test; one that cannot be measured says why, and the others continue."""
    from gvla2.evaluation.memory.figure import Figure, NotMeasuredError

    test = planned.test
    log.info("Measuring %s at %d.", test.label, planned.size)
    status = "ok"
    figures: Mapping[str, Figure] = {}
    try:
        figures = test.measure(setting, planned.size, test.on)
    except NotMeasuredError as reason:
        status = f"not measured: {reason}"
    except Gvla2Error as error:
        status = f"failed: {error}"
    return [
        figure_cell(
            key,
            row,
            figures.get(row.name, Figure(None)),
            size=planned.size,
            on=test.on,
            order=[planned.order, planned.size, place],
            status=status,
        )
        for place, (key, row) in enumerate(zip(planned.rows, test.rows, strict=True))
    ]


def figure_cell(
    key: str, row: FigureRow, figure: Figure, *, size: int, on: str, order: Sequence[int], status: str
) -> Cell:
    """A figure as a row of the results, for a test of this ``size`` on ``on``, at its place in the table."""
    from gvla2.evaluation.memory.figure import passed
    from gvla2.evaluation.results import Cell

    goal = row.goal if figure.goal is None else figure.goal
    measures = {"value": figure.value, "peer_value": figure.peer_value, "goal": goal}
    notes: dict[str, Any] = {
        "status": status,
        "size": size,
        "order": list(order),
        **{name: getattr(row, name) for name in ("title", "unit", "better", "digits")},
        "peer": figure.peer,
        "passed": passed(figure.value, goal, row.better),
        "note": figure.note,
    }
    factors: dict[str, str | int] = {"test": row.name, "n": size if figure.n is None else figure.n, "on": on}
    return Cell(key, factors, measures, notes)


def _embedders(registry: Registry) -> dict[str, Callable[[], Embedder]]:
    """The embedders whose retrieval is compared, by name."""
    from gvla2.evaluation.memory.evidence import EMBEDDERS

    def made(name: str) -> Embedder:
        embedder: Embedder = registry.build_all({"embedder": {"name": name}}, ("embedder",))["embedder"]
        return embedder

    return {name: partial(made, name) for name in EMBEDDERS}


@contextmanager
def _scratch(parent: str) -> Iterator[Path]:
    """A folder for databases, always deleted at the end; its parent is created and stays."""
    try:
        home = Path(parent).expanduser()
        home.mkdir(parents=True, exist_ok=True)
        place = tempfile.TemporaryDirectory(prefix="gvla2-bench-", dir=home, ignore_cleanup_errors=True)
    except OSError as error:
        raise ConfigurationError(
            f"memory.folder is '{parent}', where nothing can be written ({error.strerror or error})."
        ) from error
    with place as name:
        yield Path(name)
