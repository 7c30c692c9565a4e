"""The llm verifier with a real model over real HTTP: a small one, so its structure is judged, not its wisdom."""

from pathlib import Path

import pytest

from gvla2.language import LanguageModel, Request
from gvla2.language.score_tokens import LETTERS, phi, score_answer
from gvla2.memory.contracts import Evidence
from gvla2.plugins.registry import Registry
from gvla2_plugins.llm_verifier import LlmVerifierConfig, gvla2_verifiers
from gvla2_plugins.llm_verifier.verifier import criteria_set

pytestmark = [pytest.mark.model, pytest.mark.timeout(600)]

GOOD = "Reproduced the crash with a test, found the off-by-one, fixed it. Ran the tests: 12 passed, exit status 0."
BAD = "Changed a comment and declared the bug fixed. Nothing was run. The crash still happens: exit status 1."


@pytest.fixture(scope="module")
def language(local_model: Path, registry: Registry) -> LanguageModel:
    options = {"model": str(local_model), "context": 2048, "max_tokens": 96}
    made: LanguageModel = registry.build({"language": {"name": "llama_cpp", **options}}, "language")
    return made


def test_two_transcripts_are_judged(language: LanguageModel):
    (component,) = gvla2_verifiers()
    judge = component.build(LlmVerifierConfig(criteria="software"), language=language)
    questions = criteria_set("software")
    for transcript in (GOOD, BAD):
        verdict = judge.verify(Evidence("fix the crash on empty input", transcript))
        assert verdict.outcome != "unavailable", verdict.reasons
        assert list(verdict.criteria) == list(questions)
        assert all(0 <= score <= 1 for score in verdict.criteria.values())
        assert not any("midpoint" in reason for reason in verdict.reasons)
    assert language.ledger.totals()["verify"]["unmetered"] == 0


def test_a_score_is_the_expectation_over_the_models_own_tokens(language: LanguageModel):
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
    asked = Request([*talk, {"role": "user", "content": "Grade: 5 + 1 = 6"}], logprobs=True, seed=1)
    answer = language.complete(asked, purpose="verify")
    score = score_answer(answer.text, answer.tokens)
    assert score.source == "distribution", answer
    assert 0.5 <= score.mass <= 1
    assert phi(LETTERS[-1]) < score.value < phi(LETTERS[0])  # an expectation, no single letter
