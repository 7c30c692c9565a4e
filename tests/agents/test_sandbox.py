"""The sandbox against commands and task folders that misbehave."""

import errno
import os
import platform
import socket
import subprocess
from pathlib import Path

import pytest

from gvla2.agents.contracts import AgentTask, EnvironmentFailedError
from gvla2.agents.sandbox import _KEY_CALLS, BubblewrapSandbox, bubblewrap
from gvla2.agents.tasks import read_task, read_tasks, run_tests
from gvla2.errors import ConfigurationError, MissingDependencyError

OURS = Path(__file__).parents[2] / "examples" / "agent_tasks"


def task_in(folder: Path, test: str = "exit 0\n") -> AgentTask:
    for name in ("environment/files", "tests"):
        (folder / name).mkdir(parents=True)
    (folder / "task.toml").write_text('[metadata]\nfiles = "environment/files"\n')
    (folder / "instruction.md").write_text("Do it.")
    (folder / "tests" / "test.sh").write_text(test)
    return read_task(folder)


def test_files_last_from_one_command_to_the_next(sandbox):
    assert sandbox.run("pwd; echo hi > x; cd /tmp; echo there > y").text == "/app\n"
    assert sandbox.run("cat x /tmp/y").text == "hi\nthere\n"


def test_nothing_of_the_machine_is_within_reach(sandbox, tmp_path: Path):
    secret = tmp_path / "secret.txt"
    secret.write_text("mine")
    tried = sandbox.run(f"cat {secret} /etc/shadow; touch /usr/x; echo in > {tmp_path}/new; ls /root")
    assert "mine" not in tried.text
    assert tried.text.count("No such file") >= 3
    assert "Read-only" in tried.text
    assert not (tmp_path / "new").exists()
    assert sandbox.run("tail -n +2 /proc/net/route").text == ""
    assert sandbox.run("tail -n +3 /proc/net/dev | cut -d: -f1").text.split() == ["lo"]


@pytest.mark.parametrize("place", ["/", "/dev", "/etc", "/home", "/usr", "/proc/sys/kernel/core_pattern"])
def test_nothing_else_can_be_written(sandbox, place):
    # Memory without a limit, and settings of the host, which its root may change.
    written = sandbox.run(f"""python3 -c '
import os, sys
os.open(sys.argv[1] + "/x" * os.path.isdir(sys.argv[1]), os.O_WRONLY | os.O_CREAT)' {place}""")
    assert "Read-only file system" in written.text


def test_a_command_gets_no_namespace_in_which_it_could_mount(sandbox):
    output = sandbox.run("unshare -Urm sh -c 'mount -t tmpfs none /tmp && echo mounted'")
    assert output.status != 0
    assert "mounted" not in output.text


def test_no_variable_of_the_host_is_readable_anywhere_in_the_sandbox(sandboxed, tmp_path: Path, monkeypatch):
    monkeypatch.setenv("OPENAI_API_KEY", "sk-THE-KEY")
    output = BubblewrapSandbox(tmp_path).run("env; cat /proc/*/environ /proc/*/cmdline | tr '\\0' '\\n'")
    assert "HOME=/home/agent" in output.text
    assert "sk-THE-KEY" not in output.text


@pytest.mark.parametrize("command", ["sleep {0}", "(sleep {0} &); (setsid sleep {0} &); sleep {0}"])
def test_a_command_that_never_ends_is_ended_with_all_that_it_started(sandbox, command):
    output = sandbox.run(f"echo begun; {command.format(4242)}", seconds=0.5)
    assert (output.text, output.timed_out) == ("begun\n", True)
    assert not subprocess.run(["pgrep", "-f", "^sleep 4242"], capture_output=True, check=False).stdout


def test_many_files_that_fill_the_disk_end_the_command(sandbox):
    fill = "for i in $(seq 60); do head -c 3000000 /dev/zero > f$i; sleep .1; done; echo done"
    output = sandbox.run(fill, seconds=30)
    assert output.status == 137
    assert "larger than 40 MB" in output.text
    assert "done" not in output.text
    assert sandbox.run("rm f*; ls").text == "", "the next command can make room"


def test_no_command_can_end_the_watch_over_the_disk(sandbox):
    fill = "pkill sleep; pkill du; for i in $(seq 9999); do head -c 3000000 /dev/zero > f$i; done"
    assert "larger than 40 MB" in sandbox.run(fill, seconds=30).text


