"""The endpoint against a real server that misbehaves in every way that servers do."""

import asyncio
import socket
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from email.utils import formatdate
from typing import Any

import pytest

from gvla2.errors import ConfigurationError, MissingDependencyError
from gvla2.language import (
    Completion,
    Endpoint,
    EndpointOptions,
    Ledger,
    MalformedAnswerError,
    ModelRefusedError,
    ModelUnavailableError,
    Request,
    wire,
)
from gvla2.testing.language import LocalModel, Reply, refused, said

ASK = [{"role": "user", "content": "Well?"}]
PROBE = "Say the one word: yes"


def is_probe(request: dict[str, Any]) -> bool:
    return request["messages"][-1]["content"].endswith(PROBE)


def after_probe(*replies: Any):
    """Answers the probe well, then each question by the next of these; the last one serves for the rest."""
    left = list(replies)
    lock = threading.Lock()

    def answering(request: dict[str, Any]) -> Any:
        if is_probe(request):
            return said("yes", [("yes", {"yes": 0.9, "no": 0.1})])
        with lock:
            return left.pop(0) if len(left) > 1 else left[0]

    return answering


def endpoint(server: LocalModel, **options: Any) -> Endpoint:
    return Endpoint(EndpointOptions(**{"base_url": server.url, "model": "m", "backoff": 0.01, **options}))


def asked(model: LocalModel) -> list[dict[str, Any]]:
    return [r for r in model.requests if not is_probe(r)]


def test_an_answer():
    with LocalModel(after_probe(said("yes", reasoning="well"))) as model:
        answer = endpoint(model, max_tokens=33, temperature=0.5, extra={"top_k": 3}).complete(ASK, seed=4)
    assert (answer.text, answer.reasoning, answer.finish, answer.cached) == ("yes", "well", "stop", False)
    assert answer.usage.prompt_tokens == 100
    assert 0 < answer.latency < 10
    (request,) = asked(model)
    assert request == {
        "messages": ASK,
        "model": "m",
        "max_tokens": 33,
        "temperature": 0.5,
        "seed": 4,
        "top_k": 3,
    }


def test_null_options_are_not_sent():
    with LocalModel(after_probe(said("yes"))) as model:
        limit = {"max_completion_tokens": 9}
        endpoint(model, max_tokens=None, temperature=None, extra=limit).complete(ASK)
    assert asked(model) == [{"messages": ASK, "model": "m", **limit}]


def test_halves_of_characters_can_be_asked_about():
    with LocalModel(after_probe(said("yes"))) as model:
        assert endpoint(model).complete([{"role": "user", "content": "a\ud800b"}]).text == "yes"
    assert asked(model)[0]["messages"][0]["content"] == "a?b"


def test_log_probabilities_come_when_asked_for():
    reply = said("yes", [("yes", {"yes": 0.75, "no": 0.25})])
    with LocalModel(after_probe(reply)) as model:
        answer = endpoint(model).complete(ASK, logprobs=True)
    assert [t.text for t in answer.tokens] == ["yes"]
    assert asked(model)[0]["top_logprobs"] == 20


def test_the_only_model_is_found_and_several_are_named():
    with LocalModel(after_probe(said("yes")), models=["phi"]) as model:
        assert endpoint(model, model="").complete(ASK).text == "yes"
        assert asked(model)[0]["model"] == "phi"
    with (
        LocalModel(after_probe(said("yes")), models=["phi", "rho"]) as model,
        pytest.raises(ModelRefusedError, match=r"phi, rho.*option model"),
    ):
        endpoint(model, model="").complete(ASK)


def test_a_slow_answer_times_out_and_is_not_asked_for_again():
    with LocalModel(after_probe(Reply(said("late"), delay=30))) as model:
        began = time.monotonic()
        with pytest.raises(ModelUnavailableError, match=r"within 0\.3 s"):
            endpoint(model, timeout=0.3).complete(ASK)
        assert time.monotonic() - began < 3
        assert len(asked(model)) == 1


@pytest.mark.parametrize("status", [200, 500])
def test_a_dripping_answer_meets_the_same_deadline(status: int):
    """Each byte comes in time, the whole would take minutes."""
    with LocalModel(after_probe(Reply(said("late"), status, drip=0.05))) as model:
        began = time.monotonic()
        with pytest.raises(ModelUnavailableError, match=r"within 0\.4 s"):
            endpoint(model, timeout=0.4).complete(ASK)
        assert time.monotonic() - began < 3


