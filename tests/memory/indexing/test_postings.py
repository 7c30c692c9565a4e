"""BM25 from growable postings, against the formula, through additions, removals, moves and compaction."""

import math
from collections import Counter

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from gvla2.memory.indexing.postings import Postings
from gvla2.memory.meaning.words import tokens, topic_words, wording

WORDS = st.lists(st.sampled_from(["red", "cube", "push", "lamp", "würfel", "拿起"]), max_size=7)


def plain(query: set[str], documents: list[list[str]]) -> list[float]:
    mean = sum(map(len, documents)) / max(len(documents), 1)
    scores = []
    for document in documents:
        total = 0.0
        for word in query:
            holders = sum(word in other for other in documents)
            often = Counter(document)[word]
            idf = math.log(1 + (len(documents) - holders + 0.5) / (holders + 0.5))
            total += idf * often * 2.2 / (often + 1.2 * (0.25 + 0.75 * len(document) / max(mean, 1e-9)))
        scores.append(total)
    return scores


def test_by_hand() -> None:
    postings = Postings()
    postings.add(0, [["red", "cube"], ["red", "red", "block", "here"]], [1, 1])
    found, hits = postings.search(["cube"], [1], 2)
    expected = np.log(2.0) * 2.2 / (1 + 1.2 * (0.25 + 0.75 * 2 / 3))
    np.testing.assert_allclose(found, [expected, 0.0])
    assert hits.tolist() == [1, 0]
    assert postings.search(["nothing"], [1], 2)[0].tolist() == [0.0, 0.0]
    assert Postings().search(["x"], [1], 0)[0].shape == (0,)


@given(
    st.lists(st.tuples(WORDS, st.integers(0, 2)), min_size=1, max_size=12),
    WORDS,
    st.sets(st.integers(0, 11)),
    st.sets(st.integers(0, 2), min_size=1),
    st.booleans(),
)
@settings(max_examples=150, deadline=None)
def test_statistics_are_those_of_the_living_rows_asked_for(
    texts: list[tuple[list[str], int]], query: list[str], dead: set[int], groups: set[int], compacted: bool
) -> None:
    postings = Postings()
    half = len(texts) // 2
    for start, part in ((0, texts[:half]), (half, texts[half:])):
        postings.add(start, [words for words, _ in part], [group for _, group in part])
    rows = list(range(len(texts)))
    for row in dead & set(rows):
        postings.remove(*texts[row])
    living = [row for row in rows if row not in dead]
    if living:  # one of them changes its state
        row = living[0]
        postings.move(texts[row][0], texts[row][1], 2)
        texts[row] = (texts[row][0], 2)
    place = dict(zip(rows, rows, strict=True))
    if compacted:
        new = np.full(len(rows), -1, np.int32)
        new[living] = np.arange(len(living))
        postings.compact(new, len(living))
        place = {row: i for i, row in enumerate(living)}
        postings.add(len(living), [["cube", "late"]], [0])  # it still grows
        texts, living = [*texts, (["cube", "late"], 0)], [*living, len(texts)]
        place[len(texts) - 1] = len(living) - 1
    found, hits = postings.search(query, sorted(groups), len(place))
    asked = [row for row in living if texts[row][1] in groups]
    expected = plain(set(query), [texts[row][0] for row in asked])
    np.testing.assert_allclose([found[place[row]] for row in asked], expected, atol=1e-12)
    assert [hits[place[row]] for row in asked] == [len(set(query) & set(texts[row][0])) for row in asked]


def test_tokens_keep_every_script() -> None:
    assert tokens("Würfel, ROT! ２ cubes") == ["würfel", "rot", "2", "cubes"]
    assert tokens("Cube, RED! 2 cubes_") == ["cube", "red", "2", "cubes_"]
    assert tokens("拿起红色") == ["拿起", "起红", "红色"]
    assert tokens("看USB线") == ["看", "usb", "线"]
    assert tokens("ارفع المكعب") == ["ارفع", "المكعب"]
    assert topic_words("the cube is on the table") == ["cube", "table"]
    assert tokens("") == topic_words("of the") == []


def test_texts_are_bounded_and_odd_characters_taken() -> None:
    assert len(tokens("cube " * 200_000)) < 2000
    assert max(map(len, tokens("x" * 5000 + " ü" + "y" * 5000))) <= 64
    assert tokens("a\x00b\x1b[0mc \ud800") == ["a", "b", "0mc"]


def test_wording_is_equal_for_the_same_words_alone() -> None:
    assert wording("Lift the cube!") == wording("the CUBE: lift, lift")
    assert wording("lift 5 cm") != wording("lift 15 cm")
