"""Inverse kinematics: damped least squares in the tool frame, from deterministic starts; straight tool moves."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.linalg.lapack import dposv

from gvla2.geometry.transform import FloatArray, check_rigid
from gvla2.planning.arm import IKSolution
from gvla2.robot.kinematics import Kinematics, library

POSITION_TOLERANCE, ROTATION_TOLERANCE = 5e-4, 5e-3
"""A pose counts as reached within this many metres and radians; steps continue well below."""

COMFORT = 0.15
"""Distance to a joint limit, radians, under which the solution of a redundant arm is pushed away from it."""

AWAY = 0.2
"""Gain of the motion away from near joint limits along a line."""

_SAMPLED = 400
"""Members of the library among which the arm's best manipulability is searched."""

_TURN_STEP = 0.05  # radians of tool rotation per step of a line, if rotation dominates
_JUMP = 0.1  # radians a joint may move in a step; beyond, the step is halved: fast swings pass, branch changes don't
_HALVINGS = 4


class InverseKinematics:
    """Finds joints for tool poses.

    The starts are ``near``, ``home``, and the members of a seeded library of configurations whose tool poses are
    nearest to the target: results are reproducible.
    """

    def __init__(
        self, kinematics: Kinematics, home: FloatArray, library_size: int = 1500, restarts: int = 12
    ) -> None:
        self._pin = library("pinocchio")
        self._kinematics, self._home, self._restarts = kinematics, home, restarts
        self._low, self._high = kinematics.low, kinematics.high
        rng = np.random.default_rng(20240229)
        spread = 0.05 * (self._high - self._low)
        self._library = rng.uniform(self._low + spread, self._high - spread, (library_size, kinematics.dof))
        poses = np.array([kinematics.forward(row) for row in self._library])  # (L, 4, 4)
        self._positions, self._rotations = poses[:, :3, 3], poses[:, :3, :3]
        self._best = max(kinematics.manipulability(row) for row in self._library[:_SAMPLED])

    def solve(self, world_from_tcp: FloatArray, near: FloatArray | None = None) -> IKSolution | None:
        """The solution nearest to ``near`` (home by default), away from joint limits; None if none is found."""
        found = self.solutions(world_from_tcp, near, 1)
        return found[0] if found else None

    def solutions(
        self, world_from_tcp: FloatArray, near: FloatArray | None = None, count: int = 4
    ) -> list[IKSolution]:
        """Up to ``count`` solutions that differ by more than 0.2 rad in some joint, the best first.

        Raises :class:`gvla2.errors.GeometryError` for a pose that is not one.
        """
        pose = check_rigid(world_from_tcp, "target pose")
        near = self._home if near is None else np.asarray(near, dtype=np.float64)
        target = self._pin.SE3(pose)
        found: list[IKSolution] = []
        wanted = max(count, 3)  # several, so that one away from the limits can be preferred
        for start in self._starts(pose, near):
            joints = self._settle(start, target)
            if joints is None or any(np.abs(joints - f.joints).max() < 0.2 for f in found):
                continue
            share = min(1.0, self._kinematics.manipulability(joints) / self._best)
            solution = IKSolution(joints, self._kinematics.limit_distance(joints), share)
            found.append(solution)
            comfortable = solution.limit_margin > 0.05 and np.abs(joints - near).max() < 1.6
            if len(found) >= wanted or (count == 1 and len(found) == 1 and start is near and comfortable):
                break
        found.sort(key=lambda s: _cost(s, near))
        return found[:count]

    def line(self, start: FloatArray, target: FloatArray, step: float) -> list[FloatArray] | None:
        """Joints (dof,) from ``start`` to the tool pose ``target`` (4, 4): position linear, rotation by slerp.

        Points are at most ``step`` metres apart, closer where a joint swings fast. None when the line leaves the arm's
        reach or its joint limits, or when a joint would have to jump.
        """
        pin, begin = self._pin, self._pin.SE3(self._kinematics.forward(start))
        shift = target[:3, 3] - begin.translation
        turn = pin.log3(target[:3, :3] @ begin.rotation.T)
        steps = max(np.linalg.norm(shift) / step, np.linalg.norm(turn) / _TURN_STEP)
        count = max(1, int(np.ceil(steps - 1e-9)))
        path = [np.clip(start, self._low, self._high)]
        at, size = 0.0, 1.0 / count
        while at < 1.0 - 1e-9:
            to = min(1.0, at + size)
            pose = pin.SE3(pin.exp3(to * turn) @ begin.rotation, begin.translation + to * shift)
            joints = self._descend(path[-1], pose, 12, AWAY)
            if joints is not None and np.abs(joints - path[-1]).max() <= _JUMP:
                path.append(joints)
                at, size = to, min(2.0 * size, 1.0 / count)
            elif size * count > 0.5**_HALVINGS + 1e-9:
                size *= 0.5
            else:
                return None
        return path

    def _starts(self, target: FloatArray, near: FloatArray) -> Iterator[FloatArray]:
        """Starts in order; none from the library when the target is farther away than the arm ever gets."""
        yield near
        yield self._home
        distance = np.linalg.norm(self._positions - target[:3, 3], axis=1)
        if distance.min() > 0.35:
            return
        cosine = 0.5 * (np.einsum("nij,ij->n", self._rotations, target[:3, :3]) - 1.0)
        distance += 0.3 * np.arccos(np.clip(cosine, -1.0, 1.0))
        distance += 0.02 * np.linalg.norm(self._library - near, axis=1)
        yield from self._library[np.argsort(distance, kind="stable")[: self._restarts]]

    def _settle(self, start: FloatArray, target: Any) -> FloatArray | None:
        """Joints (dof,) for the SE3 ``target``; of a redundant arm the same tool pose farther from the limits."""
        best = self._descend(start, target, 40)
        if best is None or len(best) <= 6:
            return best
        margin = self._kinematics.limit_distance(best)
        if margin >= COMFORT:
            return best
        for _ in range(10):
            joints = self._descend(best + 0.5 * self._ease(best, self._kinematics.jacobian(best)), target, 6)
            if joints is None or self._kinematics.limit_distance(joints) < margin + 1e-3:
                break
            best, margin = joints, self._kinematics.limit_distance(joints)
        return best

    def _descend(
        self, start: FloatArray, target: Any, iterations: int, away: float = 0.0
    ) -> FloatArray | None:
        """Joints (dof,) for the SE3 ``target`` by steps from ``start``; None when it is not reached.

        Damped least squares with damping in proportion to the squared error (Sugihara 2011), clipped to the limits. A
        redundant arm also moves away from near limits in each step, with the gain ``away``.
        """
        kinematics, log6, damping = self._kinematics, self._pin.log6, np.eye(6)
        joints = np.minimum(np.maximum(start, self._low), self._high)
        best, stalled = np.inf, 0
        for left in range(iterations, -1, -1):
            jacobian, pose = kinematics.jacobian_and_pose(joints)
            error = log6(pose.actInv(target)).vector
            squared = float(error @ error)
            if squared < 1e-11:
                return joints
            stalled = 0 if squared < 0.9 * best else stalled + 1
            best = min(best, squared)
            if stalled > 6 or left == 0:
                break
            gram = jacobian @ jacobian.T + (1e-2 * squared + 1e-9) * damping
            step = jacobian.T @ dposv(gram, error)[1]  # numpy's own solver takes ten times as long
            if away > 0.0:
                step += away * self._ease(joints, jacobian)
            step *= min(1.0, 0.6 / max(float(np.abs(step).max()), 1e-12))
            joints = np.minimum(np.maximum(joints + step, self._low), self._high)
        near = np.linalg.norm(error[:3]) < 0.2 * POSITION_TOLERANCE
        return joints if near and np.linalg.norm(error[3:]) < 0.2 * ROTATION_TOLERANCE else None

    def _ease(self, joints: FloatArray, jacobian: FloatArray) -> FloatArray:
        """A motion (dof,) of a redundant arm away from near limits that keeps the tool where it is; else zeros."""
        push = np.maximum(0.0, 2 * COMFORT - (joints - self._low))
        push -= np.maximum(0.0, 2 * COMFORT - (self._high - joints))
        if len(joints) <= 6 or not push.any():
            return np.zeros(len(joints))
        gram = jacobian @ jacobian.T
        factor, rates, failed = dposv(gram, jacobian @ push)
        # The push is projected onto the Jacobian's null space, which is ill-conditioned near a singularity.
        if failed or factor.diagonal().min() ** 2 <= 1e-6 * gram.diagonal().max():
            return np.zeros(len(joints))
        return np.asarray(push - jacobian.T @ rates)


def _cost(solution: IKSolution, near: FloatArray) -> float:
    """Distance from ``near`` in radians; closeness to a limit or a singularity adds to it."""
    distance = float(np.linalg.norm(solution.joints - near))
    return (
        distance
        + 10.0 * max(0.0, 0.1 - solution.limit_margin)
        + max(0.0, 0.02 - solution.manipulability) * 20
    )
