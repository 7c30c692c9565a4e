"""The server's process: ``python -m gvla2_plugins.llama_cpp.serving FOLDER`` starts it and returns."""

from __future__ import annotations

import fcntl
import json
import os
import sys
import time
from pathlib import Path
from typing import Any

_WATCH = 0.5
"""Seconds between two checks for remaining users."""


def main(folder: Path) -> None:
    """Take the lock, go into the background, load the model, serve until the users' lock is free."""
    serving = os.open(folder / "serving", os.O_RDWR | os.O_CREAT, 0o600)
    fcntl.flock(serving, fcntl.LOCK_EX | fcntl.LOCK_NB)
    reading, writing = os.pipe()
    if os.fork():
        os.close(writing)
        os.read(reading, 1)  # until the child's id is written: whoever waits in vain must be able to end it
        os._exit(0)
    _report(folder, pid=os.getpid())
    os.close(writing)
    os.close(reading)
    server = _serve(json.loads((folder / "options.json").read_text()))
    _report(folder, pid=os.getpid(), url=server.listening_address)
    users = os.open(folder / "users", os.O_RDWR | os.O_CREAT, 0o600)
    while True:
        try:
            fcntl.flock(users, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            time.sleep(_WATCH)
            continue
        (folder / "server.json").unlink(missing_ok=True)
        os._exit(0)  # with both locks held: a new user waits, and then starts another


def _serve(options: dict[str, Any]) -> Any:
    import xllamacpp

    files = [name for name, *_ in options["files"]]
    asked = xllamacpp.CommonParams()
    asked.model.path = files[0]
    asked.model_alias = {Path(files[0]).name}
    if len(files) > 1:
        asked.mmproj.path = files[1]
    asked.port, asked.ui, asked.n_gpu_layers = 0, False, options["gpu_layers"]
    asked.n_parallel, asked.n_ctx = options["slots"], options["slots"] * options["context"]
    for threads in (asked.cpuparams, asked.cpuparams_batch):
        threads.n_threads, threads.poll = options["threads"], 0
    return xllamacpp.Server(asked)


def _report(folder: Path, **what: object) -> None:
    part = folder / "server.json.part"
    part.write_text(json.dumps(what))
    part.replace(folder / "server.json")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
