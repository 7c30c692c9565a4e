"""Which environments there are, and what it costs to know."""

import subprocess
import sys

import gymnasium
import pytest

from gvla2.errors import MissingDependencyError
from gvla2.gym import MAX_STEPS, env_id, register_envs
from gvla2.plugins.registry import Registry


def test_every_task_is_an_environment(registry: Registry):
    tasks = set(registry.components("task")) - {"none"}
    known = {i for i in gymnasium.registry if i.startswith("gvla2/")}
    assert known >= {env_id(task) for task in tasks}
    assert "gvla2/none-v0" not in known
    spec = gymnasium.spec("gvla2/pick_and_lift-v0")
    assert spec.max_episode_steps == MAX_STEPS
    assert spec.kwargs == {"task": "pick_and_lift"}
    spec.to_json()  # it travels


def test_without_gymnasium_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "gymnasium.envs.registration", None)
    with pytest.raises(MissingDependencyError, match=r'needs gymnasium.*pip install "gvla2\[gym\]"'):
        register_envs()


def test_registering_loads_no_simulator():
    heavy = ("sapien", "torch", "pinocchio", "scipy", "numba", "trimesh", "gvla2.robot.task")
    code = (
        "import sys, gymnasium\nbefore = set(sys.modules)\nimport gvla2.gym\n"
        "assert 'gvla2/pick_and_lift-v0' in gymnasium.registry\n"
        f"print([m for m in {heavy!r} if m in set(sys.modules) - before])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout.strip() == "[]", done.stdout + done.stderr
