"""The endpoint against a real server that misbehaves in every way that servers do."""

import asyncio
import importlib.util
import socket
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest

from gvla2.errors import ConfigurationError, MissingDependencyError
from gvla2.language import (
    Completion,
    Endpoint,
    EndpointOptions,
    MalformedAnswerError,
    ModelRefusedError,
    ModelUnavailableError,
    Request,
)
from gvla2.testing.language import LocalModel, Reply, refused, said

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
    assert (answer.text, answer.reasoning, answer.finish, answer.cached) == ("yes", "well", "stop", False)
    assert answer.usage.prompt_tokens == 100
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


def test_the_bound_on_concurrency_holds_over_threads():
    with LocalModel(replying(Reply(said("yes"), delay=0.05))) as model:
        shared = endpoint(model, concurrency=3)
        with ThreadPoolExecutor(4) as pool:
            batches = list(
                pool.map(lambda _: shared.complete_all([Request(ASK)] * 4, purpose="verify"), range(4))
            )
    assert [len(b) for b in batches] == [4] * 4
    assert all(isinstance(a, Completion) for batch in batches for a in batch)
    assert model.busiest == 3
    assert shared.ledger.totals()["verify"]["calls"] == 16


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
