"""The memory's example and page do what they say."""

import importlib.util
import os
import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

from gvla2.commands.memory import VERBS

ROOT = Path(__file__).parents[1]
EXAMPLE = ROOT / "examples" / "05_memory_for_another_agent.py"
PAGE = (ROOT / "docs" / "memory.md").read_text(encoding="utf-8")


@pytest.mark.extras
@pytest.mark.skipif(
    importlib.util.find_spec("minisweagent") is None, reason="mini-swe-agent is not installed"
)
def test_the_second_agent_hears_of_the_first(tmp_path: Path):
    done = subprocess.run(
        [sys.executable, str(EXAMPLE)],
        cwd=tmp_path,
        env={**os.environ, "HOME": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    shown, _, prompt = done.stdout.partition("\nThe second prompt:\n")
    first, second = shown.splitlines()
    assert "success=True" in first
    assert "success=False" in second
    learnt = re.search(r"learned (hint-\w+)", first)
    assert learnt is not None
    assert f"[{learnt[1]} |" in prompt
    assert "sort -o names.txt" in prompt


def test_without_the_agent_the_example_says_what_to_install(monkeypatch, capsys: pytest.CaptureFixture[str]):
    monkeypatch.setitem(sys.modules, "minisweagent", None)
    monkeypatch.setitem(sys.modules, "minisweagent.agents.default", None)
    with pytest.raises(SystemExit) as left:
        runpy.run_path(str(EXAMPLE))
    assert not left.value.code
    assert "pip install" in capsys.readouterr().out


def test_the_lines_of_the_page(tmp_path: Path, monkeypatch, capsys: pytest.CaptureFixture[str]):
    monkeypatch.chdir(tmp_path)
    (block,) = re.findall(r"```python\n(.*?)```", PAGE, flags=re.DOTALL)
    exec(compile(block, "memory.md", "exec"), {})
    assert "sort -o names.txt" in capsys.readouterr().out


def test_the_commands_of_the_page_exist():
    named = re.findall(r"^gvla2 memory (\S+)", PAGE, flags=re.MULTILINE)
    assert set(named) <= set(VERBS)
    presets = set(re.findall(r"memory_\w+(?=[, ])", "".join(re.findall(r"\+experiment=\S+ ?", PAGE))))
    assert presets
    for preset in presets:
        assert (ROOT / "conf" / "experiment" / f"{preset}.yaml").is_file(), preset
