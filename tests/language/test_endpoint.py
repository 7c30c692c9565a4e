"""The endpoint against a real server that misbehaves in every way that servers do."""

import asyncio
import gzip
import importlib.util
import json
import logging
import socket
import subprocess
import sys
import threading
import time
import tracemalloc
from pathlib import Path
from typing import Any

import diskcache
import pytest
from omegaconf import OmegaConf

from gvla2.errors import ConfigurationError, Gvla2Error, MissingDependencyError
from gvla2.language import (
    Completion,
    Endpoint,
    EndpointOptions,
    LanguageModelError,
    MalformedAnswerError,
    ModelRefusedError,
    ModelUnavailableError,
    Request,
    ask_typed,
    picture,
)
from gvla2_plugins.endpoint import EndpointConfig
from tests.local_model import LocalModel, Reply, refused, said

ASK = [{"role": "user", "content": "Well?"}]


@pytest.fixture
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """The package's first retry comes after some milliseconds, not half a second."""
    monkeypatch.setattr("openai._base_client.INITIAL_RETRY_DELAY", 0.01)


def replying(*replies: Any):
    """Answers each question by the next of these; the last one serves for the rest."""
    left = list(replies)
    lock = threading.Lock()

    def answering(request: dict[str, Any]) -> Any:
        with lock:
            return left.pop(0) if len(left) > 1 else left[0]

    return answering


def endpoint(server: LocalModel, **options: Any) -> Endpoint:
    return Endpoint(EndpointOptions(**{"base_url": server.url, "model": "m", **options}))


def ask(endpoint: Endpoint, **more: Any) -> Completion:
    return endpoint.complete(Request(ASK, **more), purpose="plan")


def test_an_answer():
    with LocalModel(replying(said("yes", reasoning="well"))) as model:
        answer = ask(endpoint(model, max_tokens=33, temperature=0.5, extra={"top_k": 3}), seed=4)
    assert (answer.text, answer.finish, answer.cached) == ("yes", "stop", False)
    assert answer.prompt_tokens == 100
    assert 0 < answer.latency < 10
    (request,) = model.requests
    assert request == {
        "messages": ASK,
        "model": "m",
        "max_tokens": 33,
        "temperature": 0.5,
        "seed": 4,
        "top_k": 3,
    }


def test_the_only_model_is_found_and_several_are_named():
    with LocalModel(replying(said("yes")), models=["phi"]) as model:
        assert ask(endpoint(model, model="")).text == "yes"
        assert model.requests[0]["model"] == "phi"
    with (
        LocalModel(replying(said("yes")), models=["phi", "rho"]) as model,
        pytest.raises(ModelRefusedError, match=r"phi, rho.*option model"),
    ):
        ask(endpoint(model, model=""))


@pytest.mark.parametrize("status", [200, 500])
def test_a_dripping_answer_meets_the_same_deadline(status: int):
    """Each byte comes in time, the whole would take minutes."""
    with LocalModel(replying(Reply(said("late"), status, drip=0.05))) as model:
        began = time.monotonic()
        with pytest.raises(ModelUnavailableError, match=r"within 0\.4 s"):
            ask(endpoint(model, timeout=0.4))
        assert time.monotonic() - began < 3


@pytest.mark.parametrize(
    ("status", "advice"),
    [(401, "api_key_env"), (403, "rights"), (404, "base_url"), (400, "extra"), (413, "shorten")],
)
def test_refusals_say_what_to_do_and_are_not_repeated(status: int, advice: str):
    with LocalModel(replying(refused(status, "no way"))) as model:
        with pytest.raises(ModelRefusedError, match=f"(?s)no way.*{advice}") as caught:
            ask(endpoint(model))
        assert len(model.requests) == 1
    assert caught.value.status == status


@pytest.mark.parametrize("body", [{"error": "no such model"}, {"detail": "no such model"}])
def test_what_a_server_says_of_a_refusal_in_its_own_form(body: dict[str, str]):
    with LocalModel(replying(Reply(body, 404))) as model, pytest.raises(ModelRefusedError, match="no such"):
        ask(endpoint(model))


