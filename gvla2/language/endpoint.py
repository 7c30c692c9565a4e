"""One model at one server, asked from any thread."""

from __future__ import annotations

import asyncio
import importlib.util
import threading
import time
from collections.abc import Coroutine, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from gvla2.errors import MissingDependencyError
from gvla2.language.answers import AnswerCache, digest
from gvla2.language.completion import Completion, read_completion
from gvla2.language.failures import LanguageModelError, ModelRefusedError, ModelUnavailableError
from gvla2.language.ledger import Ledger
from gvla2.language.options import AskingOptions, EndpointOptions
from gvla2.language.request import Request
from gvla2.language.wire import ask, connect, only_model

if TYPE_CHECKING:
    import openai

T = TypeVar("T")

REMEMBERED = 86400.0
"""Seconds for which the cache's folder tells what a server does not take: servers are restarted with other options."""

_UNSUPPORTED = (400, 422, 500)
"""How servers answer a wish or a role that they do not know (500: templates without a system role)."""


class LanguageModel(Protocol):
    """What planners, verifiers and inducers get of the run's ``language``: something that answers."""

    @property
    def ledger(self) -> Ledger:
        """What was asked so far, by purpose."""
        ...

    def complete(self, request: Request, *, purpose: str) -> Completion:
        """Ask once, for "plan", "verify", "induce"; raises :class:`LanguageModelError`."""
        ...

    def complete_all(
        self, requests: Sequence[Request], *, purpose: str
    ) -> list[Completion | LanguageModelError]:
        """Ask them all at once: an answer or a failure each, in order."""
        ...


class Server(Protocol):
    """Who answers. :class:`EndpointOptions` is one that runs already; another may be started when it is needed."""

    model: str
    """The model's name, "" for the only one."""
    grammars: bool

    @property
    def identity(self) -> str:
        """What tells this server from others, in the cache."""
        ...

    def address(self) -> str:
        """Its ``base_url``; raises :class:`ModelUnavailableError` when it cannot be started."""
        ...

    def key(self) -> str:
        """The key, "" for none."""
        ...