def test_one_large_file_and_much_memory_are_refused(sandbox):
    assert sandbox.run("head -c 300000000 /dev/zero > big; echo status $?").text.endswith("status 153\n")
    assert "MemoryError" in sandbox.run("python3 -c 'x = bytes(5 << 30)'").text


@pytest.mark.parametrize(
    "work", ["x = b'x' * (60 << 20)", "import os; f = os.memfd_create('x'); os.write(f, b'x' * (39 << 20))"]
)
def test_the_memory_of_all_processes_together_is_bounded(sandboxed, tmp_path: Path, work):
    box = BubblewrapSandbox(tmp_path, disk_mb=40, memory_mb=200)
    one = f'python3 -c "{work}; import time; time.sleep(20)" &'
    assert "more than 200 MB" in box.run(f"{one * 12} wait", seconds=20).text


def test_the_kernels_keyrings_are_closed(sandbox):
    _, calls = _KEY_CALLS.get(platform.machine(), (0, ()))
    for call in calls:  # namespaces do not hide the keys of the host's user
        asked = (
            f"c = ctypes.CDLL(None, use_errno=True); print(c.syscall({call}, 0, -3, 0), ctypes.get_errno())"
        )
        assert sandbox.run(f'python3 -c "import ctypes; {asked}"').text.split() == ["-1", str(errno.EPERM)]


WAYS_OUT = (
    "ln -s {0} d; cat d/secret; echo x > d/new",
    "ln {0}/secret hard; cat hard; cat /proc/1/root{0}/secret",
    "for p in /proc/[0-9]*; do cat $p/environ $p/cwd{0}/secret; done",
    "nsenter -t 1 -a cat {0}/secret; cat /dev/mem /proc/kcore",
    "mknod d b 8 0; mount -t tmpfs none /app; chroot / cat {0}/secret",
    "cp /bin/bash b; chmod u+s b; ./b -pc 'cat {0}/secret'",
    "mount --bind / /mnt; unshare -Urm cat /mnt{0}/secret",
    "exec 3<>/dev/tcp/127.0.0.1/{1}; cat <&3",
    "python3 -c 'import socket; socket.socket(socket.AF_UNIX).connect(chr(0) + \"gvla2 {1}\")'",
    "mkfifo p; cat p & rm -rf / --no-preserve-root; kill -9 -1; kill -STOP 1",
)


def test_no_command_leads_out(sandbox, tmp_path: Path, monkeypatch):
    outside = tmp_path / "outside"
    outside.mkdir()
    (outside / "secret").write_text("THE-SECRET")
    monkeypatch.setenv("KEY", "THE-SECRET")
    with socket.create_server(("127.0.0.1", 0)) as server, socket.socket(socket.AF_UNIX) as local:
        port = server.getsockname()[1]
        local.bind(f"\0gvla2 {port}")
        for listening in (server, local):
            listening.listen()
            listening.setblocking(False)
        for way in WAYS_OUT:
            assert "THE-SECRET" not in sandbox.run(way.format(outside, port), seconds=5).text, way
        for listening in (server, local):
            with pytest.raises(BlockingIOError):
                listening.accept()
    assert {file.name: file.read_text() for file in outside.iterdir()} == {"secret": "THE-SECRET"}


def test_endless_and_binary_output_is_bounded_text(sandbox):
    text = sandbox.run("head -c 3000000 /dev/urandom").text
    assert len(text) < 9000
    assert "bytes cut" in text
    assert all(c.isprintable() or c in "\n\t" for c in text)


@pytest.mark.parametrize(("command", "status"), [("exit 7", 7), ("kill -SEGV $$", 139), ("true", 0)])
def test_the_status_is_the_commands_own(sandbox, command, status):
    assert sandbox.run(command).status == status


@pytest.mark.parametrize(
    "command", ["echo a\0b", "echo \ud800", "cat > f <<'EOF'\n" + "line\n" * 60_000 + "EOF"]
)
def test_a_command_that_cannot_be_run_is_an_answer(sandbox, command):
    output = sandbox.run(command)
    assert output.status == 126
    assert "cannot be run" in output.text
    assert sandbox.run("echo fine").status == 0


