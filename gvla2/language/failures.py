"""How asking a language model fails: it was not there, it refused, its answer makes no sense, or is of no use."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gvla2.errors import Gvla2Error


class LanguageModelError(Gvla2Error):
    """Root of the four failures below. ``transcript`` is what was said before, where it was a conversation."""

    transcript: tuple[Mapping[str, Any], ...] = ()


class ModelUnavailableError(LanguageModelError):
    """No answer could be had: no network, a time-out, too many requests after all retries, an error of the server.

    ``transient`` tells that asking again soon may help; ``status`` is HTTP's, 0 where there was no response;
    ``reached`` is False where nobody listened at the address.
    """

    def __init__(
        self, message: str, *, transient: bool = True, status: int = 0, reached: bool = True
    ) -> None:
        super().__init__(message)
        self.transient, self.status, self.reached = transient, status, reached


class ModelRefusedError(LanguageModelError):
    """The server will not answer such a request: a wrong key, address, model or parameter; ``status`` is HTTP's."""

    def __init__(self, message: str, *, status: int) -> None:
        super().__init__(message)
        self.status = status


class MalformedAnswerError(LanguageModelError):
    """The server answered with something that is not an OpenAI-compatible completion."""


class UnusableAnswerError(LanguageModelError):
    """The model answered, again and again, and nothing that it said could be used."""
