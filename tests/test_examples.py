"""The numbered examples are short and run, on a CPU and without a network, from any directory."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = sorted((Path(__file__).parents[1] / "examples").glob("[0-9]*.py"))


SHORT = {"07": ["1024", "2"]}
"""Arguments that let a long example end soon, by number."""


def test_there_are_examples():
    assert len(EXAMPLES) >= 3
    assert [e.name[:2] for e in EXAMPLES] == [f"{i:02d}" for i in range(1, len(EXAMPLES) + 1)]


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda e: e.stem)
def test_it_is_short_and_runs(example: Path, tmp_path: Path):
    assert len(example.read_text().splitlines()) < 80
    done = subprocess.run(
        [sys.executable, str(example), *SHORT.get(example.name[:2], [])],
        cwd=tmp_path,
        env={**os.environ, "HOME": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout
