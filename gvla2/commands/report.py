"""``gvla2 report``: any selection of measured results as a table."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from gvla2.commands.run_config import ResultsConfig
from gvla2.errors import ConfigurationError

if TYPE_CHECKING:
    from gvla2.plugins import Registry

FORMATS = ("terminal", "markdown", "latex", "html")


@dataclass
class ReportConfig:
    """A selection of the results database.

    ``where`` keeps the cells whose factors have one of the given values (``where.object=[apple,bowl]``); ``runs`` keeps
    those of some runs; ``formats`` are the forms that the table is made in.
    """

    suite: str = "reconstruction"
    where: dict[str, list[str]] = field(default_factory=dict)
    runs: list[int] = field(default_factory=list)
    formats: list[str] = field(default_factory=lambda: list(FORMATS))
    results: ResultsConfig = field(default_factory=ResultsConfig)

    def __post_init__(self) -> None:
        unknown = [name for name in self.formats if name not in FORMATS]
        if unknown or not self.formats:
            raise ConfigurationError(f"formats is {self.formats}; choose among {', '.join(FORMATS)}.")


def job(config: ReportConfig, registry: Registry, folder: Path) -> int:
    """Make the report into ``folder``; returns the number of cells in it.

    Raises :class:`ConfigurationError` when the database does not exist, or nothing in it fits the selection.
    """
    from gvla2.commands.reporting import publish
    from gvla2.evaluation.reports import REPORTS
    from gvla2.evaluation.results import Results, file_of

    if config.suite not in REPORTS:
        raise ConfigurationError(f"No suite '{config.suite}'. Available: {', '.join(REPORTS)}.")
    path = file_of(config.results.url)
    if path is not None and not path.is_file():
        raise ConfigurationError(
            f"There is no results database {path}. `gvla2 bench` makes one; name another with results.url=..."
        )
    with Results.open(config.results.url) as results:
        cells = results.cells(config.suite, config.where, config.runs)
        runs = results.runs(config.suite)
        if not cells:
            raise ConfigurationError(_nothing(config, results.cells(config.suite), [run.id for run in runs]))
        written = publish(cells, runs, config.suite, folder, config.formats)
    for file in written:
        print(f"{file.suffix[1:]}: {file}")
    return len(cells)


def _nothing(config: ReportConfig, cells: list, runs: list[int | None]) -> str:  # type: ignore[type-arg]
    """Why nothing was found, and what there is."""
    if not cells:
        return f"{config.results.url} holds no cells of the suite '{config.suite}'."
    parts = [f"Nothing in {config.results.url} fits the selection. Runs: {', '.join(map(str, runs))}."]
    for name in config.where:
        values = sorted({str(cell.factors.get(name)) for cell in cells})
        parts.append(f"{name}: {', '.join(values)}.")
    return " ".join(parts)


def main(argv: list[str]) -> int:
    """Entry of ``gvla2 report [overrides]``; the process's exit status."""
    from gvla2.commands.hydra_job import launch

    # A factor is new to the configuration, for which Hydra needs a "+".
    return launch("report", job, [f"++{one}" if one.startswith("where.") else one for one in argv])
