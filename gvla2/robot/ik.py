"""Inverse kinematics: damped least squares in the tool frame, from deterministic starts; straight tool moves."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gvla2.geometry.transform import FloatArray, check_rigid, rigid
from gvla2.planning.arm import IKSolution
from gvla2.robot.descent import descend, settle
from gvla2.robot.kinematics import Kinematics, library

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
        low, high = kinematics.low, kinematics.high
        self._chain = kinematics.chain
        rng = np.random.default_rng(20240229)
        spread = 0.05 * (high - low)
        self._library = rng.uniform(low + spread, high - spread, (library_size, kinematics.dof))
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
        # Compiled loops take contiguous arrays; another memory layout would compile them again.
        target = np.ascontiguousarray(check_rigid(world_from_tcp, "target pose"))
        near = self._home if near is None else np.ascontiguousarray(near, dtype=np.float64)
        found: list[IKSolution] = []
        wanted = max(count, 3)  # several, so that one away from the limits can be preferred
        for start in self._starts(target, near):
            reached, joints, margin, volume = settle(self._chain, start, target)
            if not reached or any(np.abs(joints - f.joints).max() < 0.2 for f in found):
                continue
            solution = IKSolution(joints, margin, min(1.0, volume / self._best))
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
        path = [np.clip(start, self._chain.low, self._chain.high)]
        at, size = 0.0, 1.0 / count
        while at < 1.0 - 1e-9:
            to = min(1.0, at + size)
            pose = rigid(pin.exp3(to * turn) @ begin.rotation, begin.translation + to * shift)
            reached, joints = descend(self._chain, path[-1], pose, 12, AWAY)
            if reached and np.abs(joints - path[-1]).max() <= _JUMP:
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


def _cost(solution: IKSolution, near: FloatArray) -> float:
    """Distance from ``near`` in radians; closeness to a limit or a singularity adds to it."""
    distance = float(np.linalg.norm(solution.joints - near))
    return (
        distance
        + 10.0 * max(0.0, 0.1 - solution.limit_margin)
        + max(0.0, 0.02 - solution.manipulability) * 20
    )
