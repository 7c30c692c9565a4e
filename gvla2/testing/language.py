"""Conformance of language models and agents."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from gvla2.agents.contracts import Agent, AgentRun, AgentTask, Output
from gvla2.language import Completion, LanguageModel, LanguageModelError, Request
from gvla2.testing.conformance import allowed, require, require_members, require_type


def check_language(model: LanguageModel) -> None:
    """Check that a model answers, or fails with a typed error, and keeps its ledger."""
    asked = [Request([{"role": "user", "content": "Say yes."}], max_tokens=4, seed=seed) for seed in (0, 1)]
    with allowed("complete_all()"):
        answers = model.complete_all(asked, purpose="check")
    require_type(answers, list, "What complete_all() returns")
    require(
        len(answers) == len(asked), f"complete_all() gave {len(answers)} answers to {len(asked)} requests."
    )
    for answer in answers:
        require(
            isinstance(answer, Completion | LanguageModelError),
            f"complete_all() gave a {type(answer).__name__}, neither a Completion nor a LanguageModelError.",
        )
    totals = model.ledger.totals()
    if any(isinstance(answer, Completion) for answer in answers):
        require("check" in totals, "The ledger does not know the purpose 'check' of answered calls.")
    with allowed("complete_all() of nothing"):
        require(model.complete_all([], purpose="check") == [], "complete_all() of nothing must be [].")


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
    task = AgentTask("check", "Write the word done to /app/answer.txt.", nowhere, nowhere)
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
