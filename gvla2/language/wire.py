"""The JSON that goes to an OpenAI-compatible server, and the completion that comes back."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from gvla2.language.contracts import (
    Completion,
    MalformedAnswerError,
    Request,
    Token,
    Usage,
)
from gvla2.language.options import AskingOptions

TOP_LOGPROBS = 20
"""The most alternatives per token that the API allows."""


def request_body(
    request: Request, options: AskingOptions, without: frozenset[str], *, grammars: bool
) -> dict[str, Any]:
    """The request's JSON but for the model, ``without`` the options that the server refused."""
    body: dict[str, Any] = {"messages": _sendable(request.messages), "seed": request.seed}
    for name in ("temperature", "max_tokens"):
        own, default = getattr(request, name), getattr(options, name)
        body[name] = own if own is not None and default is not None else default
    if request.logprobs and "logprobs" not in without:
        body |= {"logprobs": True, "top_logprobs": TOP_LOGPROBS}
    if request.grammar is not None and grammars:
        body["grammar"] = request.grammar
    elif request.schema is not None and "schema" not in without:
        form = {"name": "answer", "schema": dict(request.schema), "strict": True}
        body["response_format"] = {"type": "json_schema", "json_schema": form}
    return {name: value for name, value in body.items() if value is not None}


def _sendable(value: Any) -> Any:
    """As JSON that UTF-8 can encode: lone surrogates, as in damaged logs, become question marks."""
    if isinstance(value, str):
        return value.encode(errors="replace").decode()
    if isinstance(value, Mapping):
        return {key: _sendable(each) for key, each in value.items()}
    return [_sendable(each) for each in value] if isinstance(value, list | tuple) else value


def read_completion(body: Any, *, cached: bool = False) -> Completion:
    """The first choice of a response's JSON; raises :class:`MalformedAnswerError` when there is none.

    A block of reasoning in the text itself ends at its last closing tag; one that never closes leaves no answer.
    """
    try:
        if body.get("error"):
            raise MalformedAnswerError(f"The server answered with an error: {str(body['error'])[:300]}")
        choice = body["choices"][0]
        message = choice["message"]
        content = message.get("content") or ""
        if isinstance(content, list):
            content = "".join(part["text"] for part in content if isinstance(part.get("text"), str))
        thought, closed, answer = content.rpartition("</think>")
    except (AttributeError, KeyError, IndexError, TypeError) as error:
        message = f"The server's answer is no completion ({type(error).__name__}: {error})."
        raise MalformedAnswerError(message) from None
    if not closed and answer.lstrip().startswith("<think>"):
        thought, answer = answer, ""
    answer = answer.strip() if closed else answer
    stated = (message.get("reasoning_content"), message.get("reasoning"))
    spoken = thought.strip().removeprefix("<think>").strip()
    reasoning = [*[text for text in stated if isinstance(text, str) and text][:1], spoken]
    return Completion(
        text=answer,
        reasoning="\n".join(filter(None, reasoning)),
        tokens=_tokens(choice.get("logprobs"), answer),
        usage=_usage(body.get("usage")),
        finish=str(choice.get("finish_reason") or ""),
        model=str(body.get("model") or ""),
        cached=cached,
    )


def _tokens(logprobs: Any, answer: str) -> tuple[Token, ...]:
    """The answer's tokens: those that spell the end of the stream; none when an entry is damaged."""
    try:
        entries = [
            (_spelling(entry), _logprob(entry), [*map(_alternative, entry.get("top_logprobs") or ())])
            for entry in logprobs["content"]
        ]
    except (AttributeError, KeyError, TypeError, ValueError):
        return ()
    stream, whole = b"".join(piece for piece, _, _ in entries), answer.strip().encode(errors="replace")
    begin = stream.rfind(whole) if whole else -1
    after = stream[begin + len(whole) :].decode(errors="replace").strip() if begin >= 0 else ""
    if begin < 0 or not (after == "" or (after.startswith("<") and after.endswith(">"))):
        return ()  # what follows may only be an end-of-text mark
    lead = len(answer[: len(answer) - len(answer.lstrip())].encode(errors="replace"))
    tokens, at = [], lead - begin
    for piece, logprob, others in entries:
        if lead < at + len(piece) and at < lead + len(whole):
            # Some servers leave the chosen token out of the list, some list a token twice: the first one counts.
            odds = {piece.decode(errors="replace"): logprob}
            for other, value in others:
                odds.setdefault(other, value)
            tokens.append(Token(piece, at, logprob, tuple(odds.items())))
        at += len(piece)
    return tuple(tokens)


def _spelling(entry: Mapping[str, Any]) -> bytes:
    """The token's bytes, else its text, with raw vocabularies' space markers as spaces."""
    if entry.get("bytes") is not None:
        return bytes(entry["bytes"])
    text: str = entry["token"].replace("▁", " ").replace("Ġ", " ").replace("Ċ", "\n")
    return text.encode(errors="replace")


def _logprob(entry: Mapping[str, Any]) -> float:
    value = entry.get("logprob")
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else math.nan


def _alternative(entry: Mapping[str, Any]) -> tuple[str, float]:
    return _spelling(entry).decode(errors="replace"), _logprob(entry)


def _usage(counts: Any) -> Usage:
    counts = counts if isinstance(counts, Mapping) else {}
    numbers = (counts.get("prompt_tokens"), counts.get("completion_tokens"))
    if not all(type(number) is int and number >= 0 for number in numbers):
        return Usage()
    return Usage(*numbers, metered=True)
