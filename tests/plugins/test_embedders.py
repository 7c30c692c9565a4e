"""MiniLM in numpy is the model that everybody knows, checked byte for byte; the better of what is there is chosen."""

import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from gvla2.errors import ConfigurationError, MissingDependencyError
from gvla2.testing import check_embedder
from gvla2_plugins.embedders import choosing, gvla2_embedders
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


@needs_model
def test_conformance(embedder: MiniLMEmbedder) -> None:
    check_embedder(embedder)
    assert embedder.model == "all-minilm-l6-v2-mean-256-v1"


@needs_model
def test_meaning_orders_texts(embedder: MiniLMEmbedder) -> None:
    asked, near, *_, far = embedder.embed(TEXTS)
    assert asked.shape == (384,)
    assert asked @ near > (asked @ far) + 0.3


@needs_model
def test_batches_make_no_difference(embedder: MiniLMEmbedder) -> None:
    small = MiniLMEmbedder(batch=2)
    np.testing.assert_allclose(small.embed(TEXTS), embedder.embed(TEXTS), atol=1e-5)


@needs_model
@pytest.mark.timeout(300)
def test_sentence_transformers_says_the_same(embedder: MiniLMEmbedder, tmp_path: Path) -> None:
    if importlib.util.find_spec("sentence_transformers") is None:
        pytest.skip("sentence-transformers, which it is compared with, is not installed")
    # In a process of its own: it imports torch, and warns as it likes.
    program = (
        "import sys, numpy; from sentence_transformers import SentenceTransformer;"
        "model = SentenceTransformer(sys.argv[1], device='cpu');"
        "numpy.save(sys.argv[2], model.encode(sys.argv[3:], normalize_embeddings=True))"
    )
    out = tmp_path / "theirs.npy"
    subprocess.run(
        [sys.executable, "-W", "ignore", "-c", program, str(module.model_folder()), str(out), *TEXTS],
        check=True,
        capture_output=True,
        env={**os.environ, "HF_HUB_OFFLINE": "1"},
    )
    np.testing.assert_allclose(embedder.embed(TEXTS), np.load(out), atol=2e-6)


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


def test_options() -> None:
    with pytest.raises(ConfigurationError, match="batch"):
        MiniLMEmbedder(batch=0)


def test_the_better_of_what_is_installed_is_chosen_and_said(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    by_name = {component.name: component for component in gvla2_embedders()}
    assert set(by_name) == {"auto", "static", "minilm"}
    auto = by_name["auto"]
    monkeypatch.setattr(choosing, "PACKAGE", "surely_not_installed")
    with caplog.at_level("INFO"):
        chosen = auto.build(auto.config(name="auto"))
        static = by_name["static"].build(by_name["static"].config(name="static"))
        assert chosen.model == static.model
        assert chosen.for_bank(choosing.MODEL).model == static.model
    assert "gvla2[embed]" in caplog.text


@needs_model
def test_minilm_is_chosen_where_it_is_installed(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level("INFO"):
        assert choosing.BestInstalled().model == choosing.MODEL
    assert "minilm" in caplog.text


@needs_model
def test_a_bank_stays_with_the_model_of_its_vectors() -> None:
    auto = choosing.BestInstalled()
    for one in (choosing.StaticEmbedder(), MiniLMEmbedder()):
        assert auto.for_bank(one.model).model == one.model
    assert auto.for_bank("of another lab").model == choosing.MODEL
