"""The retriever against a plain reference of the same formula, and what it refuses to do."""

import math
import random
from typing import Any

import numpy as np
import pytest

from gvla2.memory.candidates import Candidates, HeldRecord
from gvla2.memory.contracts import Lesson, MemoryTask, Ranked
from gvla2.memory.embedding import StaticEmbedder
from gvla2.memory.options import HybridOptions, ScoreWeights
from gvla2.memory.retrieval import HybridRetriever, SemanticRetriever
from gvla2.memory.text import subqueries, terms
from gvla2.testing.memory import candidates
from tests.memory.corpus import lessons, tasks

EMBEDDER = StaticEmbedder()
NOW = 1.8e9


def reference(task: MemoryTask, bank: Candidates, options: HybridOptions) -> list[tuple[int, float]]:
    """All reliable rows with S, best first, one row and one word at a time."""
    count = len(bank)
    records = [bank.record(i) for i in range(count)]
    texts = [terms(record.text) for record in records]

    def share(asked: frozenset[str], text: frozenset[str]) -> float:
        idf = {}
        for word in asked:
            holders = sum(word in other for other in texts)
            idf[word] = math.log(1 + (count + 10 - holders + 0.5) / (holders + 0.5))
        return sum(idf[word] for word in asked & text) / sum(idf.values())

    vector = EMBEDDER.embed([task.query])[0]
    found = []
    for i, record in enumerate(records):
        lexical = max(share(asked, texts[i]) for asked in subqueries(task.query))
        cosine = min(max(float(EMBEDDER.embed([record.text])[0] @ vector), 0.0), 1.0)
        if task.skill and record.skill and record.skill != task.skill:
            continue
        evidence = cosine + options.words_count * lexical
        if evidence < options.min_evidence and lexical < options.min_words:
            continue
        found.append((i, options.lexical_weight * lexical + options.cosine_weight * cosine, evidence))
    best = max((relevance for _, relevance, _ in found), default=1.0)
    scored = [(i, r / best + prior(bank, i, options.weights), evidence) for i, r, evidence in found]
    reliable = [entry for entry in scored if entry[1] >= options.min_score]
    nearest = max((evidence for _, _, evidence in reliable), default=0.0)
    about = [(i, score) for i, score, evidence in reliable if evidence >= options.min_share * nearest]
    return sorted(about, key=lambda e: (-e[1], bank.record(e[0]).id))


def prior(bank: Candidates, i: int, weights: ScoreWeights) -> float:
    """S of a record without its relevance."""
    record = bank.record(i)
    age, usage = max(NOW - record.updated, 0.0) / 86400, record.usage
    avoidance = record.type == "failure_avoidance"
    used = min(math.log1p(usage) / weights.usage_divisor, weights.usage_most)
    success = {
        "verified_success": weights.verified,
        "verified_fail": weights.verified if avoidance else weights.failed,
        "uncertain": weights.uncertain,
        "unavailable": weights.unjudged,
    }[record.outcome]
    stale = max(0.0, min(age / 365, weights.ageing) - used / 2)
    if avoidance and age > weights.stale_days and usage == 0:
        stale = weights.stale_failure
    return (
        record.confidence
        + success
        + max(0.0, weights.recency - min(age / weights.recency_days, weights.recency))
        + used
        - min(weights.conflict * bank[i].conflicts, weights.conflict_most)
        - stale
    )


def corpus(size: int, seed: int) -> Candidates:
    records = lessons(size, seed, now=NOW)
    vectors = EMBEDDER.embed([r.text for r in records])
    dice = random.Random(seed)
    held = [HeldRecord(r, v, int(dice.random() < 0.2)) for r, v in zip(records, vectors, strict=True)]
    return Candidates(held, NOW)


@pytest.mark.parametrize(
    ("seed", "weights"),
    [
        (3, ScoreWeights()),
        (4, ScoreWeights(verified=0.6, usage_most=0.6, recency=0.0)),
        (5, ScoreWeights(conflict=0.4, recency_days=3.0, stale_days=1.0)),
    ],
)
def test_ranking_is_that_of_the_plain_formula(seed: int, weights: ScoreWeights) -> None:
    bank = corpus(250, seed)
    options = HybridOptions(top_k=500, top_k_constraints=500, min_score=0.5, weights=weights)
    retriever = HybridRetriever(options)
    for task in tasks(8, seed + 10):
        expected = reference(task, bank, options)
        ranked, reason = retriever.rank(task, bank, EMBEDDER.embed([task.query])[0])
        assert [r.row for r in ranked] == [row for row, _ in expected]
        np.testing.assert_allclose([r.score for r in ranked], [s for _, s in expected], atol=2e-6)
        assert bool(reason) != bool(expected)
        for r in ranked:
            assert r.score == pytest.approx(sum(r.terms.values()))


