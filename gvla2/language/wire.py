"""One request over HTTP, by the ``openai`` package: its retries, a true deadline, failures by their kind."""

from __future__ import annotations

import asyncio
import importlib
import json
from collections.abc import Mapping
from functools import cache
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from gvla2.language.failures import MalformedAnswerError, ModelRefusedError, ModelUnavailableError
from gvla2.language.options import AskingOptions

if TYPE_CHECKING:
    import openai

_BUSY = (408, 409, 429)
"""Transient refusals, like every 5xx; the package retries them."""

_ADVICE = {
    401: "The key is missing or wrong: check api_key_env and the variable it names.",
    403: "The key does not allow this: check the account's rights and api_key_env.",
    404: "Check base_url (it usually ends in /v1) and model.",
    413: "The request is too long for the server: shorten what is asked about.",
}


def connect(address: str, key: str, options: AskingOptions) -> openai.AsyncOpenAI:
    """A client to be used as an async context."""
    import openai

    # The package insists on a key; servers without keys take any word. Its time-outs are for each read: a server that
    # drips bytes would never meet them, so the deadline is kept in ask(). No proxy stands before this machine itself.
    here = urlsplit(address).hostname in ("127.0.0.1", "::1", "localhost")
    return openai.AsyncOpenAI(
        base_url=address,
        api_key=key or "none",
        timeout=None,
        max_retries=options.retries,
        http_client=openai.DefaultAsyncHttpxClient(trust_env=not here),
    )


async def ask(client: openai.AsyncOpenAI, options: AskingOptions, body: Mapping[str, Any]) -> dict[str, Any]:
    """The JSON that answers ``body``.

    Raises :class:`ModelUnavailableError`, :class:`ModelRefusedError` or :class:`MalformedAnswerError`. What the server
    says, in an answer or in an error, never holds the key.
    """
    everything = {**body, **options.extra}  # the package sends extra_body as it is, and checks nothing in it
    create = client.chat.completions.with_raw_response.create
    return await _sent(
        client, options, create, model=body["model"], messages=body["messages"], extra_body=everything
    )


async def only_model(client: openai.AsyncOpenAI, options: AskingOptions) -> str:
    """The model that the server lists; raises :class:`ModelRefusedError` unless it lists exactly one."""
    answer = await _sent(client, options, client.models.with_raw_response.list)
    listed = answer.get("data")
    names = [m["id"] for m in listed if isinstance(m, dict) and "id" in m] if isinstance(listed, list) else []
    if len(names) != 1:
        some = ", ".join(map(str, names[:8])) or "none"
        raise ModelRefusedError(
            f"{client.base_url} lists {len(names)} models ({some}): choose one with the option model.",
            status=200,
        )
    return str(names[0])


async def _sent(
    client: openai.AsyncOpenAI, options: AskingOptions, send: Any, **asked: Any
) -> dict[str, Any]:
    import openai

    http = _http()
    try:
        async with asyncio.timeout(options.timeout):
            received = (await send(**asked)).http_response.content
    except TimeoutError as error:
        raise ModelUnavailableError(
            f"{client.base_url} did not answer within {options.timeout:g} s. Raise timeout, or lower max_tokens or "
            "concurrency.",
            transient=False,
        ) from error
    except openai.APIStatusError as error:
        raise _status_failure(client, error) from None
    except (openai.APIConnectionError, http.HTTPError) as error:
        cause = error.__cause__ or error
        raise ModelUnavailableError(
            f"{client.base_url} cannot be reached or broke off ({type(cause).__name__}: {cause}). Is a server "
            "running there?",
            reached=not isinstance(cause, http.ConnectError),
        ) from error
    try:
        answer = json.loads(_redacted(client, received.decode(errors="replace")))
    except (ValueError, RecursionError) as error:
        raise MalformedAnswerError(
            f"{client.base_url} answered with {len(received)} bytes that are not JSON ({error}). Check base_url: "
            "it usually ends in /v1."
        ) from error
    if not isinstance(answer, dict):
        raise MalformedAnswerError(f"{client.base_url} answered with JSON that is not an object.")
    return answer


@cache
def _http() -> Any:
    """The HTTP package that this ``openai`` uses: ``httpx``, or ``httpx2`` since its version 3."""
    import openai

    of_client = next(c for c in openai.DefaultAsyncHttpxClient.__mro__ if c.__name__ == "AsyncClient")
    return importlib.import_module(of_client.__module__.partition(".")[0])


def _status_failure(
    client: openai.AsyncOpenAI, error: openai.APIStatusError
) -> ModelUnavailableError | ModelRefusedError:
    told = error.body.get("message") if isinstance(error.body, Mapping) else None
    status = error.status_code
    said = _redacted(client, " ".join(str(told or error.message).split()))[:300]
    if status in _BUSY or status >= 500:
        return ModelUnavailableError(
            f"{client.base_url} answered with status {status}: {said}", status=status
        )
    advice = _ADVICE.get(status, "Check model and extra against what this server supports.")
    return ModelRefusedError(
        f"{client.base_url} refused the request with status {status}: {said}. {advice}", status=status
    )


def _redacted(client: openai.AsyncOpenAI, text: str) -> str:
    return text if client.api_key == "none" else text.replace(client.api_key, "[key]")
