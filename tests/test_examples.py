"""The numbered examples run, on a CPU and without a network, from any directory."""

import runpy
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = sorted((Path(__file__).parents[1] / "examples").glob("[0-9]*.py"))


SHORT = {"07": ["128", "1"]}
"""Arguments that let a long example end soon, by number."""
ALONE = ("01", "03", "07")
"""In a process of its own: as a reader starts it (01); its plugin stays (03); it sets torch's threads for good (07)."""


NEEDS = {"05": "minisweagent", "06": "gymnasium", "07": "stable_baselines3"}
"""Packages of [test-all], by number."""


def _marked(example: Path) -> object:
    marks = pytest.mark.extras if example.name[:2] in NEEDS else ()
    return pytest.param(example, id=example.stem, marks=marks)


@pytest.mark.parametrize("example", [*map(_marked, EXAMPLES)])
def test_it_runs(
    example: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    if example.name[:2] in NEEDS:
        pytest.importorskip(NEEDS[example.name[:2]])
    words = [str(example), *SHORT.get(example.name[:2], [])]
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    if example.name.startswith(ALONE):
        done = subprocess.run([sys.executable, *words], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        assert done.stdout
    else:
        monkeypatch.setattr(sys, "argv", words)
        runpy.run_path(str(example), run_name="__main__")
        assert capsys.readouterr().out
