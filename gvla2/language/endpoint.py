"""One model at one OpenAI-compatible server, asked from any thread: over HTTP by ``openai``, kept by ``diskcache``."""

from __future__ import annotations

import asyncio
import hashlib
import importlib.util
import json
import logging
import math
import re
import sqlite3
import time
from collections.abc import Callable, Collection, Coroutine, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar
from urllib.parse import urlsplit

from gvla2.errors import MissingDependencyError
from gvla2.language.contracts import (
    Completion,
    LanguageModelError,
    Ledger,
    MalformedAnswerError,
    ModelRefusedError,
    ModelUnavailableError,
    Request,
    Server,
    Token,
)
from gvla2.language.options import AskingOptions, EndpointOptions

if TYPE_CHECKING:
    import openai

T = TypeVar("T")
_log = logging.getLogger(__name__)
_UNKNOWN = (400, 422)
"""Statuses of servers that do not know an option."""
_OPTIONAL = {"logprobs", "top_logprobs", "response_format"}
"""What a request can do without."""
_BUSY = (408, 409, 429)
"""Transient refusals, like every 5xx; the package retries them."""
_ADVICE = {
    401: "The key is missing or wrong: check api_key_env and the variable it names.",
    403: "The key does not allow this: check the account's rights and api_key_env.",
    404: "Check base_url (it usually ends in /v1) and model.",
    413: "The request is too long for the server: shorten what is asked about.",
}


