"""Answers of a certain kind: asked for again with reasons, recorded, and never a hang."""

import json
import threading
from typing import Any

import pytest

from gvla2.language import (
    Endpoint,
    EndpointOptions,
    LanguageModelError,
    ModelRefusedError,
    ModelUnavailableError,
    UnusableAnswerError,
    ask_typed,
    json_in,
    picture,
)
from gvla2.language.typed import Answered
from tests.local_model import LocalModel, Reply, refused, said

ASK = [{"role": "system", "content": "Numbers alone."}, {"role": "user", "content": "How many?"}]


def replying(*replies: Any):
    left, lock = list(replies), threading.Lock()

    def answering(request: dict[str, Any]) -> Any:
        with lock:
            return left.pop(0) if len(left) > 1 else left[0]

    return answering


def number(text: str) -> int:
    if not text.strip().isdigit():
        raise ValueError(f"'{text[:20]}' is no number.")
    return int(text)


def asked(
    model: LocalModel, parse: Any = number, options: dict[str, Any] | None = None, **more: Any
) -> Answered[Any]:
    where = {"base_url": model.url, "model": "m", "retries": 0, **(options or {})}
    return ask_typed(Endpoint(EndpointOptions(**where)), ASK, parse, purpose="plan", **more)


def test_the_first_answer_that_parses_is_taken():
    with LocalModel(replying(said("7"))) as model:
        found = asked(model, seed=5)
    assert found.answer == 7
    (entry,) = found.transcript
    assert entry["prompt"] == ASK
    assert (entry["answer"], entry["rejected"], entry["seed"], entry["cached"]) == ("7", "", 5, False)
    assert (entry["prompt_tokens"], entry["completion_tokens"]) == (100, 10)
    assert json.loads(json.dumps(found.transcript)) == list(found.transcript)


def test_a_rejected_answer_goes_back_with_the_reason_another_seed_and_some_warmth():
    with LocalModel(replying(said("seven"), said("7"))) as model:
        found = asked(model, seed=5)
    first, second = model.requests
    assert (first["seed"], first["temperature"]) == (5, 0.0)
    assert (second["seed"], second["temperature"]) == (6, 0.7)
    assert second["messages"][:2] == first["messages"]
    back, reason = second["messages"][2:]
    assert back == {"role": "assistant", "content": "seven"}
    assert "'seven' is no number." in reason["content"]
    assert [entry["rejected"] for entry in found.transcript] == ["'seven' is no number.", ""]
    assert found.transcript[1]["prompt"] == [back, reason]


@pytest.mark.parametrize(
    "reply",
    [said("words"), said(""), said(None), said("[" * 50_000), said("7", finish="length"), said("word " * 10_000),
     said("<think>for ever", finish="length"), Reply(b'{"choices": [{"mess'), Reply({"choices": []})],
    ids=["prose", "empty", "null", "nested", "cut off", "endless", "lost in thought", "truncated", "no choice"],
)  # fmt: skip
def test_what_stays_wrong_fails_by_its_type_after_the_tries(reply: Any):
    with (
        LocalModel(replying(reply)) as model,
        pytest.raises(UnusableAnswerError, match="in 3 tries") as caught,
    ):
        asked(model, lambda text: number(str(json_in(text))))
    assert len(model.requests) == 3
    assert len(caught.value.transcript) == 3
    assert all(entry["rejected"] for entry in caught.value.transcript)
    assert len(json.dumps(model.requests)) < 30_000


@pytest.mark.parametrize(
    ("reply", "kind"),
    [(refused(401, "who?"), ModelRefusedError), (refused(503, "loading"), ModelUnavailableError),
     (Reply(said("7"), delay=30), ModelUnavailableError), (Reply(said("7"), drip=0.05), ModelUnavailableError)],
)  # fmt: skip
def test_what_asking_again_does_not_help_fails_at_once(reply: Any, kind: type[LanguageModelError]):
    with LocalModel(replying(said("?"), reply)) as model, pytest.raises(kind) as caught:
        asked(model, options={"timeout": 0.5 if reply.delay or reply.drip else 60.0})
    assert [entry["answer"] for entry in caught.value.transcript] == ["?", ""]


def test_mistakes_of_the_parser_are_not_taken_for_the_model_s():
    with LocalModel(replying(said("7"))) as model, pytest.raises(KeyError):
        asked(model, lambda _: {}["missing"])
    with pytest.raises(ValueError, match="tries is 0"):
        asked(model, tries=0)


def test_images_are_named_in_the_transcript_not_kept():
    shown = [{"role": "user", "content": [{"type": "text", "text": "Where?"}, picture(b"png" * 999)]}]
    with LocalModel(replying(said("7"))) as model:
        options = EndpointOptions(base_url=model.url, model="m")
        (entry,) = ask_typed(Endpoint(options), shown, number, purpose="plan").transcript
    assert entry["prompt"][0]["content"].startswith("Where?\n[image_url, ")
    assert len(json.dumps(entry)) < 500


@pytest.mark.parametrize(
    ("text", "value"),
    [('{"a": 1}', {"a": 1}), ("Sure:\n```json\n[1, 2]\n```\nGood luck!", [1, 2]),
     ('see [1]: {"a": [1, 2]}', {"a": [1, 2]}),
     ("a { b [3] c", [3]), ("[]", [])],
)  # fmt: skip
def test_json_is_found_among_words(text: str, value: object):
    assert json_in(text) == value


@pytest.mark.parametrize(
    ("text", "why"),
    [("none", "no JSON object"), ("", "no JSON object"), ("[1, 2", "is broken"), ("{'a': 1}", "no JSON object"),
     ("[NaN]", "NaN, which is not a number"), ("[-Infinity]", "-Infinity"),
     ("[" * 100_000, "too deeply"), ("{" * 100_000, "no JSON object"), ("[[1, 2], [NaN, 3]]", "NaN"),
     ('[{"a": 1}, {"b": 2},]', "is broken"), ('[{"a": 1}, {"b"', "is broken")],
    ids=range(11),
)  # fmt: skip
def test_what_is_no_json_is_explained(text: str, why: str):
    with pytest.raises(ValueError, match=why):
        json_in(text)
