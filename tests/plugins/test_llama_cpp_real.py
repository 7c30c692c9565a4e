"""A real model in one option: schema, grammar and log-probabilities; one server for two processes."""

import subprocess
import sys
import time
from pathlib import Path

import pytest

from gvla2.language import LanguageModel, Request, ask_typed, json_in
from gvla2.plugins.registry import Registry

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
def language(local_model: Path, registry: Registry, tmp_path_factory) -> LanguageModel:
    state = tmp_path_factory.mktemp("llama")
    root = {
        "language": {"name": "llama_cpp", "model": str(local_model), "folder": str(state), "context": 2048}
    }
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
    assert len(answer.tokens[0].alternatives) >= 10


def test_the_server_is_shared_and_ends_with_the_last(local_model: Path, tmp_path: Path):
    code = (
        "import sys; from gvla2.plugins.registry import load_plugins; from gvla2.language import Request\n"
        "root = {'language': {'name': 'llama_cpp', 'model': sys.argv[1], 'folder': sys.argv[2], 'context': 512}}\n"
        "made = load_plugins().build(root, 'language')\n"
        "made.complete(Request([{'role': 'user', 'content': 'Hi'}], max_tokens=2), purpose='plan')\n"
    )
    command = [sys.executable, "-c", code, str(local_model), str(tmp_path)]
    runs = [subprocess.Popen(command) for _ in range(2)]
    assert [run.wait(300) for run in runs] == [0, 0]
    (log,) = tmp_path.glob("*/log")
    assert log.read_text(errors="replace").count("listening") <= 2
    deadline = time.monotonic() + 10
    while list(tmp_path.glob("*/server.json")) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not list(tmp_path.glob("*/server.json"))
