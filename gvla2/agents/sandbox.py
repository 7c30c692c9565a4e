"""The sandbox for agents: commands under bubblewrap.

The host never opens, follows or executes a file that an agent wrote: commands inside the sandbox do it.
"""

from __future__ import annotations

import errno
import os
import platform
import resource
import shlex
import shutil
import stat
import struct
import subprocess
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
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
WATCH_SECONDS = 0.2
"""Between looks at how much a running command has written, and how much memory it takes."""
SHARED = 256 << 20
"""Bytes of processes together from which on it is worth counting shared pages once."""
_KEY_CALLS = {"x86_64": (0xC000003E, (248, 249, 250)), "aarch64": (0xC00000B7, (217, 218, 219))}
"""By machine: its number in Linux's audits, and the numbers of the calls add_key, request_key and keyctl."""
_GUARDED = """\
ulimit -c 0 -u 4096 -f {file_blocks} -v {memory_kb} 2>/dev/null
cd {folder} 2>/dev/null || cd /
o=/run/output
timeout -k 1 {seconds:g} {words} >$o 2>&1 </dev/null; status=$?
n=$(stat -c %s $o 2>/dev/null || echo 0)
if [ $n -le {output} ]; then cat $o
else head -c {half} $o; echo; echo "[... $((n - 2 * {half})) bytes cut ...]"; tail -c {half} $o; fi
exit $status
"""
"""Runs one command under the limits. Output goes through a file so that a process left behind cannot hold it open."""


class BubblewrapSandbox:
    """A :class:`~gvla2.agents.contracts.Sandbox` of Linux namespaces.

    Commands get no network, no other process, and none of the host's variables or files but its programs. ``root`` is a
    folder of the host for what they write: the working folder, ``/tmp``, the home, ``/logs``; all else is read-only but
    ``/dev/shm`` and ``/run``. The files may take ``disk_mb``, so may each of these two, and all processes of a command
    together ``memory_mb``.
    """

    folder = _WRITABLE["app"]

    def __init__(self, root: Path, disk_mb: float = 512, memory_mb: float = 4096) -> None:
        if (program := shutil.which("bwrap")) is None:
            raise MissingDependencyError(
                "the program 'bwrap'", "Running an agent in a sandbox", "apt install bubblewrap (LGPL-2.0)"
            )
        for name in _WRITABLE:
            (root / name).mkdir(parents=True, exist_ok=True)
        self._root, self._arguments = root, [program, *_namespaces(root, int(disk_mb))]
        self._disk_mb, self._memory_mb = int(disk_mb), int(memory_mb)

    def run(
        self,
        command: str,
        *,
        seconds: float = 60.0,
        variables: Mapping[str, str] | None = None,
        shown: Mapping[Path, str] | None = None,
    ) -> Output:
        """Run a command by bash in the working folder; it ends after ``seconds``, or when it fills disk or memory.

        It sees the folders ``shown`` of the host, read-only, at these places; links in them lead nowhere on the host. A
        command that cannot be started (a NUL byte, too long) is an output with status 126.
        """
        pairs = [f"{name}={value}" for name, value in (variables or {}).items()]
        guarded = _GUARDED.format(
            file_blocks=self._disk_mb * 1024,
            memory_kb=self._memory_mb * 1024,
            output=OUTPUT,
            half=OUTPUT // 2,
            folder=shlex.quote(self.folder),
            seconds=seconds,
            words=shlex.join(["env", *pairs, "bash", "-c", command]),
        )
        mounts = [word for folder, at in (shown or {}).items() for word in ("--ro-bind", str(folder), at)]
        # Read-only once every mount point is made: bubblewrap's root and /dev are memory without a limit, and where
        # the host's user is root, /proc/sys holds the host's settings.
        closed = [word for place in ("/proc", "/dev", "/") for word in ("--remount-ro", place)]
        before, full, hungry, free = self._megabytes(), False, False, shutil.disk_usage(self._root).free
        most, shared = self._memory_mb << 20, _shared_memory() + 2 * (self._disk_mb << 20)
        room, begun = max(self._disk_mb - before, 0) << 20, time.monotonic()
        with _keyless() as (fd, closed_calls):
            words = [*self._arguments, *mounts, *closed, *closed_calls, "--chdir", self.folder, "bash", "-c"]
            try:
                # Bubblewrap itself gets no variable either: its environment is readable in the sandbox.
                process = subprocess.Popen(
                    [*words, guarded],
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.STDOUT,
                    env={},
                    pass_fds=fd,
                )
            except (OSError, ValueError) as error:
                return Output(f"The command cannot be run: {error}", 126, time.monotonic() - begun)
        with process:
            try:
                # Watched from outside, where no command can end the watch; one that makes room may run on. Counting is
                # slow, so files are counted only where the disk's free space says that they may be too large.
                while (written := _written_by(process)) is None:
                    if free - shutil.disk_usage(self._root).free > room:
                        full = self._megabytes() > max(self._disk_mb, before)
                    hungry = max(_memory_of(process.pid), _shared_memory() - shared) > most
                    if full or hungry or time.monotonic() - begun > seconds + 10:
                        break
            finally:
                process.kill()
        spent = time.monotonic() - begun
        full = full or self._megabytes() > max(self._disk_mb, before)
        if full:
            return Output(f"[Ended: the files are larger than {self._disk_mb} MB.]\n", 137, spent)
        if hungry:
            return Output(f"[Ended: its processes took more than {self._memory_mb} MB.]\n", 137, spent)
        if written is None:
            return Output("", 137, spent, timed_out=True)
        late = process.returncode in (124, 137) and spent >= seconds
        return Output(_printable(written.decode(errors="replace")), process.returncode, spent, late)

    def _megabytes(self) -> int:
        """What all files take; ``du`` follows no link."""
        counted = subprocess.run(["du", "-sk", str(self._root)], capture_output=True, check=False)
        return int(counted.stdout.split()[0]) >> 10


