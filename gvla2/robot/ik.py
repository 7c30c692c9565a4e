"""Inverse kinematics: Levenberg-Marquardt steps in the tool frame, from deterministic starts."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gvla2.geometry.transform import FloatArray, check_rigid
from gvla2.planning.arm import IKSolution
from gvla2.robot.descent import descend, settle
from gvla2.robot.kinematics import Kinematics

_SAMPLED = 400
"""Members of the library among which the arm's best manipulability is searched."""
_AWAY = 0.2
"""Gain of the motion away from near joint limits along a line; see :func:`gvla2.robot.descent.descend`."""


class InverseKinematics:
    """Finds joints for tool poses.

    The starts are ``near``, ``home``, and the members of a seeded library of configurations whose tool poses are
    nearest to the target: results are reproducible.
    """

    def __init__(
        self, kinematics: Kinematics, home: FloatArray, library: int = 1500, restarts: int = 12
    ) -> None:
        self._kinematics = kinematics
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

        With ``count`` 1 a comfortable solution found from ``near`` itself is taken immediately. Raises
        :class:`GeometryError` for a pose that is not one.
        """
        target = np.ascontiguousarray(check_rigid(world_from_tcp, "target pose"))
        near = self._home if near is None else np.ascontiguousarray(near, dtype=np.float64)
        found: list[IKSolution] = []
        wanted = max(count, 3)  # several, so that one away from the limits can be preferred
        for start in self._starts(target, near):
            solution = self._from(start, target)
            if solution is None or any(np.abs(solution.joints - f.joints).max() < 0.2 for f in found):
                continue
            found.append(solution)
            comfortable = solution.limit_margin > 0.05 and np.abs(solution.joints - near).max() < 1.6
            if len(found) >= wanted or (count == 1 and len(found) == 1 and start is near and comfortable):
                break
        found.sort(key=lambda s: _cost(s, near))
        return found[:count]

    def track(self, joints: FloatArray, target: FloatArray, iterations: int = 12) -> FloatArray | None:
        """Joints (dof,) for a near-by pose (4, 4) on the same branch as ``joints``; None when lost."""
        start, goal = np.ascontiguousarray(joints), np.ascontiguousarray(target)  # other layouts compile anew
        reached, found = descend(self._kinematics.chain, start, goal, iterations, _AWAY)
        return found if reached else None

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

    def _from(self, start: FloatArray, target: FloatArray) -> IKSolution | None:
        reached, joints, margin, volume = settle(self._kinematics.chain, start, target)
        return IKSolution(joints, margin, min(1.0, volume / self._best)) if reached else None


def _cost(solution: IKSolution, near: FloatArray) -> float:
    """Distance from ``near`` in radians; closeness to a limit or a singularity adds to it."""
    distance = float(np.linalg.norm(solution.joints - near))
    return (
        distance
        + 10.0 * max(0.0, 0.1 - solution.limit_margin)
        + max(0.0, 0.02 - solution.manipulability) * 20
    )
