"""The sandbox against commands that misbehave."""

import subprocess
from pathlib import Path

import pytest

from gvla2.agents.sandbox import BubblewrapSandbox, EnvironmentFailedError, bubblewrap
from gvla2.agents.solving import run_tests
from gvla2.agents.task_folder import read_tasks
from gvla2.errors import MissingDependencyError

OURS = Path(__file__).parents[2] / "examples" / "agent_tasks"


def test_files_last_from_one_command_to_the_next(sandbox):
    assert sandbox.run("pwd; echo hi > x; cd /tmp; echo there > y").text == "/app\n"
    assert sandbox.run("cat x /tmp/y").text == "hi\nthere\n"


def test_nothing_of_the_machine_is_within_reach(sandbox, tmp_path: Path):
    secret = tmp_path / "secret.txt"
    secret.write_text("mine")
    tried = sandbox.run(f"cat {secret} /etc/shadow; touch /usr/x; echo in > {tmp_path}/new; ls /root /home")
    assert "mine" not in tried.text
    assert tried.text.count("No such file") >= 3
    assert "Read-only" in tried.text
    assert not (tmp_path / "new").exists()


def test_there_is_no_network(sandbox):
    assert sandbox.run("tail -n +2 /proc/net/route").text == ""
    assert sandbox.run("tail -n +3 /proc/net/dev | cut -d: -f1").text.split() == ["lo"]


def test_a_command_that_never_ends_is_ended_with_all_that_it_started(sandbox):
    output = sandbox.run("(sleep 4242 &); (setsid sleep 4242 &); sleep 4242", seconds=0.5)
    assert (output.ended, output.status) == ("time", 137)
    assert not subprocess.run(["pgrep", "-f", "sleep 4242"], capture_output=True, check=False).stdout


def test_what_it_leaves_behind_ends_with_the_command(sandbox):
    assert sandbox.run("(setsid sleep 4243 &) ; echo gone").text == "gone\n"
    assert not subprocess.run(["pgrep", "-f", "sleep 4243"], capture_output=True, check=False).stdout


def test_a_full_disk_ends_the_command(sandbox):
    fill = "for i in $(seq 40); do head -c 3000000 /dev/zero > f$i; sleep .1; done; echo done"
    assert sandbox.run(fill, seconds=30).ended == "disk"


def test_one_large_file_is_refused(sandbox):
    assert sandbox.run("head -c 300000000 /dev/zero > big; echo status $?").text.endswith("status 153\n")


def test_killing_everybody_hurts_nobody_else(sandbox):
    assert sandbox.run("kill -9 $PPID; kill -9 1; kill -9 -1; echo still").text.endswith("still\n")


def test_endless_and_binary_output_is_bounded_text(sandbox):
    text = sandbox.run("head -c 3000000 /dev/urandom").text
    assert len(text) < 4000
    assert "bytes cut" in text
    assert all(c.isprintable() or c in "\n\t" for c in text)


@pytest.mark.parametrize(("command", "status"), [("exit 7", 7), ("kill -SEGV $$", 139), ("true", 0)])
def test_the_status_is_the_commands_own(sandbox, command, status):
    assert sandbox.run(command).status == status


def test_a_link_is_no_reward_and_a_folder_is_emptied(sandbox):
    sandbox.empty("/logs/verifier")
    sandbox.run("ln -s /etc/passwd /logs/verifier/reward.txt; echo 1 > /logs/verifier/other")
    assert sandbox.read("/logs/verifier/reward.txt") is None
    assert sandbox.read("/logs/verifier/other") == "1\n"
    sandbox.empty("/logs/verifier")
    assert sandbox.read("/logs/verifier/other") is None


@pytest.mark.parametrize("place", ["/etc/x", "relative", "/app/../etc/x", "/"])
def test_the_machines_own_places_are_refused(sandbox, tmp_path: Path, place):
    with pytest.raises(EnvironmentFailedError, match="belongs to the host"):
        sandbox.put(tmp_path, place, inside=False)


def test_without_the_program_the_error_names_it(tmp_path: Path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(MissingDependencyError, match="bwrap"):
        BubblewrapSandbox(tmp_path)


@pytest.mark.parametrize("task", read_tasks(OURS), ids=lambda task: task.name)
def test_each_of_our_tasks_is_solved_by_its_solution_and_by_nothing_else(sandboxed, task):
    with bubblewrap(task) as box:
        assert run_tests(task, box).status != 0
        with box.shown(task.folder / "solution", "/solution"):
            assert box.run("bash /solution/solve.sh").status == 0
        assert run_tests(task, box).status == 0


def test_the_agent_cannot_write_its_own_reward(sandboxed):
    (task,) = read_tasks(OURS, ["deposit-photos"])
    with bubblewrap(task) as box:
        box.run("mkdir -p /logs/verifier; echo 1 > /logs/verifier/reward.txt")
        assert run_tests(task, box).status != 0


def test_a_dockerfile_that_needs_more_is_not_measured(sandboxed, tmp_path: Path):
    folder = tmp_path / "one"
    for name in ("environment", "tests"):
        (folder / name).mkdir(parents=True)
    (folder / "task.toml").write_text("")
    (folder / "instruction.md").write_text("x")
    (folder / "tests" / "test.sh").write_text("")
    for told, message in (
        ("RUN no-such-program", "status 127"),
        ("COPY missing.txt .", "not there"),
        ("COPY ../../x .", "not there|outside"),
        ("COPY --from=a b c", "needs Docker"),
    ):
        (folder / "environment" / "Dockerfile").write_text(f"FROM x\nWORKDIR /app\n{told}\n")
        (task,) = read_tasks(tmp_path)
        with pytest.raises(EnvironmentFailedError, match=message), bubblewrap(task):
            pass
