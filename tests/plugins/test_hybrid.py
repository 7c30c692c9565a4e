"""Ranking and abstention of the hybrid retriever."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gvla2.memory.contracts import Candidates, MemoryTask, Ranked
from gvla2_plugins.hash_embedder.embedder import HashEmbedder
from gvla2_plugins.hybrid import HybridConfig, gvla2_retrievers
from gvla2_plugins.hybrid.words import bm25, coverage, tokens, topic_words


def candidates(*texts: str, **columns: Any) -> Candidates:
    n = len(texts)
    return Candidates(
        ids=[f"r{i}" for i in range(n)],
        contents=list(texts),
        queries=[""] * n,
        embeddings=HashEmbedder().embed(texts),
        confidence=np.asarray(columns.get("confidence", np.full(n, 0.9))),
        outcomes=columns.get("outcomes", ["verified_success"] * n),
        types=columns.get("types", ["procedural_hint"] * n),
        ages=np.asarray(columns.get("ages", np.zeros(n))),
        usage=np.asarray(columns.get("usage", np.zeros(n, dtype=np.int64))),
        conflicts=np.asarray(columns.get("conflicts", np.zeros(n, dtype=np.int64))),
        signatures=columns.get("signatures", [{}] * n),
        skills=columns.get("skills", [""] * n),
    )


def rank(query: str, bank: Candidates, skill: str = "", **options: Any) -> tuple[list[Ranked], str]:
    (component,) = gvla2_retrievers()
    retriever = component.build(component.config(name="hybrid", **options))
    ranked, reason = retriever.rank(MemoryTask(query, skill=skill), bank, HashEmbedder().embed([query])[0])
    return list(ranked), reason


TEXTS = ("lift the red cube", "push the blue block to the goal", "press the lamp button")


@pytest.mark.parametrize(
    ("query", "row"), [("raise the red cube", 0), ("push the block", 1), ("the lamp's button", 2)]
)
def test_the_right_record_comes_first(query: str, row: int) -> None:
    ranked, reason = rank(query, candidates(*TEXTS))
    assert ranked[0].row == row
    assert reason == ""
    assert ranked[0].score == pytest.approx(sum(ranked[0].terms.values()))


def test_text_relevance_is_half_words_half_vector() -> None:
    bank = candidates(*TEXTS)
    query = "push the red cube to the goal"
    lexical = bm25(topic_words(query), [topic_words(t) for t in TEXTS])
    cosine = bank.embeddings @ HashEmbedder().embed([query])[0]
    for found in rank(query, bank)[0]:
        expected = 0.5 * lexical[found.row] / lexical.max() + 0.5 * cosine[found.row]
        assert found.terms["r_text"] == pytest.approx(expected, abs=1e-6)


def test_nothing_relevant_says_what_was_nearest() -> None:
    ranked, reason = rank("bake a chocolate cake", candidates(*TEXTS))
    assert ranked == []
    assert "about this" in reason


def test_relevant_and_unreliable_says_so() -> None:
    bank = candidates(*TEXTS, confidence=[0.0] * 3, ages=[60.0] * 3)
    ranked, reason = rank("press the lamp button", bank)
    assert ranked == []
    assert "reliable" in reason
    assert rank("press the lamp button", bank, min_score=0.5)[0]


def test_better_evidence_wins_among_equal_words() -> None:
    bank = candidates("lift the cube", "lift the cube", "lift the cube", confidence=[0.9, 0.9, 0.2],
                      usage=[0, 30, 0], conflicts=[2, 0, 0], ages=[0.0, 0.0, 0.0])  # fmt: skip
    assert [r.row for r in rank("lift the cube", bank, min_score=0.0)[0]] == [1, 0, 2]


def test_ties_are_settled_by_id_and_top_k_cuts() -> None:
    bank = candidates(*["lift the cube"] * 6)
    assert [r.row for r in rank("lift the cube", bank)[0]] == [0, 1, 2]
    assert len(rank("lift the cube", bank, top_k=5)[0]) == 5


def test_skills_narrow_where_both_are_known() -> None:
    bank = candidates("lift it", "lift it", "lift it", skills=["pick", "place", ""])
    assert [r.row for r in rank("lift it", bank, skill="pick")[0]] == [0, 2]
    assert len(rank("lift it", bank)[0]) == 3
    assert "push" in rank("lift it", candidates("lift it", skills=["pick"]), skill="push")[1]


def test_vectors_of_another_model_do_not_count() -> None:
    bank = candidates("lift the cube", "lift the cube")
    bank.embeddings[0] = 0
    bank.embeddings[1] = np.nan
    assert len(rank("lift the cube", bank)[0]) == 2


def test_tokens_keep_every_script() -> None:
    assert tokens("Würfel, ROT! ２ cubes") == ["würfel", "rot", "2", "cubes"]
    assert tokens("拿起红色") == ["拿起", "起红", "红色"]
    assert tokens("看USB线") == ["看", "usb", "线"]
    assert tokens("ارفع المكعب") == ["ارفع", "المكعب"]
    assert topic_words("the cube is on the table") == ["cube", "table"]
    assert tokens("") == topic_words("of the") == []


def test_bm25_against_the_formula_by_hand() -> None:
    documents = [["red", "cube"], ["red", "red", "block", "here"]]
    # idf(cube) = ln(1 + 1.5 / 1.5); tf part: 2.2 / (1 + 1.2 * (.25 + .75 * 2 / 3))
    expected = np.log(2.0) * 2.2 / (1 + 1.2 * (0.25 + 0.75 * 2 / 3))
    np.testing.assert_allclose(bm25(["cube"], documents), [expected, 0.0])
    assert bm25(["x"], []).shape == (0,)


@given(
    st.lists(st.sampled_from(["red", "cube", "push", "a"]), max_size=6),
    st.lists(st.text(max_size=8), max_size=6),
)
@settings(max_examples=60, deadline=None)
def test_coverage_and_bm25_stay_in_range(query: list[str], document: list[str]) -> None:
    assert 0.0 <= coverage(query, document) <= 1.0
    assert np.all(bm25(query, [document, query]) >= 0.0)


def test_configuration_is_light_and_typed() -> None:
    config = HybridConfig()
    assert (config.bm25_weight, config.cosine_weight, config.top_k) == (0.5, 0.5, 3)
    assert (config.min_relevance, config.min_score, config.weights.verified) == (0.08, 1.2, 0.3)


def test_a_record_from_another_geometry_does_not_apply() -> None:
    flat = {"theme_height": 0.02, "theme_length": 0.05, "objects": 1.0}
    bank = candidates(
        "lift the cube", "lift the cube", signatures=[flat, {"theme_height": 0.05, "objects": 9.0}]
    )
    (component,) = gvla2_retrievers()
    retriever = component.build(component.config(name="hybrid"))
    task = MemoryTask("lift the cube", {"theme_height": 0.055, "theme_length": 0.05, "objects": 1.0})
    ranked, _ = retriever.rank(task, bank, HashEmbedder().embed(["lift the cube"])[0])
    assert [r.row for r in ranked] == [1]
    alone = candidates("lift the cube", signatures=[flat])
    ranked, reason = retriever.rank(task, alone, HashEmbedder().embed(["lift the cube"])[0])
    assert not ranked
    assert "other geometry" in reason