def rank(query: str, bank: Candidates, skill: str = "", **options: Any) -> tuple[list[Ranked], str]:
    retriever = HybridRetriever(HybridOptions(**options))
    ranked, reason = retriever.rank(MemoryTask(query, skill=skill), bank, EMBEDDER.embed([query])[0])
    return list(ranked), reason


TEXTS = ("lift the red cube", "push the blue block to the goal", "press the lamp button")


@pytest.mark.parametrize(
    ("query", "row"), [("raise the red cube", 0), ("push the block", 1), ("the lamp's button", 2)]
)
def test_the_right_record_comes_first(query: str, row: int) -> None:
    ranked, reason = rank(query, candidates(TEXTS))
    assert ranked[0].row == row
    assert reason == ""


def test_nothing_relevant_says_what_was_nearest() -> None:
    ranked, reason = rank("bake a chocolate cake", candidates(TEXTS))
    assert ranked == []
    assert "about this" in reason
    assert rank("the of and", candidates(TEXTS)) == ([], "The query has no word to search by.")
    assert rank("lift", candidates([])) == ([], "The bank is empty.")


def test_relevant_and_unreliable_says_so() -> None:
    bank = candidates(TEXTS, confidence=[0.0] * 3, ages=[60.0] * 3)
    ranked, reason = rank("press the lamp button", bank)
    assert ranked == []
    assert "reliable" in reason
    assert rank("press the lamp button", bank, min_score=0.5)[0]


def test_skills_narrow_where_both_are_known() -> None:
    bank = candidates(["lift it high", "lift it low", "lift it slowly"], skill=["pick", "place", ""])
    assert {r.row for r in rank("lift it", bank, skill="pick")[0]} == {0, 2}
    assert len(rank("lift it", bank)[0]) == 3
    assert "push" in rank("lift it", candidates(["lift it"], skill=["pick"]), skill="push")[1]


def test_what_is_sure_but_about_something_else_takes_no_place() -> None:
    asked = "unscrew the gray lid of the orange jar"
    others = [f"unscrew the cap of the bottle by the {place}" for place in ("sink", "door", "stove", "wall")]
    bank = candidates(
        [*others, asked], confidence=[1.0] * 4 + [0.0], type=["failure_avoidance"] * 5, ages=[0.0] * 5
    )
    loose = {"min_score": 1.0, "top_k_constraints": 3}
    assert [r.row for r in rank(asked, bank, **loose)[0]] == [4]
    assert 4 not in {r.row for r in rank(asked, bank, **loose, min_share=0.0)[0]}
    # Relative to what is reliable: what is not pushes nothing out.
    assert rank(asked, bank)[0]


def test_semantic_is_cosine_alone() -> None:
    bank = corpus(500, 2)
    table = EMBEDDER.embed([bank.record(i).text for i in range(500)])
    for task in tasks(5, 8):
        vector = EMBEDDER.embed([task.query])[0]
        ranked, _ = SemanticRetriever(top_k=7).rank(task, bank, vector)
        expected = np.argsort(-(table @ vector), kind="stable")[:7]
        assert {r.row for r in ranked} == set(expected.tolist())
        assert [r.score for r in ranked] == sorted((r.score for r in ranked), reverse=True)
    assert SemanticRetriever().rank(MemoryTask(""), bank, np.zeros(256, np.float32))[1]
    assert SemanticRetriever().rank(MemoryTask("x"), candidates([]), vector)[1]


PROGRAM = {"kind": "program", "skill": "stack", "language": "calls", "steps": [], "roles": {}}


def test_programs_have_places_of_their_own_by_language() -> None:
    acts = ("push", "lift", "turn", "slide")
    effects = [
        {**PROGRAM, "language": language, "steps": [act]}
        for act in acts
        for language in ("calls", "waypoints")
    ]
    words = [f"stack the cubes {word}" for word in ("slowly", "by the edge", "one by one", "from the left")]
    bank = candidates(
        ["stack the cubes"] * 8 + words,
        effect=[*effects, None, None, None, None],
        confidence=[1.0] * 8 + [0.9] * 4,
    )
    rows = [r.row for r in rank("stack the cubes", bank)[0]]
    assert sorted(row % 2 for row in rows if row < 8) == [0, 0, 1, 1]
    assert sum(row >= 8 for row in rows) == 3
    assert not any(r.row < 8 for r in rank("stack the cubes", bank, programs=0)[0])


def test_circumstances_do_not_hide_what_is_asked(open_bank: Any, verdicts: Any) -> None:
    bank = open_bank()
    lesson = Lesson("procedural_hint", "Tighten the clamp before gluing the handle.")
    bank.admit(lesson, verdicts["success"], task="glue the handle onto the mug", trusted=True)
    whole = "You are in the workshop on the second floor; a customer comes at four. {} Report to the office afterwards."
    assert bank.recall(whole.format("Glue the handle onto the mug.")).items
    assert not bank.recall(whole.format("Water the plants in the hall.")).items
