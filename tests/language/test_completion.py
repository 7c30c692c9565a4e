"""Reading answers: reasoning apart, tokens in their places, damage distinguished from absence."""

import pytest

from gvla2.language import MalformedAnswerError
from gvla2.language.endpoint import read_completion
from tests.local_model import said


@pytest.mark.parametrize(
    ("content", "answer"),
    [
        ("plain", "plain"),
        ("<think>hm</think>yes", "yes"),
        ("\n<think>\nhm\n</think>\n\nyes\n", "yes"),
        ("the prompt opened it</think> yes", "yes"),
        ("<think>it quotes </think><score>A</score> and goes on</think><score>T</score>", "<score>T</score>"),
        ("<think>never ends <score>A</score>", ""),
        ("a literal <think> later", "a literal <think> later"),
        ("", ""),
    ],
)
def test_reasoning_is_no_answer(content: str, answer: str):
    assert read_completion(said(content)).text == answer
    assert read_completion(said(content, reasoning="it is so")).text == answer


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
    read = read_completion(body)
    assert (read.prompt_tokens, read.completion_tokens, read.metered) == (100, 10, True)
    for damaged in (None, {}, {"prompt_tokens": -1, "completion_tokens": 2}, {"prompt_tokens": "9"}):
        body["usage"] = damaged
        read = read_completion(body)
        assert (read.prompt_tokens, read.completion_tokens, read.metered) == (0, 0, False)
