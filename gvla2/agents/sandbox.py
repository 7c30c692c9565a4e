"""A sandbox from Linux namespaces, by bubblewrap: no engine, no root, a few milliseconds per command."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import IO

from gvla2.agents.contracts import AgentTask, Output
from gvla2.agents.dockerfile import Recipe, read_recipe
from gvla2.errors import ConfigurationError, Gvla2Error, MissingDependencyError

SYSTEM = ("usr", "bin", "sbin", "lib", "lib32", "lib64", "libx32", "etc", "proc", "dev", "sys", "boot", "run")
"""Folders of the host: a task that writes there needs Docker."""
_SHOWN_OF_ETC = ("alternatives", "ld.so.cache", "localtime", "python3", "mime.types")
_PATH = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"


@dataclass(frozen=True)
class SandboxLimits:
    """Megabytes of files in total and of memory per process, and characters of output kept per command."""

    disk_mb: int = 512
    memory_mb: int = 4096
    output: int = 20_000


DEFAULT_LIMITS = SandboxLimits()
_NO_RECIPE = Recipe()


class EnvironmentFailedError(Gvla2Error):
    """The task's environment could not be set up here; the task is not measured."""


class BubblewrapSandbox:
    """A :class:`~gvla2.agents.contracts.Sandbox` in a host folder.

    Commands see the host's programs (``/usr``, read-only), their own ``/tmp``, home and working folder, and nothing
    else: no network, no other process, no file of the user's. Whatever they start ends with them.
    """

    def __init__(
        self, root: Path, recipe: Recipe = _NO_RECIPE, limits: SandboxLimits = DEFAULT_LIMITS
    ) -> None:
        if shutil.which("bwrap") is None:
            raise MissingDependencyError(
                "the program 'bwrap'", "Running an agent in a sandbox", "apt install bubblewrap (LGPL-2.0)"
            )
        self._root, self._recipe, self._limits = root, recipe, limits
        self._hidden: dict[str, Path] = {}
        for name in ("tmp", "home"):
            (root / name).mkdir(parents=True, exist_ok=True)
        self._place(recipe.folder).mkdir(parents=True, exist_ok=True)

    @property
    def folder(self) -> str:
        """The working folder as commands see it."""
        return self._recipe.folder

    def put(self, source: Path, target: str, *, inside: bool) -> None:
        """Copy a file or a folder's contents in; ``inside`` puts a file into the folder ``target``."""
        into = self._place(target)
        if source.is_dir():
            ignored = shutil.ignore_patterns("Dockerfile", "docker-compose.y*ml")
            shutil.copytree(source, into, dirs_exist_ok=True, ignore=ignored)
            return
        whole = into / source.name if inside or into.is_dir() else into
        whole.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(source, whole)

    def empty(self, folder: str) -> None:
        """Make a folder there with nothing in it."""
        place = self._place(folder)
        if place.is_symlink():
            place.unlink()
        shutil.rmtree(place, ignore_errors=True)
        place.mkdir(parents=True)

    def read(self, path: str) -> str | None:
        """A file that commands wrote; None if it is missing or a link."""
        place = self._place(path)
        return None if place.is_symlink() or not place.is_file() else place.read_text(errors="replace")

    def run(
        self, command: str, *, seconds: float = 60.0, variables: Mapping[str, str] | None = None
    ) -> Output:
        """Run a command by bash; ended after ``seconds``, or when it fills the disk."""
        limits = self._limits
        guarded = (
            f"ulimit -c 0 -f {limits.disk_mb * 1024} -v {limits.memory_mb * 1024} 2>/dev/null; "
            'cd "$1" 2>/dev/null || cd /; exec bash -c "$0"'
        )
        words = [*self._wrapped(variables or {}), "bash", "-c", guarded, command, self.folder]
        begun = time.monotonic()
        with subprocess.Popen(
            words,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        ) as process:
            assert process.stdout is not None
            kept = _Kept(limits.output)
            reader = threading.Thread(target=kept.read, args=(process.stdout,), daemon=True)
            reader.start()
            ended = self._wait(process, begun + seconds)
            reader.join(5)
        status = process.returncode if process.returncode >= 0 else 128 - process.returncode
        return Output(kept.text(), status, time.monotonic() - begun, ended)

    @contextmanager
    def shown(self, folder: Path, at: str) -> Iterator[None]:
        """Context manager that shows commands a host folder, read-only: a task's tests."""
        self._hidden[at] = folder
        try:
            yield
        finally:
            del self._hidden[at]

    def _wait(self, process: subprocess.Popen[bytes], until: float) -> str:
        """Wait until the command ends or is killed; returns why."""
        looked = time.monotonic()
        while True:
            try:
                process.wait(timeout=0.05)
                return ""
            except subprocess.TimeoutExpired:
                now = time.monotonic()
            reason = "time" if now > until else ""
            if not reason and now - looked > 0.5:
                looked = now
                reason = "disk" if _size_mb(self._root) > self._limits.disk_mb else ""
            if reason:
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(process.pid, signal.SIGKILL)
                process.wait()
                return reason

    def _wrapped(self, variables: Mapping[str, str]) -> list[str]:
        words = ["bwrap", "--unshare-all", "--die-with-parent", "--new-session", "--clearenv"]
        words += ["--uid", "1000", "--gid", "1000", "--hostname", "sandbox"]
        told = {"PATH": _PATH, "HOME": "/home/agent", "LANG": "C.UTF-8", "TERM": "dumb", "PAGER": "cat"}
        for name, value in {**told, **self._recipe.variables, **variables}.items():
            words += ["--setenv", name, value]
        words += ["--ro-bind", "/usr", "/usr"]
        for name in ("bin", "sbin", "lib", "lib32", "lib64", "libx32"):
            place = Path("/", name)
            if place.is_symlink():
                words += ["--symlink", str(place.readlink()), f"/{name}"]
            elif place.is_dir():
                words += ["--ro-bind", str(place), f"/{name}"]
        for name in _SHOWN_OF_ETC:
            words += ["--ro-bind-try", f"/etc/{name}", f"/etc/{name}"]
        words += ["--dev", "/dev", "--proc", "/proc"]
        words += [
            "--bind",
            str(self._root / "tmp"),
            "/tmp",
            "--bind",
            str(self._root / "home"),
            "/home/agent",
        ]
        files = self._root / "files"
        for place in sorted(files.iterdir()) if files.is_dir() else []:
            words += ["--bind", str(place), f"/{place.name}"]
        for at, folder in self._hidden.items():
            words += ["--ro-bind", str(folder), at]
        return words

    def _place(self, path: str) -> Path:
        parts = PurePosixPath(path).parts[1:]
        if not path.startswith("/") or not parts or ".." in parts or parts[0] in SYSTEM:
            raise EnvironmentFailedError(
                f"A task's file would lie at {path}, which belongs to the host: use sandbox=docker."
            )
        if parts[0] == "tmp":
            return self._root.joinpath("tmp", *parts[1:])
        if parts[:2] == ("home", "agent"):
            return self._root.joinpath("home", *parts[2:])
        return self._root.joinpath("files", *parts)


