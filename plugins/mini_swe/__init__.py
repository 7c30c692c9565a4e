"""The ``mini_swe`` agent: mini-swe-agent (MIT) with its own loop and prompts, at the run's ``language``."""

from __future__ import annotations

import logging
import os
import platform
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from gvla2 import Component, ComponentConfig, hookimpl
from gvla2.agents.contracts import Agent, AgentRun, AgentTask, Sandbox
from gvla2.errors import ConfigurationError, MissingDependencyError, reading
from gvla2.io.array_cache import cache_folder
from gvla2.language import LanguageModel, Request

SUBMITTED = "COMPLETE_TASK_AND_SUBMIT_FINAL_OUTPUT"
"""mini-swe-agent's agents print this line when they are done."""


@dataclass(kw_only=True)
class MiniSweConfig(ComponentConfig):
    """Options of the ``mini_swe`` agent.

    It stops after ``steps`` commands; each may take ``command_seconds``. ``temperature`` and ``max_tokens`` apply to
    each answer; null leaves them to the ``language``. ``prompts`` is a configuration file of mini-swe-agent, whose
    templates are used; its own for answers with one bash block by default.
    """

    steps: int = 20
    command_seconds: float = 30.0
    temperature: float | None = None
    max_tokens: int | None = 1024
    prompts: str = ""

    def __post_init__(self) -> None:
        if self.steps < 1 or self.command_seconds <= 0:
            raise ConfigurationError("mini_swe needs steps >= 1 and command_seconds > 0.")


class MiniSwe:
    """mini-swe-agent 2.4: a bash command per answer, until it submits."""

    def __init__(self, config: MiniSweConfig, language: LanguageModel) -> None:
        if find_spec("minisweagent") is None:
            raise MissingDependencyError(
                "the package 'mini-swe-agent' (MIT)", "agent=mini_swe", "pip install 'gvla2[agents]'"
            )
        # Its import reads and writes a settings file, which nobody else may prepare, and prints a banner.
        os.environ.setdefault("MSWEA_SILENT_STARTUP", "1")
        os.environ.setdefault("MSWEA_GLOBAL_CONFIG_DIR", str(cache_folder() / "mini-swe"))
        import minisweagent
        import yaml

        # Its own prompts, for models that answer with one bash block.
        folder = Path(minisweagent.__file__).parent / "config"
        self._settings = yaml.safe_load((folder / "mini_textbased.yaml").read_text(encoding="utf-8"))
        if config.prompts:
            with reading("agent.prompts", config.prompts, ConfigurationError):
                given = yaml.safe_load(Path(config.prompts).expanduser().read_text(encoding="utf-8-sig"))
                self._settings = {name: one | given.get(name, {}) for name, one in self._settings.items()}
        self._config, self._language = config, language
        logging.getLogger("minisweagent").setLevel(logging.ERROR)

    def solve(
        self, task: AgentTask, sandbox: Sandbox, knowledge: str, *, seed: int, report: Callable[[str], None]
    ) -> AgentRun:
        """Work until it submits, or runs out of steps or time."""
        from minisweagent.agents.default import DefaultAgent

        bridge = _Bridge(self._language, sandbox, self._config, self._settings, seed, report)
        agent = DefaultAgent(
            bridge,
            bridge,
            system_template=self._settings["agent"]["system_template"],
            instance_template=self._settings["agent"]["instance_template"],
            step_limit=self._config.steps,
            cost_limit=0.0,
            wall_time_limit_seconds=max(1, int(task.agent_seconds)),
        )
        begun = time.monotonic()
        ended = agent.run(f"{task.instruction}\n\n{knowledge}" if knowledge else task.instruction)
        return AgentRun(
            messages=tuple(map(_plain, agent.messages)),
            steps=bridge.steps,
            exit_status=str(ended.get("exit_status", "")),
            seconds=time.monotonic() - begun,
            usage=bridge.usage,
        )


