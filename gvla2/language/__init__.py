"""Language models at any OpenAI-compatible address: what planners, verifiers and inducers ask.

A component that asks a model says ``needs=("language",)`` and gets the run's :class:`LanguageModel` (Hydra group
``language``). It asks for text by :meth:`LanguageModel.complete`, and for a typed answer by

    found = ask_typed(language, [{"role": "user", "content": "..."}], parse, purpose="plan", schema={...})
    found.answer, found.transcript          # or a LanguageModelError

Nothing here depends on what the models are asked about.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from gvla2.language.contracts import (
    Completion,
    LanguageModel,
    LanguageModelError,
    MalformedAnswerError,
    Message,
    ModelRefusedError,
    ModelUnavailableError,
    Request,
    UnusableAnswerError,
    picture,
)
from gvla2.language.options import AskingOptions, EndpointOptions
from gvla2.language.typed import ask_typed, json_in

if TYPE_CHECKING:
    from gvla2.language.endpoint import Endpoint

__all__ = [
    "AskingOptions",
    "Completion",
    "Endpoint",
    "EndpointOptions",
    "LanguageModel",
    "LanguageModelError",
    "MalformedAnswerError",
    "Message",
    "ModelRefusedError",
    "ModelUnavailableError",
    "Request",
    "UnusableAnswerError",
    "ask_typed",
    "json_in",
    "picture",
]


def __getattr__(name: str) -> object:
    """Load the client code when it is asked for: `gvla2 plugins` needs only the options."""
    if name != "Endpoint":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from gvla2.language.endpoint import Endpoint

    return Endpoint
