"""The schema of `gvla2 report`: which results, in which form."""

from __future__ import annotations

from dataclasses import dataclass, field

from gvla2.commands.run_config import ResultsConfig
from gvla2.errors import ConfigurationError

FORMATS = ("terminal", "markdown", "latex", "html")


@dataclass
class ReportConfig:
    """A selection of the results database.

    ``where`` keeps the cells whose factors have one of the values given (``where.object=[apple,bowl]``); ``runs``
    keeps those of some runs; ``formats`` are the forms that the table is made in.
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
