"""Language models at any OpenAI-compatible address: the ground floor for planners, verifiers and inducers.

A component that asks a model says ``needs=("language",)`` and gets the run's :class:`LanguageModel` (Hydra group
``language``). It asks for text by :meth:`LanguageModel.complete`, and for a typed answer by

    found = ask_typed(language, [{"role": "user", "content": "..."}], parse, purpose="plan", schema={...})
    found.answer, found.transcript          # or a LanguageModelError

Nothing here depends on what the models are asked about.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gvla2.language.completion import Completion, Token, Usage
    from gvla2.language.endpoint import Endpoint, LanguageModel, Server
    from gvla2.language.failures import (
        LanguageModelError,
        MalformedAnswerError,
        ModelRefusedError,
        ModelUnavailableError,
        UnusableAnswerError,
    )
    from gvla2.language.ledger import Ledger, Tally
    from gvla2.language.options import AskingOptions, EndpointOptions
    from gvla2.language.request import Message, Request, picture
    from gvla2.language.typed import Answered, ask_typed, json_in

__all__ = [
    "Answered",
    "AskingOptions",
    "Completion",
    "Endpoint",
    "EndpointOptions",
    "LanguageModel",
    "LanguageModelError",
    "Ledger",
    "MalformedAnswerError",
    "Message",
    "ModelRefusedError",
    "ModelUnavailableError",
    "Request",
    "Server",
    "Tally",
    "Token",
    "UnusableAnswerError",
    "Usage",
    "ask_typed",
    "json_in",
    "picture",
]

_HOMES = (
    ("completion", "Completion", "Token", "Usage"),
    ("endpoint", "Endpoint", "LanguageModel", "Server"),
    (
        "failures",
        "LanguageModelError",
        "MalformedAnswerError",
        "ModelRefusedError",
        "ModelUnavailableError",
        "UnusableAnswerError",
    ),
    ("ledger", "Ledger", "Tally"),
    ("options", "AskingOptions", "EndpointOptions"),
    ("request", "Message", "Request", "picture"),
    ("typed", "Answered", "ask_typed", "json_in"),
)


def __getattr__(name: str) -> object:
    """Load a name's module when it is asked for: `gvla2 plugins` needs the options without the client code."""
    for module, *names in _HOMES:
        if name in names:
            return getattr(import_module(f"{__name__}.{module}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
