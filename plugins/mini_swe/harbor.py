"""mini-swe-agent with a KnowledgeBank for Harbor, the harness of Terminal-Bench 2.0, loaded by its import path.

    harbor run -d terminal-bench@2.0 --agent-import-path gvla2_plugins.mini_swe.harbor:RememberingAgent -m my-model
    python -m gvla2_plugins.mini_swe.harbor JOBS_FOLDER        # the job's verdicts become experience

Harbor (Apache-2.0) verifies after the agent has finished, so learning is a separate step: the second line. Environment
variables: ``GVLA2_BANK`` (a path or database address; none: no memory), ``GVLA2_BASE_URL`` (an OpenAI-compatible
address) and the variable that ``GVLA2_KEY_ENV`` names. Harbor needs Python 3.12.
"""

from __future__ import annotations

import asyncio
import json
import os
import shlex
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from harbor.agents.base import BaseAgent
from harbor.environments.base import BaseEnvironment
from harbor.models.agent.context import AgentContext

from gvla2.agents.contracts import AgentRun, AgentTask, Output
from gvla2.agents.solving import transcript, with_knowledge
from gvla2.errors import ConfigurationError
from gvla2.language import EndpointOptions
from gvla2.language.endpoint import Endpoint
from gvla2.memory import KnowledgeBank
from gvla2_plugins.mini_swe import MiniSweConfig
from gvla2_plugins.mini_swe.agent import MiniSwe

TRIAL_FILE = "gvla2.json"
"""A trial's file for learning, in its agent's folder."""


class RememberingAgent(BaseAgent):  # type: ignore[misc]
    """Recalls, then works as mini-swe-agent does, in Harbor's environment."""

    @staticmethod
    def name() -> str:
        """As Harbor lists it."""
        return "gvla2-mini-swe"

    def version(self) -> str:
        """That of gvla2."""
        from importlib.metadata import version

        return version("gvla2")

    async def setup(self, environment: BaseEnvironment) -> None:
        """Nothing is installed in the environment: the agent works from outside."""

    async def run(self, instruction: str, environment: BaseEnvironment, context: AgentContext) -> None:
        """Work until it submits or runs out of steps; tokens go into Harbor's context, the transcript into the logs."""
        address, bank = os.environ.get("GVLA2_BASE_URL", ""), os.environ.get("GVLA2_BANK", "")
        if not address:
            raise ConfigurationError("GVLA2_BASE_URL is not set: give an OpenAI-compatible address.")
        options = EndpointOptions(
            base_url=address, model=self.model_name or "", api_key_env=os.environ.get("GVLA2_KEY_ENV", "")
        )
        agent = MiniSwe(MiniSweConfig(name="mini_swe", steps=100), Endpoint(options))
        loop = asyncio.get_running_loop()
        trial = await asyncio.to_thread(
            _work, agent, instruction, _Environment(environment, loop), bank, self.session_id or ""
        )
        context.n_input_tokens = int(trial["usage"].get("prompt_tokens", 0))
        context.n_output_tokens = int(trial["usage"].get("completion_tokens", 0))
        context.metadata = {"steps": trial["steps"], "recalled": trial["recalled"]}
        Path(self.logs_dir).mkdir(parents=True, exist_ok=True)
        (Path(self.logs_dir) / TRIAL_FILE).write_text(json.dumps(trial), encoding="utf-8")


class _Environment:
    """A :class:`~gvla2.agents.contracts.Sandbox` of Harbor's environment, called from the agent's thread."""

    def __init__(self, environment: BaseEnvironment, loop: asyncio.AbstractEventLoop) -> None:
        self._environment, self._loop = environment, loop

    @property
    def folder(self) -> str:
        """Wherever Harbor's commands start."""
        return "the working folder"

    def run(
        self, command: str, *, seconds: float = 60.0, variables: Mapping[str, str] | None = None
    ) -> Output:
        """Run a command by bash."""
        asked = self._environment.exec(
            f"timeout -k 1 {seconds:g} bash -c {shlex.quote(command)} 2>&1", env=dict(variables or {})
        )
        done = asyncio.run_coroutine_threadsafe(asked, self._loop).result(timeout=seconds + 60)
        text = (done.stdout or "") + (done.stderr or "")
        return Output(text[-20_000:], done.return_code, 0.0, done.return_code == 124)


def _work(agent: MiniSwe, instruction: str, sandbox: _Environment, bank: str, session: str) -> dict[str, Any]:
    recalled, ids = "", list[str]()
    if bank:
        with KnowledgeBank(bank) as memory:
            found = memory.recall(instruction)
            recalled, ids = found.text, [item.id for item in found.items]
    nowhere = Path()
    task = AgentTask(session or "task", instruction, nowhere, nowhere, nowhere, nowhere, agent_seconds=86_400)
    run = agent.solve(task, sandbox, with_knowledge(recalled), seed=0, report=lambda line: None)
    return {
        "instruction": instruction,
        "messages": list(run.messages),
        "steps": run.steps,
        "exit_status": run.exit_status,
        "usage": dict(run.usage),
        "recalled": ids,
    }


def learn(jobs: str | Path, bank: str) -> tuple[int, int]:
    """Teach a bank the finished trials below a folder; returns how many were learnt from, and how many had no verdict.

    Repeated calls count a trial once: its marker lies beside its transcript.
    """
    learnt = unknown = 0
    with KnowledgeBank(bank) as memory:
        for file in sorted(Path(jobs).rglob(f"agent/{TRIAL_FILE}")):
            done, result = file.with_suffix(".learnt"), file.parent.parent / "result.json"
            if done.exists():
                continue
            outcome = json.loads(result.read_text(encoding="utf-8")) if result.is_file() else {}
            rewards = (outcome.get("verifier_result") or {}).get("rewards") or {}
            if "reward" not in rewards:
                unknown += 1
                continue
            trial = json.loads(file.read_text(encoding="utf-8"))
            run = AgentRun(tuple(trial["messages"]), trial["steps"], trial["exit_status"], 0.0)
            memory.learn(
                trial["instruction"], transcript(run), success=rewards["reward"] >= 1,
                source=f"harbor/{outcome.get('id', file.parent.parent.name)}",
            )  # fmt: skip
            done.touch()
            learnt += 1
    return learnt, unknown


if __name__ == "__main__":
    if len(sys.argv) != 2 or not os.environ.get("GVLA2_BANK"):
        sys.exit("GVLA2_BANK=memory.db python -m gvla2_plugins.mini_swe.harbor JOBS_FOLDER")
    learnt, unknown = learn(sys.argv[1], os.environ["GVLA2_BANK"])
    print(f"Learnt from {learnt} trials; {unknown} have no verdict.")
