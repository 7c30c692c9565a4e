"""Language models at any OpenAI-compatible address: what planners, verifiers and inducers ask.

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
    from gvla2.language.contracts import (
        Completion,
        LanguageModel,
        LanguageModelError,
        Ledger,
        MalformedAnswerError,
        Message,
        ModelRefusedError,
        ModelUnavailableError,
        Request,
        Server,
        Tally,
        Token,
        UnusableAnswerError,
        Usage,
        picture,
    )
    from gvla2.language.endpoint import Endpoint
    from gvla2.language.options import AskingOptions, EndpointOptions
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

_ELSEWHERE = {
    **dict.fromkeys(("AskingOptions", "EndpointOptions"), "options"),
    **dict.fromkeys(("Answered", "ask_typed", "json_in"), "typed"),
    "Endpoint": "endpoint",
}


def __getattr__(name: str) -> object:
    """Load a name's module when it is asked for: `gvla2 plugins` needs the options without the client code."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_ELSEWHERE.get(name, 'contracts')}"), name)
