"""Answers kept by what was asked: found again, never trusted blindly, never in the way."""

from pathlib import Path
from typing import Any

import diskcache
import pytest

from gvla2.language import Completion, Endpoint, EndpointOptions, Request
from gvla2.testing.language import LocalModel, said

ASK = [{"role": "user", "content": "Well?"}]


def options(server: LocalModel, folder: Path, **more: Any) -> EndpointOptions:
    return EndpointOptions(**{"base_url": server.url, "model": "m", "cache": str(folder), **more})


def ask(endpoint: Endpoint, **more: Any) -> Completion:
    return endpoint.complete(Request(ASK, **more), purpose="plan")


def counting():
    """Answers with how many questions came before, this one included."""
    seen = []

    def answering(request: dict[str, Any]) -> dict[str, Any]:
        seen.append(request)
        return said(str(len(seen)))

    return answering


def test_the_same_question_is_asked_once_and_costs_once(tmp_path: Path):
    with LocalModel(counting()) as model:
        first = ask(Endpoint(options(model, tmp_path)))
        again = Endpoint(options(model, tmp_path))
        second = ask(again)
    assert (first.text, first.cached) == ("1", False)
    assert (second.text, second.cached, second.latency) == ("1", True, 0.0)
    counts = again.ledger.totals()["plan"]
    assert (counts["cached"], counts["calls"], counts["prompt_tokens"], counts["seconds"]) == (1, 0, 0, 0)


@pytest.mark.parametrize(
    "change", [{"model": "n"}, {"temperature": 0.7}, {"max_tokens": 9}, {"extra": {"top_k": 1}}], ids=str
)
def test_another_question_is_another_answer(tmp_path: Path, change: dict[str, Any]):
    with LocalModel(counting()) as model:
        ask(Endpoint(options(model, tmp_path)))
        assert not ask(Endpoint(options(model, tmp_path, **change))).cached
        for request in (
            Request(ASK, seed=1, temperature=0.1),
            Request(ASK, logprobs=True),
            Request(ASK, schema={"type": "object"}),
            Request(ASK, schema={"type": "array"}),
            Request(ASK, grammar='root ::= "a"'),
            Request([{"role": "user", "content": "?"}]),
        ):
            (answer,) = Endpoint(options(model, tmp_path)).complete_all([request], purpose="plan")
            assert not answer.cached


@pytest.mark.parametrize(
    "damage",
    ["", "{", "[]", "[" * 100_000, '{"choices": []}', '{"choices": 3}', 7, b"\xff"],
    ids=range(8),
)  # fmt: skip
def test_damaged_entries_are_asked_for_anew_and_rewritten(tmp_path: Path, damage: object):
    with LocalModel(counting()) as model:
        ask(Endpoint(options(model, tmp_path)))
        with diskcache.Cache(str(tmp_path)) as cache:
            for key in list(cache):
                cache[key] = damage
        assert ask(Endpoint(options(model, tmp_path))).text == "2"
        assert ask(Endpoint(options(model, tmp_path))).cached


def test_a_destroyed_cache_loses_no_answer_and_is_reported_once(tmp_path: Path, caplog):
    with LocalModel(counting()) as model:
        ask(Endpoint(options(model, tmp_path)))
        (tmp_path / "cache.db").write_bytes(b"no database at all" * 100)
        endpoint = Endpoint(options(model, tmp_path))
        assert [ask(endpoint).text, ask(endpoint).text] == ["2", "3"]
    assert [r.levelname for r in caplog.records if "not cached" in r.getMessage()] == ["WARNING"]


def test_answers_without_words_are_not_kept(tmp_path: Path):
    with LocalModel(lambda _: said("<think>too long", finish="length")) as model:
        for _ in range(2):
            assert not ask(Endpoint(options(model, tmp_path))).cached
