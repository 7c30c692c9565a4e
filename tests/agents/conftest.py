"""A sandbox for each test, where this machine can have one."""

import shutil
import subprocess
from pathlib import Path

import pytest

from gvla2.agents.sandbox import BubblewrapSandbox, SandboxLimits


def why_no_sandbox() -> str:
    if shutil.which("bwrap") is None:
        return "bubblewrap is not installed (apt install bubblewrap)"
    tried = subprocess.run(
        ["bwrap", "--ro-bind", "/", "/", "--unshare-all", "true"], capture_output=True, check=False
    )
    return (
        ""
        if tried.returncode == 0
        else f"bubblewrap cannot make namespaces here: {tried.stderr.decode()[:80]}"
    )


@pytest.fixture
def sandboxed() -> None:
    if reason := why_no_sandbox():
        pytest.skip(reason)


@pytest.fixture
def sandbox(sandboxed, tmp_path: Path) -> BubblewrapSandbox:
    return BubblewrapSandbox(tmp_path / "box", limits=SandboxLimits(disk_mb=40, output=2000))
