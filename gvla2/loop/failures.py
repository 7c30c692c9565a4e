"""How an episode fails: the kinds of failure that its stages record, and what they mean for whoever counts episodes."""

from __future__ import annotations

from collections.abc import Mapping

from gvla2.errors import (
    Gvla2Error,
    PerceptionError,
    PlannerTimeoutError,
    PlanningError,
    SimulationError,
)
from gvla2.language.failures import ModelUnavailableError
from gvla2.record.contents import EpisodeRecord, Failure, Stage

ABANDONED: tuple[str, ...] = ("error", "unavailable", "crashed", "interrupted")
"""Kinds of failure that mean the episode was not carried out; every other kind is an outcome."""

PLANNING: tuple[Stage, ...] = ("plan", "check")
"""The stages at which nothing but the planner, its fallback and the skills that they call can crash."""

VOID = "simulation"
"""The kind of failure that makes the whole episode meaningless: its simulated world has blown up."""

_KINDS: Mapping[type[Gvla2Error], str] = {
    PerceptionError: "perception",
    PlannerTimeoutError: "timeout",  # before the planning error that it is too
    PlanningError: "invalid_plan",
    SimulationError: VOID,
    ModelUnavailableError: "unavailable",
}


def failure_of(stage: Stage, error: Gvla2Error) -> Failure:
    """The failure of a stage that one of our errors ended."""
    kind = next((kind for wrong, kind in _KINDS.items() if isinstance(error, wrong)), "error")
    return Failure(stage, kind, str(error))


def planner_crashed(record: EpisodeRecord) -> bool:
    """Whether the episode ended in a crash of its planner: whoever compares planners counts it as a failure."""
    failure = record.failure
    return failure is not None and failure.kind == "crashed" and failure.stage in PLANNING
