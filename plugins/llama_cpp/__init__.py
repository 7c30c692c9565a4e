"""The ``llama_cpp`` language model: a GGUF file on this machine, served by llama.cpp within the run's process."""

from __future__ import annotations

import importlib.util
import os
import threading
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gvla2 import Component, ComponentConfig, hookimpl
from gvla2.errors import ConfigurationError, MissingDependencyError
from gvla2.language.options import AskingOptions

if TYPE_CHECKING:
    from gvla2.language.contracts import LanguageModel

LEAST = {"context": 256, "slots": 1, "threads": 0, "gpu_layers": 0}
PROMPTS_MIB = 1024
"""Memory for earlier prompts besides the model's context; llama.cpp's own 8 GiB are more than many machines have."""
_starting = threading.Lock()


@dataclass(kw_only=True)
class LlamaCppConfig(AskingOptions, ComponentConfig):
    """``model`` is the GGUF file, ``mmproj`` the vision projector of a multimodal model.

    The model is loaded with the first question and served on a free local port, once per process for the same files and
    options. It answers ``slots`` questions of ``context`` tokens at once, answers included, computes with ``threads``
    (0: one per core available to this process) and with ``gpu_layers`` of its layers on a GPU. For the rest see
    :class:`gvla2.language.AskingOptions`; ``concurrency`` beyond ``slots`` would only make questions wait at the server
    while their timeout runs.
    """

    model: str = ""
    mmproj: str = ""
    context: int = 8192
    slots: int = 1
    threads: int = 0
    gpu_layers: int = 0
    timeout: float = 300.0
    concurrency: int = 1


class LlamaServer:
    """A :class:`gvla2.language.contracts.Server` that starts when its address is requested.

    Raises :class:`ConfigurationError` without a model's file and for invalid options, and
    :class:`MissingDependencyError` without xllamacpp; it starts nothing yet.
    """

    grammars = True

    def __init__(self, config: LlamaCppConfig) -> None:
        if not config.model:
            raise ConfigurationError("No model is given: set language.model=FILE.gguf.")
        self._files = tuple(
            Path(name).expanduser().resolve() for name in (config.model, config.mmproj) if name
        )
        for file in self._files:
            if not file.is_file():
                raise ConfigurationError(f"There is no model at {file}. Set language.model to a GGUF file.")
        if importlib.util.find_spec("xllamacpp") is None:
            raise MissingDependencyError(
                "the package 'xllamacpp'", "A model of your own", "pip install 'gvla2[local-llm]'", "MIT"
            )
        for name, lowest in LEAST.items():
            if getattr(config, name) < lowest:
                raise ConfigurationError(f"{name} is {getattr(config, name)}; it must be at least {lowest}.")
        self.model = self._files[0].name
        threads = config.threads or len(os.sched_getaffinity(0))
        self._options = (config.context, config.slots, threads, config.gpu_layers)

    @property
    def identity(self) -> str:
        """The files by name and size: answers do not depend on the file's folder or the server's address."""
        return "llama.cpp " + ", ".join(f"{file.name} ({file.stat().st_size})" for file in self._files)

    def key(self) -> str:
        """None: the server only listens locally."""
        return ""

    def address(self) -> str:
        """The ``base_url`` of the server, started if it does not run. Raises :class:`ModelUnavailableError`."""
        from gvla2.language.contracts import ModelUnavailableError

        try:
            with _starting:
                return f"{_server(self._files, *self._options).listening_address}/v1"
        except Exception as error:  # a damaged file, or too little memory: llama.cpp can raise anything
            message = f"llama.cpp cannot serve {self.model}: {error}. Its own messages stand above."
            raise ModelUnavailableError(message) from error


@cache
def _server(files: tuple[Path, ...], context: int, slots: int, threads: int, gpu_layers: int) -> Any:
    import xllamacpp

    asked = xllamacpp.CommonParams()
    asked.model.path = str(files[0])
    asked.model_alias = {files[0].name}
    if len(files) > 1:
        asked.mmproj.path = str(files[1])
    asked.port, asked.ui, asked.n_gpu_layers, asked.verbosity = 0, False, gpu_layers, 1  # 1: errors
    asked.n_parallel, asked.n_ctx = slots, slots * context
    asked.cache_ram_mib = PROMPTS_MIB
    for pool in (asked.cpuparams, asked.cpuparams_batch):
        # The simulator computes between the questions: waiting threads must not spin.
        pool.n_threads, pool.poll = threads, 0
    return xllamacpp.Server(asked)


def _build(config: LlamaCppConfig) -> LanguageModel:
    """A GGUF file on this machine, served by llama.cpp within the run's process."""
    from gvla2.language.endpoint import Endpoint

    return Endpoint(config, LlamaServer(config))


@hookimpl
def gvla2_language_models() -> list[Component[LanguageModel]]:
    """``language=llama_cpp language.model=FILE.gguf``."""
    return [Component("llama_cpp", LlamaCppConfig, _build)]
