"""The sandbox for agents: commands under bubblewrap.

The host never opens, follows or executes a file that an agent wrote: commands inside the sandbox do it.
"""

from __future__ import annotations

import shlex
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from gvla2.agents.contracts import AgentTask, EnvironmentFailedError, Output
from gvla2.errors import MissingDependencyError

_WRITABLE = {"app": "/app", "tmp": "/tmp", "home": "/home/agent", "logs": "/logs"}
"""Folders of the host, and where commands under bubblewrap see them; the first is the working folder."""
_PATH = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
_VARIABLES = {"PATH": _PATH, "HOME": "/home/agent", "LANG": "C.UTF-8", "TERM": "dumb", "PAGER": "cat"}
_READABLE_IN_ETC = ("alternatives", "ld.so.cache", "localtime", "python3", "mime.types")
OUTPUT = 8000
"""Bytes kept of a command's output."""
_GUARDED = """\
ulimit -c 0 -u 4096 -f {file_blocks} -v {memory_kb} 2>/dev/null
cd {folder} 2>/dev/null || cd /
o=/dev/shm/output
timeout -k 1 {seconds:g} {words} >$o 2>&1 </dev/null & command=$!
while sleep 0.5; do
  [ "$(du -smc {writable} 2>/dev/null | tail -n 1 | cut -f 1)" -gt {disk_mb} ] && touch $o.full && kill -KILL $command
done &
wait $command 2>/dev/null; status=$?
if [ -e $o.full ]; then status=137; echo "[Ended: the files are larger than {disk_mb} MB.]"; fi
n=$(stat -c %s $o)
if [ $n -le {output} ]; then cat $o
else head -c {half} $o; echo; echo "[... $((n - 2 * {half})) bytes cut ...]"; tail -c {half} $o; fi
exit $status
"""
"""Runs one command under the limits. Output goes through a file so that a process left behind cannot hold it open."""


class BubblewrapSandbox:
    """A :class:`~gvla2.agents.contracts.Sandbox` of Linux namespaces.

    Commands get no network, no other process, and none of the host's variables or files but its programs. ``root`` is a
    folder of the host for what they write: the working folder, ``/tmp``, the home, ``/logs``. The files may take
    ``disk_mb``, each process ``memory_mb``.
    """

    folder = _WRITABLE["app"]

    def __init__(self, root: Path, disk_mb: float = 512, memory_mb: float = 4096) -> None:
        if (program := shutil.which("bwrap")) is None:
            raise MissingDependencyError(
                "the program 'bwrap'", "Running an agent in a sandbox", "apt install bubblewrap (LGPL-2.0)"
            )
        for name in _WRITABLE:
            (root / name).mkdir(parents=True, exist_ok=True)
        self._arguments = [program, *_namespaces(root, int(disk_mb))]
        self._disk_mb, self._memory_mb = int(disk_mb), int(memory_mb)

    def run(
        self,
        command: str,
        *,
        seconds: float = 60.0,
        variables: Mapping[str, str] | None = None,
        shown: Mapping[Path, str] | None = None,
    ) -> Output:
        """Run a command by bash in the working folder; it ends after ``seconds`` or when it fills the disk.

        It sees the folders ``shown`` of the host, read-only, at these places; links in them lead nowhere on the host. A
        command that cannot be started (a NUL byte, too long) is an output with status 126.
        """
        pairs = [f"{name}={value}" for name, value in (variables or {}).items()]
        guarded = _GUARDED.format(
            file_blocks=self._disk_mb * 1024,
            memory_kb=self._memory_mb * 1024,
            disk_mb=self._disk_mb,
            output=OUTPUT,
            half=OUTPUT // 2,
            folder=shlex.quote(self.folder),
            writable=shlex.join(_WRITABLE.values()),
            seconds=seconds,
            words=shlex.join(["env", *pairs, "bash", "-c", command]),
        )
        mounts = [word for folder, at in (shown or {}).items() for word in ("--ro-bind", str(folder), at)]
        begun = time.monotonic()
        try:
            # Bubblewrap itself gets no variable either: its environment is readable in the sandbox.
            done = subprocess.run(
                [*self._arguments, *mounts, "bash", "-c", guarded],
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                env={},
                timeout=seconds + 10,
                check=False,
            )
        except subprocess.TimeoutExpired:
            return Output("", 137, time.monotonic() - begun, timed_out=True)
        except (OSError, ValueError) as error:
            return Output(f"The command cannot be run: {error}", 126, time.monotonic() - begun)
        spent, late = time.monotonic() - begun, done.returncode in (124, 137)
        return Output(
            _printable(done.stdout.decode(errors="replace")),
            done.returncode,
            spent,
            late and spent >= seconds,
        )


def _namespaces(root: Path, disk_mb: int) -> list[str]:
    """Bubblewrap's arguments: everything unshared, programs read-only, ``root``'s folders writable."""
    words = ["--unshare-all", "--die-with-parent", "--new-session", "--clearenv"]
    words += [word for name, value in _VARIABLES.items() for word in ("--setenv", name, value)]
    words += ["--uid", "1000", "--gid", "1000", "--hostname", "sandbox", "--ro-bind", "/usr", "/usr"]
    for place in map(Path, ("/bin", "/sbin", "/lib", "/lib32", "/lib64", "/libx32")):
        if place.is_symlink():
            words += ["--symlink", str(place.readlink()), str(place)]
        elif place.is_dir():
            words += ["--ro-bind", str(place), str(place)]
    for name in _READABLE_IN_ETC:
        words += ["--ro-bind-try", f"/etc/{name}", f"/etc/{name}"]
    words += ["--dev", "/dev", "--size", str(disk_mb << 20), "--tmpfs", "/dev/shm", "--proc", "/proc"]
    for name, at in _WRITABLE.items():
        words += ["--bind", str(root / name), at]
    return [*words, "--chdir", _WRITABLE["app"]]


@contextmanager
def bubblewrap(task: AgentTask) -> Iterator[BubblewrapSandbox]:
    """Context manager for a task whose environment is a folder of files, and this machine's programs.

    Raises :class:`EnvironmentFailedError` for a task that needs an image, and where namespaces are not allowed.
    """
    if task.files is None:
        raise EnvironmentFailedError(
            f"{task.name} needs an image, for which there is no sandbox here: its task.toml names no folder of files "
            "as metadata.files."
        )
    # Not below /tmp, which commands see as their own.
    with tempfile.TemporaryDirectory(
        prefix="gvla2-agent-", dir="/var/tmp", ignore_cleanup_errors=True
    ) as root:
        shutil.copytree(task.files, Path(root, "app"), symlinks=True)
        sandbox = BubblewrapSandbox(Path(root), task.disk_mb, task.memory_mb)
        tried = sandbox.run("true", seconds=30)
        if tried.status != 0:
            raise EnvironmentFailedError(f"bubblewrap cannot run a command here: {tried.text.strip()[-200:]}")
        yield sandbox


def _printable(text: str) -> str:
    return "".join(c if c.isprintable() or c in "\n\t" else "\N{REPLACEMENT CHARACTER}" for c in text)
