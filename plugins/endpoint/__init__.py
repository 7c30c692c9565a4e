"""The ``endpoint`` language model: any running OpenAI-compatible server."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl
from gvla2.language.options import EndpointOptions

if TYPE_CHECKING:
    from gvla2.language.contracts import LanguageModel


@dataclass(kw_only=True)
class EndpointConfig(EndpointOptions, ComponentConfig):
    """Where the model is and how it is asked: see :class:`gvla2.language.EndpointOptions`."""


def _build(config: EndpointConfig) -> LanguageModel:
    """A model at any OpenAI-compatible address: vLLM, Ollama, llama.cpp, a provider."""
    from gvla2.language.endpoint import Endpoint

    return Endpoint(config)


@hookimpl
def gvla2_language_models() -> list[Component[LanguageModel]]:
    """``language=endpoint language.base_url=http://127.0.0.1:8000/v1``."""
    return [Component("endpoint", EndpointConfig, _build)]
