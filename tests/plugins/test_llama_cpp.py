"""The llama.cpp server's life: started when asked, shared, ended with its last user, and never a hang.

The server's process is real; what it serves is a small HTTP server in place of a model.
"""

import gc
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from gvla2.errors import ConfigurationError, MissingDependencyError
from gvla2.language import Endpoint, ModelUnavailableError, Request, ask_typed
from gvla2.testing import check_component
from gvla2_plugins import llama_cpp
from gvla2_plugins.llama_cpp import LlamaCppConfig, server
from gvla2_plugins.llama_cpp.server import LlamaServer
from tests import local_model

STAND_IN = """
import importlib.util, os, sys, time
from pathlib import Path
from gvla2_plugins.llama_cpp import serving

# Only this module, without the package of tests.
spec = importlib.util.spec_from_file_location("language", {language!r})
sys.modules["language"] = language = importlib.util.module_from_spec(spec)
spec.loader.exec_module(language)

class Standing:
    def __init__(self, options):
        print("loading", options["files"][0][0])
        time.sleep({loading})
        if {dies}: os._exit(3)
        self.model = language.LocalModel(self.answer).__enter__()
        self.listening_address = self.model.url.removesuffix("/v1")

    def answer(self, request):
        if "die" in request["messages"][-1]["content"] and request["seed"] == 0:
            os._exit(9)
        return language.said(str(os.getpid()))

serving._serve = Standing
serving._WATCH = {watch}
sys.stdout.reconfigure(line_buffering=True)
serving.main(Path(sys.argv[1]))
"""
WATCH = 0.1
"""Seconds between two looks of the stand-in for users."""

ASK = Request([{"role": "user", "content": "Who are you?"}])


@pytest.fixture
def weights(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    stand_in(tmp_path, monkeypatch)
    file = tmp_path / "tiny.gguf"
    file.write_bytes(b"GGUF")
    return file


def stand_in(
    folder: Path, monkeypatch: pytest.MonkeyPatch, *, loading: float = 0.0, dies: bool = False
) -> None:
    script = folder / "stand_in.py"
    script.write_text(STAND_IN.format(loading=loading, dies=dies, watch=WATCH, language=local_model.__file__))
    monkeypatch.setattr(server, "_COMMAND", [sys.executable, str(script)])


def language(weights: Path, **options: Any) -> Endpoint:
    where = {"model": str(weights), "folder": str(weights.parent / "state")}
    config = LlamaCppConfig(**{"retries": 0, **where, **options})
    return Endpoint(config, LlamaServer(config))


def who(endpoint: Endpoint) -> int:
    """The process that answers."""
    return int(endpoint.complete(ASK, purpose="plan").text)


def gone(process: int, seconds: float = 5.0) -> bool:
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        try:
            os.kill(process, 0)
        except ProcessLookupError:
            return True
        if Path(f"/proc/{process}/stat").exists() and " Z " in Path(f"/proc/{process}/stat").read_text():
            return True
        time.sleep(0.02)
    return False


@pytest.fixture(autouse=True)
def _no_server_is_left(tmp_path: Path) -> Iterator[None]:
    yield
    if any(tmp_path.glob("state/*/server.json")):
        gc.collect()  # a failure's traceback holds who asked, in a circle
    for state in tmp_path.glob("state/*/server.json"):
        pid = json.loads(state.read_text()).get("pid")
        assert pid is None or gone(pid), "a server outlived its users"


def test_it_starts_with_the_first_question_and_ends_with_its_last_user(weights: Path):
    first = language(weights)
    assert not (weights.parent / "state").exists()
    process = who(first)
    second = language(weights)
    assert who(second) == process == who(first)
    del first
    assert not gone(process, 4 * WATCH)
    assert who(second) == process
    del second
    assert gone(process)


def test_it_ends_when_the_run_is_killed(weights: Path, tmp_path: Path):
    script = tmp_path / "run.py"
    script.write_text(
        "import sys, time\nfrom gvla2_plugins.llama_cpp import LlamaCppConfig, server\n"
        "server._COMMAND = [sys.executable, sys.argv[3]]\n"
        "made = server.LlamaServer(LlamaCppConfig(model=sys.argv[1], folder=sys.argv[2]))\n"
        "print(made.address(), flush=True)\ntime.sleep(60)\n"
    )
    arguments = [str(script), str(weights), str(weights.parent / "state"), str(tmp_path / "stand_in.py")]
    with subprocess.Popen([sys.executable, *arguments], stdout=subprocess.PIPE, text=True) as run:
        assert run.stdout is not None
        address = run.stdout.readline().strip()
        here = language(weights)
        process = who(here)
        (state,) = tmp_path.glob("state/*/server.json")
        assert json.loads(state.read_text()) == {"pid": process, "url": address.removesuffix("/v1")}  # shared
        run.send_signal(signal.SIGKILL)
        run.wait()
        assert not gone(process, 4 * WATCH)
    del here
    assert gone(process)


def test_a_server_that_was_killed_is_started_again(weights: Path):
    endpoint = language(weights, retries=0)
    process = who(endpoint)
    os.kill(process, signal.SIGKILL)
    assert gone(process)
    assert who(endpoint) != process


def test_one_that_dies_in_mid_answer_is_started_again_by_the_next_try(weights: Path):
    endpoint = language(weights, retries=1)
    first = who(endpoint)
    found = ask_typed(endpoint, [{"role": "user", "content": "die"}], int, purpose="plan", tries=2)
    assert found.answer != first
    assert "broke off" in found.transcript[0]["rejected"]


def test_a_server_that_dies_while_loading_is_reported_with_its_log(weights: Path, monkeypatch):
    stand_in(weights.parent, monkeypatch, dies=True)
    with pytest.raises(
        ModelUnavailableError, match=r"tiny\.gguf ended while it was loading.*ends: loading .*tiny"
    ):
        who(language(weights))


def test_a_server_that_takes_too_long_is_reported_and_ended(weights: Path, monkeypatch):
    stand_in(weights.parent, monkeypatch, loading=60)
    began = time.monotonic()
    with pytest.raises(ModelUnavailableError, match=r"not ready within 0\.5 s \(start_timeout\)"):
        who(language(weights, start_timeout=0.5))
    assert time.monotonic() - began < 30  # loading takes 60


@pytest.mark.parametrize(
    ("options", "word"),
    [({"context": 1}, "context is 1"), ({"slots": 0}, "slots"), ({"threads": -1}, "threads"),
     ({"timeout": 0}, "timeout"),
     ({"mmproj": "/nowhere.gguf"}, "no model at /nowhere.gguf")],
)  # fmt: skip
def test_options_that_cannot_be(weights: Path, options: dict[str, Any], word: str):
    with pytest.raises(ConfigurationError, match=word):
        language(weights, **options)


def test_without_a_file_or_the_package_it_says_what_to_do(weights: Path, monkeypatch):
    (component,) = llama_cpp.gvla2_language_models()
    check_component(component)
    for model, word in (("", r"language\.model=FILE"), (str(weights) + "x", "There is no model at")):
        with pytest.raises(ConfigurationError, match=word):
            component.build(component.config(model=model))
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(MissingDependencyError, match=r"gvla2\[local-llm\]"):
        LlamaServer(LlamaCppConfig(model=str(weights)))
