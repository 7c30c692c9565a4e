"""How asking a language model fails: it was not there, it refused, or its answer makes no sense."""

from __future__ import annotations

from gvla2.errors import Gvla2Error


class LanguageModelError(Gvla2Error):
    """Root of the three failures below."""


class ModelUnavailableError(LanguageModelError):
    """No answer could be had: no network, a time-out, too many requests after all retries, an error of the server.

    ``transient`` tells that asking again soon may help; ``retry_after`` is how many seconds the server asked to
    wait, None where it did not say; ``status`` is HTTP's, 0 where there was no response.
    """

    def __init__(
        self, message: str, *, transient: bool = True, retry_after: float | None = None, status: int = 0
    ) -> None:
        super().__init__(message)
        self.status = status
        self.transient = transient
        self.retry_after = retry_after


class ModelRefusedError(LanguageModelError):
    """The server will not answer such a request: a wrong key, address, model or parameter; ``status`` is HTTP's."""

    def __init__(self, message: str, *, status: int) -> None:
        super().__init__(message)
        self.status = status


class MalformedAnswerError(LanguageModelError):
    """The server answered with something that is not an OpenAI-compatible completion."""
