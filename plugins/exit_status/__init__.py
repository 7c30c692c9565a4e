"""The ``exit_status`` verifier: a command's exit status is the verdict."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl

if TYPE_CHECKING:
    from gvla2.memory.contracts import Evidence, Verdict, Verifier

NAME = "exit_status"


@dataclass
class ExitStatusConfig(ComponentConfig):
    """Options of the ``exit_status`` verifier: ``fact`` is the name of the observation that holds the status."""

    fact: str = "exit_status"


class ExitStatusVerifier:
    """Judges software tasks by an exit status: 0 succeeded, anything else or a time-out failed.

    It reads ``Evidence.facts``: the status, a whole number or its digits, and ``timed_out``, always a failure. Any
    other status, such as an agent's own "Submitted", makes the verdict ``unavailable``.
    """

    def __init__(self, config: ExitStatusConfig) -> None:
        self._fact = config.fact

    def verify(self, evidence: Evidence) -> Verdict:
        """A verdict of quality 0 or 1."""
        from gvla2.memory.contracts import Verdict
        from gvla2.memory.rendering import neutralised

        if evidence.facts.get("timed_out"):
            return Verdict.from_criteria({NAME: 0.0}, ("The command ran out of time.",), NAME)
        status = evidence.facts.get(self._fact)
        text = "" if isinstance(status, bool) else str(status).strip()
        if not re.fullmatch(r"[+-]?[0-9]{1,10}", text):
            said = (
                "is missing" if status is None else f"is '{neutralised(str(status), 64)}', not a whole number"
            )
            return Verdict.unavailable(f"The fact '{self._fact}' {said}.", NAME)
        reason = f"The command ended with status {int(text)}."
        return Verdict.from_criteria({NAME: float(int(text) == 0)}, (reason,), NAME)


@hookimpl
def gvla2_verifiers() -> list[Component[Verifier]]:
    """``verifier=exit_status``."""
    return [Component("exit_status", ExitStatusConfig, ExitStatusVerifier)]
