"""Reading answers: reasoning apart, tokens in their places, damage distinguished from absence."""

import pytest

from gvla2.language import MalformedAnswerError, Usage
from gvla2.language.endpoint import read_completion
from tests.local_model import said


@pytest.mark.parametrize(
    ("content", "reasoning", "answer"),
    [
        ("plain", "", "plain"),
        ("<think>hm</think>yes", "hm", "yes"),
        ("\n<think>\nhm\n</think>\n\nyes\n", "hm", "yes"),
        ("the prompt opened it</think> yes", "the prompt opened it", "yes"),
        ("<think>it quotes </think><score>A</score> and goes on</think><score>T</score>",
         "it quotes </think><score>A</score> and goes on", "<score>T</score>"),
        ("<think>never ends <score>A</score>", "never ends <score>A</score>", ""),
        ("a literal <think> later", "", "a literal <think> later"),
        ("", "", ""),
    ],
)  # fmt: skip
def test_reasoning_is_kept_apart(content: str, reasoning: str, answer: str):
    read = read_completion(said(content))
    assert (read.reasoning, read.text) == (reasoning, answer)


def test_reasoning_in_a_field_of_its_own():
    read = read_completion(said("yes", reasoning="it is so"))
    assert (read.reasoning, read.text) == ("it is so", "yes")


@pytest.mark.parametrize(
    "logprobs",
    [None, [], 3, {"content": None}, {"content": "A"}, {"content": [None]}, {"content": [{"token": 3}]},
     {"content": [{"token": "A", "bytes": [400, -1], "top_logprobs": 3}]}],
)  # fmt: skip
def test_damaged_probabilities_do_not_lose_the_answer(logprobs: object):
    body = said("A")
    body["choices"][0]["logprobs"] = logprobs
    assert read_completion(body).text == "A"


@pytest.mark.parametrize(
    "body",
    [
        [],
        None,
        {},
        {"choices": []},
        {"choices": None},
        {"choices": ["x"]},
        {"choices": [{}]},
        {"choices": [{"message": "x"}]},
        {"choices": [{"message": {"content": 3}}]},
        {"error": {"message": "overloaded"}},
    ],
)
def test_what_is_no_completion_is_malformed(body: object):
    with pytest.raises(MalformedAnswerError):
        read_completion(body)


def test_usage_is_counted_or_said_to_be_unknown():
    body = said("A")
    assert read_completion(body).usage == Usage(100, 10, metered=True)
    for damaged in (None, {}, {"prompt_tokens": -1, "completion_tokens": 2}, {"prompt_tokens": "9"}):
        body["usage"] = damaged
        assert read_completion(body).usage == Usage(0, 0, metered=False)