@pytest.mark.parametrize(
    "reply",
    [
        Reply(b'{"choices": [{"message": {"content": "<scor'),
        Reply(b"<html>a web page</html>", headers={"content-type": "text/html"}),
        Reply({"choices": []}),
        Reply({"error": {"message": "out of memory"}}),
    ],
    ids=["truncated", "html", "no choices", "error"],
)
def test_nonsense_is_malformed(reply: Reply):
    with LocalModel(replying(reply)) as model, pytest.raises(MalformedAnswerError):
        ask(endpoint(model))


@pytest.mark.parametrize("packed", [False, True])
def test_an_answer_without_end_is_not_read(packed: bool, monkeypatch):
    monkeypatch.setattr("gvla2.language.endpoint.MOST_BYTES", 1 << 20)
    body = json.dumps(said("x" * (50 << 20))).encode()
    reply = Reply(gzip.compress(body), headers={"Content-Encoding": "gzip"}) if packed else Reply(body)
    tracemalloc.start()
    with LocalModel(replying(reply)) as model, pytest.raises(MalformedAnswerError, match="longer than 1 MB"):
        ask(endpoint(model, retries=0))
    assert tracemalloc.get_traced_memory()[1] < 200 << 20
    tracemalloc.stop()


def test_a_connection_that_breaks_off_is_tried_again(soon: None):
    with LocalModel(replying(Reply(said("yes"), cut=20), said("yes"))) as model:
        assert ask(endpoint(model)).text == "yes"
    with LocalModel(replying(Reply(said("yes"), cut=20))) as model:
        with pytest.raises(ModelUnavailableError, match="broke off"):
            ask(endpoint(model))
        assert len(model.requests) == 3


def test_nobody_there():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        url = f"http://127.0.0.1:{taken.getsockname()[1]}/v1"
        with pytest.raises(ModelUnavailableError, match="Is a server running there"):
            ask(Endpoint(EndpointOptions(base_url=url, retries=0)))


def test_requests_in_flight_are_bounded():
    with LocalModel(replying(Reply(said("yes"), delay=0.05))) as model:
        asked = endpoint(model, concurrency=3)
        answers = asked.complete_all([Request(ASK)] * 16, purpose="verify")
    assert all(isinstance(answer, Completion) for answer in answers)
    assert model.busiest == 3
    assert asked.ledger.totals()["verify"]["calls"] == 16


def test_one_failure_among_many_stays_one():
    def answering(request: dict[str, Any]) -> Any:
        return refused(400, "no") if request.get("seed") == 2 else said("yes")

    with LocalModel(answering) as model:
        answers = endpoint(model).complete_all([Request(ASK, seed=i) for i in range(4)], purpose="plan")
    assert [isinstance(a, ModelRefusedError) for a in answers] == [False, False, True, False]
    assert endpoint(model).complete_all([], purpose="plan") == []


def test_it_works_within_a_running_loop():
    with LocalModel(replying(said("yes"))) as model:

        async def notebook() -> str:
            return ask(endpoint(model)).text

        assert asyncio.run(notebook()) == "yes"


def test_calls_tokens_and_seconds_are_counted_by_purpose():
    uncounted = said("yes")
    del uncounted["usage"]
    with LocalModel(replying(said("yes"), said("yes"), uncounted, refused(404, "gone"))) as model:
        asked = endpoint(model)
        ask(asked)
        before = asked.ledger.totals()
        for _ in range(3):
            asked.complete_all([Request(ASK)], purpose="verify")
    totals = asked.ledger.totals()
    assert list(totals) == ["plan", "verify"]
    assert (totals["plan"]["prompt_tokens"], totals["plan"]["completion_tokens"]) == (100, 10)
    counted = {name: totals["verify"][name] for name in ("calls", "unmetered", "failed", "prompt_tokens")}
    assert counted == {"calls": 2, "unmetered": 1, "failed": 1, "prompt_tokens": 100}
    assert 0 < totals["verify"]["seconds"] < 10
    assert asked.ledger.totals(before) == {"verify": totals["verify"]}


def test_a_password_in_the_address_is_refused_and_not_shown():
    with pytest.raises(ConfigurationError, match="base_url holds a name or a password") as caught:
        Endpoint(EndpointOptions(base_url="https://me:s3cret@host/v1"))
    assert "s3cret" not in str(caught.value)


