"""Where a language model is and how it is asked."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any
from urllib.parse import urlsplit

from gvla2.component import check_ranges
from gvla2.errors import ConfigurationError

RANGES = {
    "timeout": (0.001, 1e6, "s"),
    "retries": (0, 1000, ""),
    "concurrency": (1, 10_000, ""),
    "temperature": (0, 100, "or null"),
    "max_tokens": (1, 10_000_000, "or null"),
}


@dataclass(kw_only=True)
class AskingOptions:
    """How a model is asked, wherever it is.

    ``timeout`` seconds bound one answer, retries included; transient failures are tried again ``retries`` times, as
    soon as the server allows. ``concurrency`` bounds the requests in flight. ``max_tokens`` includes a reasoning
    model's reasoning; it and ``temperature`` are never sent when null, for models that refuse them (with ``extra`` =
    ``{max_completion_tokens: 4096}``).

    ``cache`` is a folder for answers, empty for none: it holds what was said in full, and forgetting a memory does not
    clear it. ``extra`` goes into each request as it is, for server-specific options (``{chat_template_kwargs:
    {enable_thinking: false}}``).
    """

    timeout: float = 120.0
    retries: int = 2
    concurrency: int = 4
    temperature: float | None = 0.0
    max_tokens: int | None = 2048
    cache: str = ""
    extra: dict[str, Any] = field(default_factory=dict)

    def check(self) -> None:
        """Raise :class:`ConfigurationError` for invalid options."""
        given = {name: value for name, value in vars(self).items() if value is not None}
        check_ranges(SimpleNamespace(**given), "language", RANGES)
        try:
            json.dumps(self.extra)
        except (TypeError, ValueError, RecursionError) as error:
            raise ConfigurationError(f"extra cannot be sent as JSON: {error}.") from error


@dataclass(kw_only=True)
class EndpointOptions(AskingOptions):
    """One OpenAI-compatible server (vLLM, Ollama, llama.cpp, a provider) and one of its models.

    ``base_url`` ends in the version (``/v1``); the default is where vLLM listens. An empty ``model`` takes the one that
    the server lists. ``api_key_env`` names the environment variable that holds the key; empty sends none, so that a
    provider's key never reaches another server by accident. ``grammars`` says that the server supports llama.cpp's
    ``grammar``, which other servers silently ignore.
    """

    base_url: str = "http://127.0.0.1:8000/v1"
    model: str = ""
    api_key_env: str = ""
    grammars: bool = False

    @property
    def identity(self) -> str:
        """Identifies this server in the cache and in messages."""
        return self.base_url.rstrip("/")

    def address(self) -> str:
        """The ``base_url``."""
        return self.base_url

    def key(self) -> str:
        """The key, "" for none; raises :class:`ConfigurationError` when its variable is not set."""
        key = os.environ.get(self.api_key_env, "").strip() if self.api_key_env else ""
        if self.api_key_env and not key:
            raise ConfigurationError(
                f"The environment variable '{self.api_key_env}' of the key for {self.base_url} is not set. Set it, or "
                "leave api_key_env empty for a server without keys."
            )
        return key

    def check(self) -> None:
        """As for every model; the address must also be valid and hold no secret, since configurations are shown."""
        super().check()
        try:
            parts = urlsplit(self.base_url)
            sound = parts.scheme in ("http", "https") and bool(parts.hostname) and parts.port != 0
        except ValueError:
            sound = False
        if not sound:
            why = "is not a server's address, such as http://127.0.0.1:8000/v1."
            raise ConfigurationError(f"base_url is '{self.base_url}', which {why}")
        if "@" in parts.netloc:
            raise ConfigurationError(
                "base_url holds a name or a password, which every run's folder would show: api_key_env names the "
                "environment variable of a key."
            )
