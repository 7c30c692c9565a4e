"""A model whose answers are the commands of a script, over real HTTP."""

from collections.abc import Callable, Mapping
from typing import Any

from gvla2.language import EndpointOptions
from gvla2.language.endpoint import Endpoint
from tests.local_model import said

DONE = "echo COMPLETE_TASK_AND_SUBMIT_FINAL_OUTPUT"


def block(command: str) -> str:
    return f"THOUGHT: next.\n\n```mswea_bash_command\n{command}\n```"


def giving(script: Mapping[str, list[str]]) -> Callable[[dict[str, Any]], Any]:
    """Commands by a word of the task; the n-th answer is the n-th command, then it submits."""

    def answer(request: dict[str, Any]) -> Any:
        messages = request["messages"]
        place = sum(message["role"] == "assistant" for message in messages)
        asked = next(message["content"] for message in messages if message["role"] == "user")
        commands = next((steps for word, steps in script.items() if word in asked), [])
        return said(block([*commands, DONE][min(place, len(commands))]))

    return answer


def endpoint(url: str) -> Endpoint:
    return Endpoint(EndpointOptions(base_url=url, model="local", cache=""))
