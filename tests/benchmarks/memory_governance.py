"""How fast a bank decides: admits, one candidate among many, a pass of governance, a flood against the budget.

    python tests/benchmarks/memory_governance.py [--active 10000] [--flood 20000] [--budget 2000]

Lessons are random, from a vocabulary in which many are alike; times are those of this machine, with its durable disk.
"""

from __future__ import annotations

import argparse
import random
import resource
import tempfile
import time

from gvla2.memory.bank import BankOptions, KnowledgeBank
from gvla2.memory.contracts import Lesson, MemoryTask, Verdict

SUCCESS = Verdict.from_criteria({"completion": 1.0, "safety": 0.9}, verifier="bench")
ACTS = [
    "lift",
    "push",
    "grip",
    "turn",
    "scan",
    "heat",
    "shake",
    "clean",
    "fold",
    "pour",
    "press",
    "stack",
    "sort",
    "weigh",
    "label",
    "open",
    "align",
    "clamp",
    "rinse",
    "tilt",
]
KINDS = [
    "red",
    "steel",
    "small",
    "tall",
    "glass",
    "paper",
    "round",
    "wooden",
    "heavy",
    "old",
    "blue",
    "soft",
    "cracked",
    "labelled",
    "wet",
    "spare",
]
THINGS = [
    "cup",
    "box",
    "lid",
    "jar",
    "bolt",
    "panel",
    "valve",
    "tray",
    "crate",
    "hose",
    "lamp",
    "drawer",
    "bottle",
    "kettle",
    "wrench",
    "screw",
    "belt",
    "filter",
    "sensor",
]
WHERE = [
    "near the edge",
    "with two fingers",
    "before lunch",
    "from the side",
    "at the rear",
    "after a pause",
    "on the belt",
    "by its rim",
]


def lesson(rng: random.Random) -> tuple[Lesson, Verdict, MemoryTask | str, str]:
    """A random hint with its task."""
    thing = f"{rng.choice(KINDS)} {rng.choice(KINDS)} {rng.choice(THINGS)}"
    other = f"{rng.choice(KINDS)} {rng.choice(THINGS)}"
    words = (
        f"{rng.choice(ACTS)} the {thing} {rng.choice(WHERE)} and {rng.choice(ACTS)} the {other}, "
        f"{rng.randint(2, 90)} {rng.choice(('cm', 's', 'degrees', 'N'))}."
    )
    return Lesson("procedural_hint", words.capitalize()), SUCCESS, f"{rng.choice(ACTS)} the {thing}", ""


def report(name: str, value: str) -> None:
    """One line of the table."""
    print(f"{name:48s} {value}", flush=True)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--active", type=int, default=10_000)
    parser.add_argument("--flood", type=int, default=20_000)
    parser.add_argument("--budget", type=int, default=2_000)
    options = parser.parse_args()
    rng = random.Random(1)
    with tempfile.TemporaryDirectory() as folder:
        with KnowledgeBank.open(f"sqlite:///{folder}/a.db", options=BankOptions(active_budget=10**9)) as bank:
            began = time.perf_counter()
            bank.admit_many(lesson(rng) for _ in range(options.active))
            report(
                f"admits in batches, up to {options.active}",
                f"{options.active / (time.perf_counter() - began):.0f}/s",
            )
            times = []
            for _ in range(200):
                item = lesson(rng)
                began = time.perf_counter()
                bank.admit(item[0], item[1], task=item[2])
                times.append(1e3 * (time.perf_counter() - began))
            times.sort()
            report("one durable admit among them", f"p50 {times[100]:.1f} ms, p95 {times[190]:.1f} ms")
            began = time.perf_counter()
            governed = bank.govern()
            report(
                f"govern({options.active})",
                f"{time.perf_counter() - began:.2f} s, {governed.changes} changes",
            )
            began = time.perf_counter()
            bank.govern()
            report("the same again", f"{time.perf_counter() - began:.2f} s")
        with KnowledgeBank.open(
            f"sqlite:///{folder}/b.db", options=BankOptions(active_budget=options.budget)
        ) as bank:
            most, memory = 0, []
            for start in range(0, options.flood, 1000):
                bank.admit_many(lesson(rng) for _ in range(min(1000, options.flood - start)))
                most = max(most, bank.stats()["states"].get("active", 0))
                memory.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
            report(f"active after {options.flood} admits, budget {options.budget}", f"{most} at most")
            half = memory[len(memory) // 2]
            report("peak memory, half way and at the end", f"{half:.0f} and {memory[-1]:.0f} MiB")


if __name__ == "__main__":
    main()
