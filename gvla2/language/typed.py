"""A question whose answer must parse: asked again, with the reason, until it does."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar

from gvla2.language.contracts import (
    Completion,
    LanguageModel,
    LanguageModelError,
    MalformedAnswerError,
    Message,
    ModelUnavailableError,
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
    """A parsed answer, the ``votes`` of ``samples`` that agreed on it, and the whole conversation.

    ``transcript`` is plain JSON, one mapping per call, ready for a plan's record: ``prompt`` (the messages that the
    call added), ``answer``, ``rejected`` (why, "" if it was not), ``prompt_tokens``, ``completion_tokens``,
    ``seconds``, ``cached``, ``seed``, ``temperature``. It is untrusted data.
    """

    answer: T
    transcript: tuple[Mapping[str, Any], ...]
    votes: int = 1
    samples: int = 1


def ask_typed(
    model: LanguageModel,
    messages: Sequence[Message],
    parse: Callable[[str], T],
    *,
    purpose: str,
    schema: Mapping[str, Any] | None = None,
    grammar: str | None = None,
    tries: int = 3,
    samples: int = 1,
    same: Callable[[T], Hashable] = repr,
    seed: int = 0,
    temperature: float | None = None,
    max_tokens: int | None = None,
) -> Answered[T]:
    """Ask until ``parse`` accepts the answer; it raises :class:`ValueError` with a sentence on what is wrong.

    The rejected answer and the sentence go back to the model, with another seed and at least the temperature
    :data:`WARM`. Of ``samples`` answers per try (the first at ``temperature``, the others warm) the majority wins,
    compared by ``same``; the first one breaks a tie. A truncated answer is always rejected.

    Raises :class:`UnusableAnswerError` after ``tries``, even if the last one was damaged;
    :class:`ModelUnavailableError` if the server broke off in the last; and any other :class:`LanguageModelError` at
    once; all with ``transcript``.
    """
    if tries < 1 or samples < 1:
        raise ValueError(f"tries is {tries} and samples {samples}; both must be at least 1.")
    question = Request(messages, max_tokens=max_tokens, schema=schema, grammar=grammar)
    warm, added = max(temperature or 0.0, WARM), tuple(messages)
    transcript: list[Mapping[str, Any]] = []
    why = ""
    for number in range(0, tries * samples, samples):
        requests = [
            replace(question, seed=seed + number + i, temperature=warm if number + i else temperature)
            for i in range(samples)
        ]
        answers = [_Tried(parse, each) for each in model.complete_all(requests, purpose=purpose)]
        transcript += [tried.entry(added, asked) for tried, asked in zip(answers, requests, strict=True)]
        if taken := [tried for tried in answers if not tried.why]:
            kinds = [same(tried.parsed[0]) for tried in taken]
            winner = max(range(len(kinds)), key=lambda i: (kinds.count(kinds[i]), -i))
            return Answered(taken[winner].parsed[0], tuple(transcript), kinds.count(kinds[winner]), samples)
        why = answers[0].why
        lost = [tried.failure for tried in answers if tried.failure is not None]
        if len(lost) == samples and not all(map(_may_pass, lost)):
            raise _with(transcript, lost[0])
        added = next((tried.correction() for tried in answers if tried.said.strip()), ())
        question = replace(question, messages=(*question.messages, *added))
    if len(lost) == samples and isinstance(lost[0], ModelUnavailableError):
        raise _with(transcript, lost[0])
    raise _with(transcript, UnusableAnswerError(f"No usable answer in {tries} tries; the last time: {why}"))


class _Tried(Generic[T]):
    """One answer: ``parsed``, or ``why`` it could not be."""

    def __init__(self, parse: Callable[[str], T], answer: Completion | LanguageModelError) -> None:
        self.completion = answer if isinstance(answer, Completion) else Completion("")
        self.failure = answer if isinstance(answer, LanguageModelError) else None
        self.said, self.parsed, self.why = self.completion.text, list[T](), ""
        try:
            if self.failure is not None:
                self.why = str(self.failure)
            elif self.completion.finish == "length":
                self.why = "It was cut off: answer more briefly."
            elif not self.said.strip():
                self.why = "It was empty."
            else:
                self.parsed = [parse(self.said)]
        except RecursionError:
            self.why = "It is nested too deeply."
        except ValueError as error:
            self.why = str(error) or type(error).__name__

    def entry(self, added: Sequence[Message], asked: Request) -> dict[str, Any]:
        """The entry of the transcript for this call."""
        usage = self.completion.usage
        return {
            "prompt": [{**message, "content": _shown(message.get("content"))} for message in added],
            "answer": self.said,
            "rejected": self.why,
            "prompt_tokens": usage.prompt_tokens,
            "completion_tokens": usage.completion_tokens,
            "seconds": round(self.completion.latency, 3),
            "cached": self.completion.cached,
            "seed": asked.seed,
            "temperature": asked.temperature,
        }

    def correction(self) -> tuple[Message, ...]:
        """The message that asks for a correction."""
        said = self.said if len(self.said) <= LONGEST_SHOWN else f"{self.said[:LONGEST_SHOWN]} ..."
        words = f"That answer cannot be used. {self.why}\nAnswer the question again, in the form that was asked for."
        return {"role": "assistant", "content": said}, {"role": "user", "content": words}


def _may_pass(failure: LanguageModelError) -> bool:
    """Whether a retry may succeed: the response was damaged, or broke off."""
    if isinstance(failure, ModelUnavailableError):
        return failure.transient and not failure.status
    return isinstance(failure, MalformedAnswerError)


def _with(transcript: Sequence[Mapping[str, Any]], failure: LanguageModelError) -> LanguageModelError:
    failure.transcript = tuple(transcript)
    return failure


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