def test_too_many_requests_waits_as_long_as_it_is_told():
    with LocalModel(after_probe(refused(429, "slow down", retry_after="0.4"), said("yes"))) as model:
        answer = endpoint(model, backoff=0.0).complete(ASK)
    assert answer.text == "yes"
    assert answer.latency >= 0.4
    assert len(asked(model)) == 2


def test_too_long_a_wait_is_not_waited():
    with LocalModel(after_probe(refused(429, "slow down", retry_after="3600"))) as model:
        with pytest.raises(ModelUnavailableError, match="wait 3600 s: slow down") as caught:
            endpoint(model).complete(ASK)
        assert len(asked(model)) == 1
    assert caught.value.retry_after == 3600


@pytest.mark.parametrize(
    ("headers", "seconds"),
    [
        ({}, None),
        ({"retry-after": "2"}, 2.0),
        ({"retry-after-ms": "1500"}, 1.5),
        ({"retry-after": "-3"}, 0.0),
        ({"retry-after": "nan"}, None),
        ({"retry-after": "soon"}, None),
        ({"retry-after": formatdate(0)}, 0.0),
    ],
)
def test_how_long_to_wait(headers: dict[str, str], seconds: float | None):
    assert wire.retry_after(headers) == seconds


def test_how_long_to_wait_by_a_date():
    seconds = wire.retry_after({"retry-after": formatdate(time.time() + 30, usegmt=True)})
    assert seconds is not None
    assert 25 < seconds <= 30


def test_errors_of_the_server_pass():
    replies = (refused(500, "oops"), Reply(b"<html>bad gateway", 502), said("yes"))
    with LocalModel(after_probe(*replies)) as model:
        assert endpoint(model).complete(ASK).text == "yes"


def test_errors_that_stay_are_reported_with_what_was_said():
    with LocalModel(after_probe(refused(503, "loading the model"))) as model:
        with pytest.raises(ModelUnavailableError, match=r"status 503.*loading the model"):
            endpoint(model, retries=1).complete(ASK)
        assert len(asked(model)) == 2


@pytest.mark.parametrize(
    ("status", "advice"),
    [(401, "api_key_env"), (403, "rights"), (404, "base_url"), (400, "extra"), (413, "shorten")],
)
def test_refusals_say_what_to_do_and_are_not_repeated(status: int, advice: str):
    with LocalModel(after_probe(refused(status, "no way"))) as model:
        with pytest.raises(ModelRefusedError, match=f"(?s)no way.*{advice}") as caught:
            endpoint(model).complete(ASK)
        assert len(asked(model)) == 1
    assert caught.value.status == status


@pytest.mark.parametrize(
    "reply",
    [
        Reply(b'{"choices": [{"message": {"content": "<scor'),
        Reply(b""),
        Reply(b"<html>a web page</html>", headers={"content-type": "text/html"}),
        Reply(b"[1, 2]"),
        Reply(b"[" * 100_000),
        Reply({"choices": []}),
        Reply({"object": "chat.completion"}),
        Reply({"error": {"message": "out of memory"}}),
    ],
    ids=["truncated", "empty", "html", "array", "nested", "no choices", "no choice", "error"],
)
def test_nonsense_is_malformed(reply: Reply):
    with LocalModel(after_probe(reply)) as model, pytest.raises(MalformedAnswerError):
        endpoint(model).complete(ASK)


def test_a_connection_that_breaks_off_is_tried_again():
    with LocalModel(after_probe(Reply(said("yes"), cut=20), said("yes"))) as model:
        assert endpoint(model).complete(ASK).text == "yes"
    with LocalModel(after_probe(Reply(said("yes"), cut=20))) as model:
        with pytest.raises(ModelUnavailableError, match="broke off"):
            endpoint(model).complete(ASK)
        assert len(asked(model)) == 3


def test_nobody_there():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        url = f"http://127.0.0.1:{taken.getsockname()[1]}/v1"
        with pytest.raises(ModelUnavailableError, match="Is a server running there"):
            Endpoint(EndpointOptions(base_url=url, backoff=0.01)).complete(ASK)


