"""Inverse kinematics: damped least squares in the tool frame, from deterministic starts; straight tool moves.

A plan needs joints for hundreds of tool poses, each in dozens of steps on small matrices: the steps are compiled, which
makes a plan twice as fast as pinocchio's Jacobians from Python. Products are written as loops, since BLAS costs more
than the product of two matrices of this size.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gvla2.geometry.compiled import compiled
from gvla2.geometry.transform import FloatArray, check_rigid, invert_rigid, rigid
from gvla2.planning.arm import IKSolution
from gvla2.robot.kinematics import Kinematics, library

POSITION_TOLERANCE, ROTATION_TOLERANCE = 5e-4, 5e-3
"""A pose counts as reached within this many metres and radians; steps continue well below."""

COMFORT = 0.15
"""Distance to a joint limit, radians, under which the solution of a redundant arm is pushed away from it."""

AWAY = 0.2
"""Gain of the motion away from near joint limits along a line."""

_LIBRARY, _SAMPLED, _RESTARTS = 1500, 400, 12
"""Configurations in the library of starts, those that give the arm's best manipulability, starts per target."""

_TURN_STEP = 0.05  # radians of tool rotation per step of a line, if rotation dominates
_JUMP = 0.1  # radians a joint may move in a step; beyond, the step is halved: fast swings pass, branch changes don't
_HALVINGS = 4


class Chain(NamedTuple):
    """The N joints from the base to the tool, in this order, and the limits of all of the arm's joints.

    Joint k moves ``column[k]`` of the joints (dof,): in the frame ``placements[k]`` (4, 4) on the joint before it, it
    turns about z, or shifts along z where ``slides[k]``. The last placement is the tool's. ``low`` and ``high`` are
    (dof,), radians or metres.
    """

    column: NDArray[np.int64]
    placements: FloatArray
    slides: NDArray[np.bool_]
    low: FloatArray
    high: FloatArray


def chain_of(kinematics: Kinematics) -> Chain:
    """The chain to the tool centre point of an arm whose joints have one axis each."""
    model = kinematics.arm
    frame = model.frames[kinematics.tcp]
    joints = [j for j in model.supports[frame.parentJoint] if j > 0]
    placements, slides, turned = [], [], np.eye(4)
    for j in joints:
        data = model.joints[j].createData()
        model.joints[j].calc(data, np.zeros(model.nq), np.zeros(model.nv))
        motion = np.asarray(data.S).reshape(6)  # metres before radians
        slides.append(bool(np.linalg.norm(motion[3:]) < 0.5))
        axis = motion[:3] if slides[-1] else motion[3:]
        aside = np.cross(np.eye(3)[int(np.argmin(np.abs(axis)))], axis)
        aside /= np.linalg.norm(aside)
        along_axis = rigid(np.stack([aside, np.cross(axis, aside), axis], axis=1))
        placements.append(invert_rigid(turned) @ model.jointPlacements[j].homogeneous @ along_axis)
        turned = along_axis
    placements.append(invert_rigid(turned) @ frame.placement.homogeneous)
    columns = np.array([model.joints[j].idx_v for j in joints], dtype=np.int64)
    return Chain(columns, np.array(placements), np.array(slides), kinematics.low, kinematics.high)


@compiled
def _product(one: FloatArray, other: FloatArray) -> FloatArray:
    """The product of two small matrices."""
    rows, inner, columns = one.shape[0], one.shape[1], other.shape[1]
    product = np.zeros((rows, columns))
    for i in range(rows):
        for k in range(inner):
            for j in range(columns):
                product[i, j] += one[i, k] * other[k, j]
    return product


@compiled
def _tool(chain: Chain, joints: FloatArray) -> tuple[FloatArray, FloatArray]:
    """world_from_tool (4, 4) and its Jacobian (6, dof) in the tool frame, metres before radians."""
    count = len(chain.column)
    frames, pose = np.empty((count, 4, 4)), np.eye(4)
    for k in range(count):
        pose = _product(pose, chain.placements[k])
        value = joints[chain.column[k]]
        c, s = np.cos(value), np.sin(value)
        for i in range(3):
            if chain.slides[k]:
                pose[i, 3] += value * pose[i, 2]
            else:
                x, y = pose[i, 0], pose[i, 1]
                pose[i, 0], pose[i, 1] = c * x + s * y, c * y - s * x
        frames[k] = pose
    pose = _product(pose, chain.placements[count])
    jacobian = np.zeros((6, len(joints)))
    for k in range(count):
        frame, column = frames[k], chain.column[k]
        for j in range(3):
            m, n = (j + 1) % 3, (j + 2) % 3
            lever_m, lever_n = pose[m, 3] - frame[m, 3], pose[n, 3] - frame[n, 3]
            moves = frame[j, 2] if chain.slides[k] else frame[m, 2] * lever_n - frame[n, 2] * lever_m
            for i in range(3):
                jacobian[i, column] += pose[j, i] * moves
                if not chain.slides[k]:
                    jacobian[3 + i, column] += pose[j, i] * frame[j, 2]
    return pose, jacobian


