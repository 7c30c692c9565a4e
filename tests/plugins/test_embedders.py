"""MiniLM in numpy is the model that everybody knows; the better of what is there is chosen."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from gvla2.errors import ConfigurationError, MissingDependencyError
from gvla2_plugins.embedders import gvla2_embedders
from gvla2_plugins.embedders import minilm as module
from gvla2_plugins.embedders.minilm import MiniLMEmbedder

needs_model = pytest.mark.skipif(
    importlib.util.find_spec(module.PACKAGE) is None, reason="the extra [embed] is not installed"
)
TEXTS = [
    "Pick up the red cube",
    "lift the crimson block",
    "拿起红色方块",
    "word " * 400,
    "compile the linux kernel",
]


@pytest.fixture(scope="module")
def embedder() -> MiniLMEmbedder:
    return MiniLMEmbedder()


@pytest.fixture(scope="module")
def vectors(embedder: MiniLMEmbedder) -> np.ndarray:
    """(5, 384) what it makes of the texts."""
    return embedder.embed(TEXTS)


@needs_model
def test_meaning_orders_texts(vectors: np.ndarray) -> None:
    asked, near, *_, far = vectors
    assert asked.shape == (384,)
    assert asked @ near > (asked @ far) + 0.3


@needs_model
def test_sentence_transformers_says_the_same(embedder: MiniLMEmbedder, vectors: np.ndarray) -> None:
    """What ``SentenceTransformer(folder).encode(TEXTS, normalize_embeddings=True)`` of 6.2.0 said, kept."""
    theirs = np.load(Path(__file__).parents[1] / "data" / "minilm_texts.npy")
    np.testing.assert_allclose(vectors, theirs, atol=2e-6)
    assert (
        embedder.model == "all-minilm-l6-v2-mean-256-v2"
    )  # stored vectors are compared with those of one model


@needs_model
def test_files_that_cannot_be_read_are_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="Cannot read"):
        MiniLMEmbedder(folder=tmp_path)


def test_a_missing_package_names_the_extra_and_the_licence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "PACKAGE", "surely_not_installed")
    with pytest.raises(MissingDependencyError, match=r"gvla2\[embed\].*Apache-2.0"):
        MiniLMEmbedder()


@pytest.mark.parametrize(
    ("package", "name"),
    [("surely_not_installed", "static"), pytest.param(module.PACKAGE, "minilm", marks=needs_model)],
)
def test_the_better_of_what_is_installed_is_chosen(
    monkeypatch: pytest.MonkeyPatch, package: str, name: str
) -> None:
    by_name = {component.name: component for component in gvla2_embedders()}
    monkeypatch.setattr(module, "PACKAGE", package)
    auto, other = (by_name[one].build(by_name[one].config(name=one)) for one in ("auto", name))
    assert auto.model == other.model
