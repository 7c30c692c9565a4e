"""Writers in processes of their own: many at once, or killed while they write. POSIX only.

Run as ``python crash_harness.py JOB`` with a JSON job: it forks the writers, which have everything
imported, and prints one JSON line. Writers say each id after it was committed: what they said must never be lost.
"""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from figure import NotMeasuredError
from plain_peer import FILE, PeerLesson, PlainPeer

from gvla2.errors import Gvla2Error
from gvla2.memory.records import Record
from gvla2.memory.store import Store

BANK = "crowd"
SHARED = "shared"
"""A record whose count every write raises by one: a lost update shows."""
_NOW = 1.8e9
_VECTOR = np.random.default_rng(0).normal(size=512).astype(np.float32)


def in_processes(job: dict[str, Any]) -> dict[str, Any]:
    """Do a job in a process of its own; its answer. Raises :class:`NotMeasuredError` where nothing can be forked."""
    if not hasattr(os, "fork"):
        raise NotMeasuredError("this system cannot fork and kill processes")
    command = [sys.executable, __file__, json.dumps(job)]
    threads = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    process = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | threads,
        start_new_session=True,
    )
    try:
        out, errors = process.communicate()
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)  # the writers, too
            process.wait()
    if process.returncode:
        raise Gvla2Error(f"The writers' process ended with {process.returncode}: {errors.strip()[-300:]}")
    answer: dict[str, Any] = json.loads(out)
    return answer


def lesson(id: str) -> Record:
    """A record of usual size."""
    return Record(
        id=id,
        bank=BANK,
        query="Pick up the red cube",
        content=f"{id}: pick up (grasp, grab, take, lift, raise) a small box: this grasp depth succeeded.",
        type="procedural_hint",
        state="active",
        outcome="verified_success",
        confidence=0.9,
        quality=0.95,
        dedup_key=f"key of {id}",
        created=_NOW,
        updated=_NOW,
        verifier='{"criteria":{"collision_safety":0.9,"task_completion":1.0},"reasons":["done"],"verifier":"bench"}',
        signature='{"extent":0.04,"height":0.1}',
        skill="pick",
        effect='{"kind":"prior","op":">=","parameter":"grasp_depth","value":0.02}',
        provenance='{"made_by":{"planner":"skill"},"sources":["run/1"]}',
    )


def bank_writer(url: str) -> Callable[[str], None]:
    """Writes records to a store; each raises the shared count in the same transaction."""
    store = Store.open(url, busy_seconds=120)

    def write(id: str) -> None:
        with store.writing(BANK, actor=id, now=_NOW) as transaction:
            transaction.put(lesson(id), "add", vector=_VECTOR, model="m")
            shared = transaction.get(SHARED)
            if shared is not None:
                transaction.put(replace(shared, count=shared.count + 1), action="merge")

    return write


def plain_writer(folder: str) -> Callable[[str], None]:
    """Reads the file, adds the record, writes the file: what the plain peer does on each admit.

    A half-written line is passed over, so that the peer goes on where it would stop with an error.
    """
    peer, place = PlainPeer(), Path(folder)

    def write(id: str) -> None:
        peer.fill(place, [*whole_lines(place / FILE), PeerLesson.of(lesson(id))])

    return write


def whole_lines(path: Path) -> list[PeerLesson]:
    """The records of a peer's file, without the lines that are damaged."""
    found = []
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines() if path.exists() else ():
        try:
            found.append(PeerLesson(**json.loads(line)))
        except (ValueError, TypeError):
            continue
    return found


_WRITERS: dict[str, Callable[[str], Callable[[str], None]]] = {"bank": bank_writer, "plain": plain_writer}


def crowd(job: dict[str, Any]) -> dict[str, Any]:
    """``processes`` writers of ``each`` records at once: what they said, seconds of each write, and of all."""
    began = time.perf_counter()
    writers = [
        _fork(lambda say, k=k: _write(job, f"w{k}", job["each"], say))  # type: ignore[misc]
        for k in range(job["processes"])
    ]
    said: list[list[Any]] = []
    for pid, pipe in writers:
        with os.fdopen(pipe) as lines:
            said += [json.loads(line) for line in lines]
        os.waitpid(pid, 0)
    return {"said": said, "seconds": time.perf_counter() - began}


def kills(job: dict[str, Any]) -> dict[str, Any]:
    """``times`` writers, one after the other, each killed at a random instant: what they had said."""
    moments = random.Random(job["seed"])
    said: list[list[Any]] = []
    for k in range(job["times"]):
        pid, pipe = _fork(lambda say, k=k: _write(job, f"k{k}", 10**9, say))  # type: ignore[misc]
        with os.fdopen(pipe) as lines:
            first = lines.readline()
            time.sleep(moments.uniform(0, 0.05))
            os.kill(pid, signal.SIGKILL)
            text = first + lines.read()
        os.waitpid(pid, 0)
        said += [json.loads(line) for line in text.rpartition("\n")[0].splitlines()]
    return {"said": said}


def _write(job: dict[str, Any], name: str, count: int, say: Callable[[list[Any]], None]) -> None:
    write = _WRITERS[job["kind"]](job["place"])
    for i in range(count):
        began = time.perf_counter()
        write(f"{name}-{i}")
        say([f"{name}-{i}", time.perf_counter() - began])


def _fork(work: Callable[[Callable[[list[Any]], None]], None]) -> tuple[int, int]:
    """A child that does the work, and the pipe that it speaks through, each time in one write."""
    reading, writing = os.pipe()
    pid = os.fork()
    if pid:
        os.close(writing)
        return pid, reading
    status = 1
    try:
        os.close(reading)
        work(lambda said: _say(writing, said))
        status = 0
    finally:
        os._exit(status)


def _say(pipe: int, said: list[Any]) -> None:
    os.write(pipe, (json.dumps(said) + "\n").encode())


def main(argv: list[str]) -> int:
    """Do the job that the one argument names."""
    job = json.loads(argv[0])
    print(json.dumps({"crowd": crowd, "kills": kills}[job["do"]](job)))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
