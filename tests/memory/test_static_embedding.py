"""The default embedder: an average of token vectors, from files that are there or are named as missing."""

from pathlib import Path

import numpy as np
import pytest

from gvla2.errors import ConfigurationError, MissingDependencyError
from gvla2.memory import embedding as module
from gvla2.memory.embedding import StaticEmbedder
from gvla2.testing import check_embedder


def test_conformance() -> None:
    check_embedder(StaticEmbedder())


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
    with pytest.raises(ConfigurationError, match=r"cannot read its table.*pip install"):
        StaticEmbedder(tmp_path)
    monkeypatch.setattr(module, "PACKAGE", "surely_not_installed")
    with pytest.raises(MissingDependencyError, match=r"pip install.*MIT"):
        StaticEmbedder()
