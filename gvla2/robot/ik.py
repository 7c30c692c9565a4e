"""Inverse kinematics: damped least squares in the tool frame, from deterministic starts; straight tool moves.

A plan needs joints for hundreds of tool poses, each in dozens of steps on small matrices: the steps are compiled, which
makes a plan twice as fast as pinocchio's Jacobians from Python. Loops are written out because array expressions
(slices, sums, linear algebra) multiply numba's compile time and allocate in every step.
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
    """The product of two matrices (4, 4)."""
    product = np.zeros((4, 4))
    for i in range(4):
        for k in range(4):
            for j in range(4):
                product[i, j] += one[i, k] * other[k, j]
    return product


@compiled
def _tool(chain: Chain, joints: FloatArray, jacobian: FloatArray) -> FloatArray:
    """world_from_tool (4, 4); writes its Jacobian (6, dof) in the tool frame, metres before radians."""
    count = len(chain.column)
    axes, hinges, pose = np.empty((count, 3)), np.empty((count, 3)), np.eye(4)
    for k in range(count):
        pose = _product(pose, chain.placements[k])
        value = joints[chain.column[k]]
        c, s = np.cos(value), np.sin(value)
        for i in range(3):
            axes[k, i] = pose[i, 2]
            if chain.slides[k]:
                pose[i, 3] += value * pose[i, 2]
            else:
                x, y = pose[i, 0], pose[i, 1]
                pose[i, 0], pose[i, 1] = c * x + s * y, c * y - s * x
            hinges[k, i] = pose[i, 3]
    pose = _product(pose, chain.placements[count])
    for i in range(6):
        for k in range(len(joints)):
            jacobian[i, k] = 0.0
    for k in range(count):
        column = chain.column[k]
        for j in range(3):
            m, n = (j + 1) % 3, (j + 2) % 3
            spin, moves = axes[k, j], axes[k, m] * (pose[n, 3] - hinges[k, n])
            moves -= axes[k, n] * (pose[m, 3] - hinges[k, m])
            if chain.slides[k]:
                spin, moves = 0.0, axes[k, j]
            for i in range(3):
                jacobian[i, column] += pose[j, i] * moves
                jacobian[3 + i, column] += pose[j, i] * spin
    return pose


@compiled
def _length(vector: FloatArray, first: int, last: int) -> float:
    """The norm of the entries ``first`` to ``last`` - 1 of a vector (n,)."""
    total = 0.0
    for i in range(first, last):
        total += vector[i] * vector[i]
    return float(np.sqrt(total))


@compiled
def _solve(matrix: FloatArray, vector: FloatArray) -> float:
    """Solves A x = b in place for a symmetric A (n, n): b (n,) becomes x, and A its Cholesky factor.

    Returns the least pivot over the largest diagonal entry; 0 if A is not positive definite.
    """
    size, largest, least = len(vector), 0.0, np.inf
    for k in range(size):
        largest = max(largest, matrix[k, k])
    for j in range(size):
        pivot = matrix[j, j]
        for k in range(j):
            pivot -= matrix[j, k] * matrix[j, k]
        least = min(least, pivot)
        if not pivot > 0.0:
            return 0.0
        root = np.sqrt(pivot)
        matrix[j, j] = root
        for i in range(j + 1, size):
            value = matrix[i, j]
            for k in range(j):
                value -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = value / root
        for k in range(j):
            vector[j] -= matrix[j, k] * vector[k]
        vector[j] /= root
    for j in range(size - 1, -1, -1):
        for k in range(j + 1, size):
            vector[j] -= matrix[k, j] * vector[k]
        vector[j] /= matrix[j, j]
    return float(least / largest)


@compiled
def _error(pose: FloatArray, target: FloatArray, twist: FloatArray) -> None:
    """Writes the motion (6,) from a pose (4, 4) to the target (4, 4) in the pose's frame: log(pose^-1 target)."""
    turn, shift, vector = np.zeros((3, 3)), np.zeros(3), np.empty(3)
    for i in range(3):
        for k in range(3):
            for j in range(3):
                turn[i, j] += pose[k, i] * target[k, j]
            shift[i] += pose[k, i] * (target[k, 3] - pose[k, 3])
    # Through a quaternion: accurate for small turns and for half turns. Its largest component is computed first.
    trace, i = turn[0, 0] + turn[1, 1] + turn[2, 2], 0
    for n in range(1, 3):
        if turn[n, n] > turn[i, i]:
            i = n
    j, k = (i + 1) % 3, (i + 2) % 3
    if trace > turn[i, i]:
        real = 0.5 * np.sqrt(1.0 + trace)
        vector[i] = (turn[k, j] - turn[j, k]) / (4.0 * real)
        vector[j] = (turn[i, k] - turn[k, i]) / (4.0 * real)
        vector[k] = (turn[j, i] - turn[i, j]) / (4.0 * real)
    else:
        vector[i] = 0.5 * np.sqrt(max(0.0, 1.0 + turn[i, i] - turn[j, j] - turn[k, k]))
        vector[j] = (turn[j, i] + turn[i, j]) / (4.0 * vector[i])
        vector[k] = (turn[k, i] + turn[i, k]) / (4.0 * vector[i])
        real = (turn[k, j] - turn[j, k]) / (4.0 * vector[i])
    sign = -1.0 if real < 0.0 else 1.0
    real *= sign
    sine = _length(vector, 0, 3)
    angle = 2.0 * np.arctan2(sine, real)
    gain = sign * (2.0 if sine < 1e-12 else angle / sine)
    if angle < 1e-4:
        share = 1.0 / 12.0 + angle * angle / 720.0
    else:
        share = (1.0 - 0.5 * angle * real / sine) / (angle * angle)
    across = np.empty(3)
    for n in range(3):
        twist[3 + n] = gain * vector[n]
    for n in range(3):
        m, o = (n + 1) % 3, (n + 2) % 3
        across[n] = twist[3 + m] * shift[o] - twist[3 + o] * shift[m]
    for n in range(3):
        m, o = (n + 1) % 3, (n + 2) % 3
        twice = twist[3 + m] * across[o] - twist[3 + o] * across[m]
        twist[n] = shift[n] - 0.5 * across[n] + share * twice


