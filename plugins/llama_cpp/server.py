"""Finding, or starting, the llama.cpp server of a model on this machine.

Processes agree by locks on files in the server's folder, which the system frees when a process ends in any way:

* ``users`` is held, shared, by each process that may ask; the server ends when it gets it for itself alone;
* ``serving`` is held by the server while it lives;
* ``start`` is held while a process looks for the server or starts it, so that only one does.
"""

from __future__ import annotations

import fcntl
import hashlib
import importlib.util
import json
import os
import platform
import signal
import subprocess
import sys
import threading
import time
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gvla2.errors import ConfigurationError, MissingDependencyError
from gvla2.io.array_cache import cache_folder
from gvla2.language.contracts import ModelUnavailableError

if TYPE_CHECKING:
    from gvla2_plugins.llama_cpp import LlamaCppConfig

_POLL = 0.05
_COMMAND = [sys.executable, "-m", "gvla2_plugins.llama_cpp.serving"]


class LlamaServer:
    """A :class:`gvla2.language.contracts.Server` that starts when its address is requested.

    Raises :class:`ConfigurationError` without a model's file and for invalid options, and
    :class:`MissingDependencyError` without xllamacpp; it starts nothing yet.
    """

    grammars = True

    def __init__(self, config: LlamaCppConfig) -> None:
        if not config.model:
            raise ConfigurationError("No model is given: set language.model=FILE.gguf.")
        files = [Path(name).expanduser().resolve() for name in (config.model, config.mmproj) if name]
        for file in files:
            if not file.is_file():
                raise ConfigurationError(f"There is no model at {file}. Set language.model to a GGUF file.")
        if importlib.util.find_spec("xllamacpp") is None:
            raise MissingDependencyError(
                "the package 'xllamacpp'", "A model of your own", "pip install 'gvla2[local-llm]'", "MIT"
            )
        least = {"context": 256, "slots": 1, "threads": 0, "gpu_layers": 0}
        for name, lowest in least.items():
            if getattr(config, name) < lowest:
                raise ConfigurationError(f"{name} is {getattr(config, name)}; it must be at least {lowest}.")
        self.model = files[0].name
        self._patience = config.start_timeout
        self._options: dict[str, Any] = {
            "files": [[str(file), file.stat().st_size, file.stat().st_mtime_ns] for file in files],
            "context": config.context,
            "slots": config.slots,
            "threads": config.threads or len(os.sched_getaffinity(0)),
            "gpu_layers": config.gpu_layers,
            "host": platform.node(),  # machines may share a home folder
        }
        which = hashlib.sha256(json.dumps(self._options, sort_keys=True).encode()).hexdigest()[:16]
        self._folder = (
            Path(config.folder).expanduser() if config.folder else cache_folder() / "llama_cpp"
        ) / which
        self._turn = threading.Lock()
        self._using = False

    @property
    def identity(self) -> str:
        """The files by name and size: answers do not depend on the file's folder or the server's address."""
        return "llama.cpp " + ", ".join(
            f"{Path(name).name} ({size})" for name, size, _ in self._options["files"]
        )

    def key(self) -> str:
        """None: the server only listens locally."""
        return ""

    def address(self) -> str:
        """The ``base_url`` of the server, started if none runs. Raises :class:`ModelUnavailableError`."""
        with self._turn:
            self._folder.mkdir(parents=True, exist_ok=True)
            if not self._using:
                users = _lock(self._folder / "users", fcntl.LOCK_SH)
                weakref.finalize(self, os.close, users)
                self._using = True
            deadline = time.monotonic() + self._patience
            with self._alone(deadline):
                return self._ready(deadline)

    def _alive(self) -> bool:
        if (free := self._try_lock("serving")) is not None:
            os.close(free)
        return free is None

    def _launch(self) -> None:
        (self._folder / "options.json").write_text(json.dumps(self._options))
        (self._folder / "server.json").unlink(missing_ok=True)
        # The simulator computes between the questions: waiting threads must not spin.
        threads = str(self._options["threads"])
        environment = os.environ | {"OMP_WAIT_POLICY": "PASSIVE", "OMP_NUM_THREADS": threads}
        with (self._folder / "log").open("wb") as log:
            done = subprocess.run(
                [*_COMMAND, str(self._folder)],
                stdin=subprocess.DEVNULL, stdout=log, stderr=log, env=environment, start_new_session=True, check=False,
            )  # fmt: skip
        if done.returncode:
            raise self._failure(f"could not be started (exit status {done.returncode})")

    def _ready(self, deadline: float) -> str:
        """The address of the running server, once it listens; one is started if none runs."""
        launched = False
        while True:
            if not self._alive():
                if launched:
                    raise self._failure("ended while it was loading")
                self._launch()
                launched = True
            state = self._state()
            if url := state.get("url"):
                return f"{url}/v1"
            if time.monotonic() > deadline:
                if pid := state.get("pid"):
                    os.kill(pid, signal.SIGKILL)
                raise self._late()
            time.sleep(_POLL)

    def _state(self) -> dict[str, Any]:
        """What the server's process last wrote about itself: its ``pid``, and its ``url`` once it listens."""
        try:
            state = json.loads((self._folder / "server.json").read_bytes())
        except (OSError, ValueError):
            return {}
        return state if isinstance(state, dict) else {}

    def _failure(self, what: str) -> ModelUnavailableError:
        log = self._folder / "log"
        lines = log.read_text(errors="replace").splitlines() if log.exists() else []
        said = " ".join(" ".join(lines[-3:]).split())[-300:]
        return ModelUnavailableError(
            f"The server of {self.model} {what}. Its log, {log}, ends: {said}", transient=False
        )

    @contextmanager
    def _alone(self, deadline: float) -> Iterator[None]:
        """Hold the lock ``start``."""
        while (held := self._try_lock("start")) is None:
            if time.monotonic() > deadline:
                raise self._late()
            time.sleep(_POLL)
        try:
            yield
        finally:
            os.close(held)

    def _try_lock(self, name: str) -> int | None:
        """A descriptor that holds the lock for this process alone, None while another holds it."""
        try:
            return _lock(self._folder / name, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return None

    def _late(self) -> ModelUnavailableError:
        return self._failure(f"was not ready within {self._patience:g} s (start_timeout)")


def _lock(file: Path, how: int) -> int:
    """A descriptor that holds the lock until it is closed."""
    descriptor = os.open(file, os.O_RDWR | os.O_CREAT, 0o600)
    try:
        fcntl.flock(descriptor, how)
    except BaseException:
        os.close(descriptor)
        raise
    return descriptor
