"""Seconds, of the clock and of the processor, of seeing and of planning a second time, on the fourteen tasks' scenes.

    python tests/benchmarks/latency.py see perceiver=classical [depth_noise=realistic]
    python tests/benchmarks/latency.py plan planner=code_policies language=llama_cpp language.model=FILE.gguf \
        language.cache=FOLDER

``see`` perceives layout 460 of six tasks four times each, ``plan`` plans layout 216 of two tasks seven times; the first
time of each, which compiles, loads or asks the model, does not count. Other words are overrides of ``gvla2 run``.
"""

import statistics
import sys
import time
from contextlib import closing
from dataclasses import replace

from gvla2.commands.hydra_job import schemas
from gvla2.commands.run import build_components
from gvla2.episode.fallback import NamedPlanner, PlannerWithFallback
from gvla2.episode.record import EpisodeRecord
from gvla2.plugins.hydra_config import register
from gvla2.plugins.registry import load_plugins

SEEN = ("put_block", "open_jar", "sort_mustard", "put_knife", "open_drawer", "close_box"), 460, 4
PLANNED = ("put_block", "pickup_cup"), 216, 7


def seconds(task, layout, times, what, overrides, registry):
    """What each time but the first took: (seconds of the clock, of the processor)."""
    from hydra import compose, initialize_config_module
    from omegaconf import OmegaConf

    with initialize_config_module("gvla2.conf", version_base="1.3"):
        composed = compose("run", overrides=[f"task={task}", "robot=sapien_panda", "memory=none", *overrides])
    parts = build_components(OmegaConf.to_object(composed), registry)
    took = []
    with closing(parts.robot), closing(parts.memory):
        wish = parts.robot.reset(parts.task, layout, None).instruction
        seen = parts.robot.observe()
        scene = None
        for _ in range(times):
            began = time.perf_counter(), time.process_time()
            if what == "see" or scene is None:
                scene = parts.perceiver.perceive(seen, wish, parts.robot.arm.workspace)
            if what == "plan":
                began = time.perf_counter(), time.process_time()
                record = EpisodeRecord("", "", "", layout, parts.choices, observation=seen, scene=scene)
                asked = NamedPlanner("planner", parts.planner)
                consultation = PlannerWithFallback(asked, None, 0.0, parts.robot.arm, parts.skills, False)
                consultation.plan(replace(record, instruction=wish))
            took.append((time.perf_counter() - began[0], time.process_time() - began[1]))
    return took[1:]


def main() -> None:
    what, *overrides = sys.argv[1:] or [""]
    if what not in ("see", "plan"):
        raise SystemExit(f"'{what}' is neither see nor plan.\n\n{__doc__}")
    registry = load_plugins()
    register(registry, schemas())
    tasks, layout, times = SEEN if what == "see" else PLANNED
    for task in tasks:
        took = seconds(task, layout, times, what, overrides, registry)
        for kind, spent in zip(("clock", "processor"), zip(*took, strict=True), strict=True):
            print(
                f"{task:14} {kind:9} median {statistics.median(spent):.3f} s, most {max(spent):.3f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