def test_links_in_a_task_lead_nowhere_on_the_host(sandboxed, tmp_path: Path):
    (tmp_path / "home").mkdir()
    (tmp_path / "home" / "key").write_text("SECRET")
    task = task_in(tmp_path / "task", "cat /tests/key /tests/home/key\nexit 0\n")
    for folder in (task.files, task.tests):
        (folder / "key").symlink_to(tmp_path / "home" / "key")
        (folder / "home").symlink_to(tmp_path / "home")
    with bubblewrap(task) as box:
        assert "SECRET" not in box.run("cat key home/key; echo x > home/new; echo x > key; ls -l").text
        assert "SECRET" not in run_tests(task, box).text
    assert [path.name for path in (tmp_path / "home").iterdir()] == ["key"]
    assert (tmp_path / "home" / "key").read_text() == "SECRET"


def test_pipes_and_giants_in_a_task_hold_nothing_up(sandboxed, tmp_path: Path):
    task = task_in(tmp_path / "task")
    os.mkfifo(task.files / "pipe")
    with pytest.raises(EnvironmentFailedError, match="named pipe"), bubblewrap(task):
        pass
    (task.files / "pipe").unlink()
    (task.files / "sparse").touch()
    os.truncate(task.files / "sparse", 40 << 30)
    with pytest.raises(EnvironmentFailedError, match="take 40960 MB"), bubblewrap(task):
        pass
    (task.folder / "instruction.md").unlink()
    os.mkfifo(task.folder / "instruction.md")
    with pytest.raises(ConfigurationError, match=r"instruction\.md is not a file"):
        read_task(task.folder)


@pytest.mark.parametrize("name", ["tests", "environment", "environment/files", "instruction.md", "task.toml"])
def test_a_task_whose_own_folders_are_links_is_refused(tmp_path: Path, name):
    task = task_in(tmp_path / "task")
    (task.folder / name).rename(tmp_path / "elsewhere")
    (task.folder / name).symlink_to(tmp_path / "elsewhere")
    with pytest.raises(ConfigurationError, match=r"link|not a folder of the task"):
        read_task(task.folder)


@pytest.mark.parametrize(
    ("script", "status"),
    [
        ("echo 0.5 > reward.txt", 1),
        ("printf '1\\r\\n' > reward.txt; exit 3", 0),
        ('echo \'{"reward": 0, "why": "it is late"}\' > reward.json', 1),
        ("echo '{\"reward\": 1.0}' > reward.json; exit 3", 0),
        ('echo \'{"fast": 1, "right": 0}\' > reward.json', 1),
        ("echo '{}' > reward.json", 1),
        ("echo 1 > reward.txt; echo 0 > reward.json", 0),
    ],
)
def test_the_reward_that_tests_write_counts(sandboxed, tmp_path: Path, script: str, status: int):
    with bubblewrap(task := task_in(tmp_path / "task", f"cd /logs/verifier; {script}\n")) as box:
        assert (run_tests(task, box).status == 0) == (status == 0)


def test_the_agent_cannot_write_its_own_reward(sandboxed, tmp_path: Path):
    elsewhere = tmp_path / "reward"
    elsewhere.mkdir()
    (elsewhere / "reward.txt").write_text("1")
    task = task_in(tmp_path / "task", "exit 1\n")
    for trick in (
        "mkdir -p /logs/verifier; echo 1 > /logs/verifier/reward.txt; chmod a-w /logs/verifier",
        f"ln -s {elsewhere} /logs/verifier",
        "mkdir -p /logs/verifier/x; chmod 000 /logs/verifier /logs",
    ):
        with bubblewrap(task) as box:
            box.run(trick)
            assert run_tests(task, box).status != 0


def test_a_task_that_needs_an_image_is_not_measured(tmp_path: Path):
    task = task_in(tmp_path / "task")
    (task.folder / "task.toml").write_text("")
    with pytest.raises(EnvironmentFailedError, match="needs an image"), bubblewrap(read_task(task.folder)):
        pass


def test_without_the_program_the_error_names_it(tmp_path: Path, monkeypatch):
    task = task_in(tmp_path / "task")
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(MissingDependencyError, match="bwrap"), bubblewrap(task):
        pass


@pytest.mark.parametrize("task", read_tasks(OURS), ids=lambda task: task.name)
def test_each_of_our_tasks_is_solved_by_its_solution_and_by_nothing_else(sandboxed, task):
    with bubblewrap(task) as box:
        assert run_tests(task, box).status != 0
        shown = {task.folder / "solution": "/solution"}
        assert box.run("bash /solution/solve.sh", shown=shown).status == 0
        assert run_tests(task, box).status == 0
