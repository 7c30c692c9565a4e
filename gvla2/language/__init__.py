"""Language models at any OpenAI-compatible address: the ground floor for verifiers, inducers and planners.

    endpoint = Endpoint(EndpointOptions(base_url="http://127.0.0.1:8000/v1"))
    answer = endpoint.complete([{"role": "user", "content": "..."}])     # Completion, or a LanguageModelError

Nothing here knows what the models are asked about.
"""

from gvla2.language.capabilities import Capabilities
from gvla2.language.completion import Completion, Message, Token, Usage
from gvla2.language.endpoint import Endpoint, Request
from gvla2.language.failures import (
    LanguageModelError,
    MalformedAnswerError,
    ModelRefusedError,
    ModelUnavailableError,
)
from gvla2.language.ledger import Ledger, Tally
from gvla2.language.options import EndpointOptions

__all__ = [
    "Capabilities",
    "Completion",
    "Endpoint",
    "EndpointOptions",
    "LanguageModelError",
    "Ledger",
    "MalformedAnswerError",
    "Message",
    "ModelRefusedError",
    "ModelUnavailableError",
    "Request",
    "Tally",
    "Token",
    "Usage",
]
