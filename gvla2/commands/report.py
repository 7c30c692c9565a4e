"""``gvla2 report``: any selection of measured results as a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from gvla2.errors import ConfigurationError
from gvla2.evaluation.config import ResultsConfig

if TYPE_CHECKING:
    from rich.console import Console

    from gvla2.evaluation.results import Cell, Run
    from gvla2.evaluation.tables import Sheet
    from gvla2.plugins.registry import Registry

FORMATS = ("terminal", "markdown", "latex", "csv", "html")


@dataclass
class ReportConfig:
    """A selection of the results database.

    ``suite`` "" takes every suite that has results; several of them get a folder each, of the suite's name.
    ``where`` keeps the cells whose factors have one of the given values (``where.object=[apple,bowl]``); ``runs``
    keeps those of some runs; ``formats`` are the forms that the table is made in.
    """

    suite: str = ""
    where: dict[str, list[str]] = field(default_factory=dict)
    runs: list[int] = field(default_factory=list)
    formats: list[str] = field(default_factory=lambda: list(FORMATS))
    results: ResultsConfig = field(default_factory=ResultsConfig)

    def __post_init__(self) -> None:
        unknown = [name for name in self.formats if name not in FORMATS]
        if unknown or not self.formats:
            raise ConfigurationError(f"formats is {self.formats}; choose among {', '.join(FORMATS)}.")
        if self.results.fresh:
            raise ConfigurationError("results.fresh does nothing in a report, which measures nothing.")


def job(config: ReportConfig, registry: Registry, folder: Path, suite: str = "") -> int:
    """Make the report into ``folder``; returns the number of cells in it. ``suite`` replaces the configured one.

    Raises :class:`ConfigurationError` when the database does not exist, or nothing in it fits the selection.
    """
    config = replace(config, suite=suite) if suite else config
    from gvla2.evaluation.results import Results, file_of
    from gvla2.evaluation.suites import REPORTED

    if config.suite and config.suite not in REPORTED:
        raise ConfigurationError(f"No suite '{config.suite}'. Available: {', '.join(REPORTED)}.")
    path = file_of(config.results.url)
    if path is not None and not path.is_file():
        raise ConfigurationError(
            f"There is no results database {path}. `gvla2 bench` makes one, or a sweep of `gvla2 run`; "
            "name another with results.url=..."
        )
    with Results.open(config.results.url) as results:
        asked = [config.suite] if config.suite else list(REPORTED)
        found = {suite: results.cells(suite, config.where, config.runs) for suite in asked}
        found = {suite: cells for suite, cells in found.items() if cells}
        if not found:
            raise ConfigurationError(_nothing(config, {suite: results.cells(suite) for suite in REPORTED}))
        written = []
        for suite, cells in found.items():
            place = folder / suite if len(found) > 1 else folder
            written += publish(cells, results.runs(suite), suite, place, config.formats)
    for file in written:
        print(f"{file.suffix[1:]}: {file}")
    return sum(len(cells) for cells in found.values())


def _nothing(config: ReportConfig, stored: Mapping[str, Sequence[Cell]]) -> str:
    """Why nothing was found, and what there is, by suite."""
    there = [f"{suite} ({len(cells)} cells)" for suite, cells in stored.items() if cells]
    if not there:
        return f"{config.results.url} is empty: `gvla2 bench` and sweeps of `gvla2 run` fill it."
    known = [cell.factors for cells in stored.values() for cell in cells]
    values = {name: {str(factors[name]) for factors in known if name in factors} for name in config.where}
    none = f"no such factor; there are {', '.join(sorted({name for factors in known for name in factors}))}"
    factors = [f"{name}: {', '.join(sorted(found)) or none}" for name, found in values.items()]
    return f"Nothing in {config.results.url} fits the selection. It holds {'; '.join([*there, *factors])}."


def publish(
    cells: Sequence[Cell],
    runs: Sequence[Run],
    suite: str,
    folder: Path,
    formats: Sequence[str] = FORMATS,
    out: Console | None = None,
) -> list[Path]:
    """Make the suite's tables of these cells in every format asked for; returns the files written into ``folder``."""
    from gvla2.commands.tables import console
    from gvla2.evaluation.suites import report
    from gvla2.evaluation.tables import render_report, to_csv, to_latex, to_markdown
    from gvla2.io.files import write_text

    title, sheets = report(suite, cells, runs)
    if "terminal" in formats:
        show(sheets, out or console())
    written = []
    if "markdown" in formats:
        written.append(write_text(folder / "report.md", to_markdown(sheets)))
    if "latex" in formats:
        written.append(write_text(folder / "report.tex", to_latex(sheets)))
    if "csv" in formats:
        written.append(write_text(folder / "report.csv", to_csv(cells)))
    if "html" in formats:
        page = render_report(sheets, runs, f"gvla2: {title}")
        written.append(write_text(folder / "index.html", page))
    return written


def show(sheets: Sequence[Sheet], out: Console) -> None:
    """Print tables, one below the other, with what their numbers mean."""
    from rich.text import Text

    from gvla2.commands.tables import row, table
    from gvla2.evaluation.tables import explanations

    for sheet in sheets:
        listing = table("", *sheet.headings)
        for line in sheet.rows:
            row(listing, line.label, *("\n".join(cell.lines) for cell in line.cells))
        out.print(Text(sheet.title, style="bold"), soft_wrap=True)
        out.print(listing)
        out.print(Text(sheet.footnote, style="dim"), soft_wrap=True)
        out.print()
    if sheets:
        out.print(Text(explanations(sheets), style="dim"), soft_wrap=True)


def main(argv: Sequence[str]) -> int:
    """Entry of ``gvla2 report [overrides]``; the process's exit status."""
    from gvla2.commands.hydra_job import launch

    # To Hydra `suite=` is the group that `gvla2 bench` chooses from.
    suites = [word.removeprefix("suite=") for word in argv if word.startswith("suite=")]
    others = [_plain(word) for word in argv if not word.startswith("suite=")]
    return launch(
        "report", {"report": ReportConfig}, partial(job, suite=suites[-1] if suites else ""), others
    )


def _plain(override: str) -> str:
    """A selection in Hydra's terms: a factor is new to the configuration, and one value is a list too."""
    name, equals, value = override.partition("=")
    if not name.startswith("where."):
        return override
    return f"++{name}={value if value.startswith('[') or not equals else f'[{value}]'}"