class Endpoint:
    """A :class:`LanguageModel` at an OpenAI-compatible server. It keeps no connection: there is nothing to close.

    Raises :class:`ConfigurationError` for options that cannot be or a key that is not set, and
    :class:`MissingDependencyError` without the packages; it does not look for the server yet. An answer's ``text``
    may be empty, when the model spent ``max_tokens`` on reasoning (``finish`` is then "length").
    """

    def __init__(
        self, options: AskingOptions, server: Server | None = None, *, ledger: Ledger | None = None
    ) -> None:
        options.check()
        for package in ("openai", "diskcache"):
            if importlib.util.find_spec(package) is None:
                raise MissingDependencyError(
                    f"the package '{package}'",
                    "Asking a language model",
                    "pip install 'gvla2[llm]'",
                    "Apache-2.0",
                )
        if server is None:
            assert isinstance(options, EndpointOptions), "AskingOptions do not say where the model is"
            server = options
        self._options, self._server, self._ledger = options, server, ledger or Ledger()
        self._key = server.key()
        self._cache = AnswerCache(options.cache) if options.cache else None
        self._free = threading.BoundedSemaphore(options.concurrency)
        self._model, self._without = server.model, self._remembered()

    @property
    def ledger(self) -> Ledger:
        """What was asked so far, by purpose."""
        return self._ledger

    def complete(self, request: Request, *, purpose: str) -> Completion:
        """Ask once. Raises :class:`LanguageModelError`."""
        (answer,) = self.complete_all([request], purpose=purpose)
        if isinstance(answer, LanguageModelError):
            raise answer
        return answer

    def complete_all(
        self, requests: Sequence[Request], *, purpose: str
    ) -> list[Completion | LanguageModelError]:
        """Ask them all at once, within the bound on concurrency: an answer or a failure each, in order."""
        try:
            keys = [self._key_of(request) for request in requests]
        except LanguageModelError as error:
            return [error for _ in requests]
        answers: dict[int, Completion | LanguageModelError] = {
            i: kept for i, key in enumerate(keys) if (kept := self._kept(key, requests[i]))
        }
        fresh = [i for i in range(len(requests)) if i not in answers]
        if fresh:
            asked = [(requests[i], keys[i]) for i in fresh]
            answers |= dict(zip(fresh, _run(self._ask_all(asked, purpose)), strict=True))
        for answer in answers.values():
            if isinstance(answer, Completion) and answer.cached:
                self._ledger.add(purpose, answer)
        return [answers[i] for i in range(len(requests))]

    def model(self) -> str:
        """The model's name: the option, or else what the server lists. Raises :class:`LanguageModelError`."""
        if not self._model:
            self._model = _run(self._list())
        return self._model

    async def _list(self) -> str:
        async with connect(self._server.address(), self._key, self._options) as client:
            return await only_model(client, self._options)

    async def _ask_all(
        self, asked: Sequence[tuple[Request, str]], purpose: str
    ) -> list[Completion | LanguageModelError]:
        try:
            address = self._server.address()
        except LanguageModelError as error:
            return [error for _ in asked]
        async with connect(address, self._key, self._options) as client:
            return await asyncio.gather(*(self._timed(client, each, purpose) for each in asked))

    async def _timed(
        self, client: openai.AsyncOpenAI, asked: tuple[Request, str], purpose: str
    ) -> Completion | LanguageModelError:
        # The bound holds over all threads, each with a loop of its own, so no asyncio semaphore can keep it.
        while not self._free.acquire(blocking=False):
            await asyncio.sleep(0.005)
        began = time.monotonic()
        try:
            answer: Completion | LanguageModelError = await self._ask(client, *asked)
        except LanguageModelError as error:
            answer = error
        finally:
            self._free.release()
        seconds = time.monotonic() - began
        self._ledger.add(purpose, answer if isinstance(answer, Completion) else None, seconds)
        return replace(answer, latency=seconds) if isinstance(answer, Completion) else answer

    async def _ask(self, client: openai.AsyncOpenAI, request: Request, key: str) -> Completion:
        without = self._without
        try:
            document = await self._send(client, request, without)
        except (ModelRefusedError, ModelUnavailableError) as refusal:
            if refusal.status not in _UNSUPPORTED:
                raise
            without, document = await self._concede(client, request, refusal)
        answer = self._read(document, request, without)
        if self._cache and answer.text:
            self._cache.put(key, {"without": sorted(without), "answer": document})
        return answer

    async def _concede(
        self, client: openai.AsyncOpenAI, request: Request, refusal: LanguageModelError
    ) -> tuple[frozenset[str], dict[str, Any]]:
        """Ask for less until the server takes it, and remember what it does not; its refusal where nothing helps."""
        for without in request.concessions(self._without, grammars=self._server.grammars):
            try:
                document = await self._send(client, request, without)
            except (ModelRefusedError, ModelUnavailableError) as error:
                if error.status not in _UNSUPPORTED:
                    raise
                continue
            self._without |= without
            if self._cache:
                self._cache.put(self._about(), {"at": time.time(), "without": sorted(self._without)})
            return without, document
        raise refusal

    async def _send(
        self, client: openai.AsyncOpenAI, request: Request, without: frozenset[str]
    ) -> dict[str, Any]:
        body = request.body(self._options, without, grammars=self._server.grammars)
        return await ask(client, self._options, {"model": self._model, **body})

    def _read(
        self, document: dict[str, Any], request: Request, without: frozenset[str], *, cached: bool = False
    ) -> Completion:
        answer = read_completion(document, cached=cached)
        unmet = set(request.unmet(without, grammars=self._server.grammars))
        if request.logprobs and not answer.tokens:
            unmet.add("logprobs")
        return replace(answer, unmet=tuple(sorted(unmet)))

    def _kept(self, key: str, request: Request) -> Completion | None:
        """A kept answer; what was kept and makes no sense is asked for anew."""
        match self._cache.get(key) if self._cache else None:
            case {"without": [*without], "answer": dict(document)}:
                try:
                    return self._read(document, request, frozenset(map(str, without)), cached=True)
                except LanguageModelError:
                    return None
        return None

    def _remembered(self) -> frozenset[str]:
        match self._cache.get(self._about()) if self._cache else None:
            case {"at": int() | float() as at, "without": [*without]} if abs(time.time() - at) < REMEMBERED:
                return frozenset(map(str, without))
        return frozenset()

    def _about(self) -> str:
        return digest({"unsupported by": self._server.identity, "model": self._server.model})

    def _key_of(self, request: Request) -> str:
        body = request.body(self._options, frozenset(), grammars=True)
        schema = dict(request.schema) if request.schema else None
        about = {"server": self._server.identity, "model": self.model(), "extra": self._options.extra}
        return digest({**about, **body, "schema": schema, "heeded": self._server.grammars})


def _run(work: Coroutine[Any, Any, T]) -> T:
    """Run to the end in this thread, or in one of its own where a loop runs here already (a notebook)."""
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        return asyncio.run(work)
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(asyncio.run, work).result()
