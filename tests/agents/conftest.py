"""A sandbox for each test, where this machine can have one."""

import shutil
from pathlib import Path

import pytest

from gvla2.agents.sandbox import BubblewrapSandbox


@pytest.fixture
def sandboxed(tmp_path: Path) -> None:
    if shutil.which("bwrap") is None:
        pytest.skip("bubblewrap is not installed (apt install bubblewrap)")
    tried = BubblewrapSandbox(tmp_path / "tried").run("true")
    if tried.status != 0:
        pytest.skip(f"bubblewrap cannot make namespaces here: {tried.text[:80]}")


@pytest.fixture
def sandbox(sandboxed, tmp_path: Path) -> BubblewrapSandbox:
    return BubblewrapSandbox(tmp_path / "box", disk_mb=40)
