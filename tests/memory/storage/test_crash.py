"""Many processes at once, processes killed at any moment, disks that are full: what was acknowledged is there.

At full size, with the 99th percentile of a write: GVLA2_WRITES=1000 GVLA2_KILLS=200 pytest -s FILE.
"""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Self

import numpy as np
import pytest

from gvla2.memory.store import Store
from tests.memory.looking import look

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="this system cannot fork")
NOW = 1.8e9
WRITES = int(os.environ.get("GVLA2_WRITES", "12"))
"""Number of writes of each process."""
KILLS = int(os.environ.get("GVLA2_KILLS", "10"))
NURSERY = """
import dataclasses, os, resource, sys, time
from gvla2.memory.records import Record
from gvla2.memory.store import Store
from gvla2.errors import MemoryStoreError

def say(*words):
    sys.stdout.write(" ".join(map(str, words)) + "\\n")  # whole lines: others write there, too
    sys.stdout.flush()

def write(name, count, limit):
    say("born", os.getpid())
    store = Store.open(sys.argv[1], busy_seconds=30)
    if limit:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
    vector = [float(i) for i in range(64)]
    for i in range(count):
        id = f"{name}-{i}"
        started = time.perf_counter()
        try:
            with store.writing("b", actor=name, now=1.8e9) as t:
                shared = t.get("shared")
                values = dict(bank="b", query="q", type="tool_usage", state="active", outcome="verified_success",
                              confidence=.9, quality=.9, created=t.now, updated=t.now)
                t.put(Record(id=id, content=f"{id} says " + "x" * 500, dedup_key=id, **values), "add",
                      vector=vector, model="m")
                if shared is None:
                    t.put(Record(id="shared", content="said by all", dedup_key="shared", **values), action="add")
                else:
                    t.put(dataclasses.replace(shared, count=shared.count + 1), action="merge")
        except MemoryStoreError as error:
            say("refused", error)
            break
        say(id, time.perf_counter() - started)

for line in sys.stdin:
    *names, count, limit = line.split()
    children = []
    for name in names:
        child = os.fork()
        if child == 0:
            status = 1
            try:
                write(name, int(count), int(limit))
                status = 0
            finally:
                os._exit(status)
        children.append(child)
    say("ended", *(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) for child in children))
"""


class Nursery:
    """A process that has everything imported and forks the writers, so that each of them starts at once."""

    def __init__(self, url: str) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-c", NURSERY, url], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, error: type[BaseException] | None, *_: object) -> None:
        if error:
            self._process.kill()  # a writer that nobody hears any more ends by itself
        self._process.communicate(timeout=100)
        assert error or self._process.returncode == 0

    def start(self, *names: str, count: int, limit: int = 0) -> None:
        """Fork a writer of ``count`` records by each name; its files may hold ``limit`` bytes, 0 for any number."""
        assert self._process.stdin is not None
        print(*names, count, limit, file=self._process.stdin, flush=True)

    def line(self) -> str:
        """The next line of the process."""
        assert self._process.stdout is not None
        return self._process.stdout.readline()

    def rest(self) -> tuple[str, list[int]]:
        """What the writers say until all of them have ended, and their exit statuses."""
        said = ""
        while not (line := self.line()).startswith("ended"):
            assert line, "the nursery died"
            said += line
        return said, [int(status) for status in line.split()[1:]]


def acknowledged(text: str) -> dict[str, float]:
    """Seconds by id."""
    lines = [line.split() for line in text.splitlines()]
    return {line[0]: float(line[1]) for line in lines if line[0] not in ("born", "refused")}


def test_processes_fill_a_new_bank_at_once(url: str) -> None:
    """None of them created it before, and nothing is lost or doubled."""
    processes, each = 8, WRITES
    with Nursery(url) as nursery:
        nursery.start(*(f"w{i}" for i in range(processes)), count=each)
        out, statuses = nursery.rest()
    assert statuses == [0] * processes
    said = acknowledged(out)
    assert len(said) == processes * each
    print(f"p99 of {len(said)} writes: {np.percentile(list(said.values()), 99):.3f} s")
    with Store.open(url) as store:
        records = {r.id: r for r in look(store, "b").records()}
        assert records.pop("shared").count == processes * each  # no update was lost either
        assert set(records) == set(said)
        assert sorted(r.rev for r in records.values()) == list(range(1, processes * each + 1))
        assert len(look(store, "b").events()) == 2 * processes * each
        assert look(store, "b").verify() == []
        assert len(look(store, "b").embedded(["active"])) == processes * each + 1


def test_what_was_acknowledged_survives_kill_9(url: str) -> None:
    said: set[str] = set()
    moments = random.Random(1)
    Store.open(url).close()
    rounds = KILLS if url.startswith("sqlite") else max(KILLS // 3, 1)
    with Nursery(url) as nursery:
        for round_ in range(rounds):
            nursery.start(f"r{round_}", count=100_000)
            writer = int(nursery.line().split()[1])
            first = nursery.line()  # it is under way
            time.sleep(moments.uniform(0, 0.12))
            os.kill(writer, signal.SIGKILL)
            out, statuses = nursery.rest()
            assert statuses == [-signal.SIGKILL]
            said |= set(acknowledged(first + out))
    with Store.open(url) as store:
        stored = {r.id for r in look(store, "b").records()}
        assert len(said) >= rounds
        assert said <= stored
        assert len(stored - said) <= rounds + 1  # stored and not yet said, one a round; and the shared one
        assert look(store, "b").verify() == []


def test_a_full_disk_undoes_one_transaction_and_no_more(sqlite_url: str, tmp_path: Path) -> None:
    Store.open(sqlite_url).close()
    with Nursery(sqlite_url) as nursery:
        nursery.start("w", count=100_000, limit=600_000)
        out, statuses = nursery.rest()
    assert statuses == [0]
    last = out.splitlines()[-1]
    assert last.startswith("refused")
    assert str(tmp_path / "memory.db") in last
    said = set(acknowledged(out))
    with Store.open(sqlite_url) as store:
        assert said
        assert {r.id for r in look(store, "b").records()} == {*said, "shared"}
        assert look(store, "b").verify() == []
        with store.writing("b", actor="later", now=NOW) as t:
            assert t.get("shared").count == len(said)
            t.decide("there is room again")