@compiled
def _error(pose: FloatArray, target: FloatArray) -> FloatArray:
    """The motion (6,) from a pose (4, 4) to the target (4, 4) in the pose's frame: log(pose^-1 target)."""
    turn = _product(pose[:3, :3].T, target[:3, :3])
    shift = _product(pose[:3, :3].T, target[:3, 3:] - pose[:3, 3:])[:, 0]
    # Through the quaternion (w, x, y, z) by its largest component: accurate for small turns and for half turns.
    squares = np.array([
        1.0 + turn[0, 0] + turn[1, 1] + turn[2, 2], 1.0 + turn[0, 0] - turn[1, 1] - turn[2, 2],
        1.0 - turn[0, 0] + turn[1, 1] - turn[2, 2], 1.0 - turn[0, 0] - turn[1, 1] + turn[2, 2],
    ])  # fmt: skip
    q = np.empty(4)
    largest = int(np.argmax(squares))
    q[largest] = 0.5 * np.sqrt(squares[largest])
    gain = 0.25 / q[largest]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        if largest == 0:
            q[1 + i] = gain * (turn[k, j] - turn[j, k])
        elif largest == 1 + i:
            q[0] = gain * (turn[k, j] - turn[j, k])
            q[1 + j], q[1 + k] = gain * (turn[j, i] + turn[i, j]), gain * (turn[k, i] + turn[i, k])
    if q[0] < 0.0:
        q = -q
    sine = np.sqrt(q[1] ** 2 + q[2] ** 2 + q[3] ** 2)
    angle = 2.0 * np.arctan2(sine, q[0])
    spin = q[1:] * (2.0 if sine < 1e-12 else angle / sine)
    if angle < 1e-4:
        share = 1.0 / 12.0 + angle * angle / 720.0
    else:
        share = (1.0 - 0.5 * angle * q[0] / sine) / (angle * angle)
    across = np.cross(spin, shift)
    return np.concatenate((shift - 0.5 * across + share * np.cross(spin, across), spin))


@compiled
def _margin(chain: Chain, joints: FloatArray) -> float:
    """Smallest distance to a joint limit, radians; negative outside."""
    return float(min((joints - chain.low).min(), (chain.high - joints).min()))


@compiled
def _from_limits(chain: Chain, joints: FloatArray, jacobian: FloatArray) -> FloatArray:
    """A motion (dof,) of a redundant arm away from near limits that keeps the tool where it is; else zeros."""
    push = np.zeros(len(joints))
    if len(joints) <= 6 or _margin(chain, joints) > 2 * COMFORT:
        return push
    push += np.maximum(0.0, 2 * COMFORT - (joints - chain.low))
    push -= np.maximum(0.0, 2 * COMFORT - (chain.high - joints))
    gram = _product(jacobian, jacobian.T)
    if np.linalg.det(gram) < 1e-12:  # the Jacobian's null space is ill-conditioned near a singularity
        return np.zeros(len(joints))
    rates = np.linalg.solve(gram, _product(jacobian, push.reshape((-1, 1))))
    return push - _product(jacobian.T, rates)[:, 0]


