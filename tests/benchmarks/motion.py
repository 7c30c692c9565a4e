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


def measure(
    what: str, calls: int, body: Callable[[int], Any], note: Callable[[list[Any]], str] | None = None
) -> list[Any]:
    """Print the milliseconds of ``body(0)``, ``body(1)``, ... with a note on the results, which are returned."""
    seconds, results = [], []
    for i in range(calls):
        began = time.perf_counter()
        results.append(body(i))
        seconds.append(time.perf_counter() - began)
    median, high = 1e3 * np.percentile(seconds, [50, 95])
    print(f"{what:34s} median {median:8.3f} ms   p95 {high:8.3f} ms   {note(results) if note else ''}")
    return results


def solved(found: list[Any]) -> str:
    return f"solved {np.mean([f is not None for f in found]):.1%}"


def planned(found: list[Any]) -> str:
    paths = [f for f in found if isinstance(f, MotionPath)]
    return f"found {len(paths)}/{len(found)}, {sum(f.status == 'rrt_connect' for f in paths)} by RRT-Connect"


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
    measure("IK, any reachable pose", 300, lambda i: arm.inverse(targets[i]), solved)
    places = rng.uniform((0.1, -0.35, 0.77), (0.45, 0.35, 1.0), (300, 3))
    grasps = [rigid(r, p) for r, p in zip(down, places, strict=True)]
    measure("IK, grasps over the table", 300, lambda i: arm.inverse(grasps[i]), solved)

    checker = arm.checker(clutter(rng, arm), 1.0)
    checker.set_margins(0.01)
    near = np.clip(arm.home + rng.normal(size=(3000, arm.dof)) * 0.4, low, high)
    measure(
        "collision check, 6 objects",
        3000,
        lambda i: checker.free(near[i]),
        lambda f: f"free {np.mean(f):.0%}",
    )
    measure("signed clearance, 6 objects", 1000, lambda i: checker.clearance(near[i]))

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
    found = measure(
        "free motion across a wall", len(queries), lambda i: plan_motion(arm, *queries[i], seed=i), planned
    )
    paths = [f for f in found if isinstance(f, MotionPath)]
    for f in found:
        if not isinstance(f, MotionPath):
            print("   ", f)

    starts = [arm.inverse(pose).joints for pose in grasps[:100] if arm.inverse(pose) is not None]
    lift, empty = rigid(None, (0, 0, 0.15)), Scene((), 0.752, arm.workspace)
    ends = [lift @ arm.forward(joints) for joints in starts]
    measure(
        "straight lift of 15 cm",
        len(starts),
        lambda i: plan_motion(arm, starts[i], ends[i], empty, motion="linear"),
        planned,
    )

    limits = MotionLimits(arm.velocity_limits, np.full(arm.dof, 6.0), 0.25)
    measure(
        "time samples of a free motion",
        len(paths),
        lambda i: time_path(paths[i].joints, 1 / 60, limits, arm.tool_positions),
    )


if __name__ == "__main__":
    main()
