"""Conformance of language models and agents."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from gvla2.agents.contracts import Agent, AgentRun, AgentTask, Output
from gvla2.geometry.exchange import require, require_type
from gvla2.language import Completion, LanguageModel, LanguageModelError, Request
from gvla2.testing.conformance import allowed, require_members


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


class _Sandbox:
    """Runs nothing: it counts commands, and answers an echo with its text."""

    folder = "/app"

    def __init__(self) -> None:
        self.steps = 0

    def run(
        self, command: str, *, seconds: float = 60.0, variables: Mapping[str, str] | None = None
    ) -> Output:
        self.steps += 1
        return Output(command.removeprefix("echo ") if command.startswith("echo ") else "", 0, 0.0)


def check_agent(agent: Agent) -> None:
    """The agent solves, or gives up on, a one-sentence task in a sandbox whose commands print nothing."""
    require_members(agent, "agent")
    task = AgentTask("check", "Write the word done to /app/answer.txt.", Path(), Path())
    sandbox = _Sandbox()
    run = agent.solve(task, sandbox, "A lesson as data.", seed=0, report=lambda line: None)
    require_type(run, AgentRun, "solve()'s answer")
    require(run.steps == sandbox.steps, f"It says {run.steps} steps and ran {sandbox.steps}.")
    require(run.seconds >= 0, f"It took {run.seconds} seconds.")
    for message in run.messages:
        require({"role", "content"} <= set(message), "Each message has a role and a content.")
    asked = " ".join(str(message["content"]) for message in run.messages)
    require("A lesson as data." in asked, "What memory recalled never reached the conversation.")
