"""The probe: what servers can do, found out by asking for less and less."""

from typing import Any

import pytest

from gvla2.language import (
    Capabilities,
    Endpoint,
    EndpointOptions,
    ModelRefusedError,
    ModelUnavailableError,
)
from gvla2.language.capabilities import without_system
from gvla2.testing.language import LocalModel, refused, said

SYSTEM = [{"role": "system", "content": "Be brief."}, {"role": "user", "content": "Well?"}]


def server(*, most: int | None = 20, system: bool = True, gives: bool = True, counts: bool = True):
    """A server that refuses what it does not know, or (``gives`` False) takes it in silence and gives nothing."""

    def answering(request: dict[str, Any]) -> Any:
        if not system and any(m["role"] == "system" for m in request["messages"]):
            return refused(400, "System role not supported")
        if request.get("logprobs") and (most is None or request.get("top_logprobs", 0) > most):
            return refused(422, "logprobs")
        given = request.get("logprobs") and gives
        others = {"yes": 0.8, "no": 0.1} if request.get("top_logprobs") else {}
        body = said("yes", [("yes", others)] if given else ())
        if not counts:
            del body["usage"]
        return body

    return answering


def found(answering, **options: Any) -> tuple[Capabilities, LocalModel]:
    with LocalModel(answering) as model:
        able = Endpoint(
            EndpointOptions(base_url=model.url, model="m", backoff=0.01, **options)
        ).capabilities()
    return able, model


@pytest.mark.parametrize(
    ("answering", "able", "calls"),
    [
        (server(), Capabilities(True, 20, True, True), 1),
        (server(counts=False), Capabilities(True, 20, False, True), 1),
        (server(system=False), Capabilities(True, 20, True, False), 2),
        (server(most=5), Capabilities(True, 5, True, True), 3),
        (server(most=5, system=False), Capabilities(True, 5, True, False), 4),
        (server(most=None), Capabilities(False, 0, True, True), 5),
        (server(most=None, system=False), Capabilities(False, 0, True, False), 6),
        (server(gives=False), Capabilities(False, 0, True, True), 1),
    ],
)
def test_what_is_refused_is_asked_for_no_more(answering, able: Capabilities, calls: int):
    probed, model = found(answering)
    assert probed == able
    assert len(model.requests) == calls


def test_a_model_still_thinking_is_given_the_benefit_of_the_doubt():
    able, _ = found(lambda _: said(None, reasoning="hm", finish="length"))
    assert (able.logprobs, able.top_logprobs) == (True, 20)


def test_tokens_without_alternatives():
    def answering(request: dict[str, Any]) -> Any:
        return said("yes", [("yes", {})])

    able, _ = found(answering)
    assert (able.logprobs, able.top_logprobs) == (True, 0)


def test_a_server_that_refuses_everything_is_reported():
    with pytest.raises(ModelRefusedError, match="never"):
        found(lambda _: refused(400, "never"))


def test_a_template_that_breaks_over_the_system_role():
    def answering(request: dict[str, Any]) -> Any:
        if any(m["role"] == "system" for m in request["messages"]):
            return refused(500, "Jinja exception: system role not supported")
        return server()(request)

    assert found(answering, retries=0)[0] == Capabilities(True, 20, True, False)
    with pytest.raises(ModelUnavailableError, match="broken"):
        found(lambda _: refused(500, "broken"), retries=0)


def test_what_is_not_to_be_sent_is_not_probed_with_either():
    _, model = found(server(), max_tokens=None, temperature=None)
    assert not {"max_tokens", "temperature"} & set(model.requests[0])


def test_a_wrong_key_is_not_taken_for_a_missing_feature():
    with LocalModel(lambda _: refused(401, "who are you")) as model:
        with pytest.raises(ModelRefusedError, match="api_key_env"):
            Endpoint(EndpointOptions(base_url=model.url, model="m")).capabilities()
        assert len(model.requests) == 1


def test_a_failed_probe_is_not_remembered():
    replies = [refused(503, "loading")]

    def answering(request: dict[str, Any]) -> Any:
        return replies.pop() if replies else server()(request)

    with LocalModel(answering) as model:
        endpoint = Endpoint(EndpointOptions(base_url=model.url, model="m", retries=0))
        with pytest.raises(ModelUnavailableError):
            endpoint.capabilities()
        assert endpoint.capabilities().logprobs
        asked = len(model.requests)
        assert endpoint.capabilities().logprobs
        assert len(model.requests) == asked


def test_requests_are_cut_to_what_the_server_can():
    with LocalModel(server(most=None, system=False)) as model:
        answer = Endpoint(EndpointOptions(base_url=model.url, model="m")).complete(SYSTEM, logprobs=True)
    assert answer.text == "yes"
    assert answer.tokens == ()
    assert "logprobs" not in model.requests[-1]
    assert model.requests[-1]["messages"] == [{"role": "user", "content": "Be brief.\n\nWell?"}]


def test_orders_without_a_system_role():
    user = {"role": "user", "content": "u"}
    assert without_system([user]) == [user]
    assert without_system([{"role": "system", "content": "s"}]) == [{"role": "user", "content": "s"}]
    said_before = {"role": "assistant", "content": "a"}
    assert without_system([said_before, {"role": "system", "content": "s"}, user]) == [
        said_before,
        {"role": "user", "content": "s\n\nu"},
    ]
