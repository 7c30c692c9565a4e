"""One model at one server, asked from any thread."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Coroutine, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

from gvla2.language.cache import AnswerCache, digest
from gvla2.language.capabilities import MOST_ALTERNATIVES, Capabilities, probe, without_system
from gvla2.language.completion import Completion, Message, read_completion
from gvla2.language.failures import LanguageModelError
from gvla2.language.ledger import Ledger, Purpose
from gvla2.language.options import EndpointOptions
from gvla2.language.wire import connect, only_model, post, require_sdk

if TYPE_CHECKING:
    import openai

T = TypeVar("T")

REMEMBERED = 86400.0
"""Seconds for which a probe in the cache's folder holds: servers are restarted with other options."""


@dataclass(frozen=True)
class Request:
    """One question. ``logprobs`` asks for the answer's token probabilities, which a server may not give.

    The same ``seed`` gives the same answer where the server supports it; different seeds are different questions
    to the cache. ``temperature`` and ``max_tokens`` None take the endpoint's.
    """

    messages: Sequence[Message]
    logprobs: bool = False
    seed: int | None = None
    temperature: float | None = None
    max_tokens: int | None = None


class Endpoint:
    """A model that can be asked. It keeps no connection, so there is nothing to close.

    Raises :class:`ConfigurationError` for options that cannot be or a key that is not set, and
    :class:`MissingDependencyError` without the SDK; it does not look for the server yet. ``ledger`` counts the
    tokens; give one to several endpoints to count them together.
    """

    def __init__(self, options: EndpointOptions, *, ledger: Ledger | None = None) -> None:
        options.check()
        require_sdk()
        self.options = options
        self.ledger = ledger or Ledger()
        self._key = options.api_key()
        self._cache = AnswerCache(options.cache) if options.cache else None
        self._free = threading.BoundedSemaphore(options.concurrency)
        self._learning = threading.Lock()
        self._model = options.model
        self._capabilities: Capabilities | None = None

    def complete(
        self,
        messages: Sequence[Message],
        *,
        logprobs: bool = False,
        seed: int | None = None,
        temperature: float | None = None,
        max_tokens: int | None = None,
        purpose: Purpose = "extra",
    ) -> Completion:
        """Ask once. Raises :class:`LanguageModelError` (one of its three kinds).

        The answer's ``text`` may be empty, when the model spent ``max_tokens`` on reasoning (``finish`` is then
        "length").
        """
        request = Request(messages, logprobs, seed, temperature, max_tokens)
        (answer,) = self.complete_all([request], purpose=purpose)
        if isinstance(answer, LanguageModelError):
            raise answer
        return answer

    def complete_all(
        self, requests: Sequence[Request], *, purpose: Purpose = "extra"
    ) -> list[Completion | LanguageModelError]:
        """Ask them all at once, within the bound on concurrency: an answer or a failure each, in order."""
        try:
            self.model()
        except LanguageModelError as error:
            return [error for _ in requests]
        keys = [self._key_of(request) for request in requests]
        answers: list[Completion | LanguageModelError | None] = [self._kept(key, purpose) for key in keys]
        open_ = [i for i, answer in enumerate(answers) if answer is None]
        if open_:
            try:
                able = self.capabilities()
            except LanguageModelError as error:
                fresh: list[Completion | LanguageModelError] = [error] * len(open_)
            else:
                fresh = _run(self._ask_all([(requests[i], keys[i]) for i in open_], able, purpose))
            for i, answer in zip(open_, fresh, strict=True):
                answers[i] = answer
        return [answer for answer in answers if answer is not None]

    def model(self) -> str:
        """The model's name: the option, or else what the server lists; asked once.

        Raises :class:`LanguageModelError` when the server cannot be asked or lists not exactly one.
        """
        with self._learning:
            if not self._model:
                self._model = _run(self._list())
            return self._model

    def capabilities(self) -> Capabilities:
        """What the server and model can do; asked once, then remembered (for a day in the cache's folder too).

        Raises :class:`LanguageModelError` when it cannot be found out; the next call tries again.
        """
        self.model()
        with self._learning:
            if self._capabilities is None:
                key = digest({"probe": self._identity()})
                kept = (self._cache.get(key) if self._cache else None) or {}
                at = kept.get("at")
                if isinstance(at, int | float) and abs(time.time() - at) < REMEMBERED:
                    self._capabilities = Capabilities.from_json(kept)
                if self._capabilities is None:
                    self._capabilities = _run(self._probe())
                    if self._cache:
                        self._cache.put(key, {"at": time.time(), **self._capabilities.to_json()})
            return self._capabilities

    @property
    def problem(self) -> str:
        """Why answers are not kept in the cache, "" when they are or were not meant to be."""
        return self._cache.problem if self._cache else ""

    def _kept(self, key: str, purpose: Purpose) -> Completion | None:
        """A kept answer; what was kept and makes no sense is asked for anew."""
        body = self._cache.get(key) if self._cache else None
        if body is None:
            return None
        try:
            answer = read_completion(body, cached=True)
        except LanguageModelError:
            return None
        self.ledger.add(purpose, 0, 0, cached=True)
        return answer

    async def _list(self) -> str:
        async with connect(self.options, self._key) as client:
            return await only_model(client, self.options)

    async def _probe(self) -> Capabilities:
        async with connect(self.options, self._key) as client:

            async def ask(wanted: dict[str, Any]) -> dict[str, Any]:
                unsent = {k for k in ("temperature", "max_tokens") if getattr(self.options, k) is None}
                full = {"model": self._model, "temperature": 0.0, **wanted}
                body, _ = await self._send(client, {k: v for k, v in full.items() if k not in unsent})
                usage = read_completion(body).usage
                self.ledger.add("extra", usage.prompt_tokens, usage.completion_tokens, metered=usage.metered)
                return body

            return await probe(ask)

    async def _ask_all(
        self, asked: Sequence[tuple[Request, str]], able: Capabilities, purpose: Purpose
    ) -> list[Completion | LanguageModelError]:
        async with connect(self.options, self._key) as client:
            return await asyncio.gather(*(self._ask(client, r, key, able, purpose) for r, key in asked))

    async def _ask(
        self, client: openai.AsyncOpenAI, request: Request, key: str, able: Capabilities, purpose: Purpose
    ) -> Completion | LanguageModelError:
        body = self._asked(request)
        if not able.system_role:
            body["messages"] = without_system(body["messages"])
        if request.logprobs and able.logprobs:
            body |= {"logprobs": True, "top_logprobs": min(able.top_logprobs, MOST_ALTERNATIVES)}
        try:
            response, latency = await self._send(client, {"model": self._model, **body})
            answer = read_completion(response, latency=latency)
        except LanguageModelError as error:
            return error
        usage = answer.usage
        self.ledger.add(purpose, usage.prompt_tokens, usage.completion_tokens, metered=usage.metered)
        if self._cache and answer.text:
            self._cache.put(key, response)
        return answer

    async def _send(
        self, client: openai.AsyncOpenAI, body: Mapping[str, Any]
    ) -> tuple[dict[str, Any], float]:
        # The bound holds over all threads, each with a loop of its own, so no asyncio semaphore can keep it.
        while not self._free.acquire(blocking=False):
            await asyncio.sleep(0.005)
        try:
            return await post(client, self.options, body)
        finally:
            self._free.release()

    def _asked(self, request: Request) -> dict[str, Any]:
        options = self.options
        body: dict[str, Any] = {
            "messages": [{k: _sendable(v) for k, v in m.items()} for m in request.messages],
            "temperature": options.temperature if request.temperature is None else request.temperature,
            "max_tokens": options.max_tokens if request.max_tokens is None else request.max_tokens,
            "seed": request.seed,
        }
        return {name: value for name, value in body.items() if value is not None}

    def _identity(self) -> dict[str, Any]:
        return {
            "url": self.options.base_url.rstrip("/"),
            "model": self._model,
            "extra": self.options.extra,
        }

    def _key_of(self, request: Request) -> str:
        return digest({**self._identity(), **self._asked(request), "logprobs": request.logprobs})


def _sendable(value: object) -> object:
    """Text that UTF-8 can carry: halves of characters, as damaged logs have them, become question marks."""
    return value.encode(errors="replace").decode() if isinstance(value, str) else value


def _run(work: Coroutine[Any, Any, T]) -> T:
    """Run to the end in this thread, or in one of its own where a loop runs here already (a notebook)."""
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        return asyncio.run(work)
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(asyncio.run, work).result()
