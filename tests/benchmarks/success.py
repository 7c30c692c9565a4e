"""Success over seeds, with Wilson intervals and the classes of failure.

    python tests/benchmarks/success.py [seeds=20] [tasks=pick_and_lift,push_block,lamp_on] [key=value ...]

Further arguments are overrides of ``gvla2 run`` (memory is off unless they say otherwise).
"""

import sys
import time
from collections import Counter
from contextlib import closing
from dataclasses import asdict
from multiprocessing import get_context

from hydra import compose, initialize_config_module
from omegaconf import OmegaConf

from gvla2.commands.primary import PRIMARY
from gvla2.commands.run import build_parts
from gvla2.episode import EpisodeRequest, run_episode
from gvla2.evaluation.statistics import wilson_interval
from gvla2.hydra_bridge import register
from gvla2.plugins import load_plugins
from gvla2.robot.depth_noise import DepthNoise

TASKS = "pick_and_lift,push_block,lamp_on"


class Silent:
    def begin(self, stage):
        pass

    def stage(self, record, stage):
        pass

    def frame(self, image):
        pass


def run_task(job: tuple[str, int, list[str]]) -> list[dict]:
    """All seeds of one task in one process."""
    task, seeds, overrides = job
    registry = load_plugins()
    register(registry, PRIMARY)
    with initialize_config_module("gvla2.conf", version_base="1.3"):
        config = OmegaConf.to_object(compose("run", overrides=["memory=none", f"task={task}", *overrides]))
    parts = build_parts(config, registry)
    rows = []
    with closing(parts.robot), closing(parts.memory):
        noise = DepthNoise(**asdict(config.depth_noise))
        for seed in range(config.seed, config.seed + seeds):
            started = time.perf_counter()
            request = EpisodeRequest(seed, instruction=config.instruction, depth_noise=noise)
            record = run_episode(parts, request, Silent())
            motion = [w.planning_seconds for w in record.report.waypoints] if record.report else []
            rows.append(
                {
                    "seed": seed,
                    "eased": bool(record.judgement and record.judgement.eased),
                    "strict": bool(record.judgement and record.judgement.strict),
                    "verdict": record.verdict.outcome if record.verdict else "none",
                    "failure": record.failure,
                    "seconds": time.perf_counter() - started,
                    "motion": motion,
                    "instruction": record.instruction,
                }
            )
            print(
                f"  {task} seed {seed}: {'ok' if rows[-1]['eased'] else 'FAILED'}",
                file=sys.stderr,
                flush=True,
            )
    return rows


def main() -> None:
    named = dict(a.split("=", 1) for a in sys.argv[1:] if a.startswith(("seeds=", "tasks=")))
    overrides = [a for a in sys.argv[1:] if not a.startswith(("seeds=", "tasks="))]
    tasks = named.get("tasks", TASKS).split(",")
    seeds = int(named.get("seeds", 20))
    with get_context("spawn").Pool(2) as pool:
        results = pool.map(run_task, [(task, seeds, overrides) for task in tasks], chunksize=1)
    print(
        f"{'task':16} {'eased':>8} {'95 % interval':>14} {'strict':>8} {'verifier agrees':>16} {'s/episode':>10}"
    )
    motion = []
    for task, rows in zip(tasks, results, strict=True):
        eased = sum(r["eased"] for r in rows)
        low, high = wilson_interval(eased, len(rows))
        agree = sum((r["verdict"] == "verified_success") == r["eased"] for r in rows)
        seconds = sorted(r["seconds"] for r in rows)[len(rows) // 2]
        strict = sum(r["strict"] for r in rows)
        print(
            f"{task:16} {eased:4d}/{len(rows):<3d} {low:6.0%} - {high:4.0%} {strict:4d}/{len(rows):<3d}"
            f" {agree:12d}/{len(rows):<3d} {seconds:10.2f}"
        )
        motion += [seconds for r in rows for seconds in r["motion"]]
    if motion:
        motion.sort()
        print(f"motion plan of one waypoint: median {1e3 * motion[len(motion) // 2]:.0f} ms, "
              f"p95 {1e3 * motion[int(0.95 * len(motion))]:.0f} ms, n={len(motion)}")  # fmt: skip
    for task, rows in zip(tasks, results, strict=True):
        classes = Counter(f"{r['failure'].stage}/{r['failure'].kind}" for r in rows if r["failure"])
        if classes:
            print(f"{task}: {dict(classes)}")
        for r in rows:
            if not r["eased"]:
                print(f"  seed {r['seed']}: {r['instruction']!r}: {r['failure']}")


if __name__ == "__main__":
    main()
