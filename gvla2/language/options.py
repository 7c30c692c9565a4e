"""Where a language model is and how it is to be asked."""

from __future__ import annotations

import json
import math
import os
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import urlsplit

from gvla2.errors import ConfigurationError


@dataclass(kw_only=True)
class EndpointOptions:
    """One OpenAI-compatible server (vLLM, SGLang, llama.cpp, a provider) and one of its models.

    ``base_url`` ends in the version (``/v1``); the default is where vLLM listens. An empty ``model`` takes the one
    that the server lists. ``api_key_env`` names the environment variable that holds the key; empty sends none, so
    that a provider's key never reaches another server by accident.

    ``timeout`` seconds bound one request from its first byte to its last; a request that timed out is not sent again.
    Other transient failures are, ``retries`` times, after ``backoff`` seconds, doubled each time, or after what the
    server asks for; when it asks for more than ``longest_wait`` seconds the request fails at once. ``concurrency``
    bounds the requests in flight. ``max_tokens`` includes a reasoning model's reasoning; it and ``temperature`` are not
    sent when null, for models that refuse them (with ``extra`` = ``{max_completion_tokens: 4096}``).

    ``cache`` is a folder for answers, empty for none: its files hold what models said in full, and forgetting a
    memory does not reach them. ``extra`` goes into each request as it is, for what one server alone understands
    (``{chat_template_kwargs: {enable_thinking: false}}``).
    """

    base_url: str = "http://127.0.0.1:8000/v1"
    model: str = ""
    api_key_env: str = ""
    timeout: float = 60.0
    retries: int = 2
    backoff: float = 0.5
    longest_wait: float = 60.0
    concurrency: int = 4
    temperature: float | None = 0.0
    max_tokens: int | None = 2048
    cache: str = ""
    extra: dict[str, Any] = field(default_factory=dict)

    @property
    def shown_url(self) -> str:
        """The address without a password, for messages."""
        return self.base_url.replace(f"{urlsplit(self.base_url).netloc.rpartition('@')[0]}@", "", 1)

    def api_key(self) -> str:
        """The key, "" for none; raises :class:`ConfigurationError` when its variable is not set."""
        if not self.api_key_env:
            return ""
        key = os.environ.get(self.api_key_env, "").strip()
        if not key:
            raise ConfigurationError(
                f"The environment variable '{self.api_key_env}' should hold the key for {self.shown_url} and is not "
                "set. Set it, or leave api_key_env empty for a server without keys."
            )
        return key

    def check(self) -> None:
        """Raise :class:`ConfigurationError` for options that cannot be."""
        try:
            parts = urlsplit(self.base_url)
            sound = parts.scheme in ("http", "https") and bool(parts.hostname) and parts.port != 0
        except ValueError:
            sound = False
        if not sound:
            raise ConfigurationError(
                f"base_url is '{self.base_url}', which is no address of a server. It should look like "
                "http://127.0.0.1:8000/v1."
            )
        limits = {
            "timeout": (self.timeout, self.timeout > 0, "more than 0 seconds"),
            "retries": (self.retries, self.retries >= 0, "0 or more"),
            "backoff": (self.backoff, self.backoff >= 0, "0 seconds or more"),
            "longest_wait": (self.longest_wait, self.longest_wait >= 0, "0 seconds or more"),
            "concurrency": (self.concurrency, self.concurrency >= 1, "1 or more"),
            "temperature": (self.temperature or 0.0, (self.temperature or 0.0) >= 0, "0 or more, or null"),
            "max_tokens": (
                self.max_tokens or 0,
                self.max_tokens is None or self.max_tokens >= 1,
                "1 or more, or null",
            ),
        }
        for name, (value, right, wanted) in limits.items():
            if not (right and math.isfinite(value)):
                raise ConfigurationError(f"{name} is {value}; it must be {wanted}.")
        try:
            json.dumps(self.extra)
        except (TypeError, ValueError, RecursionError) as error:
            raise ConfigurationError(f"extra cannot be sent as JSON: {error}.") from error
