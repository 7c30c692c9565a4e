"""How fast the Panda's kinematics, collision checks and motion planning are: python tests/benchmarks/motion.py."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from gvla2.geometry.transform import rigid
from gvla2.planning.scene import Scene, SceneObject
from gvla2.planning.trajectory import grasp_rotation
from gvla2.robot.motion import MotionPath, plan_motion
from gvla2.robot.timing import MotionLimits, time_path
from gvla2.robot.workcell import make_cell
from gvla2_plugins.sapien import SapienPandaConfig


def clutter(rng: np.random.Generator, arm: Any) -> Scene:
    """Five blocks and a wall 0.3 m high that stands between left and right."""
    objects = [
        SceneObject(f"block{i}", "block", "box", "", rigid(None, (x, y, 0.782)), np.full(3, 0.06), np.zeros((0, 3)))
        for i, (x, y) in enumerate(rng.uniform((0.1, -0.4), (0.45, 0.4), (5, 2)))
    ]  # fmt: skip
    wall = rigid(None, (0.32, rng.uniform(-0.05, 0.05), 0.902))
    objects.append(SceneObject("wall", "wall", "box", "", wall, np.array([0.3, 0.03, 0.3]), np.zeros((0, 3))))
    return Scene(tuple(objects), 0.752, arm.workspace)


def measure(calls: int, body: Callable[[int], object]) -> tuple[list[float], list[object]]:
    """Seconds and results of ``body(0)``, ``body(1)``, ..."""
    seconds, results = [], []
    for i in range(calls):
        began = time.perf_counter()
        results.append(body(i))
        seconds.append(time.perf_counter() - began)
    return seconds, results


def show(what: str, seconds: list[float], unit: float, name: str, note: str = "") -> None:
    median, high = np.percentile(seconds, [50, 95]) / unit
    print(f"{what:34s} median {median:8.2f} {name}   p95 {high:8.2f} {name}   {note}")


def main() -> None:
    rng = np.random.default_rng(0)
    began = time.perf_counter()
    arm = make_cell(SapienPandaConfig()).arm
    print(f"arm model made in {time.perf_counter() - began:.2f} s")
    low, high = arm.limits
    down = [
        grasp_rotation(np.array([0.0, 0, -1]), np.array([np.cos(a), np.sin(a), 0]))
        for a in rng.uniform(0, 3, 300)
    ]

    targets = [arm.forward(q) for q in rng.uniform(low, high, (300, arm.dof))]
    seconds, found = measure(300, lambda i: arm.inverse(targets[i]))
    show(
        "IK, any reachable pose", seconds, 1e-3, "ms", f"solved {np.mean([f is not None for f in found]):.1%}"
    )
    grasps = [
        rigid(r, p)
        for r, p in zip(down, rng.uniform((0.1, -0.35, 0.77), (0.45, 0.35, 1.0), (300, 3)), strict=True)
    ]
    seconds, found = measure(300, lambda i: arm.inverse(grasps[i]))
    show(
        "IK, grasps over the table",
        seconds,
        1e-3,
        "ms",
        f"solved {np.mean([f is not None for f in found]):.1%}",
    )

    checker = arm.checker(clutter(rng, arm), 1.0)
    checker.set_margins(0.01)
    near = np.clip(arm.home + rng.normal(size=(3000, arm.dof)) * 0.4, low, high)
    seconds, found = measure(3000, lambda i: checker.free(near[i]))
    show("collision check, 6 objects", seconds, 1e-6, "µs", f"free {np.mean(found):.0%}")
    seconds, _ = measure(1000, lambda i: checker.clearance(near[i]))
    show("signed clearance, 6 objects", seconds, 1e-6, "µs")

    queries = []
    while len(queries) < 40:
        scene = clutter(rng, arm)
        sides = rng.permutation([-1, 1])
        ends = [
            rigid(down[rng.integers(300)], (rng.uniform(0.2, 0.4), s * rng.uniform(0.15, 0.3), 0.9))
            for s in sides
        ]
        joints = arm.inverse(ends[0])
        if joints is not None and arm.clearance(joints.joints, 1.0, scene).distance > 0.01:
            queries.append((joints.joints, ends[1], scene))
    seconds, found = measure(len(queries), lambda i: plan_motion(arm, *queries[i], seed=i))
    paths = [f for f in found if isinstance(f, MotionPath)]
    searched = sum(f.status == "rrt_connect" for f in paths)
    show(
        "free motion across a wall",
        seconds,
        1e-3,
        "ms",
        f"found {len(paths)}/{len(queries)}, {searched} by RRT-Connect",
    )
    for f in found:
        if not isinstance(f, MotionPath):
            print("   ", f)

    starts = [arm.inverse(pose).joints for pose in grasps[:100] if arm.inverse(pose) is not None]
    lift = rigid(None, (0, 0, 0.15))
    empty = Scene((), 0.752, arm.workspace)
    seconds, found = measure(
        len(starts),
        lambda i: plan_motion(arm, starts[i], lift @ arm.forward(starts[i]), empty, motion="linear"),
    )
    share = np.mean([isinstance(f, MotionPath) for f in found])
    show("straight lift of 15 cm", seconds, 1e-3, "ms", f"found {share:.0%}")

    limits = MotionLimits(arm.velocity_limits, np.full(arm.dof, 6.0), 0.25)
    seconds, _ = measure(len(paths), lambda i: time_path(paths[i].joints, 1 / 60, limits, arm.tool_positions))
    show("time samples of a free motion", seconds, 1e-3, "ms")


if __name__ == "__main__":
    main()
