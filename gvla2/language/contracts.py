"""What is asked of a language model and what it answers: requests, completions, failures, the ledger, the protocols."""

from __future__ import annotations

import base64
import threading
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from gvla2.errors import Gvla2Error

Message = Mapping[str, Any]
"""``{"role": "system" | "user" | "assistant", "content": str | parts}``; parts as OpenAI has them: text, images."""


class LanguageModelError(Gvla2Error):
    """Root of the four failures below. ``transcript`` is the conversation so far, if any."""

    transcript: tuple[Mapping[str, Any], ...] = ()


class ModelUnavailableError(LanguageModelError):
    """No answer was received: no network, a time-out, too many requests after all retries, an error of the server."""


class ModelRefusedError(LanguageModelError):
    """The server will not answer such a request: a wrong key, address, model or parameter; ``status`` is HTTP's."""

    def __init__(self, message: str, *, status: int) -> None:
        super().__init__(message)
        self.status = status


class MalformedAnswerError(LanguageModelError):
    """The server answered with something that is not an OpenAI-compatible completion."""


class UnusableAnswerError(LanguageModelError):
    """The model answered every time, but no answer could be used."""


@dataclass(frozen=True)
class Request:
    """One question. Options that a server does not support are left out.

    ``logprobs`` asks for the answer's token probabilities. ``schema`` (JSON Schema) or ``grammar`` (llama.cpp's GBNF)
    constrains the answer; where the server supports grammars, a grammar takes precedence over a schema. The same
    ``seed`` gives the same answer where the server supports it; different seeds are different questions to the cache,
    unless the temperature is 0. ``temperature`` and ``max_tokens`` None take the endpoint's; where those are null,
    neither is sent.
    """

    messages: Sequence[Message]
    logprobs: bool = False
    seed: int | None = None
    temperature: float | None = None
    max_tokens: int | None = None
    schema: Mapping[str, Any] | None = None
    grammar: str | None = None


def picture(png: bytes) -> dict[str, Any]:
    """A part of a message that shows an image to a model that can see."""
    url = f"data:image/png;base64,{base64.b64encode(png).decode()}"
    return {"type": "image_url", "image_url": {"url": url}}


Token = tuple[bytes, Mapping[str, float]]
"""A token's bytes (it may end within a character), and the natural log-probabilities of what the model might have said
in its place, by text, itself included; values may be -inf or NaN if the server sent them."""


@dataclass(frozen=True)
class Completion:
    """What a model answered.

    ``text`` is the answer alone, without what the model thought before. ``tokens`` spell the whole stream, its thoughts
    included; empty when the server gave no log-probabilities. ``metered`` is False where the server did not count
    tokens (the numbers are then 0). ``finish`` is the server's finish reason ("stop", "length"). ``latency`` in
    seconds, with retries; a ``cached`` answer was not asked for again and cost nothing.
    """

    text: str
    tokens: tuple[Token, ...] = ()
    prompt_tokens: int = 0
    completion_tokens: int = 0
    metered: bool = False
    finish: str = ""
    cached: bool = False
    latency: float = 0.0


Tally = Mapping[str, float]
"""``calls``, ``cached`` (answers that cost nothing), ``unmetered`` (calls whose tokens the server did not count),
``failed``, ``prompt_tokens``, ``completion_tokens``, ``seconds``."""

_COUNTED = ("calls", "cached", "unmetered", "failed", "prompt_tokens", "completion_tokens", "seconds")


class Ledger:
    """What models cost, by purpose ("plan", "verify", "induce"); several endpoints and threads may share one."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._tallies: dict[str, Counter[str]] = {}

    def add(self, purpose: str, answer: Completion | None) -> None:
        """Count one call; None is one that failed."""
        counts: dict[str, float] = {"failed": 1}
        if answer is not None and answer.cached:
            counts = {"cached": 1}
        elif answer is not None:
            counts = {
                "calls": 1,
                "unmetered": not answer.metered,
                "prompt_tokens": answer.prompt_tokens,
                "completion_tokens": answer.completion_tokens,
                "seconds": round(answer.latency, 3),
            }
        with self._lock:
            self._tallies.setdefault(purpose, Counter()).update(counts)

    def totals(self, since: Mapping[str, Tally] | None = None) -> dict[str, Tally]:
        """The counts so far, or from an earlier ``totals()`` on; purposes without a call are left out."""
        with self._lock:
            now = {purpose: dict(tally) for purpose, tally in self._tallies.items()}
        found: dict[str, Tally] = {}
        for purpose, tally in now.items():
            before = (since or {}).get(purpose, {})
            counts = {name: round(tally.get(name, 0) - before.get(name, 0), 3) for name in _COUNTED}
            if any(counts.values()):
                found[purpose] = counts
        return found


class LanguageModel(Protocol):
    """The run's ``language`` as planners, verifiers and inducers see it."""

    @property
    def ledger(self) -> Ledger:
        """The calls so far, by purpose."""

    def complete(self, request: Request, *, purpose: str) -> Completion:
        """Ask once, for "plan", "verify", "induce"; raises :class:`LanguageModelError`."""

    def complete_all(
        self, requests: Sequence[Request], *, purpose: str
    ) -> list[Completion | LanguageModelError]:
        """Ask them all at once: an answer or a failure each, in order."""


class Server(Protocol):
    """A server. :class:`EndpointOptions` is one that already runs; others may be started when needed.

    ``model`` is the model's name, "" for the only one; ``identity`` distinguishes servers in the cache.
    """

    model: str
    grammars: bool

    @property
    def identity(self) -> str:
        """Equal for servers that give equal answers."""

    def address(self) -> str:
        """Its ``base_url``; raises :class:`ModelUnavailableError` when it cannot be started."""

    def key(self) -> str:
        """The key, "" for none."""
