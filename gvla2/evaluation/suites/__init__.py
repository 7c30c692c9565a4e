"""The suites of ``gvla2 bench``, by name: what each measures, and how its rows become tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from gvla2.evaluation.config import SUITES
from gvla2.evaluation.engine import Suite
from gvla2.evaluation.results import Cell, Run
from gvla2.evaluation.tables import Sheet

SWEPT = ("run", "reconstruct")
"""Commands whose sweeps are stored under their name."""
REPORTED = (*SUITES, *SWEPT)
"""Whatever a report can show, in the order in which a message lists it."""


def suite_named(name: str) -> type[Suite[Any, Any]]:
    """The suite of that name; its module is imported now. Raises KeyError for another name."""
    if name == "reconstruction":
        from gvla2.evaluation.suites.reconstruction import ReconstructionSuite

        return ReconstructionSuite
    if name == "robot":
        from gvla2.evaluation.suites.robot import RobotSuite

        return RobotSuite
    if name == "agents":
        from gvla2.evaluation.suites.agents import AgentsSuite

        return AgentsSuite
    raise KeyError(name)


def report(name: str, cells: Sequence[Cell], runs: Sequence[Run] = ()) -> tuple[str, list[Sheet]]:
    """The title and the tables of a suite's rows, which ``runs`` measured, or of a sweep's jobs."""
    if name in SWEPT:
        from gvla2.evaluation.sweeps import reconstruction_sheets, run_sheets

        return (
            ("Runs", run_sheets(cells))
            if name == "run"
            else ("Reconstructions", reconstruction_sheets(cells))
        )
    suite = suite_named(name)
    return suite.title, suite.sheets(cells, runs)
