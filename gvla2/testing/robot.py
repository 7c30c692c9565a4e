"""Conformance of tasks, robot backends and depth cameras."""

from __future__ import annotations

import json

import numpy as np

from gvla2.errors import ConformanceError
from gvla2.geometry.exchange import require, require_array, require_rigid, require_share, require_type
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import Observation
from gvla2.planning.scene import Scene
from gvla2.planning.trajectory import Trajectory, Waypoint
from gvla2.robot.backend import (
    CameraFrames,
    DepthCamera,
    ExecutionListener,
    OffersTasks,
    RobotBackend,
    SuccessCheck,
)
from gvla2.robot.policy import Policy
from gvla2.robot.report import ExecutionReport, WaypointReport
from gvla2.robot.solids import lowest
from gvla2.robot.task import CheckedTask, Layout, Task, TaskInstance, TaskSite
from gvla2.testing.conformance import allowed, require_members
from gvla2.testing.inputs import INSTRUCTION, observation

SEEDS = (0, 1, 17)
SITE = TaskSite(centre=(0.25, 0.0), size=(0.65, 0.91), table_height=0.752, reachable=lambda point: True)


class _AtRest:
    """The untouched state of a layout."""

    def __init__(self, layout: Layout) -> None:
        self._poses = {body.name: body.world_from_body for body in layout.bodies}
        self._travel = {joint.name: joint.rest for joint in layout.joints}
        self._travel |= {thread.name: 0.0 for thread in layout.threads}

    def pose(self, body: str) -> FloatArray:
        return self._poses[body]

    def joint(self, name: str) -> float:
        return self._travel[name]

    def peak(self, name: str) -> float:
        return self._travel[name]

    def held(self, body: str) -> bool:
        return False

    def touching(self, body: str) -> frozenset[str]:
        return frozenset({"table"})

    def resting(self, body: str) -> bool:
        return True

    def loose(self, thread: str) -> bool:
        return False


def check_task(task: Task, site: TaskSite = SITE) -> None:
    """Sampling: repeatable by seed, varied over seeds, physically valid, and not done at the start."""
    require_members(task, "task")
    require(
        len(set(task.instructions)) >= 4, f"A task has at least four paraphrases, got {task.instructions}."
    )
    first, task = [], CheckedTask(task, "The task")
    for seed in SEEDS:
        with allowed(f"sample() of seed {seed}"):
            instance = task.sample(np.random.default_rng(seed), site)
            again = task.sample(np.random.default_rng(seed), site)
        _check_instance(instance, site)
        require(_places(instance) == _places(again), f"Seed {seed} must give the same layout each time.")
        require(
            instance.instruction == again.instruction, f"Seed {seed} must give the same sentence each time."
        )
        first.append(_places(instance))
        with allowed("sample() with an instruction"):
            worded = task.sample(np.random.default_rng(seed), site, "words of my own")
        require(worded.instruction == "words of my own", "A given instruction is kept.")
        require(_places(worded) == _places(instance), "An instruction must not change the seed's layout.")
    require(len(set(first)) > 1, f"The seeds {SEEDS} all give the same layout.")


def _places(instance: TaskInstance) -> tuple[bytes, ...]:
    return tuple(np.round(b.world_from_body, 9).tobytes() for b in instance.layout.bodies)


def _check_instance(instance: TaskInstance, site: TaskSite) -> None:
    words = instance.instruction
    require(words and "{" not in words, "An instruction is a finished sentence.")
    for body in instance.layout.bodies:
        for solid in body.solids if not body.fixed else ():
            sunk = site.table_height - lowest(solid, body.world_from_body) if solid.collides else 0.0
            require(sunk < 0.002, f"Body '{body.name}' reaches {sunk:.4f} m into the table.")
    for profile, done in instance.succeeded.items():
        with allowed(f"The predicate '{profile}'"):
            value = done(_AtRest(instance.layout))
        require(not value, f"The task is already done ({profile}) before anything moved.")


def check_robot(robot: RobotBackend, task: Task | None = None, *, move: bool = True) -> None:
    """Reset, observe, move by five centimetres, check success, close twice.

    ``task`` is laid out by a simulator; a robot with tasks of its own is reset to its first. ``move=False`` omits the
    motion, for an armed robot.
    """
    require_members(robot, "robot")
    own = next(iter(robot.tasks()), None) if task is None and isinstance(robot, OffersTasks) else None
    try:
        with allowed("reset()"):
            instance = robot.reset(task or own, seed=3)
        require_type(instance, (TaskInstance, type(None)), "reset()'s answer")
        with allowed("observe()"):
            seen = robot.observe()
        _check_observation(robot, seen)
        if move:
            _check_motion(robot, seen)
        with allowed("success_check()"):
            require_type(robot.success_check(), (SuccessCheck, type(None)), "success_check()'s answer")
    finally:
        robot.close()
    with allowed("close(), called twice,"):
        robot.close()


