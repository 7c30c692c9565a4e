"""mini-swe-agent's loop between our language model and our sandbox."""

from __future__ import annotations

import logging
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gvla2.agents.contracts import AgentRun, AgentTask, Sandbox
from gvla2.agents.sandbox import SUBMITTED, prepare_minisweagent
from gvla2.errors import MissingDependencyError
from gvla2.language import Request

if TYPE_CHECKING:
    from gvla2.language.contracts import LanguageModel
    from gvla2_plugins.mini_swe import MiniSweConfig


class MiniSwe:
    """An :class:`~gvla2.agents.contracts.Agent`."""

    def __init__(self, config: MiniSweConfig, language: LanguageModel) -> None:
        if find_spec("minisweagent") is None:
            raise MissingDependencyError(
                "the package 'mini-swe-agent' (MIT)", "agent=mini_swe", "pip install 'gvla2[agents]'"
            )
        prepare_minisweagent()
        self._config, self._language, self._settings = config, language, _settings()
        logging.getLogger("minisweagent").setLevel(logging.ERROR)

    def solve(
        self, task: AgentTask, sandbox: Sandbox, knowledge: str, *, seed: int, report: Callable[[str], None]
    ) -> AgentRun:
        """Work until it submits, or runs out of steps or time."""
        from minisweagent.agents.default import DefaultAgent

        model = _Model(self._language, self._config, self._settings["model"], seed)
        environment = _Environment(sandbox, self._config.command_seconds, self._settings, report)
        agent = DefaultAgent(
            model,
            environment,
            system_template=self._settings["agent"]["system_template"],
            instance_template=self._settings["agent"]["instance_template"],
            step_limit=self._config.steps,
            cost_limit=0.0,
            wall_time_limit_seconds=max(1, int(task.agent_seconds)),
        )
        begun = time.monotonic()
        ended = agent.run(f"{task.instruction}\n\n{knowledge}" if knowledge else task.instruction)
        return AgentRun(
            messages=tuple(
                {name: str(m.get(name, "")) for name in ("role", "content")} for m in agent.messages
            ),
            steps=environment.steps,
            exit_status=str(ended.get("exit_status", "")),
            seconds=time.monotonic() - begun,
            usage=model.usage,
        )


class _Model:
    """mini-swe-agent's model, answered by a :class:`~gvla2.language.contracts.LanguageModel`."""

    def __init__(
        self, language: LanguageModel, config: MiniSweConfig, settings: Mapping[str, Any], seed: int
    ) -> None:
        self.config = config
        self._language, self._settings, self._seed = language, settings, seed
        self.usage = {"calls": 0.0, "prompt_tokens": 0.0, "completion_tokens": 0.0}

    def query(self, messages: Sequence[Mapping[str, Any]], **_: Any) -> dict[str, Any]:
        """The next answer with its one action; raises mini-swe-agent's own ``FormatError`` for any other number."""
        from minisweagent.models.utils.actions_text import parse_regex_actions

        asked = [{"role": m["role"], "content": m["content"]} for m in messages]
        request = Request(
            asked,
            seed=self._seed * 1000 + len(asked),  # the same seed would repeat the same mistake
            temperature=self.config.temperature,
            max_tokens=self.config.max_tokens,
        )
        answer = self._language.complete(request, purpose="agent")
        self.usage["calls"] += 1
        self.usage["prompt_tokens"] += answer.usage.prompt_tokens
        self.usage["completion_tokens"] += answer.usage.completion_tokens
        # A lone surrogate can be neither sent back nor stored.
        text = answer.text.encode(errors="replace").decode()
        actions = parse_regex_actions(
            text,
            action_regex=self._settings.get("action_regex", r"```mswea_bash_command\s*\n(.*?)\n```"),
            format_error_template=self._settings["format_error_template"],
            template_kwargs={"finish_reason": answer.finish},
        )
        return {
            "role": "assistant",
            "content": text,
            "extra": {"actions": actions, "cost": 0.0, "timestamp": time.time()},
        }

    def format_message(self, **message: Any) -> dict[str, Any]:
        """A plain text message."""
        return message

    def format_observation_messages(
        self,
        message: Mapping[str, Any],
        outputs: Sequence[Mapping[str, Any]],
        template_vars: Mapping[str, Any] | None = None,
    ) -> list[dict[str, Any]]:
        """A command's output for the agent, in mini-swe-agent's own words."""
        from minisweagent.models.utils.actions_text import format_observation_messages

        template = self._settings["observation_template"]
        shown: list[dict[str, Any]] = format_observation_messages(
            [dict(o) for o in outputs], observation_template=template, template_vars=dict(template_vars or {})
        )
        return shown

    def get_template_vars(self, **_: Any) -> dict[str, Any]:
        """No variables for prompts."""
        return {}

    def serialize(self) -> dict[str, Any]:
        """The model in a saved trajectory."""
        return {"info": {"config": {"model_type": "gvla2 language"}}}


class _Environment:
    """Commands go into the sandbox; ``steps`` counts them."""

    def __init__(
        self, sandbox: Sandbox, seconds: float, settings: Mapping[str, Any], report: Callable[[str], None]
    ) -> None:
        self.config: Any = None
        self._sandbox, self._seconds, self._report = sandbox, seconds, report
        self._variables = {k: str(v) for k, v in settings.get("environment", {}).get("env", {}).items()}
        self.steps = 0

    def execute(self, action: Mapping[str, Any], cwd: str = "") -> dict[str, Any]:
        """Run one command; raises mini-swe-agent's own ``Submitted`` when it says that the task is done."""
        from minisweagent.exceptions import Submitted

        command = str(action.get("command", ""))
        self.steps += 1
        self._report(f"step {self.steps}: {command.splitlines()[0][:80] if command else '(nothing)'}")
        output = self._sandbox.run(command, seconds=self._seconds, variables=self._variables)
        lines = output.text.lstrip().splitlines(keepends=True)
        if lines and lines[0].strip() == SUBMITTED and output.status == 0:
            rest = "".join(lines[1:])
            raise Submitted(
                {"role": "exit", "content": rest, "extra": {"exit_status": "Submitted", "submission": rest}}
            )
        why = f"The command was ended after {self._seconds:g} s." if output.timed_out else ""
        return {"output": output.text, "returncode": output.status, "exception_info": why}

    def get_template_vars(self, **given: Any) -> dict[str, Any]:
        """The machine's variables for prompts."""
        return {**platform.uname()._asdict(), "cwd": self._sandbox.folder, **given}

    def serialize(self) -> dict[str, Any]:
        """The environment in a saved trajectory."""
        return {"info": {"config": {"environment_type": "gvla2 sandbox"}}}


def _settings() -> dict[str, Any]:
    """mini-swe-agent's own prompts, for models that answer with one bash block."""
    import minisweagent
    import yaml

    file = Path(minisweagent.__file__).parent / "config" / "mini_textbased.yaml"
    return dict(yaml.safe_load(file.read_text(encoding="utf-8")))
