"""What a server does not take is left out, named, and not asked for again."""

import json
from typing import Any

import pytest

from gvla2.language import (
    Completion,
    Endpoint,
    EndpointOptions,
    ModelRefusedError,
    ModelUnavailableError,
    Request,
    picture,
)
from gvla2.language.wire import without_system
from gvla2.testing.language import LocalModel, Reply, refused, said

SYSTEM = [{"role": "system", "content": "Be brief."}, {"role": "user", "content": "Well?"}]
SCHEMA = {"type": "object", "properties": {"a": {"type": "number"}}}
ALL = Request(SYSTEM, logprobs=True, schema=SCHEMA)


def server(
    *, most: int | None = 20, system: bool = True, schema: bool = True, gives: bool = True, status: int = 400
):
    """A server that refuses what it does not know, or (``gives`` False) takes log-probs in silence and gives none."""

    def answering(request: dict[str, Any]) -> Any:
        if not system and any(m["role"] == "system" for m in request["messages"]):
            return refused(status, "System role not supported")
        if not schema and "response_format" in request:
            return refused(422, "response_format")
        if request.get("logprobs") and (most is None or request.get("top_logprobs", 0) > most):
            return refused(400, "logprobs")
        return said("yes", [("yes", {"yes": 0.8, "no": 0.1})] if request.get("logprobs") and gives else ())

    return answering


def endpoint(model: LocalModel, **options: Any) -> Endpoint:
    return Endpoint(EndpointOptions(**{"base_url": model.url, "model": "m", "retries": 0, **options}))


def asked(answering, request: Request = ALL, **options: Any) -> tuple[Completion, LocalModel]:
    with LocalModel(answering) as model:
        answer = endpoint(model, **options).complete(request, purpose="plan")
    return answer, model


@pytest.mark.parametrize(
    ("answering", "unmet", "calls"),
    [
        (server(), (), 1),
        (server(schema=False), ("schema",), 2),
        (server(most=5), (), 3),
        (server(most=None), ("logprobs",), 4),
        (server(system=False), ("system_role",), 5),
        (server(most=None, schema=False, system=False), ("logprobs", "schema", "system_role"), 6),
        (server(gives=False), ("logprobs",), 1),
        (server(system=False, status=500), ("system_role",), 2),
    ],
)
def test_what_is_refused_is_left_out_and_named(answering, unmet: tuple[str, ...], calls: int):
    answer, model = asked(answering)
    assert (answer.text, answer.unmet) == ("yes", unmet)
    assert len(model.requests) == calls


def test_a_plain_question_is_never_preceded_by_another():
    _, model = asked(server(), Request(SYSTEM))
    assert len(model.requests) == 1


def test_it_is_learnt_once_and_one_wish_at_a_time():
    with LocalModel(server(most=5, schema=False)) as model:
        language = endpoint(model)
        # Of two things that are lacking neither alone helps: both are left out, with the system role, this once.
        first = language.complete(ALL, purpose="plan")
        before = len(model.requests)
        again = language.complete(ALL, purpose="plan")
    assert first.unmet == again.unmet == ("logprobs", "schema", "system_role")
    assert len(model.requests) == before + 1


def test_a_schema_and_a_grammar_are_sent_by_request():
    _, model = asked(server(), Request(SYSTEM, schema=SCHEMA))
    assert model.requests[0]["response_format"] == {
        "type": "json_schema",
        "json_schema": {"name": "answer", "schema": SCHEMA, "strict": True},
    }
    both = Request(SYSTEM, schema=SCHEMA, grammar='root ::= "a"')
    answer, model = asked(server(), both, grammars=True)
    assert (model.requests[0]["grammar"], "response_format" in model.requests[0]) == ('root ::= "a"', False)
    assert answer.unmet == ()
    answer, model = asked(server(), both)
    assert ("grammar" in model.requests[0], "response_format" in model.requests[0]) == (False, True)
    assert answer.unmet == ("grammar",)


def test_a_refusal_that_no_concession_helps_is_the_first_one():
    with LocalModel(lambda r: refused(400, f"{len(json.dumps(r))} bytes are too many")) as model:
        with pytest.raises(ModelRefusedError, match="too many") as caught:
            endpoint(model).complete(ALL, purpose="plan")
        assert str(len(json.dumps(model.requests[0]))) in str(caught.value)


@pytest.mark.parametrize("status", [401, 404, 413])
def test_a_wrong_key_is_not_taken_for_a_missing_feature(status: int):
    with LocalModel(lambda _: refused(status, "no")) as model:
        with pytest.raises(ModelRefusedError):
            endpoint(model).complete(ALL, purpose="plan")
        assert len(model.requests) == 1


def test_a_broken_server_is_asked_once_more_without_a_system_role():
    with LocalModel(lambda _: refused(500, "broken")) as model:
        with pytest.raises(ModelUnavailableError, match="broken"):
            endpoint(model).complete(ALL, purpose="plan")
        assert len(model.requests) == 2


def test_orders_without_a_system_role():
    user = {"role": "user", "content": "u"}
    order = {"role": "system", "content": "s"}
    assert without_system([order]) == [{"role": "user", "content": "s"}]
    before = {"role": "assistant", "content": "a"}
    assert without_system([before, order, user]) == [before, {"role": "user", "content": "s\n\nu"}]
    seen = {"role": "user", "content": [picture(b"png")]}
    assert without_system([order, seen]) == [
        {"role": "user", "content": [{"type": "text", "text": "s"}, picture(b"png")]}
    ]


def test_a_picture_is_sent():
    shown = [{"role": "user", "content": [{"type": "text", "text": "Where?\ud800"}, picture(b"\x89PNG")]}]
    _, model = asked(server(), Request(shown))
    text, image = model.requests[0]["messages"][0]["content"]
    assert text["text"] == "Where??"
    assert image["image_url"]["url"] == "data:image/png;base64,iVBORw=="


def test_a_server_that_dies_while_it_concedes_is_unavailable():
    replies = [refused(400, "schema?"), Reply(said("yes"), cut=5)]
    with (
        LocalModel(lambda _: replies.pop(0) if len(replies) > 1 else replies[0]) as model,
        pytest.raises(ModelUnavailableError, match="broke off"),
    ):
        endpoint(model).complete(ALL, purpose="plan")
