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
_UNKNOWN, _BROKEN = (400, 422), 500
"""Statuses of servers that do not know an option, or whose template fails on a system role."""


class LanguageModel(Protocol):
    """The run's ``language`` as planners, verifiers and inducers see it."""

    @property
    def ledger(self) -> Ledger:
        """The calls so far, by purpose."""
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
    """A server. :class:`EndpointOptions` is one that already runs; others may be started when needed.

    ``model`` is the model's name, "" for the only one; ``identity`` distinguishes servers in the cache.
    """

    model: str
    grammars: bool

    @property
    def identity(self) -> str:
        """Equal for servers that give equal answers."""
        ...

    def address(self) -> str:
        """Its ``base_url``; raises :class:`ModelUnavailableError` when it cannot be started."""
        ...

    def key(self) -> str:
        """The key, "" for none."""
        ...


class Endpoint:
    """A :class:`LanguageModel` at an OpenAI-compatible server. It keeps no connection: there is nothing to close.

    Raises :class:`ConfigurationError` for invalid options or a key that is not set, and :class:`MissingDependencyError`
    without the packages; it does not contact the server yet. An option that the server refuses is not requested again.
    An answer's ``text`` may be empty, when the model spent ``max_tokens`` on reasoning (``finish`` is then "length").
    """

    def __init__(self, options: AskingOptions, server: Server | None = None) -> None:
        options.check()
        for package in ("openai", "diskcache"):
            if importlib.util.find_spec(package) is None:
                what = f"the package '{package}'"
                raise MissingDependencyError(what, "Asking a language model", "pip install 'gvla2[llm]'")
        if server is None:
            assert isinstance(options, EndpointOptions), "AskingOptions do not say where the model is"
            server = options
        self._options, self._server, self._ledger = options, server, Ledger()
        self._key = server.key()
        self._cache = AnswerCache(options.cache) if options.cache else None
        self._free = threading.BoundedSemaphore(options.concurrency)
        self._model, self._without = server.model, frozenset[str]()

    @property
    def ledger(self) -> Ledger:
        """The calls so far, by purpose."""
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
        answers: dict[int, Completion | LanguageModelError] = {}
        try:
            keys = [self._key_of(request) for request in requests]
            answers |= {i: kept for i, key in enumerate(keys) if (kept := self._kept(key, requests[i]))}
            fresh = [i for i in range(len(requests)) if i not in answers]
            if fresh:
                asked = _run(self._ask_all([(requests[i], keys[i]) for i in fresh]))
                answers |= dict(zip(fresh, asked, strict=True))
        except LanguageModelError as error:
            answers |= {i: error for i in range(len(requests)) if i not in answers}
        for answer in answers.values():
            self._ledger.add(purpose, answer if isinstance(answer, Completion) else None)
        return [answers[i] for i in range(len(requests))]

    def model(self) -> str:
        """The model's name: the option, or else what the server lists. Raises :class:`LanguageModelError`."""
        if not self._model:
            self._model = _run(self._list())
        return self._model

    async def _list(self) -> str:
        async with connect(self._server.address(), self._key, self._options) as client:
            return await only_model(client, self._options)

    async def _ask_all(self, asked: Sequence[tuple[Request, str]]) -> list[Completion | LanguageModelError]:
        address = self._server.address()
        answers = await self._ask_at(address, asked)
        lost = [i for i, a in enumerate(answers) if isinstance(a, ModelUnavailableError) and not a.reached]
        # A server of ours that stopped just after it was found is restarted at another address.
        if lost and (moved := self._server.address()) != address:
            for i, answer in zip(lost, await self._ask_at(moved, [asked[i] for i in lost]), strict=True):
                answers[i] = answer
        return answers

    async def _ask_at(
        self, address: str, asked: Sequence[tuple[Request, str]]
    ) -> list[Completion | LanguageModelError]:
        async with connect(address, self._key, self._options) as client:
            return await asyncio.gather(*(self._in_turn(client, *each) for each in asked))

    async def _in_turn(
        self, client: openai.AsyncOpenAI, request: Request, key: str
    ) -> Completion | LanguageModelError:
        # The bound holds over all threads, each with a loop of its own, so no asyncio semaphore can keep it.
        while not self._free.acquire(blocking=False):
            await asyncio.sleep(0.005)
        began = time.monotonic()
        try:
            document, without = await self._ask(client, request)
            answer = self._read(document, request, without)
        except LanguageModelError as error:
            return error
        finally:
            self._free.release()
        if self._cache and answer.text:
            self._cache.put(key, {"answer": document, "without": sorted(without)})
        return replace(answer, latency=time.monotonic() - began)

    async def _ask(
        self, client: openai.AsyncOpenAI, request: Request
    ) -> tuple[dict[str, Any], frozenset[str]]:
        """The answer's JSON, and the options left out: one after another, while the server refuses."""
        known = self._without
        wishes = [wish for wish in request.wishes(grammars=self._server.grammars) if wish not in known]
        first: ModelRefusedError | ModelUnavailableError | None = None
        for less in ([], *([wish] for wish in wishes), *([wishes] if len(wishes) > 1 else [])):
            if first is not None and first.status == _BROKEN and less != ["system_role"]:
                continue
            without = known.union(less)
            body = request.body(self._options, without, grammars=self._server.grammars)
            try:
                document = await ask(client, self._options, {"model": self._model, **body})
            except (ModelRefusedError, ModelUnavailableError) as error:
                if error.status not in (*_UNKNOWN, _BROKEN):
                    raise
                first = first or error
                continue
            self._without |= without
            return document, without
        assert first is not None
        raise first

    def _read(
        self, document: Any, request: Request, without: frozenset[str], *, cached: bool = False
    ) -> Completion:
        answer = read_completion(document, cached=cached)
        unmet = set(without).intersection(request.wishes(grammars=self._server.grammars)) - {"alternatives"}
        if request.logprobs and not answer.tokens:
            unmet.add("logprobs")
        if request.grammar and not self._server.grammars:
            unmet.add("grammar")
        return replace(answer, unmet=tuple(sorted(unmet)))

    def _kept(self, key: str, request: Request) -> Completion | None:
        """A cached answer; an invalid one is requested again."""
        kept = (self._cache.get(key) if self._cache else None) or {}
        try:
            return self._read(kept["answer"], request, frozenset(kept["without"]), cached=True)
        except (LanguageModelError, KeyError, TypeError):
            return None

    def _key_of(self, request: Request) -> str:
        body = request.body(self._options, frozenset(), grammars=False)
        if body.get("temperature") == 0:  # the likeliest words, whatever the seed
            body.pop("seed", None)
        about = {"server": self._server.identity, "model": self.model(), "extra": self._options.extra}
        return digest({**about, **body, "grammar": [request.grammar, self._server.grammars]})


def _run(work: Coroutine[Any, Any, T]) -> T:
    """Run to completion in this thread, or in a new one if a loop already runs here (a notebook)."""
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        return asyncio.run(work)
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(asyncio.run, work).result()
