"""A key goes to its server and nowhere else: no log, no message, no cache, no transcript, no configuration."""

import json
import logging
from pathlib import Path
from typing import Any

import pytest
from omegaconf import OmegaConf

from gvla2.errors import Gvla2Error
from gvla2.language import Endpoint, LanguageModelError, ask_typed
from gvla2.testing.language import LocalModel, Reply, refused, said
from gvla2_plugins.endpoint import EndpointConfig

KEY = "sk-t0p-s3cret"
ASK = [{"role": "user", "content": "What is my key?"}]


def number(text: str) -> int:
    return int(text)


@pytest.mark.parametrize(
    "reply",
    [said(f"It is {KEY}."), refused(401, f"Bearer {KEY} is wrong"), refused(503, f"busy with {KEY}"),
     Reply(f"<html>{KEY}</html>".encode(), 500), Reply(f"{KEY} is no JSON".encode()),
     Reply({"error": {"message": f"{KEY}?"}}), Reply({"choices": KEY})],
    ids=range(7),
)  # fmt: skip
def test_a_key_in_a_response_is_redacted_everywhere(reply: Any, tmp_path: Path, monkeypatch, caplog):
    monkeypatch.setenv("MY_KEY", KEY)
    caplog.set_level(logging.DEBUG)
    with LocalModel(lambda _: reply) as model:
        config = EndpointConfig(
            base_url=model.url, model="m", api_key_env="MY_KEY", retries=1, cache=str(tmp_path)
        )
        with pytest.raises(LanguageModelError) as caught:
            ask_typed(Endpoint(config), ASK, number, purpose="plan", tries=2)
        assert {h["Authorization"] for h in model.headers} == {f"Bearer {KEY}"}
    assert KEY not in str(caught.value)
    assert KEY not in json.dumps(caught.value.transcript)
    assert KEY not in caplog.text
    assert all(KEY.encode() not in file.read_bytes() for file in tmp_path.rglob("*") if file.is_file())
    assert KEY not in OmegaConf.to_yaml(OmegaConf.structured(config))


def test_a_missing_key_names_its_variable_alone(monkeypatch):
    monkeypatch.delenv("MY_KEY", raising=False)
    with pytest.raises(Gvla2Error, match=r"'MY_KEY'.*is not set"):
        Endpoint(EndpointConfig(api_key_env="MY_KEY"))
