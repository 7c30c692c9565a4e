"""A question whose answer must parse: asked again, with the reason, until it does."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar

from gvla2.language.contracts import (
    Completion,
    LanguageModel,
    LanguageModelError,
    MalformedAnswerError,
    Message,
    Request,
    UnusableAnswerError,
)

T = TypeVar("T")

LONGEST_SHOWN = 2_000
"""Characters of a rejected answer that are sent back: an endless one would push the question out of context."""
WARM = 0.7
"""Temperature of a second try: at 0 the same wrong answer comes back word for word."""
_STARTS = 200
"""Brackets that :func:`json_in` tries at most."""
_OPENING = re.compile(r"[{\[]")


@dataclass(frozen=True)
class Answered(Generic[T]):
    """A parsed answer and the whole conversation.

    ``transcript`` is plain JSON, one mapping per call, ready for a plan's record: ``prompt`` (the messages that the
    call added), ``answer``, ``rejected`` (why, "" if it was not), ``prompt_tokens``, ``completion_tokens``,
    ``seconds``, ``cached``, ``seed``, ``temperature``. It is untrusted data.
    """

    answer: T
    transcript: tuple[Mapping[str, Any], ...]


def ask_typed(
    model: LanguageModel,
    messages: Sequence[Message],
    parse: Callable[[str], T],
    *,
    purpose: str,
    tries: int = 3,
    seed: int = 0,
    **options: Any,
) -> Answered[T]:
    """Ask until ``parse`` accepts the answer; it raises :class:`ValueError` with a sentence on what is wrong.

    ``options`` are a :class:`Request`'s: ``schema``, ``grammar``, ``temperature``, ``max_tokens``.

    The rejected answer and the sentence go back to the model, with another seed and at least the temperature
    :data:`WARM`. A truncated answer is always rejected.

    Raises :class:`UnusableAnswerError` after ``tries``, damaged responses included, and any other
    :class:`LanguageModelError` at once; both with ``transcript``.
    """
    if tries < 1:
        raise ValueError(f"tries is {tries}; it must be at least 1.")
    question = Request(messages, seed=seed, **options)
    added, why, transcript = tuple(messages), "", list[Mapping[str, Any]]()
    for _ in range(tries):
        said, parsed = Completion(""), list[T]()
        failure: LanguageModelError | None = None
        try:
            said = model.complete(question, purpose=purpose)
            parsed = [_parsed(parse, said)]
        except LanguageModelError as error:
            failure, why = error, str(error)
        except ValueError as error:
            why = str(error) or type(error).__name__
        transcript.append(_entry(added, question, said, "" if parsed else why))
        if parsed:
            return Answered(parsed[0], tuple(transcript))
        if failure is not None and not isinstance(failure, MalformedAnswerError):
            failure.transcript = tuple(transcript)
            raise failure
        added = _correction(said.text, why) if said.text.strip() else ()
        question = replace(
            question,
            messages=(*question.messages, *added),
            seed=(question.seed or 0) + 1,
            temperature=max(question.temperature or 0.0, WARM),
        )
    unusable = UnusableAnswerError(f"No usable answer in {tries} tries; the last time: {why}")
    unusable.transcript = tuple(transcript)
    raise unusable


def _parsed(parse: Callable[[str], T], said: Completion) -> T:
    if said.finish == "length":
        raise ValueError("It was cut off: answer more briefly.")
    if not said.text.strip():
        raise ValueError("It was empty.")
    try:
        return parse(said.text)
    except RecursionError:
        raise ValueError("It is nested too deeply.") from None


def _entry(added: Sequence[Message], asked: Request, said: Completion, why: str) -> dict[str, Any]:
    """The entry of the transcript for one call."""
    return {
        "prompt": [{**message, "content": _shown(message.get("content"))} for message in added],
        "answer": said.text,
        "rejected": why,
        "prompt_tokens": said.prompt_tokens,
        "completion_tokens": said.completion_tokens,
        "seconds": round(said.latency, 3),
        "cached": said.cached,
        "seed": asked.seed,
        "temperature": asked.temperature,
    }


def _correction(said: str, why: str) -> tuple[Message, ...]:
    """The messages that ask for a correction."""
    shown = said if len(said) <= LONGEST_SHOWN else f"{said[:LONGEST_SHOWN]} ..."
    words = f"That answer cannot be used. {why}\nAnswer the question again, in the form that was asked for."
    return {"role": "assistant", "content": shown}, {"role": "user", "content": words}


def _shown(content: Any) -> Any:
    """A message's content for the record: images are replaced by their size."""
    if not isinstance(content, list | tuple):
        return content
    texts = (part.get("text") or f"[{part.get('type')}, {len(str(part))} characters]" for part in content)
    return "\n".join(map(str, texts))


def json_in(text: str) -> Any:
    """The longest JSON object or array of an answer, which may stand in a code fence or between other words.

    Raises :class:`ValueError` with a sentence for the model when there is none, or when one is broken or holds NaN or
    Infinity: a valid part of broken JSON is not what was meant.
    """
    decoder = json.JSONDecoder(parse_constant=_no_number)
    best: tuple[int, Any] = (0, None)
    at = 0
    for _ in range(_STARTS):
        opening = _OPENING.search(text, at)
        if opening is None:
            break
        try:
            value, at = decoder.raw_decode(text, opening.start())
        except json.JSONDecodeError as error:
            if text[opening.end() : error.pos].strip():
                raise ValueError(f"Its JSON is broken: {error}.") from None
            at = opening.end()  # a bracket of the prose
            continue
        except RecursionError:
            raise ValueError("Its JSON is nested too deeply.") from None
        best = max(best, (at - opening.start(), value), key=lambda each: each[0])
    if not best[0]:
        raise ValueError("It holds no JSON object or array.")
    return best[1]


def _no_number(name: str) -> None:
    raise ValueError(f"Its JSON holds {name}, which is not a number.")
