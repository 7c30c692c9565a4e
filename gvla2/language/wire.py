"""One request over HTTP: a true deadline, retries that honour the server's wishes, failures by their kind."""

from __future__ import annotations

import asyncio
import itertools
import json
import math
import random
import time
from collections.abc import Callable, Mapping
from contextlib import AbstractAsyncContextManager
from email.utils import parsedate_to_datetime
from typing import TYPE_CHECKING, Any

from gvla2.errors import MissingDependencyError
from gvla2.language.failures import MalformedAnswerError, ModelRefusedError, ModelUnavailableError
from gvla2.language.options import EndpointOptions

if TYPE_CHECKING:
    import openai

LARGEST_ANSWER = 32 * 2**20
"""Bytes of one response that are read at most; an answer of 100,000 tokens with log-probabilities is half of it."""

_BUSY = (408, 409, 425, 429)
"""Refusals that pass by themselves, like every 5xx."""

_ADVICE = {
    401: "The key is missing or wrong: check api_key_env and the variable it names.",
    403: "The key does not allow this: check the account's rights and api_key_env.",
    404: "Check base_url (it usually ends in /v1) and model.",
    413: "The request is too long for the server: shorten what is asked about.",
}


def require_sdk() -> None:
    """Raise :class:`MissingDependencyError` unless the SDK is installed."""
    try:
        import openai  # noqa: F401
    except ImportError as error:
        raise MissingDependencyError(
            "the package 'openai'", "Asking a language model", "pip install 'gvla2[llm]'", "Apache-2.0"
        ) from error


def connect(options: EndpointOptions, key: str) -> openai.AsyncOpenAI:
    """A client to be used as an async context. It retries nothing itself: :func:`post` does."""
    import openai

    # The SDK insists on a key; servers without keys take any word.
    return openai.AsyncOpenAI(
        base_url=options.base_url, api_key=key or "none", timeout=options.timeout, max_retries=0
    )


async def post(
    client: openai.AsyncOpenAI, options: EndpointOptions, body: Mapping[str, Any]
) -> tuple[dict[str, Any], float]:
    """The response's JSON and the seconds it took, retries included.

    Raises :class:`ModelUnavailableError`, :class:`ModelRefusedError` or :class:`MalformedAnswerError`.
    """
    began = time.monotonic()
    extra = dict(options.extra) or None
    create = client.chat.completions.with_streaming_response.create
    answer = await _persistently(options, lambda: create(**body, extra_body=extra))
    return answer, time.monotonic() - began


async def only_model(client: openai.AsyncOpenAI, options: EndpointOptions) -> str:
    """The model that the server lists; raises :class:`ModelRefusedError` unless it lists exactly one."""
    answer = await _persistently(options, client.models.with_streaming_response.list)
    listed = answer.get("data")
    names = [m["id"] for m in listed if isinstance(m, dict) and "id" in m] if isinstance(listed, list) else []
    if len(names) != 1:
        some = ", ".join(map(str, names[:8])) or "none"
        raise ModelRefusedError(
            f"{options.shown_url} lists {len(names)} models ({some}): choose one with the option model.",
            status=200,
        )
    return str(names[0])


Opening = Callable[[], "AbstractAsyncContextManager[openai.AsyncAPIResponse[Any]]"]
"""Starts one request; what it opens is the response, unread."""


async def _persistently(options: EndpointOptions, opening: Opening) -> dict[str, Any]:
    for attempt in itertools.count():
        try:
            return await _once(options, opening)
        except ModelUnavailableError as error:
            if attempt >= options.retries or not error.transient:
                raise
            wait = error.retry_after
            if wait is None:  # jitter, so that many callers do not come back at once
                wait = options.backoff * 2**attempt * (0.5 + random.random())
            if wait > options.longest_wait:
                raise
            await asyncio.sleep(wait)
    raise AssertionError("itertools.count ends never")


async def _once(options: EndpointOptions, opening: Opening) -> dict[str, Any]:
    import httpx
    import openai

    received = bytearray()
    try:
        # The SDK's own time-out is for each read: a server that drips bytes would never meet it.
        async with asyncio.timeout(options.timeout), opening() as response:
            async for chunk in response.iter_bytes():
                received += chunk
                if len(received) > LARGEST_ANSWER:
                    raise MalformedAnswerError(
                        f"The answer from {options.shown_url} is longer than {LARGEST_ANSWER >> 20} MiB. "
                        "Lower max_tokens."
                    )
    except (TimeoutError, openai.APITimeoutError, httpx.TimeoutException) as error:
        raise ModelUnavailableError(
            f"{options.shown_url} did not answer within {options.timeout:g} s. Raise timeout, or lower max_tokens "
            "or concurrency.",
            transient=False,
        ) from error
    except openai.APIStatusError as error:
        raise _status_failure(options, error) from error
    except (openai.APIConnectionError, httpx.HTTPError) as error:
        cause = error.__cause__ or error
        raise ModelUnavailableError(
            f"{options.shown_url} cannot be reached or broke off ({type(cause).__name__}: {cause}). Is a server "
            "running there?"
        ) from error
    return _decoded(options, bytes(received))


def _decoded(options: EndpointOptions, received: bytes) -> dict[str, Any]:
    try:
        answer = json.loads(received)
    except (ValueError, RecursionError) as error:
        raise MalformedAnswerError(
            f"{options.shown_url} answered with {len(received)} bytes that are not JSON ({error}). Check base_url: "
            "it usually ends in /v1."
        ) from error
    if not isinstance(answer, dict):
        raise MalformedAnswerError(f"{options.shown_url} answered with JSON that is not an object.")
    return answer


def _status_failure(
    options: EndpointOptions, error: openai.APIStatusError
) -> ModelUnavailableError | ModelRefusedError:
    told = error.body.get("message") if isinstance(error.body, Mapping) else None
    status, said = error.status_code, " ".join(str(told or error.message).split())[:300]
    if status in _BUSY or status >= 500:
        wait = retry_after(error.response.headers)
        asks = f" and asks to wait {wait:.0f} s" if wait is not None else ""
        return ModelUnavailableError(
            f"{options.shown_url} answered with status {status}{asks}: {said}",
            retry_after=wait,
            status=status,
        )
    advice = _ADVICE.get(status, "Check model, extra and what this server supports.")
    return ModelRefusedError(
        f"{options.shown_url} refused the request with status {status}: {said}. {advice}", status=status
    )


def retry_after(headers: Mapping[str, str]) -> float | None:
    """Seconds that a response asks to wait, by ``retry-after-ms`` or ``retry-after`` (seconds or a date), or None."""
    for name, scale in (("retry-after-ms", 1e-3), ("retry-after", 1.0)):
        try:
            seconds = float(headers[name]) * scale
        except (KeyError, ValueError):
            continue
        return max(seconds, 0.0) if math.isfinite(seconds) else None
    try:
        moment = parsedate_to_datetime(headers.get("retry-after", "")).timestamp()
    except (TypeError, ValueError, OverflowError):
        return None
    return max(moment - time.time(), 0.0)