@compiled
def descend(
    chain: Chain, start: FloatArray, target: FloatArray, iterations: int, away: float
) -> tuple[bool, FloatArray]:
    """Whether the tool gets from joints ``start`` (dof,) to the pose ``target`` (4, 4), and the final joints (dof,).

    Damped least squares with damping in proportion to the squared error (Sugihara 2011), clipped to the limits. A
    redundant arm also moves away from near limits in each step, with the gain ``away``.
    """
    joints = np.minimum(np.maximum(start, chain.low), chain.high)
    best, stalled = np.inf, 0
    for left in range(iterations, -1, -1):
        pose, jacobian = _tool(chain, joints)
        error = _error(pose, target)
        squared = (error**2).sum()
        if squared < 1e-11:
            return True, joints
        stalled = 0 if squared < 0.9 * best else stalled + 1
        best = min(best, squared)
        if stalled > 6 or left == 0:
            break
        normal = _product(jacobian.T, jacobian)
        for k in range(len(joints)):
            normal[k, k] += 1e-2 * squared + 1e-9
        step = np.linalg.solve(normal, _product(jacobian.T, error.reshape((6, 1))))[:, 0]
        if away > 0.0:
            step += away * _from_limits(chain, joints, jacobian)
        joints = joints + min(1.0, 0.6 / max(np.abs(step).max(), 1e-12)) * step
        joints = np.minimum(np.maximum(joints, chain.low), chain.high)
    shift, turn = np.sqrt((error[:3] ** 2).sum()), np.sqrt((error[3:] ** 2).sum())
    return shift < 0.2 * POSITION_TOLERANCE and turn < 0.2 * ROTATION_TOLERANCE, joints


@compiled
def settle(chain: Chain, start: FloatArray, target: FloatArray) -> tuple[bool, FloatArray, float, float]:
    """:func:`descend` with more steps; then, for a redundant arm, the same tool pose farther from the limits.

    Returns whether it was reached, and joints (dof,) with their distance to the nearest limit and Yoshikawa's
    manipulability sqrt(det(J J^T)).
    """
    reached, best = descend(chain, start, target, 40, 0.0)
    margin = _margin(chain, best)
    for _ in range(10):
        if not reached or len(best) <= 6 or margin >= COMFORT:
            break
        jacobian = _tool(chain, best)[1]
        settled, joints = descend(chain, best + 0.5 * _from_limits(chain, best, jacobian), target, 6, 0.0)
        if not settled or _margin(chain, joints) < margin + 1e-3:
            break
        best, margin = joints, _margin(chain, joints)
    jacobian = _tool(chain, best)[1]
    return reached, best, margin, np.sqrt(max(0.0, np.linalg.det(_product(jacobian, jacobian.T))))


class InverseKinematics:
    """Finds joints for tool poses.

    The starts are ``near``, ``home``, and the members of a seeded library of configurations whose tool poses are
    nearest to the target: results are reproducible.
    """

    def __init__(self, kinematics: Kinematics, home: FloatArray) -> None:
        self._kinematics, self._home, self._chain = kinematics, home, chain_of(kinematics)
        low, high = kinematics.low, kinematics.high
        rng = np.random.default_rng(20240229)
        spread = 0.05 * (high - low)
        self._library = rng.uniform(low + spread, high - spread, (_LIBRARY, kinematics.dof))
        poses = np.array([kinematics.forward(row) for row in self._library])  # (L, 4, 4)
        self._positions, self._rotations = poses[:, :3, 3], poses[:, :3, :3]
        jacobians = (_tool(self._chain, row)[1] for row in self._library[:_SAMPLED])
        self._best = max(np.sqrt(max(0.0, np.linalg.det(j @ j.T))) for j in jacobians)

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
        pin, begin = library("pinocchio"), self._kinematics.forward(start)
        shift = target[:3, 3] - begin[:3, 3]
        turn = pin.log3(target[:3, :3] @ begin[:3, :3].T)
        steps = max(np.linalg.norm(shift) / step, np.linalg.norm(turn) / _TURN_STEP)
        count = max(1, int(np.ceil(steps - 1e-9)))
        path = [np.clip(start, self._chain.low, self._chain.high)]
        at, size = 0.0, 1.0 / count
        while at < 1.0 - 1e-9:
            to = min(1.0, at + size)
            pose = rigid(pin.exp3(to * turn) @ begin[:3, :3], begin[:3, 3] + to * shift)
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
        yield from self._library[np.argsort(distance, kind="stable")[:_RESTARTS]]


def _cost(solution: IKSolution, near: FloatArray) -> float:
    """Distance from ``near`` in radians; closeness to a limit or a singularity adds to it."""
    to_limit, to_singularity = 0.1 - solution.limit_margin, 0.02 - solution.manipulability
    distance = float(np.linalg.norm(solution.joints - near))
    return distance + 10.0 * max(0.0, to_limit) + 20.0 * max(0.0, to_singularity)
