"""A sandbox in a Docker container, for tasks whose environment needs more than this machine's programs."""

from __future__ import annotations

import contextlib
import shutil
import subprocess
import time
import uuid
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from gvla2.agents.contracts import AgentTask, Output
from gvla2.agents.sandbox import DEFAULT_LIMITS, EnvironmentFailedError, SandboxLimits
from gvla2.errors import MissingDependencyError

BUILD_SECONDS = 1800.0
_FOLDER_OF = "{{.Config.WorkingDir}}"


class DockerSandbox:
    """A :class:`~gvla2.agents.contracts.Sandbox`: one container without a network, removed with the task."""

    def __init__(self, container: str, folder: str, limits: SandboxLimits) -> None:
        self._container, self._folder, self._limits = container, folder or "/", limits

    @property
    def folder(self) -> str:
        """The working folder as commands see it."""
        return self._folder

    def run(
        self, command: str, *, seconds: float = 60.0, variables: Mapping[str, str] | None = None
    ) -> Output:
        """Run a command by bash; killed after ``seconds``, inside the container too."""
        told = [word for name, value in (variables or {}).items() for word in ("-e", f"{name}={value}")]
        guarded = ["timeout", "-k", "1", f"{seconds:g}", "bash", "-c", command]
        begun = time.monotonic()
        words = ["docker", "exec", *told, "-w", self._folder, self._container, *guarded]
        status, text = _docker(words, seconds + 10)
        spent = time.monotonic() - begun
        ended = "time" if status in (124, 137) and spent >= seconds else ""
        return Output(_middle_cut(text, self._limits.output), status, spent, ended)

    def empty(self, folder: str) -> None:
        """Make a folder there with nothing in it."""
        self._must("rm", "-rf", folder)
        self._must("mkdir", "-p", folder)

    def read(self, path: str) -> str | None:
        """A file that commands wrote; None if it is missing or a link."""
        check = f'[ -f "{path}" ] && [ ! -L "{path}" ] && cat "{path}"'
        status, text = _docker(["docker", "exec", self._container, "sh", "-c", check], 30)
        return text if status == 0 else None

    @contextmanager
    def shown(self, folder: Path, at: str) -> Iterator[None]:
        """Context manager that shows commands a host folder: a copy, removed on exit."""
        self._must("rm", "-rf", at)
        status, text = _docker(["docker", "cp", str(folder), f"{self._container}:{at}"], 120)
        if status != 0:
            raise EnvironmentFailedError(f"docker cp of {folder} failed: {text.strip()[-200:]}")
        try:
            yield
        finally:
            self._must("rm", "-rf", at)

    def _must(self, *words: str) -> None:
        status, text = _docker(["docker", "exec", "-u", "0", self._container, *words], 60)
        if status != 0:
            raise EnvironmentFailedError(f"docker exec {' '.join(words)} failed: {text.strip()[-200:]}")


@contextmanager
def docker(task: AgentTask, limits: SandboxLimits = DEFAULT_LIMITS) -> Iterator[DockerSandbox]:
    """Context manager for a container of the task's image, which is built if missing.

    Raises :class:`MissingDependencyError` without Docker and :class:`EnvironmentFailedError` when the engine does not
    answer or the image cannot be built.
    """
    if shutil.which("docker") is None:
        raise MissingDependencyError(
            "the program 'docker'", "sandbox=docker", "Docker (Apache-2.0), or sandbox=bubblewrap"
        )
    image = f"gvla2-task-{task.name.lower()}"
    _succeed(["docker", "build", "-q", "-t", image, str(task.environment)], BUILD_SECONDS, task)
    name = f"gvla2-{uuid.uuid4().hex[:12]}"
    bounds = ["--network", "none", "--memory", f"{limits.memory_mb}m", "--pids-limit", "512", "--rm"]
    _succeed(["docker", "run", "-d", *bounds, "--name", name, image, "sleep", "infinity"], 120, task)
    try:
        folder = _succeed(["docker", "inspect", "-f", _FOLDER_OF, name], 30, task).strip()
        yield DockerSandbox(name, folder, limits)
    finally:
        with contextlib.suppress(OSError, subprocess.SubprocessError):
            _docker(["docker", "rm", "-f", name], 60)


def _succeed(words: Sequence[str], seconds: float, task: AgentTask) -> str:
    status, text = _docker(words, seconds)
    if status != 0:
        raise EnvironmentFailedError(
            f"{task.name}: '{' '.join(words[:2])}' failed (status {status}): {text.strip()[-300:]}"
        )
    return text


def _docker(words: Sequence[str], seconds: float) -> tuple[int, str]:
    try:
        ended = subprocess.run(
            words,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            timeout=seconds,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        return 124, (error.output or b"").decode(errors="replace")
    return ended.returncode, ended.stdout.decode(errors="replace")


def _middle_cut(text: str, characters: int) -> str:
    if len(text) <= characters:
        return text
    half = characters // 2
    return f"{text[:half]}\n[... {len(text) - 2 * half} characters cut ...]\n{text[-half:]}"
