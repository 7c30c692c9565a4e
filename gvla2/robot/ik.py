"""Inverse kinematics: Levenberg-Marquardt steps in the tool frame, from deterministic starts."""

from __future__ import annotations

from typing import Any

import numpy as np

from gvla2.geometry.transform import FloatArray, check_rigid
from gvla2.planning.arm import IKSolution
from gvla2.robot.kinematics import Kinematics, import_pinocchio

POSITION_TOLERANCE, ROTATION_TOLERANCE = 5e-4, 5e-3
"""A pose counts as reached within this many metres and radians; steps go on well below."""

_SAMPLED = 400
"""Members of the library among which the arm's best manipulability is looked for."""

_COMFORT = 0.15
"""Distance to a joint limit, radians, under which a solution is pushed away from it where the arm has spare joints."""


class InverseKinematics:
    """Finds joints for tool poses.

    The starts are ``near``, ``home``, and the members of a seeded library of configurations whose tool poses are
    nearest to the target: the same question always gets the same answer.
    """

    def __init__(
        self, kinematics: Kinematics, home: FloatArray, library: int = 1500, restarts: int = 12
    ) -> None:
        self._kinematics = kinematics
        self._pin = import_pinocchio()
        self._home = home
        self._restarts = restarts
        rng = np.random.default_rng(20240229)
        spread = 0.05 * (kinematics.high - kinematics.low)
        self._library = rng.uniform(
            kinematics.low + spread, kinematics.high - spread, (library, kinematics.dof)
        )
        poses = np.array([kinematics.forward(row) for row in self._library])  # (L, 4, 4)
        self._positions, self._rotations = poses[:, :3, 3], poses[:, :3, :3]
        self._best = max(kinematics.manipulability(row) for row in self._library[:_SAMPLED])

    def solve(self, world_from_tcp: FloatArray, near: FloatArray | None = None) -> IKSolution | None:
        """The solution nearest to ``near`` (home by default), away from joint limits; None if none is found."""
        found = self.solutions(world_from_tcp, near, count=1)
        return found[0] if found else None

    def solutions(
        self, world_from_tcp: FloatArray, near: FloatArray | None = None, count: int = 6
    ) -> list[IKSolution]:
        """Up to ``count`` solutions more than 0.2 rad apart, best first.

        With ``count`` 1 a comfortable solution found from ``near`` itself is taken at once.
        Raises :class:`GeometryError` for a pose that is not one.
        """
        target = check_rigid(world_from_tcp, "target pose")
        near = self._home if near is None else np.asarray(near, dtype=np.float64)
        placement = self._pin.SE3(target)
        starts = self._starts(target, near)
        if starts is None:
            return []
        found: list[IKSolution] = []
        wanted = max(count, 3)  # one more choice than asked, to weigh the limits
        for start in starts:
            solution = self._from(start, placement)
            if solution is None or any(np.abs(solution.joints - f.joints).max() < 0.2 for f in found):
                continue
            found.append(solution)
            comfortable = solution.limit_margin > 0.05 and np.abs(solution.joints - near).max() < 1.6
            if len(found) >= wanted or (count == 1 and len(found) == 1 and start is near and comfortable):
                break
        found.sort(key=lambda s: _cost(s, near))
        return found[:count]

    def track(self, joints: FloatArray, target: Any, iterations: int = 12) -> FloatArray | None:
        """Joints (dof,) for a near-by SE3 target on the same branch as ``joints``; None when lost."""
        return self._descend(joints, target, iterations, spare=True)

    def _starts(self, target: FloatArray, near: FloatArray) -> list[FloatArray] | None:
        """Starts in order; None when the target is farther away than the arm ever gets."""
        distance = np.linalg.norm(self._positions - target[:3, 3], axis=1)
        if distance.min() > 0.35:
            return None
        cosine = 0.5 * (np.einsum("nij,ij->n", self._rotations, target[:3, :3]) - 1.0)
        distance += 0.3 * np.arccos(np.clip(cosine, -1.0, 1.0))
        distance += 0.02 * np.linalg.norm(self._library - near, axis=1)
        order = np.argsort(distance, kind="stable")[: self._restarts]
        return [near, self._home, *self._library[order]]

    def _from(self, start: FloatArray, target: Any) -> IKSolution | None:
        joints = self._descend(start, target, iterations=40, spare=False)
        if joints is None:
            return None
        kinematics = self._kinematics
        if kinematics.limit_distance(joints) < _COMFORT and kinematics.dof > 6:
            joints = self._relax(joints, target)
        error = self._pin.log6(kinematics.pose(joints).actInv(target)).vector
        return IKSolution(
            joints=joints,
            limit_margin=kinematics.limit_distance(joints),
            manipulability=min(1.0, kinematics.manipulability(joints) / self._best),
            position_error=float(np.linalg.norm(error[:3])),
            rotation_error=float(np.linalg.norm(error[3:])),
        )

    def _descend(self, start: FloatArray, target: Any, iterations: int, spare: bool) -> FloatArray | None:
        """Damped least squares, damping falling with the squared error (Sugihara 2011), clipped to the limits."""
        kinematics, log6 = self._kinematics, self._pin.log6
        low, high = kinematics.low, kinematics.high
        joints = np.clip(start, low, high)
        eye = np.eye(kinematics.dof)
        best, stalled = np.inf, 0
        for _ in range(iterations):
            error = log6(kinematics.pose(joints).actInv(target)).vector
            squared = float(error @ error)
            if squared < 1e-11:
                return joints
            stalled = 0 if squared < 0.9 * best else stalled + 1
            best = min(best, squared)
            if stalled > 6:
                break
            jacobian = kinematics.jacobian(joints)
            normal = jacobian.T @ jacobian + (1e-2 * squared + 1e-9) * eye
            step = np.linalg.solve(normal, jacobian.T @ error)
            if spare:
                step += self._away(joints, jacobian)
            largest = np.abs(step).max()
            joints = np.clip(joints + step * min(1.0, 0.6 / max(largest, 1e-12)), low, high)
        error = log6(kinematics.pose(joints).actInv(target)).vector
        reached = np.linalg.norm(error[:3]) < 0.2 * POSITION_TOLERANCE
        return joints if reached and np.linalg.norm(error[3:]) < 0.2 * ROTATION_TOLERANCE else None

    def _away(self, joints: FloatArray, jacobian: FloatArray, gain: float = 0.2) -> FloatArray:
        """A small motion away from near limits that leaves the tool where it is (spare joints only)."""
        kinematics = self._kinematics
        if kinematics.dof <= 6 or kinematics.limit_distance(joints) > 2 * _COMFORT:
            return np.zeros(kinematics.dof)
        push = np.maximum(0.0, 2 * _COMFORT - (joints - kinematics.low))
        push -= np.maximum(0.0, 2 * _COMFORT - (kinematics.high - joints))
        toward = np.linalg.lstsq(jacobian, jacobian @ push, rcond=1e-4)[0]
        return np.asarray(gain * (push - toward))

    def _relax(self, joints: FloatArray, target: Any) -> FloatArray:
        """The same tool pose, farther from the limits."""
        best, margin = joints, self._kinematics.limit_distance(joints)
        for _ in range(10):
            self._kinematics.pose(joints)
            moved = joints + self._away(joints, self._kinematics.jacobian(joints), gain=0.5)
            settled = self._descend(moved, target, iterations=6, spare=False)
            if settled is None or self._kinematics.limit_distance(settled) < margin + 1e-3:
                break
            best, joints, margin = settled, settled, self._kinematics.limit_distance(settled)
        return best


def _cost(solution: IKSolution, near: FloatArray) -> float:
    """Distance from ``near`` in radians; closeness to a limit or a singularity counts as more of it."""
    distance = float(np.linalg.norm(solution.joints - near))
    return (
        distance
        + 10.0 * max(0.0, 0.1 - solution.limit_margin)
        + max(0.0, 0.02 - solution.manipulability) * 20
    )
