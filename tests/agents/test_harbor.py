"""The adapter for Harbor, with Harbor's own classes where it is installed (it needs Python 3.12)."""

import asyncio
import json
from pathlib import Path
from types import SimpleNamespace

import pytest

from gvla2.memory import KnowledgeBank
from gvla2.testing.language import LocalModel
from tests.agents.scripted import giving

pytest.importorskip("harbor", reason="Harbor is not installed: it needs Python 3.12 (pip install harbor)")


class Shell:
    """Harbor's environment as far as the agent calls it: commands run in a folder of this machine."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    async def exec(self, command: str, cwd=None, env=None, timeout_sec=None, user=None):
        process = await asyncio.create_subprocess_shell(
            command,
            cwd=self.folder,
            env={"PATH": "/usr/bin:/bin", **(env or {})},
            stdout=asyncio.subprocess.PIPE,
        )
        output, _ = await process.communicate()
        return SimpleNamespace(stdout=output.decode(), stderr=None, return_code=process.returncode)


def trial(folder: Path, url: str, monkeypatch, bank: Path, reward: float) -> dict:
    from harbor.models.agent.context import AgentContext

    from gvla2_plugins.mini_swe.harbor import RememberingAgent

    monkeypatch.setenv("GVLA2_BASE_URL", url)
    monkeypatch.setenv("GVLA2_BANK", str(bank))
    work = folder / "work"
    work.mkdir(parents=True)
    agent = RememberingAgent(logs_dir=folder / "agent", model_name="local")
    context = AgentContext()
    asyncio.run(agent.run("Write the word alpha to answer.txt.", Shell(work), context))
    (folder / "result.json").write_text(
        json.dumps({"id": folder.name, "verifier_result": {"rewards": {"reward": reward}}})
    )
    assert context.n_input_tokens
    assert (work / "answer.txt").read_text() == "alpha\n"
    return context.metadata


def test_a_trial_is_learnt_from_once_and_the_next_one_is_told(tmp_path: Path, monkeypatch):
    from gvla2_plugins.mini_swe.harbor import learn

    bank = tmp_path / "memory.db"
    with LocalModel(giving({"alpha": ["echo alpha > answer.txt"]})) as model:
        first = trial(tmp_path / "jobs" / "one", model.url, monkeypatch, bank, 1.0)
        assert first["recalled"] == []
        assert learn(tmp_path / "jobs", str(bank)) == (1, 0)
        assert learn(tmp_path / "jobs", str(bank)) == (0, 0)
        second = trial(tmp_path / "jobs" / "two", model.url, monkeypatch, bank, 1.0)
    assert second["recalled"]
    with KnowledgeBank(bank) as memory:
        assert "echo alpha" in memory.recall("Write the word alpha to answer.txt.").text
