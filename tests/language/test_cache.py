"""Answers kept by what was asked: found again, never trusted blindly, never in the way."""

import json
import threading
from pathlib import Path
from typing import Any

import pytest

from gvla2.language import Endpoint, EndpointOptions, Request
from gvla2.language.cache import AnswerCache, digest
from gvla2.testing.language import LocalModel, said

ASK = [{"role": "user", "content": "Well?"}]


def options(server: LocalModel, folder: Path, **more: Any) -> EndpointOptions:
    return EndpointOptions(**{"base_url": server.url, "model": "m", "cache": str(folder), **more})


def counting():
    """Answers with how many questions came before; the probe does not count."""
    seen = []

    def answering(request: dict[str, Any]) -> dict[str, Any]:
        if "yes" in request["messages"][-1]["content"]:
            return said("yes")
        seen.append(request)
        return said(str(len(seen)))

    return answering


def test_the_same_question_is_asked_once_and_costs_once(tmp_path: Path):
    with LocalModel(counting()) as model:
        first = Endpoint(options(model, tmp_path)).complete(ASK)
        again = Endpoint(options(model, tmp_path))
        second = again.complete(ASK)
    assert (first.text, first.cached) == ("1", False)
    assert (second.text, second.cached, second.latency) == ("1", True, 0.0)
    assert again.ledger.totals()["extra"].tokens == 0
    assert again.ledger.totals()["extra"].cached == 1


def test_kept_answers_need_no_server(tmp_path: Path):
    with LocalModel(counting()) as model:
        kept = options(model, tmp_path)
        Endpoint(kept).complete(ASK)
    assert Endpoint(kept).complete(ASK).cached


@pytest.mark.parametrize(
    "change", [{"model": "n"}, {"temperature": 0.7}, {"max_tokens": 9}, {"extra": {"top_k": 1}}], ids=str
)
def test_another_question_is_another_answer(tmp_path: Path, change: dict[str, Any]):
    with LocalModel(counting()) as model:
        Endpoint(options(model, tmp_path)).complete(ASK)
        assert not Endpoint(options(model, tmp_path, **change)).complete(ASK).cached
        for request in (
            Request(ASK, seed=1),
            Request(ASK, logprobs=True),
            Request([{"role": "user", "content": "?"}]),
        ):
            (answer,) = Endpoint(options(model, tmp_path)).complete_all([request])
            assert not answer.cached


@pytest.mark.parametrize(
    "damage",
    [b"", b"{", b"\xff\xfe", b"[]", b'{"key": "another", "answer": {}}', b"[" * 100_000,
     b'{"key": KEY, "answer": {"choices": []}}', b'{"key": KEY, "answer": 3}'],
    ids=range(8),
)  # fmt: skip
def test_damaged_entries_are_asked_for_anew_and_rewritten(tmp_path: Path, damage: bytes):
    with LocalModel(counting()) as model:
        Endpoint(options(model, tmp_path)).complete(ASK)
        for file in tmp_path.rglob("*.json"):
            file.write_bytes(damage.replace(b"KEY", json.dumps(file.stem).encode()))
        assert Endpoint(options(model, tmp_path)).complete(ASK).text == "2"
        assert Endpoint(options(model, tmp_path)).complete(ASK).cached


def test_the_probe_is_kept_for_a_day(tmp_path: Path):
    with LocalModel(counting()) as model:
        Endpoint(options(model, tmp_path)).capabilities()
        Endpoint(options(model, tmp_path)).capabilities()
        assert len(model.requests) == 1
        (file,) = tmp_path.rglob("*.json")
        old = json.loads(file.read_text())
        old["answer"]["at"] -= 2 * 86400
        file.write_text(json.dumps(old))
        Endpoint(options(model, tmp_path)).capabilities()
        assert len(model.requests) == 2
        for odd in ("yesterday", None, [], float("nan")):
            old["answer"]["at"] = odd
            file.write_text(json.dumps(old))
            Endpoint(options(model, tmp_path)).capabilities()
        assert len(model.requests) == 6


def test_a_folder_that_cannot_be_written_loses_no_answer(tmp_path: Path):
    (tmp_path / "file").write_text("in the way")
    with LocalModel(counting()) as model:
        endpoint = Endpoint(options(model, tmp_path / "file"))
        assert endpoint.complete(ASK).text == "1"
        assert "not kept" in endpoint.problem
    assert (tmp_path / "file").read_text() == "in the way"


def test_answers_without_words_are_not_kept(tmp_path: Path):
    with LocalModel(lambda _: said("<think>too long", finish="length")) as model:
        for _ in range(2):
            assert not Endpoint(options(model, tmp_path)).complete(ASK).cached


def test_keys_do_not_depend_on_order_and_files_are_whole(tmp_path: Path):
    assert digest({"a": 1, "b": [2]}) == digest({"b": [2], "a": 1}) != digest({"a": 1, "b": [3]})
    cache, key = AnswerCache(str(tmp_path)), digest({"q": 1})
    answers = [{"text": str(i) * 50_000} for i in range(4)]
    writers = [threading.Thread(target=cache.put, args=(key, a)) for a in answers for _ in range(5)]
    for writer in writers:
        writer.start()
    while any(w.is_alive() for w in writers):
        found = cache.get(key)
        assert found is None or found in answers
    assert cache.get(key) in answers
    assert [f.name for f in tmp_path.rglob("*") if f.is_file()] == [f"{key}.json"]