@compiled
def _margin(chain: Chain, joints: FloatArray) -> float:
    """Smallest distance to a joint limit, radians; negative outside."""
    least = np.inf
    for k in range(len(joints)):
        least = min(least, joints[k] - chain.low[k], chain.high[k] - joints[k])
    return least


@compiled
def _gram(jacobian: FloatArray) -> FloatArray:
    """J J^T (6, 6) of a Jacobian."""
    gram = np.zeros((6, 6))
    for i in range(6):
        for j in range(6):
            for k in range(jacobian.shape[1]):
                gram[i, j] += jacobian[i, k] * jacobian[j, k]
    return gram


@compiled
def _go_away(chain: Chain, joints: FloatArray, jacobian: FloatArray, gain: float, step: FloatArray) -> None:
    """Adds to ``step`` (dof,) of a redundant arm a motion away from near limits that keeps the tool where it is."""
    dof = len(joints)
    if dof <= 6 or _margin(chain, joints) > 2 * COMFORT:
        return
    push, rates = np.empty(dof), np.zeros(6)
    for k in range(dof):
        push[k] = max(0.0, 2 * COMFORT - (joints[k] - chain.low[k]))
        push[k] -= max(0.0, 2 * COMFORT - (chain.high[k] - joints[k]))
    # The push is projected onto the Jacobian's null space, which is ill-conditioned near a singularity.
    for i in range(6):
        for k in range(dof):
            rates[i] += jacobian[i, k] * push[k]
    if _solve(_gram(jacobian), rates) <= 1e-6:
        return
    for k in range(dof):
        for i in range(6):
            push[k] -= jacobian[i, k] * rates[i]
        step[k] += gain * push[k]


