"""The score of an answer: one number, however the server cuts the answer into tokens."""

import math
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gvla2.language.endpoint import read_completion
from gvla2.language.score_tokens import LETTERS, TokenScore, phi, score_answer
from tests.local_model import said


@pytest.mark.parametrize(
    ("text", "letter"),
    [
        ("<score>C</score>", "C"),
        ("<score> c </score>", "C"),
        ("<SCORE>C</Score>", "C"),
        ("<score>\n**C**\n</score>", "C"),
        ('<score>"C"</score>.', "C"),
        ("it says <score>A</score>, which is wrong: <score>C</score>", "C"),
        ("cut short <score>C", "C"),
        ("größer, 大きい <score>C</score>", "C"),
    ],
)
def test_the_last_tag_counts(text: str, letter: str):
    assert score_answer(text) == TokenScore(phi(letter), 0.0, "tag")


@pytest.mark.parametrize(
    "text",
    ["", "A", "score: A", "<score></score>", "<score>U</score>", "<score>AB</score>", "<score>A+</score>",
     "<score>A</score> or rather <score>?</score>", "<score>Ａ</score>", "<score>ſ</score>", "<score>0.9</score>",
     "<score>A is the best letter there is, without doubt</score>"],
)  # fmt: skip
def test_without_a_valid_letter_it_is_the_midpoint(text: str):
    assert score_answer(text) == TokenScore(0.5, 0.0, "midpoint")


WORDS = st.sampled_from(["", "Good. ", "Schön größer ", "見た。", "earlier <score>T</score> ", "a < b; "])
ODDS = st.dictionaries(st.sampled_from(LETTERS), st.floats(0.01, 1.0), min_size=1, max_size=8)


@settings(max_examples=150)
@given(
    prefix=WORDS,
    odds=ODDS,
    valid=st.floats(0.51, 1.0),
    chosen=st.integers(0, 7),
    blanks=st.tuples(st.sampled_from(["", " ", "\n"]), st.sampled_from(["", " "])),
    cuts=st.sets(st.integers(1, 70), max_size=25),
    lower=st.booleans(),
    ending=st.sampled_from(["", "\n", "<|im_end|>"]),
)
def test_any_tokenisation_gives_the_same_score(prefix, odds, valid, chosen, blanks, cuts, lower, ending):
    """The answer is cut anywhere; what might stand in the letter's token is the same text with other letters."""
    total = math.fsum(odds.values()) / valid
    odds = {v: p / total for v, p in odds.items()}
    letter = sorted(odds)[chosen % len(odds)]
    before, after = f"{prefix}<score>{blanks[0]}", f"{blanks[1]}</score>"
    at = len(before.encode())
    spelt = (before + letter + after).encode()
    edges = [0, *sorted(c for c in cuts if c < len(spelt)), len(spelt)]
    tokens = []
    for a, b in pairwise(edges):
        piece = spelt[a:b]
        if not a <= at < b:
            # What might have stood elsewhere must not matter, letters least of all.
            tokens.append((piece, {piece.decode(errors="replace"): 0.5, "A": 0.5}))
            continue
        head, tail = spelt[a:at].decode(errors="replace"), spelt[at + 1 : b].decode()
        here: dict[str, float] = {f"{head}{tail}?!": 1 - valid}
        for v, p in odds.items():
            if lower and v != letter:
                here[f"{head}{v}{tail}"], here[f"{head}{v.lower()}{tail}"] = p / 4, 3 * p / 4
            else:
                here[f"{head}{v}{tail}"] = p
        tokens.append((piece, here))
    if ending:
        tokens.append((ending, {}))
    answer = read_completion(said(spelt.decode(), tokens))
    score = score_answer(answer.text, answer.tokens)
    assert score.source == "distribution"
    assert score.mass == pytest.approx(valid)
    assert score.value == pytest.approx(math.fsum(p * phi(v) for v, p in odds.items()) / valid)


def one(text: str, *alternatives: tuple[str, float]) -> TokenScore:
    """The score of an answer whose letter stands in one token with these log-probabilities."""
    stream = ((b"<score>", {}), (text.encode(), dict(alternatives)), (b"</score>", {}))
    return score_answer("<score>B</score>", stream)


def test_tokens_of_the_reasoning_and_of_another_answer_are_no_evidence() -> None:
    thought = [(b"maybe <score>", {}), (b"A", {"A": 0.0}), (b"</score></think>\n\n<score>", {})]
    score = score_answer("<score>B</score>", [*thought, (b"B", {"B": 0.0}), (b"</score><|im_end|>", {})])
    assert (score.value, score.source) == (phi("B"), "distribution")
    assert one("T", ("T", 0.0)) == TokenScore(phi("B"), 0.0, "tag")


def test_below_half_the_mass_the_letter_counts_as_written():
    score = one("B", ("B", math.log(0.2)), ("T", math.log(0.25)), ("because", math.log(0.5)))
    assert score.source == "tag"
    assert score.value == phi("B")
    assert score.mass == pytest.approx(0.45)


@given(st.lists(st.tuples(st.text(max_size=6), st.floats()), min_size=1, max_size=12), st.text(max_size=30))
def test_the_score_is_a_share_whatever_the_server_sends(alternatives, text):
    answer = f"{text}<score>B</score>"
    score = score_answer(answer, [(answer.encode(errors="replace"), dict(alternatives))])
    assert 0.0 <= score.value <= 1.0
    assert 0.0 <= score.mass <= 1.0
