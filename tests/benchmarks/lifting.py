"""Slow: how many scanned objects are lifted, one at a time on the table, with true perception or any other.

    python tests/benchmarks/lifting.py FOLDER [--names a,b] [--poses 3] [--perceiver oracle] [--out FILE]

Pose 0 is upright, the others as things fall. Prints one line an episode, then the shares: of all, and of the objects
whose narrowest side is below 75 mm.
"""

from __future__ import annotations

import argparse
import json
import logging
import time
from pathlib import Path

import numpy as np
from hydra import compose, initialize_config_module
from omegaconf import OmegaConf

from gvla2.commands.primary import PRIMARY
from gvla2.commands.run import build_parts
from gvla2.episode import EpisodeRequest, run_episode
from gvla2.hydra_bridge import register
from gvla2.plugins import Registry, load_plugins
from gvla2.robot.mesh_library import chosen, mesh_library
from gvla2.robot.scan import read_scan

NARROW = 0.075


class _Silent:
    def begin(self, stage): ...
    def stage(self, record, stage): ...
    def frame(self, image): ...


def main() -> None:
    """Measure, and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder")
    parser.add_argument("--names", default="")
    parser.add_argument("--poses", type=int, default=3)
    parser.add_argument("--perceiver", default="oracle")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--out", default="")
    options = parser.parse_args()
    logging.disable(logging.WARNING)
    registry = load_plugins()
    library = chosen(mesh_library(options.folder), options.names.split(",") if options.names else [])
    register(registry, PRIMARY)
    rows = []
    for name, path in library.items():
        narrow = min(read_scan(path).size)
        for pose in range(options.poses):
            objects = {"root": options.folder, "names": f"[{name}]", "pose": "fallen" if pose else "upright"}
            rows.append(_episode(registry, options.perceiver, objects, options.first_seed + pose))
            row = {"name": name, "narrow": round(narrow, 4), "pose": pose, **rows[-1]}
            rows[-1] = row
            print(json.dumps(row), flush=True)
            if options.out:
                Path(options.out).write_text("\n".join(map(json.dumps, rows)) + "\n")
    for what, of in (("all", rows), ("narrow", [r for r in rows if r["narrow"] < NARROW])):
        for profile in ("eased", "strict"):
            print(f"{what} {profile}: {sum(r[profile] for r in of)} of {len(of)}")
    print(f"median planning {np.median([r['planning_s'] for r in rows]):.2f} s")


def _episode(registry: Registry, perceiver: str, objects: dict, seed: int) -> dict:
    asked = [f"task.objects.{key}={value}" for key, value in objects.items()]
    with initialize_config_module("gvla2.conf", version_base="1.3"):
        chosen_ones = ["memory=none", "task=tabletop_objects", f"perceiver={perceiver}", *asked]
        config = OmegaConf.to_object(compose("run", overrides=chosen_ones))
    parts = build_parts(config, registry)
    started = time.perf_counter()
    try:
        record = run_episode(parts, EpisodeRequest(seed=seed), _Silent())
        judged = record.judgement
        why = "" if record.failure is None else f"{record.failure.stage}: {record.failure.message}"
        report = record.report
        if report is not None and report.abort is not None:
            why = f"{report.abort.abort}: {report.abort.message}"
        tried = () if record.plan is None else record.plan.candidates
        best = [c for c in tried if not c.rejected]
        how = best[0].description if best else f"none of {len(tried)}: {tried[0].rejected if tried else ''}"
        if record.plan is not None and record.plan.abstention is not None:
            why = record.plan.abstention.message
        return {
            "seed": seed,
            "eased": bool(judged and judged.eased),
            "strict": bool(judged and judged.strict),
            "planning_s": round(record.timings.get("plan", 0.0), 2),
            "seconds": round(time.perf_counter() - started, 1),
            "why": why[:240],
            "how": how[:160],
        }
    finally:
        parts.robot.close()
        parts.memory.close()


if __name__ == "__main__":
    main()