def _written_by(process: subprocess.Popen[bytes]) -> bytes | None:
    """The output of a process that ended; None while it runs on."""
    try:
        return process.communicate(timeout=WATCH_SECONDS)[0]
    except subprocess.TimeoutExpired:
        return None


@contextmanager
def _keyless() -> Iterator[tuple[Sequence[int], Sequence[str]]]:
    """A file descriptor and bubblewrap's arguments for a filter of system calls (seccomp) that refuses the kernel's
    keyrings: no namespace hides those of the host's user.

    There is no filter for a machine whose calls are not known here.
    """
    if (known := _KEY_CALLS.get(platform.machine())) is None:
        yield (), ()
        return
    machine, calls = known
    refuse = len(calls) + 5  # the place of the last step, which a jump counts from its next one
    steps = [(0x20, 0, 0, 4), (0x15, 0, refuse - 2, machine), (0x20, 0, 0, 0), (0x35, refuse - 4, 0, 1 << 30)]
    steps += [(0x15, refuse - 5 - k, 0, call) for k, call in enumerate(calls)]
    steps += [(0x06, 0, 0, 0x7FFF0000), (0x06, 0, 0, 0x00050000 | errno.EPERM)]
    read, write = os.pipe()
    try:
        os.write(write, b"".join(struct.pack("HBBI", *step) for step in steps))
        os.close(write)
        yield (read,), ("--seccomp", str(read))
    finally:
        os.close(read)


def _shared_memory() -> int:
    """Bytes of the machine's memory that lie in no process: memory files, System V segments, tmpfs."""
    return int(Path("/proc/meminfo").read_text().partition("\nShmem:")[2].split()[0]) << 10


def _memory_of(top: int) -> int:
    """Bytes of memory of a process and of all that descend from it; what they share counts once."""
    parents = {}
    for file in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):  # it has ended
            parents[int(file.parent.name)] = int(file.read_bytes().rpartition(b")")[2].split()[1])
    family = {top}
    while more := {pid for pid, parent in parents.items() if parent in family} - family:
        family |= more
    held = {}
    for pid in family:
        with suppress(OSError):
            held[pid] = int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * resource.getpagesize()
    for pid in held if sum(held.values()) > SHARED else ():  # exact, and slower
        with suppress(OSError):
            shares = Path(f"/proc/{pid}/smaps_rollup").read_text().partition("\nPss:")[2].split()
            held[pid] = int(shares[0]) << 10 if shares else 0
    return sum(held.values())


def _namespaces(root: Path, disk_mb: int) -> list[str]:
    """Bubblewrap's arguments: everything unshared, programs read-only, ``root``'s folders writable."""
    words = ["--unshare-all", "--unshare-user", "--disable-userns", "--die-with-parent", "--new-session"]
    words += ["--clearenv"]
    words += [word for name, value in _VARIABLES.items() for word in ("--setenv", name, value)]
    words += ["--uid", "1000", "--gid", "1000", "--hostname", "sandbox", "--ro-bind", "/usr", "/usr"]
    for place in map(Path, ("/bin", "/sbin", "/lib", "/lib32", "/lib64", "/libx32")):
        if place.is_symlink():
            words += ["--symlink", str(place.readlink()), str(place)]
        elif place.is_dir():
            words += ["--ro-bind", str(place), str(place)]
    for name in _READABLE_IN_ETC:
        words += ["--ro-bind-try", f"/etc/{name}", f"/etc/{name}"]
    words += ["--dev", "/dev", "--proc", "/proc"]
    for folder in ("/dev/shm", "/run"):
        words += ["--size", str(disk_mb << 20), "--tmpfs", folder]
    for name, at in _WRITABLE.items():
        words += ["--bind", str(root / name), at]
    return words


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
        try:
            _check(task.files, int(task.disk_mb))
            shutil.copytree(task.files, Path(root, "app"), symlinks=True)
        except OSError as error:
            raise EnvironmentFailedError(f"The files of {task.name} cannot be copied: {error}") from error
        sandbox = BubblewrapSandbox(Path(root), task.disk_mb, task.memory_mb)
        tried = sandbox.run("true", seconds=30)
        if tried.status != 0:
            raise EnvironmentFailedError(f"bubblewrap cannot run a command here: {tried.text.strip()[-200:]}")
        yield sandbox


def _check(folder: Path, disk_mb: int) -> None:
    """Raise OSError for files that exceed the disk, however sparse, and for a pipe or a device, which may never end."""
    size = 0
    for path in folder.rglob("*"):
        found = path.lstat()
        if not (stat.S_ISREG(found.st_mode) or stat.S_ISDIR(found.st_mode) or stat.S_ISLNK(found.st_mode)):
            raise OSError(f"{path} is a named pipe, a socket or a device")
        size += found.st_size
    if size > disk_mb << 20:
        raise OSError(f"they take {size >> 20} MB, and the task has a disk of {disk_mb} MB")


def _printable(text: str) -> str:
    return "".join(c if c.isprintable() or c in "\n\t" else "\N{REPLACEMENT CHARACTER}" for c in text)
