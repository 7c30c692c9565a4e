"""Fault injection on the Piper's virtual bus, and the jitter of its control loop.

    python -m tests.benchmarks.piper_faults [--times 100] [--workers 6] [--jitter 60] [--seed 0] [--only FAULT]

Each fault comes at a random instant of a motion. Every trial must end in a hold (or a refusal before motion) within
150 ms of detection, with no frame that stops, resets or disables, and with a complete log. Exit status 1 otherwise.
A trial mostly waits, so that several workers share two cores; those that kill a process share a port and take turns.
A hundred of each fault and a minute of jitter take some twelve minutes on a quiet machine.
"""

import argparse
import sys
import tempfile
import warnings
from collections import Counter
from contextlib import closing
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from tests.plugins.piper_trials import FAULTS, OTHERS, FaultTrial, TrialBench, interrupted, loop_ticks

CHANNEL = "239.74.163.91"
BATCH = 20
"""Trials with one virtual arm."""


def many(job: tuple[str, int, int]) -> list[FaultTrial]:
    warnings.simplefilter("error")
    fault, times, seed = job
    with tempfile.TemporaryDirectory() as folder:
        if fault == "kill -INT":
            return [interrupted(Path(folder), seed + i, CHANNEL) for i in range(times)]
        with closing(TrialBench(Path(folder) / "log.jsonl", seed)) as bench:
            return [bench.trial(fault) for _ in range(times)]


def named(job: tuple[str, int, int]) -> tuple[str, list[FaultTrial]]:
    return job[0], many(job)


def jobs_of(faults: list[str], times: int, seed: int) -> list[tuple[str, int, int]]:
    """Batches with seeds of their own; the longest, which is one batch since it cannot be shared, first."""
    jobs = []
    for fault in sorted(faults, key=lambda f: f != "kill -INT"):
        batch = times if fault == "kill -INT" else BATCH
        jobs += [(fault, min(batch, times - k), 1000 * seed + k) for k in range(0, times, batch)]
    return jobs


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--times", type=int, default=3)
    parser.add_argument("--workers", type=int, default=6)
    parser.add_argument("--jitter", type=float, default=20.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="")
    options = parser.parse_args()
    faults = [f for f in (*FAULTS, *OTHERS) if options.only in f]
    jobs = jobs_of(faults, options.times, options.seed)
    left = Counter(fault for fault, _, _ in jobs)
    done: dict[str, list[FaultTrial]] = {fault: [] for fault in faults}
    good = total = 0
    print(f"{'fault':<26}{'well':>9}  {'endings':<44}{'hold after detection, ms':>26}", flush=True)
    with get_context("spawn").Pool(options.workers) as pool:
        for fault, batch in pool.imap_unordered(named, jobs):
            done[fault] += batch
            left[fault] -= 1
            if left[fault]:
                continue
            trials = done[fault]
            well = [t for t in trials if t.ending and not t.problems]
            good, total = good + len(well), total + len(trials)
            endings = ", ".join(f"{n} {what}" for what, n in Counter(t.ending for t in trials).most_common())
            late = 1e3 * np.array([t.latency for t in trials if t.ending in ("stopped", "held")] or [0.0])
            worst = f"p50 {np.median(late):.1f} max {late.max():.1f}"
            print(f"{fault:<26}{len(well):>4}/{len(trials):<4}  {endings:<44}{worst:>26}", flush=True)
            for trial in trials:
                if trial.problems or not trial.ending:
                    print(f"    {trial.ending or 'no ending'}: {trial.reason} {trial.problems}", flush=True)
    print(f"{good} of {total} ended in a hold or a refusal, log complete, nothing released.", flush=True)
    tight = True
    if options.jitter > 0:
        with tempfile.TemporaryDirectory() as folder:
            ticks = np.array(loop_ticks(Path(folder), CHANNEL, options.jitter))  # (N, 2) moment, moving
        off = 1e3 * np.abs(np.diff(ticks[:, 0]) - 0.01)
        moving = ticks[1:, 1] * ticks[:-1, 1] > 0
        for what, some in (("while the arm moves", off[moving]), ("all ticks, planning too", off)):
            p50, p99 = np.percentile(some, [50, 99])
            print(
                f"control loop at 100 Hz, {what}, {len(some)} ticks: jitter p50 {p50:.2f}, p99 {p99:.2f}, "
                f"max {some.max():.2f} ms"
            )
        tight = bool(np.percentile(off[moving], 99) <= 5.0)
    return 0 if good == total and tight else 1


if __name__ == "__main__":
    sys.exit(main())
