"""The ``llama_cpp`` language model: a GGUF file on this machine, served by llama.cpp while a run needs it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl
from gvla2.language.options import AskingOptions

if TYPE_CHECKING:
    from gvla2.language.contracts import LanguageModel


@dataclass(kw_only=True)
class LlamaCppConfig(AskingOptions, ComponentConfig):
    """``model`` is the GGUF file, ``mmproj`` the vision projector of a multimodal model.

    The server starts with the first question, on a free local port, and must be ready within ``start_timeout`` seconds.
    Runs with the same model and options share it; it stops when the last of them ends, in any way. It holds ``slots``
    questions of ``context`` tokens at once, answers included, computes with ``threads`` (0: one per core available to
    this process) and with ``gpu_layers`` of its layers on a GPU. ``folder`` is for its state and log, "" for
    ``gvla2/llama_cpp`` in the user's cache. For the rest see :class:`gvla2.language.AskingOptions`; ``concurrency``
    beyond ``slots`` would only make questions wait at the server while their timeout runs.
    """

    model: str = ""
    mmproj: str = ""
    context: int = 8192
    slots: int = 1
    threads: int = 0
    gpu_layers: int = 0
    start_timeout: float = 120.0
    folder: str = ""
    timeout: float = 300.0
    concurrency: int = 1


def _build(config: LlamaCppConfig) -> LanguageModel:
    """A GGUF file on this machine, served by llama.cpp while a run needs it."""
    from gvla2.language.endpoint import Endpoint
    from gvla2_plugins.llama_cpp.server import LlamaServer

    return Endpoint(config, LlamaServer(config))


@hookimpl
def gvla2_language_models() -> list[Component[LanguageModel]]:
    """``language=llama_cpp language.model=FILE.gguf``."""
    return [Component("llama_cpp", LlamaCppConfig, _build)]