def _plain(message: Mapping[str, Any]) -> dict[str, str]:
    """A message of the conversation, with what the command printed and its status where it is an observation."""
    kept = {name: str(message.get(name, "")) for name in ("role", "content")}
    extra = message.get("extra", {})
    if "raw_output" not in extra:
        return kept
    return {**kept, "output": str(extra["raw_output"]), "status": str(extra.get("returncode", ""))}


@dataclass
class _Bridge:
    """mini-swe-agent's model and environment in one: our language model answers, our sandbox runs the commands."""

    language: LanguageModel
    sandbox: Sandbox
    config: MiniSweConfig
    settings: Mapping[str, Any]
    seed: int
    report: Callable[[str], None]
    steps: int = 0
    usage: Counter[str] = field(default_factory=Counter)

    def query(self, messages: Sequence[Mapping[str, Any]], **_: Any) -> dict[str, Any]:
        """The next answer with its one action; raises mini-swe-agent's own ``FormatError`` for any other number."""
        from minisweagent.models.utils.actions_text import parse_regex_actions

        asked = [{"role": m["role"], "content": m["content"]} for m in messages]
        request = Request(
            asked,
            seed=self.seed * 1000 + len(asked),  # the same seed would repeat the same mistake
            temperature=self.config.temperature,
            max_tokens=self.config.max_tokens,
        )
        answer = self.language.complete(request, purpose="agent")
        counted = {
            "prompt_tokens": answer.prompt_tokens,
            "completion_tokens": answer.completion_tokens,
        }
        self.usage.update(calls=1, **counted)
        # A lone surrogate can be neither sent back nor stored.
        text = answer.text.encode(errors="replace").decode()
        actions = parse_regex_actions(
            text,
            action_regex=r"```mswea_bash_command\s*\n(.*?)\n```",
            format_error_template=self.settings["model"]["format_error_template"],
            template_kwargs={"finish_reason": answer.finish},
        )
        return {"role": "assistant", "content": text, "extra": {"actions": actions, "cost": 0.0}}

    def format_message(self, **message: Any) -> dict[str, Any]:
        """A plain text message."""
        return message

    def format_observation_messages(
        self,
        message: Mapping[str, Any],
        outputs: Sequence[dict[str, Any]],
        template_vars: Mapping[str, Any] | None = None,
    ) -> list[dict[str, Any]]:
        """A command's output for the agent, in mini-swe-agent's own words."""
        from minisweagent.models.utils.actions_text import format_observation_messages

        shown: list[dict[str, Any]] = format_observation_messages(
            list(outputs),
            observation_template=self.settings["model"]["observation_template"],
            template_vars=dict(template_vars or {}),
        )
        return shown

    def execute(self, action: Mapping[str, Any], cwd: str = "") -> dict[str, Any]:
        """Run one command; raises mini-swe-agent's own ``Submitted`` when it says that the task is done."""
        from minisweagent.exceptions import Submitted

        command, seconds = str(action.get("command", "")), self.config.command_seconds
        self.steps += 1
        self.report(f"step {self.steps}: {command.splitlines()[0][:80] if command else '(nothing)'}")
        variables = {name: str(value) for name, value in self.settings["environment"]["env"].items()}
        output = self.sandbox.run(command, seconds=seconds, variables=variables)
        first, _, rest = output.text.lstrip().partition("\n")
        if first.strip() == SUBMITTED and output.status == 0:
            extra = {"exit_status": "Submitted", "submission": rest}
            raise Submitted({"role": "exit", "content": rest, "extra": extra})
        why = f"The command was ended after {seconds:g} s." if output.timed_out else ""
        return {"output": output.text, "returncode": output.status, "exception_info": why}

    def get_template_vars(self, **given: Any) -> dict[str, Any]:
        """The machine's variables for prompts."""
        return {**platform.uname()._asdict(), "cwd": self.sandbox.folder, **given}

    def serialize(self) -> dict[str, Any]:
        """The model and the environment in a saved trajectory."""
        return {"info": {"config": {"model_type": "gvla2 language", "environment_type": "gvla2 sandbox"}}}


@hookimpl
def gvla2_agents() -> list[Component[Agent]]:
    """``agent=mini_swe``."""
    return [Component("mini_swe", MiniSweConfig, MiniSwe, needs=("language",))]
