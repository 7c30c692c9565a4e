"""A run with a language model: chosen once, asked by several parts, its cost in ``result.json``."""

import json
from pathlib import Path
from typing import Any

from gvla2.commands.run import build_components, run_episodes
from tests.local_model import LocalModel, said
from tests.quick import QUICK

KEY = "sk-t0p-s3cret"


def answering(request: dict[str, Any]) -> dict[str, Any]:
    judging = "Criterion" in request["messages"][-1]["content"]
    return said("<score>A</score>" if judging else "[]")


def test_what_the_model_cost_is_in_the_result_by_purpose_and_the_key_nowhere(
    registry, compose_run, tmp_path: Path, monkeypatch
):
    monkeypatch.setenv("MY_KEY", KEY)
    with LocalModel(answering) as model:
        chosen = (f"language.base_url={model.url}", "language.model=m", "language.api_key_env=MY_KEY")
        config = compose_run(
            *QUICK, "verifier=llm", "inducer=llm", f"memory.url=sqlite:///{tmp_path}/m.db", *chosen
        )
        run_episodes(config, registry, tmp_path / "out")
        asked = len(model.requests)
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    shown = result["language"]
    assert set(shown) == {"verify", "induce"}
    assert shown["verify"]["calls"] + shown["induce"]["calls"] == asked
    assert shown["verify"]["prompt_tokens"] == 100 * shown["verify"]["calls"] > 0
    assert shown["verify"]["seconds"] > 0
    assert result["choices"]["language"] == "endpoint"
    for file in (tmp_path / "out").rglob("*"):
        assert file.is_dir() or KEY.encode() not in file.read_bytes(), file


def test_a_result_names_no_component_that_nothing_used(registry, compose_run, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    parts = build_components(compose_run(*QUICK, "memory=none"), registry)
    parts.robot.close()
    assert parts.language is None
    assert not {"language", "retriever", "axis", "renderer"} & set(parts.choices)
