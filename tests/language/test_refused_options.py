"""What a server does not take is left out, named, and not asked for again."""

from typing import Any

import pytest

from gvla2.language import (
    Completion,
    Endpoint,
    EndpointOptions,
    Request,
    picture,
)
from gvla2.language.wire import without_system
from gvla2.testing.language import LocalModel, refused, said

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
    ("answering", "calls"),
    [
        (server(), 1),
        (server(schema=False), 2),
        (server(most=5), 3),
        (server(most=None), 4),
        (server(system=False), 5),
        (server(most=None, schema=False, system=False), 6),
        (server(gives=False), 1),
        (server(system=False, status=500), 2),
    ],
)
def test_what_is_refused_is_left_out_then_and_later(answering, calls: int):
    with LocalModel(answering) as model:
        language = endpoint(model)
        for asked_before in (0, calls):
            assert language.complete(ALL, purpose="plan").text == "yes"
            assert len(model.requests) == asked_before + (1 if asked_before else calls)


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
