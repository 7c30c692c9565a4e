"""The ``exit_status`` verifier: a command's exit status is the verdict."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl

if TYPE_CHECKING:
    from gvla2.memory.contracts import Verifier


@dataclass
class ExitStatusConfig(ComponentConfig):
    """Options of the ``exit_status`` verifier.

    ``fact`` is the observation that holds the status. 0 is a success and every other number a failure; of words, which
    some agents end with, ``success`` are successes and ``failure`` failures, ignoring case; other words (such as
    "Submitted", an agent's own opinion of its work) are inconclusive.
    """

    fact: str = "exit_status"
    success: list[str] = field(default_factory=lambda: ["ok", "passed", "success"])
    failure: list[str] = field(
        default_factory=lambda: [
            "error", "failed", "failure", "killed", "timeout", "timed_out",
            "LimitsExceeded", "TimeExceeded", "RepeatedFormatError",
        ]
    )  # fmt: skip


def _build(config: ExitStatusConfig) -> Verifier:
    """Judges software tasks by an exit status: 0 succeeded, anything else, a signal or a time-out failed."""
    from gvla2_plugins.exit_status.verifier import ExitStatusVerifier

    return ExitStatusVerifier(config)


@hookimpl
def gvla2_verifiers() -> list[Component[Verifier]]:
    """``verifier=exit_status``."""
    return [Component("exit_status", ExitStatusConfig, _build)]
