"""The llama.cpp server within the process: options that cannot be, what is missing, and a file that is no model."""

from pathlib import Path
from typing import Any

import pytest

from gvla2.errors import ConfigurationError, MissingDependencyError
from gvla2.language import Endpoint, ModelUnavailableError, Request
from gvla2.testing import check_component
from gvla2_plugins import llama_cpp
from gvla2_plugins.llama_cpp import LlamaCppConfig, LlamaServer


@pytest.fixture
def weights(tmp_path: Path) -> Path:
    file = tmp_path / "tiny.gguf"
    file.write_bytes(b"GGUF")
    return file


def language(weights: Path, **options: Any) -> Endpoint:
    config = LlamaCppConfig(**{"model": str(weights), "retries": 0, **options})
    return Endpoint(config, LlamaServer(config))


def test_a_file_that_is_no_model_is_reported(weights: Path):
    with pytest.raises(ModelUnavailableError, match=r"cannot serve tiny\.gguf"):
        language(weights).complete(Request([{"role": "user", "content": "Hi"}]), purpose="plan")


@pytest.mark.parametrize(
    ("options", "word"),
    [({"context": 1}, "context is 1"), ({"slots": 0}, "slots"), ({"threads": -1}, "threads"),
     ({"timeout": 0}, "timeout"),
     ({"mmproj": "/nowhere.gguf"}, "no model at /nowhere.gguf")],
)  # fmt: skip
def test_options_that_cannot_be(weights: Path, options: dict[str, Any], word: str):
    with pytest.raises(ConfigurationError, match=word):
        language(weights, **options)


def test_without_a_file_or_the_package_it_says_what_to_do(weights: Path, monkeypatch):
    (component,) = llama_cpp.gvla2_language_models()
    check_component(component)
    for model, word in (("", r"language\.model=FILE"), (str(weights) + "x", "There is no model at")):
        with pytest.raises(ConfigurationError, match=word):
            component.build(component.config(model=model))
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(MissingDependencyError, match=r"gvla2\[local-llm\]"):
        LlamaServer(LlamaCppConfig(model=str(weights)))