MOST_BYTES = 32 << 20
"""The longest answer that is read: a hostile server could fill the memory."""
TOP_LOGPROBS = 20
"""The most alternatives per token that the API allows."""


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
        self.ledger = Ledger()
        self._options, self._server, self._key = options, server, server.key()
        self._spelled = _spellings_of(self._key) if self._key else None
        self._cache = str(Path(options.cache).expanduser()) if options.cache else ""
        self._model, self._refused = server.model, set[str]()

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
            answers = _run(self._ask_all(requests)) if requests else []
        except LanguageModelError as error:
            answers = [error] * len(requests)
        for answer in answers:
            self.ledger.add(purpose, answer if isinstance(answer, Completion) else None)
        return answers

    async def _ask_all(self, requests: Sequence[Request]) -> list[Completion | LanguageModelError]:
        if not self._model:
            async with self._client() as client:
                self._model = await self._only_model(client)
        keys = [self._key_of(request) for request in requests]
        answers: list[Completion | LanguageModelError | None] = [self._kept(key) for key in keys]
        fresh = [i for i, answer in enumerate(answers) if answer is None]
        if fresh:
            turn = asyncio.Semaphore(self._options.concurrency)
            async with self._client() as client:
                work = (self._in_turn(turn, client, requests[i], keys[i]) for i in fresh)
                asked = await asyncio.gather(*work)
            for i, answer in zip(fresh, asked, strict=True):
                answers[i] = answer
        return [answer for answer in answers if answer is not None]

    def _client(self) -> openai.AsyncOpenAI:
        """A client to be used as an async context; the server starts now if it is ours."""
        import openai

        address = self._server.address()
        # The package insists on a key; servers without keys take any word. Its time-outs are for each read: a server
        # that drips bytes would never meet them, so _sent() keeps the deadline. No proxy stands before this machine.
        here = urlsplit(address).hostname in ("127.0.0.1", "::1", "localhost")
        return openai.AsyncOpenAI(
            base_url=address,
            api_key=self._key or "none",
            timeout=None,
            max_retries=self._options.retries,
            http_client=_bounded_client(trust_env=not here),
        )

    async def _only_model(self, client: openai.AsyncOpenAI) -> str:
        """The model that the server lists; raises :class:`ModelRefusedError` unless it lists exactly one."""
        listed = (await self._sent(client, client.models.with_raw_response.list)).get("data")
        names = [str(m["id"]) for m in listed or () if isinstance(m, dict) and "id" in m]
        if len(names) != 1:
            some = f"{len(names)} models ({', '.join(names[:8]) or 'none'})"
            raise ModelRefusedError(
                f"{client.base_url} lists {some}: choose one with the option model.", status=200
            )
        return names[0]

    async def _in_turn(
        self, turn: asyncio.Semaphore, client: openai.AsyncOpenAI, request: Request, key: str
    ) -> Completion | LanguageModelError:
        async with turn:
            began = time.monotonic()
            try:
                document = await self._ask(client, request)
                answer = read_completion(document)
            except LanguageModelError as error:
                return error
        if answer.text:
            self._use_cache(lambda cache: cache.set(key, json.dumps(document)))
        return replace(answer, latency=time.monotonic() - began)

    async def _ask(self, client: openai.AsyncOpenAI, request: Request) -> dict[str, Any]:
        """The answer's JSON. A schema, log-probabilities or a seed that the server refuses is left out from now on."""
        body = request_body(request, self._options, grammars=self._server.grammars) | self._options.extra
        for name in self._refused:
            body.pop(name, None)

        async def sent(without: Collection[str] = ()) -> dict[str, Any]:
            # The package sends extra_body as it is, and checks nothing in it.
            extra = {name: value for name, value in body.items() if name not in without}
            create = client.chat.completions.with_raw_response.create
            return await self._sent(
                client, create, model=self._model, messages=body["messages"], extra_body=extra
            )

        without: set[str] = set()
        first: ModelRefusedError | None = None
        while True:
            try:
                document = await sent(without)
            except ModelRefusedError as error:
                first, left = first or error, body.keys() - without
                named = {"seed"} & left if "seed" in str(error) else set[str]()
                optional = named or _OPTIONAL & left
                if error.status not in _UNKNOWN or not optional:
                    raise first from None
                without |= optional
            else:
                self._refused |= without
                return document

    async def _sent(self, client: openai.AsyncOpenAI, send: Any, **asked: Any) -> dict[str, Any]:
        """The JSON that answers a request. What the server says, in an answer or an error, never holds the key.

        Raises :class:`ModelUnavailableError`, :class:`ModelRefusedError` or :class:`MalformedAnswerError`.
        """
        import openai

        where = client.base_url
        try:
            async with asyncio.timeout(self._options.timeout):
                received = (await send(**asked)).http_response.content
        except TimeoutError as error:
            message = f"{where} did not answer within {self._options.timeout:g} s. Raise timeout, or lower max_tokens"
            raise ModelUnavailableError(f"{message} or concurrency.") from error
        except openai.APIStatusError as error:
            raise self._status_failure(where, error) from None
        except openai.APIConnectionError as error:
            cause = error.__cause__ or error
            message = f"{where} cannot be reached or broke off ({type(cause).__name__}: {cause})."
            raise ModelUnavailableError(f"{message} Is a server running there?") from error
        try:
            answer = self._redacted(json.loads(received.decode(errors="replace")))
        except (ValueError, RecursionError) as error:
            message = f"{where} answered with {len(received)} bytes that are not JSON ({error})."
            raise MalformedAnswerError(f"{message} Check base_url: it usually ends in /v1.") from error
        if not isinstance(answer, dict):
            raise MalformedAnswerError(f"{where} answered with JSON that is not an object.")
        return answer

    def _status_failure(
        self, where: object, error: openai.APIStatusError
    ) -> ModelUnavailableError | ModelRefusedError:
        body = error.body
        message = (body.get("message") or body.get("detail")) if isinstance(body, Mapping) else body
        status = error.status_code
        said = self._redacted(" ".join(str(message or error.message).split()))[:300]
        if status in _BUSY or status >= 500:
            return ModelUnavailableError(f"{where} answered with status {status}: {said}")
        advice = _ADVICE.get(status, "Check model and extra against what this server supports.")
        message = f"{where} refused the request with status {status}: {said}. {advice}"
        return ModelRefusedError(message, status=status)

    def _redacted(self, said: Any) -> Any:
        """Text or JSON without the key, however its characters are escaped."""
        if isinstance(said, str):
            return self._spelled.sub("[key]", said) if self._spelled else said
        if isinstance(said, dict):
            return {self._redacted(name): self._redacted(value) for name, value in said.items()}
        return [self._redacted(value) for value in said] if isinstance(said, list) else said

    def _kept(self, key: str) -> Completion | None:
        """A cached answer; a damaged one is requested again."""
        try:
            return read_completion(json.loads(self._use_cache(lambda cache: cache.get(key))), cached=True)
        except (TypeError, ValueError, RecursionError, MalformedAnswerError):
            return None

    def _use_cache(self, work: Callable[[Any], Any]) -> Any:
        """Work on the folder of answers, which processes may share (beyond 1 GB the oldest are dropped).

        If it is not writable, answers are not cached, but no call fails.
        """
        if not self._cache:
            return None
        import diskcache

        try:
            # Opened for each use, as threads come and go; syncing to disk would cost 20 ms at each close.
            with diskcache.Cache(self._cache, sqlite_synchronous=0) as cache:
                return work(cache)
        except (OSError, sqlite3.Error, diskcache.Timeout) as error:
            _log.warning("Answers of language models are not cached in %s: %s", self._cache, error)
            self._cache = ""
            return None

    def _key_of(self, request: Request) -> str:
        """The key of a request in the cache: the same for equal JSON, whatever the order of its keys."""
        body = request_body(request, self._options, grammars=False)
        if body.get("temperature") == 0:  # the likeliest words, whatever the seed
            body.pop("seed", None)
        about = {"server": self._server.identity, "model": self._model, "extra": self._options.extra}
        asked = {**about, **body, "grammar": [request.grammar, self._server.grammars]}
        text = json.dumps(asked, sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode("ascii")).hexdigest()


