"""Sampling-based search in joint space: OMPL's RRT-Connect, then shortcuts. The same seed finds the same path."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from typing import Any

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2.robot.libraries import library

RESOLUTION = 0.001
"""Spacing of checked configurations as a share of the joint space's extent. 0.01 lets colliding paths through."""

Free = Callable[[FloatArray], bool]
"""Whether joints (dof,) are allowed."""

SegmentFree = Callable[[FloatArray, FloatArray], bool]
"""Whether the straight joint-space segment between two configurations (dof,) is allowed."""


def rrt_connect(
    start: FloatArray,
    goals: Sequence[FloatArray],
    low: FloatArray,
    high: FloatArray,
    free: Free,
    *,
    seed: int,
    max_checks: int,
    max_seconds: float,
    reach: float = 1.5,
) -> FloatArray | None:
    """A path (N, dof) from ``start`` to one of ``goals``, inside the limits; None when none was found.

    Tree edges are at most ``reach`` radians long. The search is bounded by ``max_checks`` calls of ``free``, which
    keeps it reproducible; ``max_seconds`` is a safety net far above that.
    """
    ob, og, ou = (library(f"ompl.{part}") for part in ("base", "geometric", "util"))
    dof = len(start)
    with _quiet(ou):
        # Samplers and planners draw their own seeds when created: they must all be created after this line.
        ou.RNG.setSeed(1 + seed % (2**31 - 2))
        space = ob.RealVectorStateSpace(dof)
        bounds = ob.RealVectorBounds(dof)
        for j in range(dof):
            bounds.setLow(j, float(low[j]))
            bounds.setHigh(j, float(high[j]))
        space.setBounds(bounds)
        information = ob.SpaceInformation(space)
        calls = 0

        class Validity(ob.StateValidityChecker):  # type: ignore[misc, name-defined]
            def isValid(self, state: Any) -> bool:  # noqa: N802
                nonlocal calls
                calls += 1
                return free(np.array([state[j] for j in range(dof)]))

        validity = Validity(information)
        information.setStateValidityChecker(validity)
        information.setStateValidityCheckingResolution(RESOLUTION)
        information.setup()
        problem = ob.ProblemDefinition(information)
        problem.addStartState(_state(space, start))
        states = ob.GoalStates(information)
        for goal in goals:
            states.addState(_state(space, goal))
        problem.setGoal(states)
        planner = og.RRTConnect(information)
        planner.setRange(reach)
        planner.setProblemDefinition(problem)
        planner.setup()
        deadline = time.monotonic() + max_seconds
        stop = ob.PlannerTerminationCondition(lambda: calls > max_checks or time.monotonic() > deadline)
        planner.solve(stop)
        if not problem.hasExactSolution():
            return None
        path = problem.getSolutionPath()
        return np.array([[s[j] for j in range(dof)] for s in path.getStates()])


def shorten(path: FloatArray, segment_free: SegmentFree, seed: int, tries: int = 25) -> FloatArray:
    """The path (N, dof) with detours cut where the straight segment is allowed; its ends stay.

    First whole vertices are skipped, farthest first; then random points on the path are joined.
    """
    path = _skip_vertices(path, segment_free)
    rng = np.random.default_rng(seed)
    idle = 0
    for _ in range(tries):
        if len(path) < 3 or idle > 8:
            break
        lengths = np.linalg.norm(np.diff(path, axis=0), axis=1)
        ends = np.concatenate([[0.0], np.cumsum(lengths)])
        first, second = np.sort(rng.uniform(0.0, ends[-1], 2))
        a, b = np.searchsorted(ends, [first, second], side="right") - 1
        b = min(int(b), len(lengths) - 1)
        idle += 1
        if a >= b or lengths[a] < 1e-9 or lengths[b] < 1e-9:
            continue
        p = path[a] + (path[a + 1] - path[a]) * ((first - ends[a]) / lengths[a])
        q = path[b] + (path[b + 1] - path[b]) * ((second - ends[b]) / lengths[b])
        saved = (second - first) - np.linalg.norm(q - p)
        if saved > 0.02 * ends[-1] and segment_free(p, q):
            path, idle = np.vstack([path[: a + 1], p, q, path[b + 1 :]]), 0
    return _skip_vertices(path, segment_free)


def interpolate(path: FloatArray, step: float) -> FloatArray:
    """The polyline (N, dof) with points at most ``step`` radians apart in every joint; its vertices stay."""
    pieces = [path[:1]]
    for a, b in pairwise(path):
        count = max(1, int(np.ceil(np.abs(b - a).max() / step)))
        pieces.append(a + (b - a) * (np.arange(1, count + 1) / count)[:, None])
    return np.concatenate(pieces)


def _skip_vertices(path: FloatArray, segment_free: SegmentFree) -> FloatArray:
    kept, i = [path[0]], 0
    while i < len(path) - 1:
        j = len(path) - 1
        while j > i + 1 and not segment_free(path[i], path[j]):
            j -= 1
        kept.append(path[j])
        i = j
    return np.array(kept)


def _state(space: Any, joints: FloatArray) -> Any:
    state = space.allocState()
    for j, value in enumerate(joints):
        state[j] = float(value)
    return state


@contextmanager
def _quiet(ou: Any) -> Iterator[None]:
    """Keep OMPL from printing; it complains about every seed except a process's first, but honours it anyway."""
    ou.noOutputHandler()
    try:
        yield
    finally:
        ou.restorePreviousOutputHandler()
