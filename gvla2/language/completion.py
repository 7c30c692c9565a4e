"""A language model's answer, read from the JSON of an OpenAI-compatible server."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from gvla2.language.failures import MalformedAnswerError
from gvla2.language.reasoning import locate_answer, split_reasoning


@dataclass(frozen=True)
class Token:
    """One token of an answer.

    ``spelt`` is its bytes (a token may end within a character; ``text`` shows the decodable part). ``start`` is the
    byte of the answer's UTF-8 where it begins, negative when it begins before the answer does. ``alternatives`` are
    (text, natural log-probability) of what the model might have said here, the token itself included, most likely first
    as the server sent them; values may be -inf or NaN if the server sent them.
    """

    spelt: bytes
    start: int
    logprob: float
    alternatives: tuple[tuple[str, float], ...] = ()

    @property
    def text(self) -> str:
        """The token in characters."""
        return self.spelt.decode(errors="replace")


@dataclass(frozen=True)
class Usage:
    """Tokens of one call; ``metered`` is False where the server did not count (the numbers are then 0)."""

    prompt_tokens: int = 0
    completion_tokens: int = 0
    reasoning_tokens: int = 0
    metered: bool = False


@dataclass(frozen=True)
class Completion:
    """What a model answered.

    ``text`` is the answer alone, ``reasoning`` what it thought before. ``tokens`` belong to ``text``, never to the
    reasoning, and cover it from the first token's ``start`` to its end; empty when the server gave no
    log-probabilities, or none that spell the answer. ``finish`` is the server's finish reason ("stop", "length").
    ``latency`` in seconds, with retries; a ``cached`` answer was not asked for again and cost nothing. ``unmet`` names
    what was requested but not supported: "logprobs", "schema", "grammar", "system_role".
    """

    text: str
    reasoning: str = ""
    tokens: tuple[Token, ...] = ()
    usage: Usage = Usage()
    finish: str = ""
    model: str = ""
    cached: bool = False
    latency: float = 0.0
    unmet: tuple[str, ...] = ()


def read_completion(body: object, *, cached: bool = False, latency: float = 0.0) -> Completion:
    """The first choice of a response's JSON; raises :class:`MalformedAnswerError` when there is none."""
    if not isinstance(body, Mapping):
        raise MalformedAnswerError(
            f"The server answered with JSON of type {type(body).__name__}, not with an object."
        )
    if body.get("error"):
        raise MalformedAnswerError(f"The server answered with an error: {str(body['error'])[:300]}")
    choices = body.get("choices")
    if not isinstance(choices, Sequence) or not choices or not isinstance(choices[0], Mapping):
        raise MalformedAnswerError(
            f"The server's answer holds no choice (its keys: {', '.join(map(str, list(body)[:8])) or 'none'})."
        )
    choice = choices[0]
    message = choice.get("message")
    if not isinstance(message, Mapping):
        raise MalformedAnswerError("The server's answer holds a choice without a message.")
    told = (message.get(key) for key in ("reasoning_content", "reasoning"))
    stated = next((r for r in told if isinstance(r, str) and r), "")
    thought, answer = split_reasoning(_text(message.get("content")))
    reasoning = "\n".join(filter(None, (stated, thought)))
    logprobs = choice.get("logprobs")
    return Completion(
        text=answer,
        reasoning=reasoning,
        tokens=_tokens(logprobs.get("content") if isinstance(logprobs, Mapping) else None, answer, reasoning),
        usage=_usage(body.get("usage")),
        finish=str(choice.get("finish_reason") or ""),
        model=str(body.get("model") or ""),
        cached=cached,
        latency=latency,
    )


def _text(content: object) -> str:
    """A message's content: a string, parts with text, or nothing."""
    if content is None:
        return ""
    if isinstance(content, str):
        return content
    if isinstance(content, Sequence):
        return "".join(
            part["text"]
            for part in content
            if isinstance(part, Mapping) and isinstance(part.get("text"), str)
        )
    raise MalformedAnswerError(f"The message's content is a {type(content).__name__}, not text.")


def _tokens(entries: object, answer: str, reasoning: str) -> tuple[Token, ...]:
    """The answer's tokens; none when an entry is damaged, since positions cannot be trusted then."""
    if not isinstance(entries, Sequence) or isinstance(entries, str) or not entries:
        return ()
    if not all(isinstance(e, Mapping) and isinstance(e.get("token"), str) for e in entries):
        return ()
    pieces = [_bytes(e) for e in entries]
    found = locate_answer(b"".join(pieces), answer, reasoning)
    if found is None:
        return ()
    shift, end = found[1] - found[0], len(answer.rstrip().encode(errors="replace"))
    tokens, at = [], shift
    for entry, piece in zip(entries, pieces, strict=True):
        if at + len(piece) > found[1] and at < end:
            tokens.append(_token(entry, piece, at))
        at += len(piece)
    return tuple(tokens)


def _token(entry: Mapping[str, Any], piece: bytes, start: int) -> Token:
    logprob = _number(entry.get("logprob"))
    text = piece.decode(errors="replace")
    # Some servers leave the chosen token out of the list, some list a token twice.
    alternatives = {text: logprob}
    listed = entry.get("top_logprobs")
    for other in listed if isinstance(listed, Sequence) else ():
        if isinstance(other, Mapping) and isinstance(other.get("token"), str):
            alternatives.setdefault(_bytes(other).decode(errors="replace"), _number(other.get("logprob")))
    return Token(piece, start, logprob, tuple(alternatives.items()))


def _bytes(entry: Mapping[str, Any]) -> bytes:
    """A token's bytes as the server spells them, else its text, with raw vocabularies' space markers as spaces."""
    spelt = entry.get("bytes")
    if isinstance(spelt, Sequence) and not isinstance(spelt, str):
        try:
            return bytes(spelt)
        except (TypeError, ValueError):
            pass
    raw: str = entry["token"]
    return raw.replace("▁", " ").replace("Ġ", " ").replace("Ċ", "\n").encode(errors="replace")


def _number(value: object) -> float:
    """A log-probability; NaN if it is not a number."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.nan


def _usage(counts: object) -> Usage:
    if not isinstance(counts, Mapping):
        return Usage()
    details = counts.get("completion_tokens_details")
    thinking = details.get("reasoning_tokens") if isinstance(details, Mapping) else 0
    prompt, completion = _count(counts.get("prompt_tokens")), _count(counts.get("completion_tokens"))
    if prompt is None or completion is None:
        return Usage()
    return Usage(prompt, completion, _count(thinking) or 0, metered=True)


def _count(value: object) -> int | None:
    """A count of tokens; None if it is not one."""
    return value if isinstance(value, int) and not isinstance(value, bool) and value >= 0 else None
