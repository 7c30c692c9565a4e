"""Many processes at once, processes killed at any moment, disks that are full: what was acknowledged is there."""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from gvla2.memory.storage.store import Store
from tests.memory.looking import look

NOW = 1.8e9
WRITER = """
import dataclasses, resource, sys, time
from gvla2.memory.records import Record
from gvla2.memory.storage.store import Store
from gvla2.errors import MemoryStoreError

url, name, count, limit = sys.argv[1], sys.argv[2], int(sys.argv[3]), int(sys.argv[4])
store = Store.open(url, busy_seconds=30)
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
            t.put(Record(id=id, content=f"{id} says " + "x" * 500, dedup_key=id, **values), vector, model="m",
                  action="add")
            if shared is None:
                t.put(Record(id="shared", content="said by all", dedup_key="shared", **values), action="add")
            else:
                t.put(dataclasses.replace(shared, count=shared.count + 1), action="merge")
    except MemoryStoreError as error:
        print("refused", error, flush=True)
        break
    print(id, time.perf_counter() - started, flush=True)
"""


def writer(url: str, name: str, count: int, limit: int = 0) -> subprocess.Popen[str]:
    arguments = [sys.executable, "-c", WRITER, url, name, str(count), str(limit)]
    return subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True)


def acknowledged(text: str) -> dict[str, float]:
    """Seconds by id, of whole lines only: a killed process may have left half of one."""
    lines = [line.split() for line in text.rpartition("\n")[0].splitlines()]
    return {line[0]: float(line[1]) for line in lines if line[0] != "refused"}


def test_processes_fill_a_new_bank_at_once(url: str) -> None:
    """None of them created it before, and nothing is lost or doubled."""
    processes, each = 8, 12
    writers = [writer(url, f"w{i}", each) for i in range(processes)]
    said: dict[str, float] = {}
    for process in writers:
        out, _ = process.communicate(timeout=100)
        assert process.returncode == 0
        said |= acknowledged(out)
    assert len(said) == processes * each
    with Store.open(url) as store:
        records = {r.id: r for r in look(store, "b").records()}
        assert records.pop("shared").count == processes * each  # no update was lost either
        assert set(records) == set(said)
        assert sorted(r.rev for r in records.values()) == list(range(1, processes * each + 1))
        assert len(look(store, "b").events()) == 2 * processes * each
        assert look(store, "b").verify() == []
        assert len(look(store, "b").changes(0)) == processes * each + 1


def test_what_was_acknowledged_survives_kill_9(url: str) -> None:
    said: set[str] = set()
    moments = random.Random(1)
    Store.open(url).close()
    rounds = 10 if url.startswith("sqlite") else 3
    for round_ in range(rounds):
        process = writer(url, f"r{round_}", 100_000)
        assert process.stdout is not None
        first = process.stdout.readline()  # it is under way
        time.sleep(moments.uniform(0, 0.12))
        os.kill(process.pid, signal.SIGKILL)
        said |= set(acknowledged(first + process.stdout.read()))
        process.wait(10)
        process.stdout.close()
    with Store.open(url) as store:
        stored = {r.id for r in look(store, "b").records()}
        assert len(said) >= rounds
        assert said <= stored
        assert len(stored - said) <= rounds + 1  # stored and not yet said, one a round; and the shared one
        assert look(store, "b").verify() == []


@pytest.mark.skipif(sys.platform == "win32", reason="this system cannot limit the size of files")
def test_a_full_disk_undoes_one_transaction_and_no_more(sqlite_url: str, tmp_path: Path) -> None:
    Store.open(sqlite_url).close()
    process = writer(sqlite_url, "w", 100_000, limit=600_000)
    out, _ = process.communicate(timeout=60)
    assert process.returncode == 0
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
