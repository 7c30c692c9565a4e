"""From an exit status to a verdict."""

from __future__ import annotations

import re
import signal
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from gvla2.memory.contracts import Evidence, Verdict
from gvla2.memory.rendering import neutralised

if TYPE_CHECKING:
    from gvla2_plugins.exit_status import ExitStatusConfig

NAME = "exit_status"
_SHELL_SIGNALS = range(129, 129 + 64)
"""A shell reports a command that signal n ended as 128 + n."""


class ExitStatusVerifier:
    """Reads ``Evidence.facts``: the status itself, and ``timed_out`` (true) or ``signal`` (its number or name).

    A time-out or a signal is a failure regardless of the status. Without a status, or with an inconclusive one, the
    verdict is ``unavailable``.
    """

    def __init__(self, config: ExitStatusConfig) -> None:
        self._config = config
        self._success = {word.casefold() for word in config.success}
        self._failure = {word.casefold() for word in config.failure}

    def verify(self, evidence: Evidence) -> Verdict:
        """A verdict of quality 0 or 1."""
        facts = evidence.facts
        if str(facts.get("timed_out") or "").casefold() not in ("", "0", "false", "no"):
            return _judged(0.0, "The command ran out of time.")
        if (ended := _signal(facts)) is not None:
            return _judged(0.0, f"The command was ended by {ended}.")
        status = facts.get(self._config.fact)
        if status is None:
            return Verdict.unavailable(f"The evidence holds no '{self._config.fact}'.", NAME)
        number = _number(status)
        if number is None:
            return self._word(str(status))
        if number == 0:
            return _judged(1.0, "The command ended with status 0.")
        how = f" ({_named(number - 128)})" if number in _SHELL_SIGNALS else ""
        how = f" ({_named(-number)})" if number < 0 else how
        return _judged(0.0, f"The command ended with status {number}{how}.")

    def _word(self, status: str) -> Verdict:
        said, word = neutralised(status, 64), status.strip().casefold()
        if word in self._failure:
            return _judged(0.0, f"The run ended with '{said}'.")
        if word in self._success:
            return _judged(1.0, f"The run ended with '{said}'.")
        return Verdict.unavailable(
            f"The status '{said}' does not tell success from failure; name it in the option success or failure.",
            NAME,
        )


def _judged(quality: float, reason: str) -> Verdict:
    return Verdict.from_criteria({NAME: quality}, (reason,), NAME)


def _number(status: object) -> int | None:
    """The status as a whole number; None for words, booleans (whose meaning is unclear) and anything else."""
    if isinstance(status, bool):
        return None
    if isinstance(status, int):
        return status
    if isinstance(status, float) and status.is_integer():
        return int(status)
    # ASCII digits, and few of them: Python refuses to convert very long ones.
    if isinstance(status, str) and re.fullmatch(r"[+-]?[0-9]{1,10}", status.strip()):
        return int(status)
    return None


def _signal(facts: Mapping[str, Any]) -> str | None:
    """The signal that ended the command, in words, None when there was none."""
    ended = facts.get("signal")
    if ended is None or ended is False or ended in (0, "", "0"):
        return None
    number = _number(ended)
    return _named(number) if number is not None else f"the signal {neutralised(str(ended), 32)}"


def _named(number: int) -> str:
    try:
        return f"signal {number}, {signal.Signals(number).name}"
    except ValueError:
        return f"signal {number}"
