"""The door to the built-in retrievers; their ranking is tested in tests/memory/test_retrieval.py."""

import pytest

from gvla2.memory.contracts import MemoryTask
from gvla2.memory.embedding import StaticEmbedder
from gvla2.memory.retrieval import HybridRetriever, SemanticRetriever
from gvla2.testing import candidates, check_retriever
from gvla2_plugins.hybrid import HybridConfig, SemanticConfig, gvla2_retrievers

TEXTS = (
    "lift the red cube",
    "push the blue block to the goal",
    "press the lamp button",
    "compile the kernel",
)


def test_two_retrievers_by_name() -> None:
    built = {c.name: c.build(c.config(name=c.name)) for c in gvla2_retrievers()}
    assert {name: type(retriever) for name, retriever in built.items()} == {
        "hybrid": HybridRetriever,
        "semantic": SemanticRetriever,
    }


@pytest.mark.parametrize("component", gvla2_retrievers(), ids=lambda component: component.name)
def test_conformance(component) -> None:
    check_retriever(component.build(component.config(name=component.name)))


def test_options_reach_the_retriever() -> None:
    hybrid, semantic = gvla2_retrievers()
    task, vector = MemoryTask("compile the cube"), StaticEmbedder().embed(["compile the cube"])[0]
    strict = hybrid.build(HybridConfig(name="hybrid", min_score=9.0))
    assert "9.00 is required" in strict.rank(task, candidates(TEXTS), vector)[1]
    one = semantic.build(SemanticConfig(name="semantic", top_k=1))
    assert len(one.rank(task, candidates(TEXTS), vector)[0]) == 1
