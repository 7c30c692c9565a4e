"""The JSON that goes to an OpenAI-compatible server, and the completion that comes back."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from pydantic import BaseModel, Field, ValidationError

from gvla2.language.contracts import (
    Completion,
    MalformedAnswerError,
    Message,
    Request,
    Token,
    Usage,
)
from gvla2.language.options import AskingOptions

TOP_LOGPROBS, FEW_LOGPROBS = 20, 5
"""The most alternatives per token that the API allows, and the limit of some servers."""


def request_body(
    request: Request, options: AskingOptions, without: frozenset[str], *, grammars: bool
) -> dict[str, Any]:
    """The request's JSON but for the model, ``without`` the options that the server refused."""
    messages = request.messages if "system_role" not in without else without_system(request.messages)
    body: dict[str, Any] = {"messages": _sendable(messages), "seed": request.seed}
    for name in ("temperature", "max_tokens"):
        own, default = getattr(request, name), getattr(options, name)
        body[name] = own if own is not None and default is not None else default
    if request.logprobs and "logprobs" not in without:
        few = "alternatives" in without
        body |= {"logprobs": True, "top_logprobs": FEW_LOGPROBS if few else TOP_LOGPROBS}
    if request.grammar is not None and grammars:
        body["grammar"] = request.grammar
    elif request.schema is not None and "schema" not in without:
        form = {"name": "answer", "schema": dict(request.schema), "strict": True}
        body["response_format"] = {"type": "json_schema", "json_schema": form}
    return {name: value for name, value in body.items() if value is not None}


def refusable(request: Request, *, grammars: bool) -> list[str]:
    """Options that a server may refuse, likeliest first; "alternatives" means more than a few per token."""
    asked = {
        "schema": request.schema is not None and not (grammars and request.grammar),
        "alternatives": request.logprobs,
        "logprobs": request.logprobs,
        "system_role": any(m.get("role") == "system" for m in request.messages),
    }
    return [name for name, there in asked.items() if there]


def without_system(messages: Sequence[Message]) -> list[dict[str, Any]]:
    """The same words for a model that knows no system role: they open the first of the user's messages."""
    orders = "\n\n".join(str(m["content"]) for m in messages if m.get("role") == "system")
    rest = [dict(m) for m in messages if m.get("role") != "system"]
    first = next((m for m in rest if m.get("role") == "user"), None)
    if first is None:
        return [{"role": "user", "content": orders}, *rest]
    said = first["content"]
    text = isinstance(said, str)
    first["content"] = f"{orders}\n\n{said}" if text else [{"type": "text", "text": orders}, *said]
    return rest


def _sendable(value: Any) -> Any:
    """As JSON that UTF-8 can encode: lone surrogates, as in damaged logs, become question marks."""
    if isinstance(value, str):
        return value.encode(errors="replace").decode()
    if isinstance(value, Mapping):
        return {key: _sendable(each) for key, each in value.items()}
    return [_sendable(each) for each in value] if isinstance(value, list | tuple) else value


class _Alternative(BaseModel):
    token: str
    bytes: list[int] | None = None
    logprob: Any = math.nan

    def spelt(self) -> Any:
        """The token's bytes, else its text, with raw vocabularies' space markers as spaces."""
        if self.bytes is not None:
            return bytes(self.bytes)
        text = self.token.replace("▁", " ").replace("Ġ", " ").replace("Ċ", "\n")
        return text.encode(errors="replace")

    def value(self) -> float:
        number = isinstance(self.logprob, int | float) and not isinstance(self.logprob, bool)
        return float(self.logprob) if number else math.nan


class _Entry(_Alternative):
    top_logprobs: list[_Alternative] | None = None


class _Logprobs(BaseModel):
    content: list[_Entry]


class _Message(BaseModel):
    content: str | list[Any] | None = None
    reasoning_content: Any = None
    reasoning: Any = None


class _Choice(BaseModel):
    message: _Message
    finish_reason: str | None = None
    logprobs: Any = None


