"""A flood of admits against a budget: does the bank stay within it, and does memory stay flat?

Run as ``python flood.py URL COUNT BUDGET SEED`` it is the flood itself, in a process of its
own whose memory nothing else has grown; it prints a JSON line now and then.
"""

from __future__ import annotations

import json
import os
import resource
import shutil
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path

from corpus import lessons
from figure import Figure, FigureRow, NotMeasuredError, Test
from setting import NOW, Setting, admission

from gvla2.errors import Gvla2Error
from gvla2.memory.bank import BankOptions, KnowledgeBank
from gvla2.memory.index import SERVED

BUDGET = 10_000
ADMITS = 1_000_000
STEP = 1000
LOOK = 10
"""Steps between two looks at the bank: to count all it ever held takes longer with each step."""
BYTES_EACH = 8_000
"""Of disk, for a record with its history and vector: a guess on the safe side."""


def endurance(setting: Setting, size: int, on: str) -> Mapping[str, Figure]:
    """Admit in batches of ``STEP`` at most; now and then, look at how many are active and how large the process is."""
    budget = max(50, BUDGET * size // ADMITS)
    free = shutil.disk_usage(setting.folder).free
    if free < BYTES_EACH * size:
        raise NotMeasuredError(
            f"{size:,} admits need {BYTES_EACH * size / 1e9:.0f} GB of disk, {free / 1e9:.0f} are free"
        )
    command = [
        sys.executable,
        __file__,
        setting.url("flood"),
        str(size),
        str(budget),
        str(setting.seed),
    ]
    seen: list[dict[str, float]] = []
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        try:
            for line in process.stdout:
                seen.append(json.loads(line))
            errors = process.stderr.read()
        except BaseException:
            process.kill()
            raise
    if process.returncode or not seen:
        raise Gvla2Error(f"The flood's process ended with {process.returncode}: {errors.strip()[-300:]}")
    # Columns and caches are tidied now and then, so that memory goes up and down: its peaks are compared.
    middle, end = len(seen) // 2, seen[-1]
    first, second = (max(one["resident"] for one in part) for part in (seen[:middle], seen[middle:]))
    growth = 100 * (second / first - 1)
    bytes_ = sum(path.stat().st_size for path in setting.folder.glob("flood.db*"))
    for path in setting.folder.glob("flood.db*"):
        path.unlink()
    note = f"{end['seconds']:.0f} s, {bytes_ / 1e9:.2f} GB on disk; the peer slows with each record"
    memory = f"at most {first:.0f} MB in the first half, {second:.0f} MB in the second"
    return {
        "flood_active": Figure(max(one["active"] for one in seen), note=note, goal=float(budget)),
        "flood_growth": Figure(growth, note=memory),
        "flood_rate": Figure(size / end["seconds"], note=note),
    }


def flood(url: str, count: int, budget: int, seed: int) -> None:
    """Admit; now and then print ``done``, ``active`` with summaries, ``resident`` (the most MB since the last time),
    ``seconds`` and ``cpu``.
    """
    spent = peak = 0.0
    with KnowledgeBank(url, options=BankOptions(active_budget=budget), clock=lambda: NOW) as bank:
        step = min(STEP, max(1, count // 10))
        look = LOOK if count > LOOK * step else 1
        for start in range(0, count, step):
            fresh = lessons(min(step, count - start), seed + 1 + start, now=NOW)
            items = [admission(record, start + i) for i, record in enumerate(fresh)]
            began = time.perf_counter()
            bank.admit_many(items, trusted=True)
            spent += time.perf_counter() - began
            peak = max(peak, resident())
            if start // step % look and start + step < count:
                continue
            seen = {
                "done": start + len(items),
                "active": sum(bank.stats()["states"].get(state, 0) for state in SERVED),
                "resident": peak,
                "seconds": spent,
                "cpu": time.process_time(),
            }
            print(json.dumps(seen), flush=True)
            peak = 0.0


def resident() -> float:
    """Megabytes of this process in memory; the most there ever were, where the system does not tell."""
    status = Path(f"/proc/{os.getpid()}/statm")
    if status.exists():
        return int(status.read_text().split()[1]) * resource.getpagesize() / 1e6
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def tests() -> list[Test]:
    """The one test of this file: it takes many minutes."""
    rows = (
        FigureRow(
            "flood_active",
            "Flood of admits: active and summaries at most",
            "records",
            "lower",
            float(BUDGET),
            0,
        ),
        FigureRow(
            "flood_growth",
            "Flood of admits: peak memory of its second half above the first's",
            "%",
            "lower",
            5.0,
            1,
        ),
        FigureRow("flood_rate", "Flood of admits: rate", "/s", "higher", None, 0),
    )
    return [Test("flood", rows, endurance, ADMITS, least=500)]


if __name__ == "__main__":
    flood(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4]))
