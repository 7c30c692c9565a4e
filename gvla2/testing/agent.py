"""Conformance of agents: they work in the given sandbox, and terminate."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from gvla2.agents.contracts import Agent, AgentRun, AgentTask, Output
from gvla2.testing.conformance import require, require_members, require_type


class RecordingSandbox:
    """A sandbox that runs nothing: it records commands and gives prepared answers."""

    folder = "/app"

    def __init__(self, says: str = "") -> None:
        self.says, self.commands = says, list[str]()

    def run(
        self, command: str, *, seconds: float = 60.0, variables: Mapping[str, str] | None = None
    ) -> Output:
        """Record the command; a plain echo is answered with its text."""
        self.commands.append(command)
        echoed = command.removeprefix("echo ") if command.startswith("echo ") else self.says
        return Output(echoed, 0, 0.0)


def check_agent(agent: Agent) -> None:
    """The agent solves, or gives up on, a one-sentence task in a sandbox that answers every command with empty output.

    Raises :class:`~gvla2.testing.conformance.ConformanceError`.
    """
    require_members(agent, "agent")
    nowhere = Path()
    task = AgentTask("check", "Write the word done to /app/answer.txt.", nowhere, nowhere, nowhere, nowhere)
    sandbox, reported = RecordingSandbox(), list[str]()
    run = agent.solve(task, sandbox, "A lesson as data.", seed=0, report=reported.append)
    require_type(run, AgentRun, "solve()'s answer")
    require(run.steps == len(sandbox.commands), f"It says {run.steps} steps and ran {len(sandbox.commands)}.")
    require(run.seconds >= 0, f"It took {run.seconds} seconds.")
    require(
        all({"role", "content"} <= set(message) for message in run.messages),
        "Each message has a role and a content.",
    )
    asked = " ".join(str(message["content"]) for message in run.messages)
    require("A lesson as data." in asked, "What memory recalled never reached the conversation.")