@pytest.mark.parametrize(
    "options",
    [{"base_url": "localhost:8000"}, {"base_url": "http://"}, {"base_url": "http://[::1"}, {"base_url": ""},
     {"timeout": 0}, {"timeout": float("nan")}, {"retries": -1}, {"concurrency": 0}, {"temperature": -1},
     {"max_tokens": 0}, {"max_tokens": -1}, {"extra": {"a": {1, 2}}}],
    ids=str,
)  # fmt: skip
def test_options_that_cannot_be(options: dict[str, Any]):
    with pytest.raises(ConfigurationError, match=next(iter(options))):
        Endpoint(EndpointOptions(**options))


@pytest.mark.parametrize("package", ["openai", "diskcache"])
def test_without_a_package_the_extra_is_named(monkeypatch: pytest.MonkeyPatch, package: str):
    found = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == package else found(name))
    with pytest.raises(MissingDependencyError, match=rf"{package}.*gvla2\[llm\]"):
        Endpoint(EndpointOptions())


def test_making_one_imports_no_package():
    code = (
        "import sys, gvla2.language as l; l.Endpoint(l.EndpointOptions(cache='/nowhere'));"
        "print([m for m in ('numpy', 'openai', 'httpx', 'diskcache') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


# Answers kept by what was asked


def counting():
    """Answers with how many questions came before, this one included."""
    seen = []

    def answering(request: dict[str, Any]) -> dict[str, Any]:
        seen.append(request)
        return said(str(len(seen)))

    return answering


def test_the_same_question_is_asked_once_and_costs_once(tmp_path: Path):
    with LocalModel(counting()) as model:
        first = ask(endpoint(model, cache=str(tmp_path)))
        again = endpoint(model, cache=str(tmp_path))
        second = ask(again)
    assert (first.text, first.cached) == ("1", False)
    assert (second.text, second.cached, second.latency) == ("1", True, 0.0)
    counts = again.ledger.totals()["plan"]
    assert (counts["cached"], counts["calls"], counts["prompt_tokens"], counts["seconds"]) == (1, 0, 0, 0)


@pytest.mark.parametrize(
    "damage",
    ["", "{", "[]", "[" * 100_000, '{"choices": []}', '{"choices": 3}', 7, b"\xff"],
    ids=range(8),
)  # fmt: skip
def test_damaged_entries_are_asked_for_anew_and_rewritten(tmp_path: Path, damage: object):
    with LocalModel(counting()) as model:
        ask(endpoint(model, cache=str(tmp_path)))
        with diskcache.Cache(str(tmp_path)) as cache:
            for key in list(cache):
                cache[key] = damage
        assert ask(endpoint(model, cache=str(tmp_path))).text == "2"
        assert ask(endpoint(model, cache=str(tmp_path))).cached


# What a server does not take is left out, and not asked for again


SYSTEM = [{"role": "system", "content": "Be brief."}, {"role": "user", "content": "Well?"}]


SCHEMA = {"type": "object", "properties": {"a": {"type": "number"}}}


ALL = Request(SYSTEM, logprobs=True, schema=SCHEMA)


def server(*, logprobs: bool = True, schema: bool = True, gives: bool = True):
    """A server that refuses what it does not know, or (``gives`` False) takes log-probs in silence and gives none."""

    def answering(request: dict[str, Any]) -> Any:
        if not schema and "response_format" in request:
            return refused(422, "response_format")
        if request.get("logprobs") and not logprobs:
            return refused(400, "logprobs")
        return said("yes", [("yes", {"yes": 0.8, "no": 0.1})] if request.get("logprobs") and gives else ())

    return answering


def asked(answering, request: Request = ALL, **options: Any) -> tuple[Completion, LocalModel]:
    with LocalModel(answering) as model:
        answer = endpoint(model, retries=0, **options).complete(request, purpose="plan")
    return answer, model


@pytest.mark.parametrize(
    ("answering", "calls"),
    [(server(), 1), (server(schema=False), 2), (server(logprobs=False), 2), (server(gives=False), 1)],
)
def test_what_is_refused_is_left_out_then_and_later(answering, calls: int):
    with LocalModel(answering) as model:
        language = endpoint(model, retries=0)
        for asked_before in (0, calls):
            assert language.complete(ALL, purpose="plan").text == "yes"
            assert len(model.requests) == asked_before + (1 if asked_before else calls)


def test_a_refused_seed_alone_is_left_out():
    def answering(request: dict[str, Any]) -> Any:
        return refused(422, "Extra inputs: seed") if "seed" in request else server()(request)

    with LocalModel(answering) as model:
        language = endpoint(model, retries=0)
        for _ in range(2):
            assert language.complete(Request(SYSTEM, seed=3, schema=SCHEMA), purpose="plan").text == "yes"
    assert ["seed" in request for request in model.requests] == [True, False, False]
    assert all("response_format" in request for request in model.requests)


def test_a_schema_and_a_grammar_are_sent_by_request():
    _, model = asked(server(), Request(SYSTEM, schema=SCHEMA))
    assert model.requests[0]["response_format"] == {
        "type": "json_schema",
        "json_schema": {"name": "answer", "schema": SCHEMA, "strict": True},
    }
    both = Request(SYSTEM, schema=SCHEMA, grammar='root ::= "a"')
    _, model = asked(server(), both, grammars=True)
    assert (model.requests[0]["grammar"], "response_format" in model.requests[0]) == ('root ::= "a"', False)
    _, model = asked(server(), both)
    assert ("grammar" in model.requests[0], "response_format" in model.requests[0]) == (False, True)


def test_a_picture_is_sent():
    shown = [{"role": "user", "content": [{"type": "text", "text": "Where?\ud800"}, picture(b"\x89PNG")]}]
    _, model = asked(server(), Request(shown))
    text, image = model.requests[0]["messages"][0]["content"]
    assert text["text"] == "Where??"
    assert image["image_url"]["url"] == "data:image/png;base64,iVBORw=="


# A key goes to its server and nowhere else


KEY = "sk-t0p/s3cret"
ESCAPED = r"\u0073k-t0p\/s3cret"


@pytest.mark.parametrize(
    "reply",
    [said(f"It is {KEY}."), refused(401, f"Bearer {KEY} is wrong"), refused(503, f"busy with {KEY}"),
     Reply(f"<html>{KEY}</html>".encode(), 500), Reply(f"{KEY} is no JSON".encode()),
     Reply({"error": {"message": f"{KEY}?"}}), Reply({"choices": KEY}),
     Reply(json.dumps(said(f"It is {KEY}.")).replace(KEY, ESCAPED).encode()),
     Reply(f'{{"error": {{"message": "{ESCAPED}"}}}}'.encode(), 401), Reply(f"<b>{ESCAPED}</b>".encode(), 500)],
    ids=range(10),
)  # fmt: skip
def test_a_key_in_a_response_is_redacted_everywhere(reply: Any, tmp_path: Path, monkeypatch, caplog):
    monkeypatch.setenv("MY_KEY", KEY)
    caplog.set_level(logging.DEBUG)
    with LocalModel(lambda _: reply) as model:
        config = EndpointConfig(
            base_url=model.url, model="m", api_key_env="MY_KEY", retries=1, cache=str(tmp_path)
        )
        with pytest.raises(LanguageModelError) as caught:
            ask_typed(Endpoint(config), ASK, int, purpose="plan", tries=2)
        assert {h["Authorization"] for h in model.headers} == {f"Bearer {KEY}"}
    assert KEY not in str(caught.value)
    assert KEY not in json.dumps(caught.value.transcript)
    assert KEY not in caplog.text
    assert ESCAPED not in str(caught.value) + json.dumps(caught.value.transcript)
    assert all(KEY.encode() not in file.read_bytes() for file in tmp_path.rglob("*") if file.is_file())
    assert KEY not in OmegaConf.to_yaml(OmegaConf.structured(config))


def test_a_missing_key_names_its_variable_alone(monkeypatch):
    monkeypatch.delenv("MY_KEY", raising=False)
    with pytest.raises(Gvla2Error, match=r"'MY_KEY'.*is not set"):
        Endpoint(EndpointConfig(api_key_env="MY_KEY"))
