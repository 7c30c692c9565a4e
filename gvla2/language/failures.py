"""Failures of a language model: unavailable, refused, a malformed answer, or an unusable one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gvla2.errors import Gvla2Error


class LanguageModelError(Gvla2Error):
    """Root of the four failures below. ``transcript`` is the conversation so far, if any."""

    transcript: tuple[Mapping[str, Any], ...] = ()


class ModelUnavailableError(LanguageModelError):
    """No answer was received: no network, a time-out, too many requests after all retries, an error of the server.

    ``transient`` means that retrying soon may help; ``status`` is HTTP's, 0 without a response; ``reached`` is False if
    nothing was listening at the address.
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
    """The model answered every time, but no answer could be used."""
