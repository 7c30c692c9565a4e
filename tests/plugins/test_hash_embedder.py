"""Stored vectors must mean the same on every machine and in every release."""

import subprocess
import sys
import unicodedata
from collections import Counter
from zlib import crc32

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gvla2.errors import ConfigurationError
from gvla2.memory.retrieval.hashing import HashEmbedder
from gvla2_plugins.hash_embedder import gvla2_embedders


def test_golden_values() -> None:
    embedder = HashEmbedder()
    assert embedder.model == "hash-char-3-5-512-v1"
    english, chinese = embedder.embed(["Pick up the red cube", "拿起红色方块"])
    assert signature(english) == GOLDEN_ENGLISH
    assert signature(chinese) == GOLDEN_CHINESE


def signature(vector: np.ndarray) -> tuple[int, list[int]]:
    """How many entries are set, and the first ones, each as its place with its sign."""
    places = np.flatnonzero(vector)
    return len(places), [int(p * np.sign(vector[p])) for p in places[:8]]


GOLDEN_ENGLISH = (33, [11, -17, -19, 39, 48, 81, -83, 142])
GOLDEN_CHINESE = (15, [11, -73, 82, -113, -142, 172, 173, -225])


def plain(text: str, dimension: int = 512) -> np.ndarray:
    """The definition, one n-gram at a time."""
    letters = unicodedata.normalize("NFKD", text.casefold())
    kept = "".join(
        c if unicodedata.category(c)[0] in "LN" else "" if unicodedata.category(c) == "Mn" else " "
        for c in letters
    )
    grams: Counter[str] = Counter()
    for word in kept.split():
        marked = f"^{word}$"
        for size in (3, 4, 5):
            grams.update(marked[i : i + size] for i in range(len(marked) - size + 1))
    row = np.zeros(dimension)
    for gram, count in grams.items():
        code = crc32(gram.encode("utf-8", "surrogatepass"))
        row[(code & 0x7FFFFFFF) % dimension] += (1.0 if code >> 31 else -1.0) * count**0.5
    return row / max(float(np.linalg.norm(row)), 1e-12)


@given(st.text(max_size=60) | st.text("aab cd'é", max_size=200))
@settings(max_examples=150, deadline=None)
def test_vectors_are_those_of_the_definition(text: str) -> None:
    np.testing.assert_allclose(HashEmbedder().embed([text])[0], plain(text), atol=1e-7)


def test_another_process_agrees() -> None:
    program = (
        "from gvla2.memory.retrieval.hashing import HashEmbedder as H;"
        "print(H().embed(['Grüße, 世界'])[0].tobytes().hex())"
    )
    other = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert other.stdout.strip() == HashEmbedder().embed(["Grüße, 世界"])[0].tobytes().hex()


@given(st.lists(st.text(max_size=60), max_size=5))
@settings(max_examples=60, deadline=None)
def test_rows_are_unit_or_zero(texts: list[str]) -> None:
    rows = HashEmbedder().embed(texts)
    assert rows.shape == (len(texts), 512)
    assert rows.dtype == np.float32
    lengths = np.linalg.norm(rows, axis=1)
    assert np.all((np.abs(lengths - 1) < 1e-5) | (lengths == 0))


def test_texts_without_letters_give_zero_rows() -> None:
    assert not HashEmbedder().embed(["", "  \n", "?!… –"]).any()


def test_case_accents_and_punctuation_make_no_difference() -> None:
    first, second = HashEmbedder().embed(["Würfel, ROT!", "wurfel rot"])
    assert first @ second == pytest.approx(1.0, abs=1e-6)


def test_likeness_orders_texts() -> None:
    asked, near, typo, far = HashEmbedder().embed(
        ["pick up the red cube", "pick up the blue cube", "pikc up teh red cueb", "compile the linux kernel"]
    )
    assert asked @ near > 0.5
    assert asked @ typo > 0.3
    assert abs(asked @ far) < 0.25


def test_any_text_is_taken() -> None:
    assert np.isfinite(HashEmbedder().embed(["lone \ud800 surrogate", "a" * 100_000])).all()


def test_options() -> None:
    (component,) = gvla2_embedders()
    small = component.build(component.config(name="hash", dimension=64, shortest=2, longest=3))
    assert small.embed(["cube"]).shape == (1, 64)
    assert small.model != HashEmbedder().model
    with pytest.raises(ConfigurationError, match="shortest"):
        component.build(component.config(name="hash", shortest=4, longest=3))
