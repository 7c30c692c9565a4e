"""The door to the built-in retriever; its ranking is tested in tests/memory/test_hybrid.py."""

from gvla2.memory.contracts import MemoryTask
from gvla2.memory.embedding import StaticEmbedder
from gvla2.testing import candidates, check_retriever
from gvla2_plugins.hybrid import HybridConfig, gvla2_retrievers

TEXTS = (
    "lift the red cube",
    "push the blue block to the goal",
    "press the lamp button",
    "compile the kernel",
)


def test_it_conforms_and_gets_its_options() -> None:
    (hybrid,) = gvla2_retrievers()
    check_retriever(hybrid.build(hybrid.config(name="hybrid")))
    task, vector = MemoryTask("compile the cube"), StaticEmbedder().embed(["compile the cube"])[0]
    strict = hybrid.build(HybridConfig(name="hybrid", min_score=9.0))
    assert "9.00 is required" in strict.rank(task, candidates(TEXTS), vector)[1]
