"""Success over seeds, relaxed and strict, with Wilson intervals, classes of failure and seconds a stage.

    python tests/benchmarks/success.py [tasks=all] [seeds=600-604] [scale=0.8,1.2] [processes=1] [out=rows.jsonl]
        [key=value ...]

``tasks`` are names apart by commas, or all; ``seeds`` a range, a list (``600,`` is one) or a count from 0; with
several scales each is run. ``out`` gets one JSON line an episode as soon as it ended. Further arguments are overrides
of ``gvla2 run`` (memory is off unless they say otherwise). Parts are built once a task, its episodes share the process.
"""

import json
import sys
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import closing
from multiprocessing import get_context
from pathlib import Path

from hydra import compose, initialize_config_module
from omegaconf import OmegaConf

from gvla2.commands.hydra_job import schemas
from gvla2.commands.run import build_components
from gvla2.episode.loop import EpisodeRequest, run_episode
from gvla2.episode.record import EpisodeRecord
from gvla2.errors import Gvla2Error
from gvla2.evaluation.statistics import wilson_interval
from gvla2.plugins.hydra_config import register
from gvla2.plugins.registry import load_plugins

OPTIONS = ("tasks", "seeds", "scale", "processes", "out")
STAGES = ("setup", "observe", "perceive", "plan", "check", "execute", "verify")


def seeds_of(text: str) -> list[int]:
    """600-604, or 3,5,8, or a count."""
    if "-" in text:
        first, last = (int(part) for part in text.split("-"))
        return list(range(first, last + 1))
    return [int(part) for part in text.split(",") if part] if "," in text else list(range(int(text)))


def run_task(job: tuple[str, list[int], list[str], str]) -> list[dict]:
    """All seeds of one task, and one scale, in one process."""
    task, seeds, overrides, out = job
    registry = load_plugins()
    register(registry, schemas())
    with initialize_config_module("gvla2.conf", version_base="1.3"):
        config = OmegaConf.to_object(compose("run", overrides=["memory=none", f"task={task}", *overrides]))
    parts = build_components(config, registry)
    rows = []
    with closing(parts.robot), closing(parts.memory):
        noise = config.depth_noise
        for seed in seeds:
            wall, used = time.perf_counter(), time.process_time()
            request = EpisodeRequest(seed, instruction=config.instruction, depth_noise=noise)
            try:
                row = _row(run_episode(parts, request))
            except Gvla2Error as error:
                row = {"failure": ["setup", "error", str(error)], "relaxed": False, "strict": False}
            row |= {"task": task, "seed": seed, "overrides": overrides,
                    "seconds": time.perf_counter() - wall, "cpu": time.process_time() - used}  # fmt: skip
            rows.append(row)
            if out:
                with Path(out).open("a", encoding="utf-8") as file:
                    file.write(json.dumps(row) + "\n")
            said = "" if row["strict"] else f" {row.get('instruction')!r}: {row['failure']}"
            how = "ok" if row["strict"] else "relaxed" if row["relaxed"] else "FAILED"
            print(f"  {task} seed {seed}: {how}, {row['cpu']:.1f} s{said[:400]}", file=sys.stderr, flush=True)
    return rows


def _row(record: EpisodeRecord) -> dict:
    failure, plan = record.failure, record.plan
    return {
        "relaxed": bool(record.success_check and record.success_check.relaxed),
        "strict": bool(record.success_check and record.success_check.strict),
        "verdict": record.verdict.outcome if record.verdict else "none",
        "failure": [failure.stage, failure.kind, failure.message] if failure else None,
        "timings": dict(record.timings),
        "motion": [w.planning_seconds for w in record.report.waypoints] if record.report else [],
        "instruction": record.instruction,
        "skill": plan.skill if plan else "",
    }


def main() -> None:
    said = dict(a.split("=", 1) for a in sys.argv[1:] if a.split("=", 1)[0] in OPTIONS)
    overrides = [a for a in sys.argv[1:] if a.split("=", 1)[0] not in OPTIONS]
    tasks = said.get("tasks", "all")
    names = [n for n in load_plugins().offers("task") if n != "none"] if tasks == "all" else tasks.split(",")
    seeds = seeds_of(said.get("seeds", "20"))
    scales = [[f"task.scale={k}"] for k in said["scale"].split(",")] if "scale" in said else [[]]
    jobs = [(n, seeds, [*k, *overrides], said.get("out", "")) for n in names for k in scales]
    processes = int(said.get("processes", 1))
    if processes == 1:
        results = [run_task(job) for job in jobs]
    else:
        with get_context("spawn").Pool(processes) as pool:
            results = pool.map(run_task, jobs, chunksize=1)
    for line in report(jobs, results):
        print(line)


def report(jobs: list[tuple[str, list[int], list[str], str]], results: list[list[dict]]) -> Iterator[str]:
    """The table, the means over tasks, motion planning, classes of failure and every failed episode."""
    stages = " ".join(f"{s:>8}" for s in STAGES)
    yield f"{'task':18} {'relaxed':>7} {'95 % interval':>14} {'strict':>7} {'agrees':>7} {'s':>6} {'cpu s':>6} {stages}"
    motion: list[float] = []
    for job, rows in zip(jobs, results, strict=True):
        n, relaxed, strict = len(rows), sum(r["relaxed"] for r in rows), sum(r["strict"] for r in rows)
        low, high = wilson_interval(relaxed, n)
        agree = sum((r.get("verdict") == "verified_success") == r["relaxed"] for r in rows)
        times = " ".join(f"{_median([r.get('timings', {}).get(s, 0.0) for r in rows]):8.2f}" for s in STAGES)
        seconds, cpu = (_median([r[k] for r in rows]) for k in ("seconds", "cpu"))
        yield (f"{job[0]:18} {relaxed:3d}/{n:<3d} {low:6.0%} - {high:4.0%} {strict:4d}/{n:<3d} {agree:3d}/{n:<3d} "
               f"{seconds:6.1f} {cpu:6.1f} {times}")  # fmt: skip
        motion += [seconds for r in rows for seconds in r.get("motion", [])]
    shares = [[sum(r[p] for r in rows) / len(rows) for rows in results] for p in ("relaxed", "strict")]
    relaxed, strict = (sum(s) / len(s) for s in shares)
    yield f"mean over {len(jobs)}: relaxed {relaxed:.1%}, strict {strict:.1%}, least relaxed {min(shares[0]):.0%}"
    if motion:
        motion.sort()
        yield (f"motion plan of one waypoint: median {1e3 * motion[len(motion) // 2]:.0f} ms, "
               f"p95 {1e3 * motion[int(0.95 * len(motion))]:.0f} ms, n={len(motion)}")  # fmt: skip
    for job, rows in zip(jobs, results, strict=True):
        missed = [r for r in rows if not r["strict"]]
        if missed:
            classes = Counter("/".join(r["failure"][:2]) if r["failure"] else "strict" for r in missed)
            yield f"{job[0]} {' '.join(job[2])}: {dict(classes)}"
        for r in missed:
            yield f"  seed {r['seed']}{' (relaxed)' if r['relaxed'] else ''}: {r.get('instruction')!r}: {r['failure']}"


def _median(values: list[float]) -> float:
    return sorted(values)[len(values) // 2]


if __name__ == "__main__":
    main()