def test_a_huge_answer_is_read_and_an_endless_one_refused(monkeypatch: pytest.MonkeyPatch):
    with LocalModel(after_probe(said("x" * 3_000_000))) as model:
        assert len(endpoint(model).complete(ASK).text) == 3_000_000
        monkeypatch.setattr(wire, "LARGEST_ANSWER", 2**20)
        with pytest.raises(MalformedAnswerError, match="longer than 1 MiB"):
            endpoint(model).complete(ASK)


def test_the_bound_on_concurrency_holds_over_threads():
    with LocalModel(after_probe(Reply(said("yes"), delay=0.05))) as model:
        shared = endpoint(model, concurrency=3)
        with ThreadPoolExecutor(4) as pool:
            batches = list(pool.map(lambda _: shared.complete_all([Request(ASK)] * 4), range(4)))
    assert [len(b) for b in batches] == [4] * 4
    assert all(isinstance(a, Completion) for batch in batches for a in batch)
    assert model.busiest == 3
    assert shared.ledger.totals()["extra"].calls == 16 + 1


def test_one_failure_among_many_stays_one():
    def answering(request: dict[str, Any]) -> Any:
        return refused(400, "no") if request.get("seed") == 2 else said("yes")

    with LocalModel(answering) as model:
        answers = endpoint(model).complete_all([Request(ASK, seed=i) for i in range(4)])
    assert [isinstance(a, ModelRefusedError) for a in answers] == [False, False, True, False]
    assert endpoint(model).complete_all([]) == []


def test_it_works_within_a_running_loop():
    with LocalModel(after_probe(said("yes"))) as model:

        async def notebook() -> str:
            return endpoint(model).complete(ASK).text

        assert asyncio.run(notebook()) == "yes"


def test_tokens_are_counted_by_purpose_and_across_endpoints():
    ledger = Ledger()
    uncounted = said("yes")
    del uncounted["usage"]
    with LocalModel(after_probe(said("yes"), uncounted)) as model:
        options = EndpointOptions(base_url=model.url, model="m")
        Endpoint(options, ledger=ledger).complete(ASK, purpose="agent")
        Endpoint(options, ledger=ledger).complete(ASK)
    totals = ledger.totals()
    assert (totals["agent"].tokens, totals["agent"].calls, totals["agent"].unmetered) == (110, 1, 0)
    assert (totals["extra"].calls, totals["extra"].unmetered) == (
        3,
        1,
    )  # two probes and a call without counts
    assert totals["extra"].prompt_tokens == 200


def test_the_key_comes_from_its_variable_and_is_sent(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("MY_KEY", "s3cret")
    with LocalModel(after_probe(said("yes"))) as model:
        endpoint(model, api_key_env="MY_KEY").complete(ASK)
        assert {h["Authorization"] for h in model.headers} == {"Bearer s3cret"}
    monkeypatch.delenv("MY_KEY")
    with pytest.raises(ConfigurationError, match="'MY_KEY'"):
        Endpoint(EndpointOptions(api_key_env="MY_KEY"))


def test_a_provider_s_key_is_not_sent_unasked(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("OPENAI_API_KEY", "s3cret")
    with LocalModel(after_probe(said("yes"))) as model:
        endpoint(model).complete(ASK)
    assert "s3cret" not in str(model.headers)


def test_a_password_in_the_address_is_not_shown():
    assert EndpointOptions(base_url="https://me:pass@host/v1").shown_url == "https://host/v1"
    assert EndpointOptions().shown_url == EndpointOptions().base_url


@pytest.mark.parametrize(
    "options",
    [{"base_url": "localhost:8000"}, {"base_url": "http://"}, {"base_url": "http://[::1"}, {"base_url": ""},
     {"timeout": 0}, {"timeout": float("nan")}, {"retries": -1}, {"concurrency": 0}, {"temperature": -1},
     {"max_tokens": 0}, {"backoff": float("inf")}, {"longest_wait": -1}, {"extra": {"a": {1, 2}}}],
    ids=str,
)  # fmt: skip
def test_options_that_cannot_be(options: dict[str, Any]):
    with pytest.raises(ConfigurationError, match=next(iter(options))):
        Endpoint(EndpointOptions(**options))


def test_without_the_sdk_the_extra_is_named(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "openai", None)
    with pytest.raises(MissingDependencyError, match=r"gvla2\[llm\]"):
        Endpoint(EndpointOptions())
