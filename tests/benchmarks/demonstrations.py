"""Whether each task can be done by this arm's physics: its scripted demonstration, over seeds.

    python tests/benchmarks/demonstrations.py [seeds=10] [tasks=put_block,open_jar] [task.scale=1.1]

The demonstrations know the true state; they prove tasks, and no planner uses them.
"""

import sys
import time
from contextlib import closing
from multiprocessing import get_context

from hydra import compose, initialize_config_module
from omegaconf import OmegaConf

from gvla2.commands.hydra_job import schemas
from gvla2.errors import Gvla2Error
from gvla2.plugins.hydra_config import register
from gvla2.plugins.registry import load_plugins
from gvla2.robot.backend import demonstrate


def run_task(job: tuple[str, int, list[str]]) -> list[dict]:
    """All seeds of one task in one process."""
    task_name, seeds, overrides = job
    registry = load_plugins()
    register(registry, schemas())
    with initialize_config_module("gvla2.conf", version_base="1.3"):
        config = OmegaConf.to_object(compose("run", overrides=[f"task={task_name}", *overrides]))
    built = registry.build_all(config, ("robot", "task"))
    rows = []
    with closing(built["robot"]) as robot:
        for seed in range(config.seed, config.seed + seeds):
            started = time.perf_counter()
            instance = robot.reset(built["task"], seed)
            sampled = time.perf_counter() - started
            try:
                reports = demonstrate(robot, instance)
                abort = next((r.abort for r in reports if r.abort), None)
                judged = robot.success_check()
                done = (judged.relaxed, judged.strict)
                said = "" if abort is None else f"{abort.index} {abort.stage}: {abort.abort}: {abort.message}"
            except Gvla2Error as error:
                done, said = (False, False), str(error)
            seconds = time.perf_counter() - started
            rows.append(
                {"seed": seed, "relaxed": done[0], "strict": done[1], "said": said, "seconds": seconds}
            )
            print(f"  {task_name} seed {seed}: relaxed={done[0]} strict={done[1]} sampled in {sampled:.2f} s,"
                  f" done in {seconds:.1f} s {said}", file=sys.stderr, flush=True)  # fmt: skip
    return rows


def main() -> None:
    named = dict(a.split("=", 1) for a in sys.argv[1:] if a.startswith(("seeds=", "tasks=")))
    overrides = [a for a in sys.argv[1:] if not a.startswith(("seeds=", "tasks="))]
    offered = [name for name in load_plugins().offers("task") if name != "none"]
    tasks = named["tasks"].split(",") if "tasks" in named else offered
    jobs = [(task, int(named.get("seeds", 10)), overrides) for task in tasks]
    if len(jobs) == 1:
        results = [run_task(jobs[0])]
    else:
        with get_context("spawn").Pool(2) as pool:
            results = pool.map(run_task, jobs, chunksize=1)
    print(f"{'task':18} {'relaxed':>7} {'strict':>7} {'s/episode':>10}")
    for task, rows in zip(tasks, results, strict=True):
        seconds = sorted(r["seconds"] for r in rows)[len(rows) // 2]
        counts = [f"{sum(r[p] for r in rows)}/{len(rows)}" for p in ("relaxed", "strict")]
        print(f"{task:18} {counts[0]:>7} {counts[1]:>7} {seconds:10.1f}")


if __name__ == "__main__":
    main()
