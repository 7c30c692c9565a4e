"""The contracts of software agents: task, sandbox, agent, run."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from gvla2.errors import Gvla2Error


@dataclass(frozen=True)
class AgentTask:
    """One task: what is asked, where its files are, and how its tests are run.

    ``files`` holds the initial contents of the working folder; None if the task needs an image instead. When the agent
    has finished, ``test.sh`` in ``tests`` is run; the agent never sees that folder. ``family`` names the technique that
    tasks share ("" for none). Times in seconds; the task's files may take ``disk_mb``, all processes together
    ``memory_mb``.
    """

    name: str
    instruction: str
    folder: Path
    tests: Path
    files: Path | None = None
    family: str = ""
    agent_seconds: float = 600.0
    test_seconds: float = 120.0
    disk_mb: float = 512
    memory_mb: float = 4096


@dataclass(frozen=True)
class Output:
    """What a command did: ``text`` of both its streams, cut in the middle if it was too long.

    ``status`` is its exit status, 128 + n after signal n, 126 if it could not be run.
    """

    text: str
    status: int
    seconds: float
    timed_out: bool = False


class Sandbox(Protocol):
    """Where an agent's commands are run: its own files, no network, no access to the host."""

    folder: str
    """The working folder as commands see it."""

    def run(
        self, command: str, *, seconds: float = 60.0, variables: Mapping[str, str] | None = None
    ) -> Output:
        """Run a command by bash in the working folder. File changes persist, shell variables do not."""


class EnvironmentFailedError(Gvla2Error):
    """The task's environment could not be set up here; the task is not measured."""


@dataclass(frozen=True)
class AgentRun:
    """What an agent did.

    ``messages`` are the conversation as plain JSON: role and content, and in an observation what the command printed,
    its ``output``, if the content has more than that, and its exit ``status``, without which failures teach less;
    ``steps`` the commands that it ran; ``exit_status`` as reported by the agent ("Submitted",
    "LimitsExceeded"); ``seconds`` of wall clock. ``usage`` counts ``calls``, ``prompt_tokens`` and
    ``completion_tokens``, those of cached answers too.
    """

    messages: tuple[Mapping[str, Any], ...]
    steps: int
    exit_status: str
    seconds: float
    usage: Mapping[str, float] = field(default_factory=dict)


class Agent(Protocol):
    """Works on a task in a sandbox."""

    def solve(
        self, task: AgentTask, sandbox: Sandbox, knowledge: str, *, seed: int, report: Callable[[str], None]
    ) -> AgentRun:
        """Work until done or out of steps or time; ``knowledge`` is what memory recalled, "" for nothing.

        ``report`` is called with a line per step. Raises :class:`~gvla2.language.contracts.LanguageModelError` if the
        model cannot be asked: such a task is not counted.
        """
