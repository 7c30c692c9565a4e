"""The default embedder, and one model a bank: what has to be embedded is embedded once, whoever opens the bank."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from gvla2.errors import ConfigurationError, MissingDependencyError
from gvla2.memory import embedding as module
from gvla2.memory.bank import KnowledgeBank
from gvla2.memory.embedding import StaticEmbedder
from gvla2.memory.index import STATES
from gvla2.memory.store import Store
from tests.memory.looking import look


def test_golden_values() -> None:
    """Stored vectors must mean the same on every machine and in every release."""
    embedder = StaticEmbedder()
    assert embedder.model == GOLDEN_MODEL
    np.testing.assert_allclose(embedder.embed(["Pick up the red cube"])[0, :4], GOLDEN_VECTOR, atol=1e-5)


GOLDEN_MODEL = "wordllama-l2-256-314a7133-v2"
GOLDEN_VECTOR = [0.039041, -0.015757, -0.076823, -0.045882]


def test_synonyms_are_heard() -> None:
    asked, near, far = StaticEmbedder().embed(["raise the cup", "lift the mug", "compile the linux kernel"])
    assert asked @ near > (asked @ far) + 0.1


@pytest.mark.parametrize(
    ("query", "known"),
    [
        ("Сколько времени?", False),
        ("明日の天気は", False),
        ("Nimm den Würfel", True),
        ("the cup 'кубок'", True),
        ("", True),
    ],
)
def test_a_query_in_another_script_is_not_known(query: str, known: bool) -> None:
    assert StaticEmbedder().knows(query) is known


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"Cannot read the static embedder.*pip install"):
        StaticEmbedder(tmp_path)
    monkeypatch.setattr(module, "PACKAGE", "surely_not_installed")
    with pytest.raises(MissingDependencyError, match=r"pip install.*MIT"):
        StaticEmbedder()


class Counting:
    """Three numbers a text, and how many texts it was asked for."""

    def __init__(self, model: str) -> None:
        self.model, self.texts = model, 0

    def embed(self, texts: Sequence[str]) -> NDArray[np.float32]:
        self.texts += sum(map(bool, texts))
        rows = np.array([[len(text), text.count("e"), 1.0] for text in texts], np.float32).reshape(-1, 3)
        return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True), np.float32)


def asked(path: Path, embedder: Counting | None) -> int:
    """Texts that a process embeds until it has recalled; one of them is the query."""
    with KnowledgeBank(path, embedder=embedder) as bank:
        bank.recall("lift the cup")
        return embedder.texts if embedder else 0


@pytest.fixture
def path(tmp_path: Path) -> Path:
    with KnowledgeBank(tmp_path / "one.db", embedder=Counting("a")) as bank:
        for text in ("Lift the cup by its rim.", "Pour slowly."):
            bank.admit(text, task="lift the cup", trusted=True)
    return tmp_path / "one.db"


def models(path: Path) -> set[str]:
    with Store.open(path) as store, store.reading("default") as view:
        assert look(store, "default").verify() == []
        return {change.model for change in view.embedded(STATES)}


def test_what_was_learned_is_not_embedded_again(path: Path) -> None:
    assert asked(path, Counting("a")) == 1


def test_a_named_embedder_replaces_the_vectors_once(path: Path) -> None:
    assert [asked(path, Counting("b")) for _ in range(2)] == [5, 1]
    assert models(path) == {"b"}


def test_the_static_table_replaces_no_vectors(path: Path) -> None:
    asked(path, None)
    assert models(path) == {"a"}
