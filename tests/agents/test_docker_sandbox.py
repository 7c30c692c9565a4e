"""What is handed to ``docker``, heard by a program of that name: no engine runs where this is tested."""

from pathlib import Path

import pytest

from gvla2.agents.docker_sandbox import docker
from gvla2.agents.sandbox import EnvironmentFailedError
from gvla2.agents.solving import run_tests
from gvla2.agents.task_folder import read_tasks
from gvla2.errors import MissingDependencyError

OURS = Path(__file__).parents[2] / "examples" / "agent_tasks"
HEARD = """#!/bin/bash
echo "$*" >> "{log}"
case "$1 $2" in
  "inspect -f") echo /app ;;
  "build -q") {build} ;;
  "run -d") echo 0123abcd ;;
esac
case "$*" in
  *"cat \\"/logs/verifier/reward.txt\\""*) echo 1 ;;
  *"echo loud"*) head -c 100000 /dev/zero | tr '\\\\0' x ;;
  *"exec"*"false"*) exit 1 ;;
esac
exit 0
"""


@pytest.fixture
def heard(tmp_path: Path, monkeypatch):
    log = tmp_path / "log.txt"

    def listening(build: str = "echo sha256:1") -> Path:
        program = tmp_path / "bin" / "docker"
        program.parent.mkdir()
        program.write_text(HEARD.format(log=log, build=build))
        program.chmod(0o755)
        monkeypatch.setenv("PATH", f"{program.parent}:/usr/bin:/bin")
        return log

    return listening


def test_a_task_is_built_run_tested_and_removed(heard):
    log = heard()
    (task,) = read_tasks(OURS, ["deposit-photos"])
    with docker(task) as box:
        assert box.folder == "/app"
        assert box.run("false").status == 1
        assert len(box.run("echo loud").text) < 21_000
        assert run_tests(task, box).status == 0
    told = log.read_text().splitlines()
    assert told[0] == f"build -q -t gvla2-task-deposit-photos {task.environment}"
    assert "--network none" in told[1]
    assert "--memory 4096m" in told[1]
    assert any(line.startswith("cp ") and line.endswith(":/tests") for line in told)
    assert told[-1].startswith("rm -f gvla2-")
    tests = next(i for i, line in enumerate(told) if "cp " in line)
    assert any("rm -rf /tests" in line for line in told[tests:]), "the tests do not stay"


def test_an_engine_that_does_not_answer_is_said(heard):
    heard("echo 'Cannot connect to the Docker daemon'; exit 1")
    (task,) = read_tasks(OURS, ["deposit-photos"])
    with pytest.raises(EnvironmentFailedError, match="Cannot connect"), docker(task):
        pass


def test_without_docker_the_error_names_it(tmp_path: Path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    (task,) = read_tasks(OURS, ["deposit-photos"])
    with pytest.raises(MissingDependencyError, match="docker"), docker(task):
        pass
