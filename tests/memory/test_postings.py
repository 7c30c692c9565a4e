"""Shares of a query's information, against the formula, through additions, death of rows and compaction."""

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from gvla2.memory.index import UNSEEN, Postings

TERMS = st.frozensets(st.sampled_from(["red", "cube", "push", "lamp", "würfel", "拿起"]), max_size=6)


def plain(query: frozenset[str], documents: list[frozenset[str]]) -> list[float]:
    idf = {}
    for term in query:
        holders = sum(term in document for document in documents)
        idf[term] = math.log(1 + (len(documents) + UNSEEN - holders + 0.5) / (holders + 0.5))
    total = sum(idf.values())
    return [sum(idf[term] for term in query & document) / total if total else 0.0 for document in documents]


def test_by_hand() -> None:
    postings = Postings()
    postings.add(0, ["red", "cube"])
    postings.add(1, ["red", "block"])
    found = postings.coverage(["red", "cube"], np.ones(2, np.bool_))
    red, cube = math.log(1 + 10.5 / 2.5), math.log(1 + 11.5 / 1.5)
    np.testing.assert_allclose(found, [1.0, red / (red + cube)])
    assert postings.coverage(["nothing"], np.ones(2, np.bool_)).tolist() == [0.0, 0.0]
    assert postings.coverage([], np.ones(2, np.bool_)).tolist() == [0.0, 0.0]
    assert Postings().coverage(["x"], np.zeros(0, np.bool_)).shape == (0,)


@given(st.lists(TERMS, min_size=1, max_size=12), TERMS, st.sets(st.integers(0, 11)))
@settings(max_examples=150, deadline=None)
def test_statistics_are_those_of_the_rows_served(
    texts: list[frozenset[str]], query: frozenset[str], hidden: set[int]
) -> None:
    postings = Postings()
    for row, text in enumerate(texts):
        postings.add(row, text)
    served = np.array([row not in hidden for row in range(len(texts))])
    expected = plain(query, [text for row, text in enumerate(texts) if served[row]])
    found = postings.coverage(query, served)[served]
    np.testing.assert_allclose(found, expected, atol=1e-12)
    postings.add(len(served), query)  # what was looked at may grow
