"""One question, and its JSON for a server that may not support all of it."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from gvla2.language.options import AskingOptions

Message = Mapping[str, Any]
"""``{"role": "system" | "user" | "assistant", "content": str | parts}``; parts as OpenAI has them: text, images."""

TOP_LOGPROBS, FEW_LOGPROBS = 20, 5
"""The most alternatives per token that the API allows, and the limit of some servers."""


@dataclass(frozen=True)
class Request:
    """One question. Options that a server does not support are left out, and named in ``Completion.unmet``.

    ``logprobs`` asks for the answer's token probabilities. ``schema`` (JSON Schema) or ``grammar`` (llama.cpp's GBNF)
    constrains the answer; where the server supports grammars, a grammar takes precedence over a schema. The same
    ``seed`` gives the same answer where the server supports it; different seeds are different questions to the cache,
    unless the temperature is 0.
    ``temperature`` and ``max_tokens`` None take the endpoint's; where those are null, neither is sent.
    """

    messages: Sequence[Message]
    logprobs: bool = False
    seed: int | None = None
    temperature: float | None = None
    max_tokens: int | None = None
    schema: Mapping[str, Any] | None = None
    grammar: str | None = None

    def body(self, options: AskingOptions, without: frozenset[str], *, grammars: bool) -> dict[str, Any]:
        """The request's JSON but for the model, ``without`` the options that the server refused."""
        system = "system_role" not in without
        given: dict[str, Any] = {
            "messages": [sendable(m) for m in (self.messages if system else without_system(self.messages))],
            "seed": self.seed,
        }
        for name in ("temperature", "max_tokens"):
            own, default = getattr(self, name), getattr(options, name)
            given[name] = own if own is not None and default is not None else default
        if self.logprobs and "logprobs" not in without:
            given["logprobs"] = True
            given["top_logprobs"] = FEW_LOGPROBS if "alternatives" in without else TOP_LOGPROBS
        if self.grammar is not None and grammars:
            given["grammar"] = self.grammar
        elif self.schema is not None and "schema" not in without:
            form = {"name": "answer", "schema": dict(self.schema), "strict": True}
            given["response_format"] = {"type": "json_schema", "json_schema": form}
        return {name: value for name, value in given.items() if value is not None}

    def wishes(self, *, grammars: bool) -> list[str]:
        """Options that a server may refuse, likeliest first; "alternatives" means more than a few per token."""
        wished = {
            "schema": self.schema is not None and not (grammars and self.grammar),
            "alternatives": self.logprobs,
            "logprobs": self.logprobs,
            "system_role": any(m.get("role") == "system" for m in self.messages),
        }
        return [name for name, there in wished.items() if there]


def picture(png: bytes) -> dict[str, Any]:
    """A part of a message that shows an image to a model that can see."""
    return {
        "type": "image_url",
        "image_url": {"url": f"data:image/png;base64,{base64.b64encode(png).decode()}"},
    }


def without_system(messages: Sequence[Message]) -> list[dict[str, Any]]:
    """The same words for a model that knows no system role: they open the first of the user's messages."""
    orders = "\n\n".join(str(m["content"]) for m in messages if m.get("role") == "system")
    rest = [dict(m) for m in messages if m.get("role") != "system"]
    first = next((m for m in rest if m.get("role") == "user"), None)
    if first is None:
        return [{"role": "user", "content": orders}, *rest]
    said = first["content"]
    first["content"] = (
        f"{orders}\n\n{said}" if isinstance(said, str) else [{"type": "text", "text": orders}, *said]
    )
    return rest


def sendable(value: Any) -> Any:
    """As JSON that UTF-8 can encode: lone surrogates, as in damaged logs, become question marks."""
    if isinstance(value, str):
        return value.encode(errors="replace").decode()
    if isinstance(value, Mapping):
        return {key: sendable(each) for key, each in value.items()}
    return [sendable(each) for each in value] if isinstance(value, list | tuple) else value