def _run(work: Coroutine[Any, Any, T]) -> T:
    """Run to completion in this thread, or in a new one if a loop already runs here (a notebook)."""
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        return asyncio.run(work)
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(asyncio.run, work).result()


def _bounded_client(*, trust_env: bool) -> Any:
    """The package's HTTP client, but that it reads no more than :data:`MOST_BYTES` of an answer."""
    import openai

    class Bounded(openai.DefaultAsyncHttpxClient):
        """A client whose answers are in memory, and bounded."""

        async def send(self, request: Any, **options: Any) -> Any:
            """Send a request; raises :class:`MalformedAnswerError` for an answer that is too long."""
            response, body = await super().send(request, **options | {"stream": True}), bytearray()
            try:
                async for (
                    some
                ) in response.aiter_bytes():  # decompressed: a small answer may unpack to a large one
                    body += some
                    if len(body) > MOST_BYTES:
                        raise MalformedAnswerError(
                            f"{request.url} sent an answer longer than {MOST_BYTES >> 20} MB."
                        )
            finally:
                await response.aclose()
            coded = ("content-encoding", "content-length", "transfer-encoding")
            headers = [pair for pair in response.headers.multi_items() if pair[0].lower() not in coded]
            return type(response)(response.status_code, headers=headers, content=bytes(body), request=request)

    return Bounded(trust_env=trust_env)


def _spellings_of(key: str) -> re.Pattern[str]:
    """A key in text that escapes characters as JSON, addresses or HTML do, any number of times."""
    spelled = (
        rf"(?:\\*{re.escape(c)}|\\+u00{ord(c):02x}|%{ord(c):02x}|&#(?:x0*{ord(c):x}|0*{ord(c)});)"
        for c in key
    )
    return re.compile("".join(spelled), re.IGNORECASE)


def request_body(request: Request, options: AskingOptions, *, grammars: bool) -> dict[str, Any]:
    """The request's JSON but for the model and the server's own options."""
    body: dict[str, Any] = {"messages": _sendable(request.messages), "seed": request.seed}
    for name in ("temperature", "max_tokens"):
        own, default = getattr(request, name), getattr(options, name)
        body[name] = own if own is not None and default is not None else default
    if request.logprobs:
        body |= {"logprobs": True, "top_logprobs": TOP_LOGPROBS}
    if request.grammar is not None and grammars:
        body["grammar"] = request.grammar
    elif request.schema is not None:
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
        _, closed, answer = content.rpartition("</think>")
    except (AttributeError, KeyError, IndexError, TypeError) as error:
        message = f"The server's answer is no completion ({type(error).__name__}: {error})."
        raise MalformedAnswerError(message) from None
    if not closed and answer.lstrip().startswith("<think>"):
        answer = ""
    counts: Any = body.get("usage") if isinstance(body.get("usage"), Mapping) else {}
    asked, said = counts.get("prompt_tokens"), counts.get("completion_tokens")
    metered = all(type(number) is int and number >= 0 for number in (asked, said))
    return Completion(
        answer.strip() if closed else answer,
        _tokens(choice.get("logprobs")),
        prompt_tokens=int(asked) if metered else 0,
        completion_tokens=int(said) if metered else 0,
        metered=metered,
        finish=str(choice.get("finish_reason") or ""),
        cached=cached,
    )


def _tokens(logprobs: Any) -> tuple[Token, ...]:
    """The stream's tokens; none when an entry is damaged."""
    found = []
    try:
        for entry in logprobs["content"]:
            odds: dict[str, float] = {}
            # Some servers leave the chosen token out of the list, some list a token twice: the first one counts.
            for one in (entry, *(entry.get("top_logprobs") or ())):
                value = one.get("logprob")
                number = float(value) if isinstance(value, int | float) else math.nan
                odds.setdefault(_spelling(one).decode(errors="replace"), number)
            found.append((_spelling(entry), odds))
    except (AttributeError, KeyError, TypeError, ValueError):
        return ()
    return tuple(found)


def _spelling(entry: Mapping[str, Any]) -> bytes:
    """The token's bytes, else its text, with raw vocabularies' space markers as spaces."""
    if entry.get("bytes") is not None:
        return bytes(entry["bytes"])
    text: str = entry["token"].replace("▁", " ").replace("Ġ", " ").replace("Ċ", "\n")
    return text.encode(errors="replace")