class _Body(BaseModel):
    error: Any = None
    choices: list[_Choice] = Field(default=[])
    model: str | None = None
    usage: Any = None


class _Thinking(BaseModel):
    reasoning_tokens: int | None = Field(default=None, ge=0)


class _Counts(BaseModel, strict=True):
    prompt_tokens: int = Field(ge=0)
    completion_tokens: int = Field(ge=0)
    completion_tokens_details: _Thinking | None = None


def read_completion(body: object, *, cached: bool = False, latency: float = 0.0) -> Completion:
    """The first choice of a response's JSON; raises :class:`MalformedAnswerError` when there is none.

    A block of reasoning in the text itself ends at its last closing tag; one that never closes leaves no answer.
    """
    try:
        read = _Body.model_validate(body)
    except ValidationError as error:
        what = "; ".join(f"{'.'.join(map(str, e['loc'])) or 'body'}: {e['msg']}" for e in error.errors()[:3])
        raise MalformedAnswerError(f"The server's answer is no completion ({what}).") from None
    if read.error or not read.choices:
        said = str(read.error)[:300] if read.error else "it holds no choice"
        raise MalformedAnswerError(f"The server answered with an error: {said}")
    choice = read.choices[0]
    content = choice.message.content
    if isinstance(content, list):
        texts = [p.get("text") for p in content if isinstance(p, Mapping)]
        content = "".join(t for t in texts if isinstance(t, str))
    stated = (choice.message.reasoning_content, choice.message.reasoning)
    thought, closed, answer = (content or "").rpartition("</think>")
    if not closed and answer.lstrip().startswith("<think>"):
        thought, answer = answer, ""
    spoken = thought.strip().removeprefix("<think>").strip()
    reasoning = "\n".join(
        [*[r for r in stated if isinstance(r, str) and r][:1], *([spoken] if spoken else [])]
    )
    return Completion(
        text=answer.strip() if closed else answer,
        reasoning=reasoning,
        tokens=_tokens(choice.logprobs, answer.strip() if closed else answer),
        usage=_usage(read.usage),
        finish=choice.finish_reason or "",
        model=read.model or "",
        cached=cached,
        latency=latency,
    )


def _tokens(logprobs: object, answer: str) -> tuple[Token, ...]:
    """The answer's tokens: those that spell the end of the stream; none when an entry is damaged."""
    try:
        entries = _Logprobs.model_validate(logprobs).content
        pieces = [entry.spelt() for entry in entries]
    except (ValidationError, ValueError):
        return ()
    stream, whole = b"".join(pieces), answer.strip().encode(errors="replace")
    begin = stream.rfind(whole) if whole else -1
    after = stream[begin + len(whole) :].decode(errors="replace").strip() if begin >= 0 else ""
    if begin < 0 or not (after == "" or (after.startswith("<") and after.endswith(">"))):
        return ()  # what follows may only be an end-of-text mark
    lead = len(answer[: len(answer) - len(answer.lstrip())].encode(errors="replace"))
    tokens, at = [], lead - begin
    for entry, piece in zip(entries, pieces, strict=True):
        if lead < at + len(piece) and at < lead + len(whole):
            text = piece.decode(errors="replace")
            # Some servers leave the chosen token out of the list, some list a token twice.
            others = {text: entry.value()}
            for other in entry.top_logprobs or ():
                others.setdefault(other.spelt().decode(errors="replace"), other.value())
            tokens.append(Token(piece, at, entry.value(), tuple(others.items())))
        at += len(piece)
    return tuple(tokens)


def _usage(counts: object) -> Usage:
    try:
        read = _Counts.model_validate(counts)
    except ValidationError:
        return Usage()
    thinking = read.completion_tokens_details
    reasoned = (thinking.reasoning_tokens or 0) if thinking is not None else 0
    return Usage(read.prompt_tokens, read.completion_tokens, reasoned, metered=True)
