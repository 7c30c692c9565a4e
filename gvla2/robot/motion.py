"""Motion planning: from joints to a tool pose, clear of the perceived scene."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, Literal

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2.planning.arm import Attachment
from gvla2.planning.scene import Scene
from gvla2.robot.arm_from_urdf import ArmModel
from gvla2.robot.collision import CollisionChecker
from gvla2.robot.kinematics import library


@dataclass(frozen=True)
class MotionPath:
    """Joints (N, dof) in radians, the start first; ``status`` says how it was found."""

    joints: FloatArray = field(repr=False)
    status: Literal["linear", "direct", "rrt_connect"]


@dataclass(frozen=True)
class MotionFailure:
    """Why there is no path.

    ``unreachable``: no joints for the pose, or the straight line leaves the arm's reach; ``collision``: the
    start, the goal or the straight line touches (``pair``: the robot's link or the held object, and what it touches);
    ``no_path``: both ends are fine, the search found nothing between.
    """

    code: Literal["unreachable", "no_path", "collision"]
    message: str
    pair: tuple[str, str] | None = None


MARGIN, LINEAR_MARGIN, SLACK = 0.010, 0.0, 0.002
"""Metres kept from the scene on free and on straight motions; where the start or the goal is nearer already, the pair
keeps its distance there, less the slack."""

START_OVERLAP, GOAL_OVERLAP = 0.02, 0.003
"""Perception is a few millimetres off: a start and a goal may overlap by this much, metres."""

FINE_STEP = 0.008
"""Spacing of checked configurations along a path, radians."""

GOALS, ATTEMPTS = 5, 2
"""Joint solutions tried for a pose, and searches."""

MAX_CHECKS, MAX_SECONDS = 20_000, 20.0
"""Bounds of each search; the seconds are a safety net far above the checks."""


def plan_motion(
    arm: ArmModel,
    start: FloatArray,
    goal: FloatArray,
    scene: Scene,
    *,
    motion: Literal["free", "linear"] = "free",
    gripper: float = 1.0,
    attached: Attachment | None = None,
    allowed_contacts: frozenset[str] = frozenset(),
    then: Sequence[FloatArray] = (),
    seed: int = 0,
) -> MotionPath | MotionFailure:
    """A path from joints ``start`` (dof,) to the tool pose ``goal`` (4, 4).

    ``gripper`` is the opening in [0, 1] on the way. ``then`` are tool poses (4, 4) to reach by straight moves
    afterwards: goal joints from which these are possible are preferred. The same arguments give the same path.
    """
    checker = arm.checker(scene, gripper, allowed_contacts, attached)
    within = np.clip(np.asarray(start, dtype=np.float64), *arm.limits)
    query = _Query(arm, checker, within, checker.distances(within), seed)
    blocked = query.blocked(query.start_distances, START_OVERLAP, "At the start")
    return blocked or (query.linear(goal) if motion == "linear" else query.free(goal, then))


@dataclass(frozen=True)
class _Goal:
    joints: FloatArray
    distances: FloatArray  # (pairs,)


@dataclass(frozen=True)
class _Query:
    """One call of the planner, with the distances (pairs,) at its start."""

    arm: ArmModel
    checker: CollisionChecker
    start: FloatArray
    start_distances: FloatArray
    seed: int

    def free(self, goal: FloatArray, then: Sequence[FloatArray]) -> MotionPath | MotionFailure:
        goals = self._goals(goal, then)
        if isinstance(goals, MotionFailure):
            return goals
        # A goal in another posture may be easy to reach, but only with large arm motions: it comes last.
        nearest = min(self._away(g) for g in goals)
        handy = [g for g in goals if self._away(g) <= 1.5 * nearest + 0.5]
        for choice in (handy, goals) if len(handy) < len(goals) else (goals,):
            found = self._direct(choice) or self._search(choice)
            if found is not None:
                return found
        return MotionFailure("no_path", "The search found no way around the obstacles.")

    def linear(self, goal: FloatArray) -> MotionPath | MotionFailure:
        line = self.arm.line(self.start, goal)
        if line is None:
            lost = self.arm.inverse(goal, self.start) is None
            where = "the pose is out of reach" if lost else "the straight line there leaves the joint limits"
            return MotionFailure("unreachable", f"No straight move to {_place(goal)}: {where}.")
        path = np.stack(line)
        end = self.checker.distances(path[-1])
        if blocked := self._goal_blocked(end):
            return blocked
        self._keep(LINEAR_MARGIN, end)
        fine = interpolate(path, FINE_STEP)
        index = self.checker.first_blocked(fine)
        if index is not None:
            worst = self.checker.clearance(fine[index])
            into = f"takes {worst.robot_part} into {worst.other}"
            depth = f"{-1e3 * worst.distance:.0f} mm" if worst.distance < 0 else "nearer than its margin"
            message = f"The straight move to {_place(goal)} {into} ({depth})."
            return MotionFailure("collision", message, (worst.robot_part, worst.other))
        return MotionPath(path, "linear")

    def _goals(self, goal: FloatArray, then: Sequence[FloatArray]) -> list[_Goal] | MotionFailure:
        """Goal joints free of collisions, best first: with later moves, with the full margin, near the start."""
        found = self.arm.ik.solutions(goal, self.start, GOALS)
        if not found:
            return MotionFailure("unreachable", f"No joints put the tool at {_place(goal)}.")
        goals, reasons = [], []
        for solution in found:
            distances = self.checker.distances(solution.joints)
            if blocked := self._goal_blocked(distances):
                reasons.append(blocked)
            else:
                goals.append(_Goal(solution.joints, distances))
        if not goals:
            return reasons[0]
        world, margin = self.checker.n_world, MARGIN
        close = [bool((g.distances[:world] < margin).any()) for g in goals]
        broken = [not self._can_continue(g.joints, then) for g in goals] if len(goals) > 1 else [False]
        order = sorted(range(len(goals)), key=lambda i: (broken[i], close[i], i))
        best = (broken[order[0]], close[order[0]])
        return [goals[i] for i in order if (broken[i], close[i]) == best]

    def _can_continue(self, joints: FloatArray, then: Sequence[FloatArray]) -> bool:
        """Whether the straight moves work from here, the arm staying clear of itself."""
        own = slice(self.checker.n_world, None)
        for pose in then:
            line = self.arm.line(joints, pose, step=0.02)
            if line is None:
                return False
            joints = line[-1]
            if self.checker.distances(joints)[own].min(initial=np.inf) < 0:
                return False
        return True

    def _away(self, goal: _Goal) -> float:
        return float(np.linalg.norm(goal.joints - self.start))

    def _direct(self, goals: Sequence[_Goal]) -> MotionPath | None:
        for goal in goals:
            self._keep(MARGIN, goal.distances)
            path = np.stack([self.start, goal.joints])
            if self._clear(path):
                return MotionPath(path, "direct")
        return None

    def _search(self, goals: Sequence[_Goal]) -> MotionPath | None:
        self._keep(MARGIN, np.min([g.distances for g in goals], axis=0))
        ends = [g.joints for g in goals]
        for attempt in range(ATTEMPTS):
            seed = self.seed * 1000 + attempt
            path = rrt_connect(self.start, ends, self.arm.limits, self.checker.free, seed)
            if path is not None and self._clear(path):
                return MotionPath(path, "rrt_connect")
        return None

    def _clear(self, path: FloatArray) -> bool:
        return self.checker.first_blocked(interpolate(path, FINE_STEP)) is None

    def _keep(self, margin: float, goal_distances: FloatArray) -> None:
        """Set each world pair's margin, relaxed to the distances at start and goal."""
        world = self.checker.n_world
        ends = np.minimum(self.start_distances, goal_distances)[:world]
        self.checker.set_margins(np.minimum(margin, ends - SLACK))

    def _goal_blocked(self, distances: FloatArray) -> MotionFailure | None:
        return self.blocked(distances, GOAL_OVERLAP, "At the goal")

    def blocked(self, distances: FloatArray, overlap: float, where: str) -> MotionFailure | None:
        """A failure when a world pair overlaps by more than ``overlap``, or the arm touches itself."""
        allowed = np.zeros(len(distances))
        allowed[: self.checker.n_world] = overlap
        excess = distances + allowed
        if not len(excess) or excess.min() >= 0:
            return None
        worst = int(excess.argmin())
        pair = self.checker.pairs[worst]
        message = f"{where} {pair[0]} overlaps {pair[1]} by {-1e3 * distances[worst]:.0f} mm."
        return MotionFailure("collision", message, pair)


def _place(pose: FloatArray) -> str:
    x, y, z = pose[:3, 3]
    return f"({x:.3f}, {y:.3f}, {z:.3f}) m"


RESOLUTION = 0.001
"""Spacing of checked configurations as a share of the joint space's extent. 0.01 lets colliding paths through."""

REACH = 1.5
"""Longest edge of the search trees, radians."""

SHORTCUTS = 25
"""Attempts to join two points of a found path by a straight segment."""


def rrt_connect(
    start: FloatArray,
    goals: Sequence[FloatArray],
    limits: tuple[FloatArray, FloatArray],
    free: Callable[[FloatArray], bool],
    seed: int,
) -> FloatArray | None:
    """A path (N, dof) from ``start`` to one of ``goals``, inside the limits; None when none was found.

    ``free`` says whether joints (dof,) are allowed. The search is bounded by :data:`MAX_CHECKS` calls of it,
    which keeps it reproducible. Detours are cut afterwards.
    """
    ob, og, ou = (library(f"ompl.{part}") for part in ("base", "geometric", "util"))
    ou.noOutputHandler()  # it complains about every seed except a process's first, but honours it anyway
    # Samplers and planners draw their own seeds when created: they must all be created after this line.
    ou.RNG.setSeed(1 + seed % (2**31 - 2))
    dof, calls = len(start), 0
    space, bounds = ob.RealVectorStateSpace(dof), ob.RealVectorBounds(dof)
    for j, (low, high) in enumerate(zip(*limits, strict=True)):
        bounds.setLow(j, float(low))
        bounds.setHigh(j, float(high))
    space.setBounds(bounds)

    def joints_of(state: Any) -> FloatArray:
        return np.array([state[j] for j in range(dof)])

    def state_of(joints: FloatArray) -> Any:
        state = space.allocState()
        for j, value in enumerate(joints):
            state[j] = float(value)
        return state

    def valid(state: Any) -> bool:
        nonlocal calls
        calls += 1
        return free(joints_of(state))

    information = ob.SpaceInformation(space)
    information.setStateValidityChecker(valid)
    information.setStateValidityCheckingResolution(RESOLUTION)
    information.setup()
    problem, states = ob.ProblemDefinition(information), ob.GoalStates(information)
    problem.addStartState(state_of(start))
    for goal in goals:
        states.addState(state_of(goal))
    problem.setGoal(states)
    planner = og.RRTConnect(information)
    planner.setRange(REACH)
    planner.setProblemDefinition(problem)
    planner.setup()
    deadline = time.monotonic() + MAX_SECONDS
    planner.solve(ob.PlannerTerminationCondition(lambda: calls > MAX_CHECKS or time.monotonic() > deadline))
    if not problem.hasExactSolution():
        return None
    path, simplifier = problem.getSolutionPath(), og.PathSimplifier(information)
    simplifier.reduceVertices(path)
    simplifier.partialShortcutPath(path, SHORTCUTS, SHORTCUTS, 1.0)
    simplifier.reduceVertices(path)
    return np.array([joints_of(state) for state in path.getStates()])


def interpolate(path: FloatArray, step: float) -> FloatArray:
    """The polyline (N, dof) with points at most ``step`` radians apart in every joint; its vertices stay."""
    pieces = [path[:1]]
    for a, b in pairwise(path):
        count = max(1, int(np.ceil(np.abs(b - a).max() / step)))
        pieces.append(a + (b - a) * (np.arange(1, count + 1) / count)[:, None])
    return np.concatenate(pieces)
