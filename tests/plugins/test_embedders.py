"""MiniLM in numpy is the model that everybody knows, checked byte for byte; the better of what is there is chosen."""

import importlib.util
import shutil
from pathlib import Path

import numpy as np
import pytest

from gvla2.errors import ConfigurationError, MissingDependencyError
from gvla2.memory.embedding import StaticEmbedder
from gvla2.testing import check_embedder
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
def test_conformance(embedder: MiniLMEmbedder) -> None:
    check_embedder(embedder)
    assert embedder.model == "all-minilm-l6-v2-mean-256-v2"


@needs_model
def test_meaning_orders_texts(vectors: np.ndarray) -> None:
    asked, near, *_, far = vectors
    assert asked.shape == (384,)
    assert asked @ near > (asked @ far) + 0.3


@needs_model
def test_sentence_transformers_says_the_same(vectors: np.ndarray) -> None:
    """What ``SentenceTransformer(model_folder()).encode(TEXTS, normalize_embeddings=True)`` of 6.2.0 said, kept."""
    theirs = np.load(Path(__file__).parents[1] / "data" / "minilm_texts.npy")
    np.testing.assert_allclose(vectors, theirs, atol=2e-6)


@needs_model
def test_other_weights_are_refused(tmp_path: Path) -> None:
    folder = tmp_path / "model"
    shutil.copytree(module.model_folder(), folder)
    with (folder / "model.safetensors").open("r+b") as file:
        file.seek(5_000_000)
        file.write(b"\x01")
    with pytest.raises(ConfigurationError, match="SHA-256"):
        MiniLMEmbedder(folder=folder)
    with pytest.raises(ConfigurationError, match="cannot read"):
        MiniLMEmbedder(folder=tmp_path)


def test_a_missing_package_names_the_extra_and_the_licence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "PACKAGE", "surely_not_installed")
    with pytest.raises(MissingDependencyError, match=r"gvla2\[embed\].*Apache-2.0"):
        MiniLMEmbedder()


def test_the_better_of_what_is_installed_is_chosen_and_said(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    by_name = {component.name: component for component in gvla2_embedders()}
    assert set(by_name) == {"auto", "static", "minilm"}
    auto = by_name["auto"]
    monkeypatch.setattr(module, "PACKAGE", "surely_not_installed")
    with caplog.at_level("INFO"):
        chosen = auto.build(auto.config(name="auto"))
        static = by_name["static"].build(by_name["static"].config(name="static"))
        assert chosen.model == static.model
        assert chosen.for_bank(module.MODEL).model == static.model
    assert "gvla2[embed]" in caplog.text


@needs_model
def test_minilm_is_chosen_where_it_is_installed(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level("INFO"):
        assert module.BestInstalled().model == module.MODEL
    assert "minilm" in caplog.text


@needs_model
def test_a_bank_stays_with_the_model_of_its_vectors() -> None:
    auto = module.BestInstalled()
    for one in (StaticEmbedder(), MiniLMEmbedder()):
        assert auto.for_bank(one.model).model == one.model
    assert auto.for_bank("of another lab").model == module.MODEL