@compiled
def descend(
    chain: Chain, start: FloatArray, target: FloatArray, iterations: int, away: float
) -> tuple[bool, FloatArray]:
    """Whether the tool gets from joints ``start`` (dof,) to the pose ``target`` (4, 4), and the final joints (dof,).

    Damped least squares with damping in proportion to the squared error (Sugihara 2011), clipped to the limits. A
    redundant arm also moves away from near limits in each step, with the gain ``away``.
    """
    dof = len(start)
    joints, step, normal = np.empty(dof), np.empty(dof), np.empty((dof, dof))
    for k in range(dof):
        joints[k] = min(max(start[k], chain.low[k]), chain.high[k])
    jacobian, error = np.empty((6, dof)), np.empty(6)
    best, stalled = np.inf, 0
    for left in range(iterations, -1, -1):
        _error(_tool(chain, joints, jacobian), target, error)
        squared = _length(error, 0, 6) ** 2
        if squared < 1e-11:
            return True, joints
        stalled = 0 if squared < 0.9 * best else stalled + 1
        best = min(best, squared)
        if stalled > 6 or left == 0:
            break
        for k in range(dof):
            step[k] = 0.0
            for i in range(6):
                step[k] += jacobian[i, k] * error[i]
            for j in range(dof):
                normal[k, j] = 0.0
                for i in range(6):
                    normal[k, j] += jacobian[i, k] * jacobian[i, j]
            normal[k, k] += 1e-2 * squared + 1e-9
        _solve(normal, step)
        if away > 0.0:
            _go_away(chain, joints, jacobian, away, step)
        largest = 1e-12
        for k in range(dof):
            largest = max(largest, abs(step[k]))
        for k in range(dof):
            moved = joints[k] + min(1.0, 0.6 / largest) * step[k]
            joints[k] = min(max(moved, chain.low[k]), chain.high[k])
    shift, turn = _length(error, 0, 3), _length(error, 3, 6)
    return shift < 0.2 * POSITION_TOLERANCE and turn < 0.2 * ROTATION_TOLERANCE, joints


@compiled
def settle(chain: Chain, start: FloatArray, target: FloatArray) -> tuple[bool, FloatArray, float, float]:
    """:func:`descend` with more steps; then, for a redundant arm, the same tool pose farther from the limits.

    Returns whether it was reached, and joints (dof,) with their distance to the nearest limit and Yoshikawa's
    manipulability sqrt(det(J J^T)).
    """
    jacobian = np.empty((6, len(start)))
    reached, best, margin = False, start, -np.inf
    for k in range(11):
        settled, joints = descend(chain, start, target, 6 if k else 40, 0.0)
        if k == 0:
            reached, best, margin = settled, joints, _margin(chain, joints)
        elif settled and _margin(chain, joints) >= margin + 1e-3:
            best, margin = joints, _margin(chain, joints)
        else:
            break
        if not reached or len(best) <= 6 or (k == 0 and margin >= COMFORT):
            break
        _tool(chain, best, jacobian)
        start = best.copy()
        _go_away(chain, best, jacobian, 0.5, start)
    _tool(chain, best, jacobian)
    gram, volume = _gram(jacobian), 1.0
    if _solve(gram, np.zeros(6)) == 0.0:
        volume = 0.0
    for i in range(6):
        volume *= gram[i, i]  # the factor's diagonal
    return reached, best, margin, volume


class InverseKinematics:
    """Finds joints for tool poses.

    The starts are ``near``, ``home``, and the members of a seeded library of configurations whose tool poses are
    nearest to the target: results are reproducible. ``reach`` is the farthest of these from the base, metres.
    """

    def __init__(self, kinematics: Kinematics, home: FloatArray) -> None:
        self._kinematics, self._home, self._chain = kinematics, home, chain_of(kinematics)
        low, high = kinematics.low, kinematics.high
        rng = np.random.default_rng(20240229)
        spread = 0.05 * (high - low)
        self._library = rng.uniform(low + spread, high - spread, (_LIBRARY, kinematics.dof))
        poses = np.array([kinematics.forward(row) for row in self._library])  # (L, 4, 4)
        self._positions, self._rotations = poses[:, :3, 3], poses[:, :3, :3]
        self.reach = float(np.linalg.norm(self._positions - kinematics.world_from_base[:3, 3], axis=1).max())
        self._best, jacobian = 0.0, np.empty((6, kinematics.dof))
        for row in self._library[:_SAMPLED]:
            _tool(self._chain, row, jacobian)
            volume = np.sqrt(max(0.0, np.linalg.det(jacobian @ jacobian.T)))
            self._best = max(self._best, float(volume))

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

    def line(
        self, start: FloatArray, world_from_tcp: FloatArray, step: float = 0.01
    ) -> list[FloatArray] | None:
        """Joints (dof,) from ``start`` to a tool pose (4, 4): position linear, rotation by slerp.

        Points are at most ``step`` metres apart, closer where a joint swings fast. None when the line leaves the arm's
        reach or its joint limits, or when a joint would have to jump.
        """
        target, start = check_rigid(world_from_tcp, "target pose"), np.asarray(start, dtype=np.float64)
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
