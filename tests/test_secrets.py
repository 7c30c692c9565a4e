"""Secrets in a configuration: no file of a run may show one."""

from pathlib import Path

import pytest

from gvla2.cli import main
from gvla2.errors import ConfigurationError
from gvla2.io.secrets import refuse_secrets


@pytest.mark.parametrize("command", ["run", "bench"])
@pytest.mark.parametrize(
    "form", ["{option}=postgresql://u:hunter2@127.0.0.1:1/x", "{option}=${{oc.env:ADDRESS}}"]
)
def test_a_password_reaches_no_file(command: str, form: str, tmp_path: Path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("ADDRESS", "postgresql://u:hunter2@127.0.0.1:1/x")
    for option in ("memory.url", "results.url") if command == "run" else ("results.url",):
        assert main([command, form.format(option=option), "hydra.run.dir=out"]) == 1
    files = [file for file in tmp_path.rglob("*") if file.is_file()]
    assert not [file for file in files if b"hunter2" in file.read_bytes()]
    said = capsys.readouterr().err
    assert "hunter2" not in said
    assert "PGPASSWORD" in said


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("memory.url", "postgresql://u:p/@w@h/x"),
        ("results.url", "postgresql:///x?sslmode=require&password=p"),
        ("language.base_url", "https://host/v1?key=abc"),
        ("camera.url", "rtsp://admin:p@host/1"),
        ("language.extra", {"headers": {"Authorization": "Bearer abcdefgh"}}),
        ("language.extra", {"api_key": "abc"}),
        ("language.extra", [{"note": "sk-proj-0123456789abcdefgh"}]),
    ],
)
def test_passwords_and_keys_are_refused_in_any_option(option: str, value: object):
    with pytest.raises(ConfigurationError, match="holds a password or an access key"):
        refuse_secrets(option, value)


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("memory.url", "postgresql://u@h:5432/x?sslkey=/k/client.key&passfile=/k/pgpass"),
        ("memory.url", "sqlite:////home/a:b@c/bank.db"),
        ("language.base_url", "http://127.0.0.1:8000/v1"),
        ("language.api_key_env", "OPENAI_API_KEY"),
        ("language.max_tokens", 2048),
        ("planner.model", "hf-internal-testing/tiny-random-llama"),
    ],
)
def test_what_is_no_secret_is_left_alone(option: str, value: object):
    refuse_secrets(option, value)