@contextmanager
def bubblewrap(task: AgentTask, limits: SandboxLimits = DEFAULT_LIMITS) -> Iterator[BubblewrapSandbox]:
    """Context manager for the task's environment, as its Dockerfile describes it.

    Raises :class:`EnvironmentFailedError` if it cannot be set up without Docker or the network.
    """
    with tempfile.TemporaryDirectory(prefix="gvla2-agent-", ignore_cleanup_errors=True) as folder:
        try:
            recipe = read_recipe(task.environment / "Dockerfile")
        except ConfigurationError as error:
            raise EnvironmentFailedError(str(error)) from error
        sandbox = BubblewrapSandbox(Path(folder), recipe, limits)
        for what, words in recipe.steps:
            if what == "copy":
                _copy(task, sandbox, words)
                continue
            output = sandbox.run(words[0], seconds=120)
            if output.status != 0:
                raise EnvironmentFailedError(
                    f"{task.name}: '{words[0][:100]}' from its Dockerfile failed here (status {output.status}: "
                    f"{output.text.strip()[-200:]}). sandbox=docker builds it with the network."
                )
        yield sandbox


def _copy(task: AgentTask, sandbox: BubblewrapSandbox, words: tuple[str, ...]) -> None:
    *sources, target = words
    for source in sources:
        found = (
            sorted(task.environment.glob(source.strip("/")))
            if source not in (".", "./")
            else [task.environment]
        )
        if not found:
            raise EnvironmentFailedError(
                f"{task.name}: its Dockerfile copies '{source}', which is not there."
            )
        for place in found:
            if not place.resolve().is_relative_to(task.environment.resolve()):
                raise EnvironmentFailedError(f"{task.name}: its Dockerfile copies '{source}' from outside.")
            sandbox.put(place, target.rstrip("/"), inside=target.endswith("/") or len(found) > 1)


class _Kept:
    """The head and the tail of a command's output, whatever its length."""

    def __init__(self, characters: int) -> None:
        self._half = characters // 2
        self._head, self._tail, self._cut = b"", b"", 0

    def read(self, stream: IO[bytes]) -> None:
        """All of it, until the stream ends."""
        with contextlib.suppress(ValueError):  # closed while reading: the command was killed
            while piece := os.read(stream.fileno(), 65536):
                if len(self._head) < self._half:
                    room = self._half - len(self._head)
                    self._head, piece = self._head + piece[:room], piece[room:]
                joined = self._tail + piece
                self._cut += max(0, len(joined) - self._half)
                self._tail = joined[-self._half :]

    def text(self) -> str:
        """What was kept, with a note of what was cut; undecodable bytes become question marks."""
        middle = f"\n[... {self._cut} bytes cut ...]\n".encode() if self._cut else b""
        text = (self._head + middle + self._tail).decode(errors="replace")
        return "".join(c if c.isprintable() or c in "\n\t" else "\N{REPLACEMENT CHARACTER}" for c in text)


def _size_mb(folder: Path) -> float:
    total = 0
    for place, _, names in os.walk(folder):
        for name in names:
            with contextlib.suppress(OSError):
                total += Path(place, name).lstat().st_blocks * 512
    return total / 1e6
