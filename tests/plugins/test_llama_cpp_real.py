"""A real model in one option: schema, grammar and log-probabilities; one server for a process."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from gvla2.language import LanguageModel, Request, ask_typed, json_in
from gvla2.plugins.registry import Registry
from gvla2_plugins.llama_cpp import LlamaCppConfig, LlamaServer

pytestmark = [pytest.mark.model, pytest.mark.timeout(600)]
ASK = [
    {"role": "system", "content": "You answer in JSON."},
    {"role": "user", "content": "The cup is red. Which colour is the cup?"},
]
SCHEMA = {
    "type": "object",
    "properties": {"colour": {"enum": ["red", "green"]}},
    "required": ["colour"],
    "additionalProperties": False,
}


@pytest.fixture(scope="module")
def language(local_model: Path, registry: Registry) -> LanguageModel:
    root = {"language": {"name": "llama_cpp", "model": str(local_model), "context": 2048}}
    made: LanguageModel = registry.build(root, "language")
    return made


def test_a_schema_is_kept_to(language: LanguageModel):
    found = ask_typed(language, ASK, json_in, purpose="plan", schema=SCHEMA, max_tokens=40)
    assert found.answer == {"colour": "red"}
    assert found.transcript[0]["prompt_tokens"] > 20
    assert found.transcript[0]["seconds"] > 0


def test_a_grammar_is_kept_to_and_log_probabilities_come(language: LanguageModel):
    request = Request(ASK, logprobs=True, grammar='root ::= "green" | "red"', max_tokens=8)
    answer = language.complete(request, purpose="verify")
    assert answer.text == "red"
    assert len(answer.tokens[0][1]) >= 10


def test_threads_and_components_share_one_server(
    language: LanguageModel, local_model: Path, registry: Registry
):
    options = {"name": "llama_cpp", "model": str(local_model), "context": 2048}
    other: LanguageModel = registry.build({"language": options}, "language")
    request = Request([{"role": "user", "content": "Say hi."}], max_tokens=4)
    with ThreadPoolExecutor(2) as pool:
        texts = list(pool.map(lambda made: made.complete(request, purpose="plan").text, (language, other)))
    assert texts[0] == texts[1] != ""
    assert (
        LlamaServer(LlamaCppConfig(**options)).address() == LlamaServer(LlamaCppConfig(**options)).address()
    )
