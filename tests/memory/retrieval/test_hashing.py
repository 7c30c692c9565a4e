"""The hash embedder against its own rule, said plainly: stored vectors hang on every bit of it."""

import math
import unicodedata
from collections import Counter
from zlib import crc32

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gvla2.memory.retrieval.hashing import HashEmbedder

TEXTS = st.one_of(
    st.text(max_size=80),
    st.lists(
        st.sampled_from(["cube", "Cube", "küche", "拿起方块", "ﬁx", "a", "9", "^$", "куб"]), max_size=40
    ).map(" ".join),
)


def plain(text: str, dimension: int, shortest: int, longest: int) -> np.ndarray:
    spelt = ""
    for letter in unicodedata.normalize("NFKD", text.casefold()):
        category = unicodedata.category(letter)
        spelt += letter if category[0] in "LN" else "" if category == "Mn" else " "
    grams: Counter[int] = Counter()
    for word in spelt.split():
        marked = f"^{word}$"
        for size in range(shortest, longest + 1):
            for i in range(len(marked) - size + 1):
                grams[crc32(marked[i : i + size].encode("utf-8", "surrogatepass"))] += 1
    vector = np.zeros(dimension)
    for code, often in grams.items():
        vector[(code & 0x7FFFFFFF) % dimension] += math.copysign(math.sqrt(often), code - (1 << 31) + 0.5)
    length = np.sqrt(np.einsum("nd,nd->n", vector[None], vector[None]))[0]
    return (vector / (length or 1.0)).astype(np.float32)


@given(TEXTS, st.sampled_from([(512, 3, 5), (64, 1, 2), (100, 4, 9)]))
@settings(max_examples=200, deadline=None)
def test_every_bit_is_that_of_the_rule(text: str, setting: tuple[int, int, int]) -> None:
    assert HashEmbedder(*setting).embed([text])[0].tobytes() == plain(text, *setting).tobytes()


def test_together_is_as_alone_and_nothing_is_zero() -> None:
    texts = ["lift the red cube", "", "   ", "x" * 5000, "名" * 3000, "lift the red cube " * 60]
    embedder = HashEmbedder()
    together = embedder.embed(texts)
    for text, row in zip(texts, together, strict=True):
        assert row.tobytes() == embedder.embed([text])[0].tobytes() == plain(text, 512, 3, 5).tobytes()
    assert not together[1:3].any()
    np.testing.assert_allclose(np.linalg.norm(together[[0, 3, 4, 5]], axis=1), 1.0, atol=1e-6)


@pytest.mark.parametrize("text", ["a", "ab", "^", "$"])
def test_words_shorter_than_a_gram(text: str) -> None:
    assert HashEmbedder(512, 3, 5).embed([text])[0].tobytes() == plain(text, 512, 3, 5).tobytes()
