"""Does refining the geometry help a grasp? Error of the width that the fingers meet, before and after.

    python tests/benchmarks/refinement.py [seeds=10] [key=value ...]

The task is pick_and_lift; the cubes' true side is an option of the task. Further arguments are overrides of
``gvla2 run``, for example ``reconstructor=splat`` or ``task.size=0.06``.
"""

import sys
import time

import numpy as np
from hydra import compose, initialize_config_module
from omegaconf import OmegaConf

from gvla2.commands.hydra_job import schemas
from gvla2.commands.run import build_components
from gvla2.episode.refine import objects_of_interest, refine_scene
from gvla2.plugins.hydra_config import register
from gvla2.plugins.registry import load_plugins
from gvla2.robot.depth_noise import apply_noise
from gvla2.robot.options import DepthNoise


def main() -> None:
    named = dict(a.split("=", 1) for a in sys.argv[1:] if a.startswith("seeds="))
    overrides = ["memory=none", "reconstructor=hull", "prior=depth"]
    overrides += [a for a in sys.argv[1:] if not a.startswith("seeds=")]
    registry = load_plugins()
    register(registry, schemas())
    with initialize_config_module("gvla2.conf", version_base="1.3"):
        config = OmegaConf.to_object(compose("run", overrides=overrides))
    parts = build_components(config, registry)
    true_side = config.task.size
    print("Mean absolute error of the cubes' width:")
    print(f"{'depth noise':>12} {'perceived mm':>14} {'refined mm':>12} {'s/object':>9}")
    for sigma in (0.0, 0.002):
        noise = DepthNoise("gaussian" if sigma else "none", sigma_m=sigma)
        perceived, refined, seconds = [], [], []
        for seed in range(int(named.get("seeds", 10))):
            instance = parts.robot.reset(parts.task, seed)
            observation = apply_noise(parts.robot.observe(), noise, np.random.default_rng(seed))
            scene = parts.perceiver.perceive(observation, instance.instruction, parts.robot.arm.workspace)
            began = time.perf_counter()
            better, _ = refine_scene(scene, observation, instance.instruction, parts.geometry)
            things = objects_of_interest(scene, instance.instruction)
            seconds.append((time.perf_counter() - began) / max(1, len(things)))
            for thing in things:
                perceived.append(np.abs(thing.extents[:2] - true_side).mean())
                refined.append(np.abs(better[thing.id].extents[:2] - true_side).mean())
        figures = 1e3 * np.mean(perceived), 1e3 * np.mean(refined), np.median(seconds)
        print(f"{1e3 * sigma:9.0f} mm {figures[0]:14.2f} {figures[1]:12.2f} {figures[2]:9.2f}")
    parts.robot.close()
    parts.memory.close()


if __name__ == "__main__":
    main()
