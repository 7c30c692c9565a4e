"""Slow: how far boxes are from the true ones, as perceived, as the branch has them, and as the planner gets them.

    python tests/benchmarks/refinement.py [--scans FOLDER] [--layouts 0-9] [--settings cubes,scans]
        [--noise none,realistic] [--cameras 2,4] [KEY=VALUE ...]

Three cubes of 50 mm (``pick_and_lift``) and, with ``--scans``, five of the folder's scans side by side, known to no
gallery. Overrides of ``gvla2 run`` choose the refinement (``reconstructor=hull prior=depth branch.axis=false``). For
each setting: the objects that were found, how many boxes were replaced, and the median errors of the narrower level
side, of the box's volume and of its centre, each as perceived, as the branch has it, and as the planner gets it.
"""

from __future__ import annotations

import argparse
import logging
from contextlib import closing
from itertools import product

import numpy as np
from hydra import compose, initialize_config_module
from omegaconf import OmegaConf

from gvla2.commands.hydra_job import schemas
from gvla2.commands.run import build_components
from gvla2.episode.refine import Refinement, refine_scene, with_truth
from gvla2.planning.scene import SceneObject
from gvla2.plugins.hydra_config import register
from gvla2.plugins.registry import Registry, load_plugins
from gvla2.robot.depth_noise import apply_noise

CAMERAS = {2: ["front", "left_shoulder"], 4: ["front", "left_shoulder", "right_shoulder", "wrist"]}


def main() -> None:
    """Measure, and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--scans", default="")
    parser.add_argument("--layouts", default="0-9")
    parser.add_argument("--settings", default="cubes,scans")
    parser.add_argument("--noise", default="none,realistic")
    parser.add_argument("--cameras", default="2,4")
    parser.add_argument("overrides", nargs="*")
    asked = parser.parse_args()
    logging.disable(logging.WARNING)
    first, last = (int(number) for number in asked.layouts.split("-"))
    registry = load_plugins()
    register(registry, schemas())
    tasks = {"cubes": ["task=pick_and_lift"]}
    if asked.scans:
        # A scale, even that of the files, keeps the task from being the perceiver's gallery.
        scans = [f"task.objects.root={asked.scans}", "task.objects.count=5", "task.objects.scale=1"]
        tasks["scans"] = ["task=tabletop_objects", *scans]
    print(
        "setting   noise      cameras  objects  replaced  width, mm            volume, %            centre, mm"
    )
    settings = [name for name in asked.settings.split(",") if name in tasks]
    for setting, noise, count in product(settings, asked.noise.split(","), asked.cameras.split(",")):
        cameras = f"robot.cameras=[{','.join(CAMERAS[int(count)])}]"
        overrides = [*tasks[setting], f"depth_noise={noise}", cameras, "memory=none", *asked.overrides]
        done = measure(registry, overrides, range(first, last + 1))
        boxes = [
            [errors(box, one.true) for box in (one.before, one.after or one.before, one.chosen)]
            for one in done
        ]
        middle = np.median(boxes, axis=0).T  # of each error: perceived, the branch's, the planner's
        shown = "  ".join(" -> ".join(f"{value:.1f}" for value in line).ljust(19) for line in middle)
        used = sum(one.used for one in done)
        print(f"{setting:9} {noise:10} {count:>7} {len(done):8} {used:9}  {shown}", flush=True)


def measure(registry: Registry, overrides: list[str], layouts: range) -> list[Refinement]:
    """What became of the boxes of the objects that were found, each with the true object."""
    with initialize_config_module("gvla2.conf", version_base="1.3"):
        config = OmegaConf.to_object(compose("run", overrides=overrides))
    components = build_components(config, registry, branch=config.branch)
    found: list[Refinement] = []
    with closing(components.robot), closing(components.memory):
        for layout in layouts:
            components.robot.reset(components.task, layout)
            rng = np.random.default_rng([layout, 0])
            observation = apply_noise(components.robot.observe(), config.depth_noise, rng, layout)
            scene = components.perceiver.perceive(observation, "", components.robot.arm.workspace)
            done = refine_scene(scene, observation, "", components.geometry)[1]
            found += [one for one in with_truth(done, components.robot.true_scene()) if one.true is not None]
    return found


def errors(obj: SceneObject, true: SceneObject) -> tuple[float, float, float]:
    """Of the narrower level side, mm; of the volume, per cent; of the centre, mm."""
    width = abs(obj.extents[:2].min() - true.extents[:2].min())
    volume = abs(np.prod(obj.extents) / np.prod(true.extents) - 1.0)
    return 1e3 * float(width), 1e2 * float(volume), 1e3 * float(np.linalg.norm(obj.centre - true.centre))


if __name__ == "__main__":
    main()
