"""Conformance of language models."""

from __future__ import annotations

from gvla2.language import Completion, LanguageModel, LanguageModelError, Request
from gvla2.testing.conformance import allowed, require, require_type


def check_language(model: LanguageModel) -> None:
    """Whether a model answers, or fails with a typed error, and keeps its ledger."""
    asked = [Request([{"role": "user", "content": "Say yes."}], max_tokens=4, seed=seed) for seed in (0, 1)]
    with allowed("complete_all()"):
        answers = model.complete_all(asked, purpose="check")
    require_type(answers, list, "What complete_all() returns")
    require(
        len(answers) == len(asked), f"complete_all() gave {len(answers)} answers to {len(asked)} requests."
    )
    for answer in answers:
        require(
            isinstance(answer, Completion | LanguageModelError),
            f"complete_all() gave a {type(answer).__name__}, neither a Completion nor a LanguageModelError.",
        )
    totals = model.ledger.totals()
    if any(isinstance(answer, Completion) for answer in answers):
        require("check" in totals, "The ledger does not know the purpose 'check' of answered calls.")
    with allowed("complete_all() of nothing"):
        require(model.complete_all([], purpose="check") == [], "complete_all() of nothing must be [].")