def _check_observation(robot: RobotBackend, seen: Observation) -> None:
    require_type(seen, Observation, "observe()'s answer")
    require_rigid(seen.world_from_tcp, "world_from_tcp")
    require_share(seen.gripper, "gripper")
    require(
        0 <= seen.gripper_width <= robot.arm.hand.max_width + 0.01, f"gripper_width is {seen.gripper_width}."
    )
    joints = require_array(seen.joints, robot.arm.home.shape, "joints")
    pose = robot.arm.forward(joints)
    require_rigid(pose, "arm.forward()'s answer")
    gap = float(np.linalg.norm(pose[:3, 3] - seen.world_from_tcp[:3, 3]))
    require(gap < 0.01, f"The measured hand and the arm's model are {gap:.3f} m apart.")
    solved = robot.arm.inverse(pose, joints)
    if solved is None:
        raise ConformanceError("arm.inverse() does not reach the pose that the arm is in.")
    back = float(np.linalg.norm(robot.arm.forward(solved.joints)[:3, 3] - pose[:3, 3]))
    require(back < 0.002, f"arm.forward(arm.inverse(pose)) is {back:.4f} m off.")
    require(any(view.depth is not None for view in seen.views), "At least one camera must measure depth.")


def _check_motion(robot: RobotBackend, seen: Observation) -> None:
    start, goal = seen.world_from_tcp[:3, 3], _near_goal(robot, seen)
    if goal is None:
        raise ConformanceError(
            "arm.line() finds no straight move of 5 cm from where the arm is, in no direction."
        )
    (x, y, z), (u, v, w) = start.tolist(), goal.tolist()
    begin = Waypoint((x, y, z), seen.gripper, "start")
    path = Trajectory((begin, Waypoint((u, v, w), seen.gripper, "move", motion="linear", speed=0.1)))
    scene = Scene((), float(robot.arm.workspace.low[2]), robot.arm.workspace)
    heard: list[WaypointReport] = []
    with allowed("execute()"):
        report = robot.execute(path, scene, ExecutionListener(waypoint=heard.append))
    require_type(report, ExecutionReport, "execute()'s answer")
    require(len(report.waypoints) == len(heard), "The listener gets each waypoint once.")
    json.dumps(report.to_json())
    stopped = report.abort
    require(stopped is None, f"A free move of 5 cm was aborted: {stopped and stopped.message}")
    last = report.waypoints[-1]
    off = float(np.linalg.norm(np.array(last.reached) - goal))
    require(off < 0.02, f"The hand ended {off:.3f} m from its target.")
    moved = float(np.linalg.norm(robot.observe().world_from_tcp[:3, 3] - np.array(last.reached)))
    require(moved < 0.01, f"observe() sees the hand {moved:.3f} m from where execute() says it ended.")


def _near_goal(robot: RobotBackend, seen: Observation) -> FloatArray | None:
    """A point (3,) 5 cm off that the tool reaches on a straight line: sideways, down, forward or up."""
    for step in np.array([[0, 1, 0], [0, -1, 0], [0, 0, -1], [1, 0, 0], [-1, 0, 0], [0, 0, 1]]) * 0.05:
        pose = seen.world_from_tcp.copy()
        pose[:3, 3] += step
        if robot.arm.workspace.contains(pose[:3, 3]) and robot.arm.line(seen.joints, pose) is not None:
            return np.asarray(pose[:3, 3])
    return None


def check_policy(policy: Policy) -> None:
    """It drives an arm of seven joints in two episodes: an action is finite, and its size stays the same."""
    require_members(policy, "policy")
    require(policy.rate > 0 and policy.seconds > 0, "A policy's rate and seconds lie above 0.")
    sizes = set()
    for _ in range(2):
        with allowed("A policy in an episode"):
            policy.begin(INSTRUCTION)
            actions = [np.asarray(policy.act(observation(48)), dtype=float) for _ in range(2)]
        for action in actions:
            require(
                action.ndim == 1 and bool(np.isfinite(action).all()),
                "An action is one row of finite numbers.",
            )
        sizes |= {len(action) for action in actions}
    require(len(sizes) == 1, f"Actions have one size, not {sorted(sizes)}.")


def check_camera(camera: DepthCamera) -> None:
    """Frames are RGB-D in metres, rigidly placed, timestamped, and new for each call; closing twice is allowed."""
    require_members(camera, "camera")
    with allowed("observe(), with and without the tool's pose"):
        both = camera.observe(np.eye(4)), camera.observe()
    for frames in both:
        require_type(frames, CameraFrames, "observe()")
        for view, stamp in zip(frames.views, frames.timestamps, strict=True):
            require_rigid(view.camera.world_from_camera, f"The pose of the view '{view.name}'")
            if view.depth is None:
                raise ConformanceError(f"The view '{view.name}' has no depth.")
            known = view.depth[np.isfinite(view.depth)]
            metres = bool((known > 0).all() and (known < 100).all())
            require(metres, f"The depth of '{view.name}' is not in metres: values outside (0, 100).")
            require(bool(np.isfinite(stamp)) and stamp > 0, f"The timestamp of '{view.name}' is {stamp}.")
    first, second = both
    same = [view.name for view in first.views] == [view.name for view in second.views]
    require(same, "Two observations must have the same views in the same order.")
    later = all(b >= a for a, b in zip(first.timestamps, second.timestamps, strict=True))
    require(later, "A later observation has earlier timestamps.")
    with allowed("close(), twice"):
        camera.close()
        camera.close()
