"""The compiled inner loop of inverse kinematics: the chain of joints up to the tool, and descents along it.

A plan needs joints for hundreds of tool poses, and each takes dozens of steps on a few small matrices: from Python,
with pinocchio's Jacobians, a solution takes five times as long and a plan twice. Loops are written out because array
expressions (slices, sums, matrix products) take most of numba's compile time and allocate in every step.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gvla2.geometry.compiled import compiled
from gvla2.geometry.transform import FloatArray

POSITION_TOLERANCE, ROTATION_TOLERANCE = 5e-4, 5e-3
"""A pose counts as reached within this many metres and radians; steps continue well below."""

COMFORT = 0.15
"""Distance to a joint limit, radians, under which the solution of a redundant arm is pushed away from it."""


class Chain(NamedTuple):
    """The N joints from the base to the tool, in this order, and the limits of all of the arm's joints.

    Joint k moves ``column[k]`` of the joints (dof,): placed at ``turns[k]`` (3, 3) and ``places[k]`` (3,) on the one
    before, it turns about ``spin[k]`` (3,) and shifts along ``slide[k]`` (3,), both in its own frame. ``tool_turn``
    (3, 3) and ``tool_place`` (3,) are the tool's on the last. ``low`` and ``high`` are (dof,), radians or metres.
    """

    column: NDArray[np.int64]
    turns: FloatArray
    places: FloatArray
    spin: FloatArray
    slide: FloatArray
    tool_turn: FloatArray
    tool_place: FloatArray
    low: FloatArray
    high: FloatArray


def chain_of(model: Any, tool: int, low: FloatArray, high: FloatArray) -> Chain:
    """The chain to frame number ``tool`` of a pinocchio model whose joints have one axis each."""
    frame = model.frames[tool]
    joints = [j for j in model.supports[frame.parentJoint] if j > 0]
    placements = [model.jointPlacements[j].homogeneous for j in joints]
    axes = []
    for j in joints:
        data = model.joints[j].createData()
        model.joints[j].calc(data, np.zeros(model.nq), np.zeros(model.nv))
        axes.append(np.asarray(data.S).reshape(6))
    end = frame.placement.homogeneous

    def stacked(rows: list[Any], *shape: int) -> FloatArray:
        return np.ascontiguousarray(np.array(rows, dtype=np.float64).reshape(len(joints), *shape))

    return Chain(
        np.array([model.joints[j].idx_v for j in joints], dtype=np.int64),
        stacked([p[:3, :3] for p in placements], 3, 3),
        stacked([p[:3, 3] for p in placements], 3),
        stacked([a[3:] for a in axes], 3),
        stacked([a[:3] for a in axes], 3),
        np.ascontiguousarray(end[:3, :3]),
        np.ascontiguousarray(end[:3, 3]),
        np.ascontiguousarray(low, dtype=np.float64),
        np.ascontiguousarray(high, dtype=np.float64),
    )


@compiled
def _times(one: FloatArray, other: FloatArray, product: FloatArray) -> None:
    """Writes the product of two matrices (3, 3)."""
    for i in range(3):
        for j in range(3):
            product[i, j] = one[i, 0] * other[0, j] + one[i, 1] * other[1, j] + one[i, 2] * other[2, j]


@compiled
def _apply(turn: FloatArray, vector: FloatArray, product: FloatArray) -> None:
    """Writes a matrix (3, 3) times a vector (3,)."""
    for i in range(3):
        product[i] = turn[i, 0] * vector[0] + turn[i, 1] * vector[1] + turn[i, 2] * vector[2]


@compiled
def _add(vector: FloatArray, other: FloatArray, share: float) -> None:
    """Adds ``share`` of ``other`` (n,) to a vector (n,)."""
    for i in range(len(vector)):
        vector[i] += share * other[i]


@compiled
def _length(vector: FloatArray, first: int, last: int) -> float:
    """The norm of the entries ``first`` to ``last`` - 1 of a vector (n,)."""
    total = 0.0
    for i in range(first, last):
        total += vector[i] * vector[i]
    return float(np.sqrt(total))


@compiled
def _about(spin: FloatArray, value: float, turn: FloatArray) -> None:
    """Writes the rotation (3, 3) by ``value`` radians about a unit axis (3,); the identity for a zero axis."""
    c, s = np.cos(value), np.sin(value)
    if _length(spin, 0, 3) < 0.5:
        c, s = 1.0, 0.0
    for i in range(3):
        for j in range(3):
            turn[i, j] = (1.0 - c) * spin[i] * spin[j]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        turn[i, i] += c
        turn[k, j] += s * spin[i]
        turn[j, k] -= s * spin[i]


@compiled
def _tool(chain: Chain, joints: FloatArray, pose: FloatArray, jacobian: FloatArray) -> None:
    """Writes world_from_tool (4, 4) and its Jacobian (6, dof) in the tool frame, metres before radians."""
    count = len(chain.column)
    turn, other, about = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    spins, slides, hinges = np.empty((count, 3)), np.empty((count, 3)), np.empty((count, 3))
    place, shift = np.zeros(3), np.empty(3)
    for i in range(3):
        for j in range(3):
            turn[i, j] = 1.0 if i == j else 0.0
    for k in range(count):
        value = joints[chain.column[k]]
        _apply(turn, chain.places[k], shift)
        _add(place, shift, 1.0)
        _times(turn, chain.turns[k], other)
        _apply(other, chain.spin[k], spins[k])
        _apply(other, chain.slide[k], slides[k])
        _add(place, slides[k], value)
        for i in range(3):
            hinges[k, i] = place[i]
        _about(chain.spin[k], value, about)
        _times(other, about, turn)
    _apply(turn, chain.tool_place, shift)
    _add(place, shift, 1.0)
    _times(turn, chain.tool_turn, other)
    for i in range(3):
        for j in range(3):
            pose[i, j] = other[i, j]
        pose[i, 3], pose[3, i] = place[i], 0.0
    pose[3, 3] = 1.0
    for i in range(6):
        for k in range(len(joints)):
            jacobian[i, k] = 0.0
    for k in range(count):
        column = chain.column[k]
        for j in range(3):
            m, n = (j + 1) % 3, (j + 2) % 3
            lever_m, lever_n = place[m] - hinges[k, m], place[n] - hinges[k, n]
            moves = slides[k, j] + (spins[k, m] * lever_n - spins[k, n] * lever_m)
            for i in range(3):
                jacobian[i, column] += other[j, i] * moves
                jacobian[3 + i, column] += other[j, i] * spins[k, j]


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
    pose, jacobian, error = np.empty((4, 4)), np.empty((6, dof)), np.empty(6)
    best, stalled = np.inf, 0
    for left in range(iterations, -1, -1):
        _tool(chain, joints, pose, jacobian)
        _error(pose, target, error)
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
        _add(joints, step, min(1.0, 0.6 / largest))
        for k in range(dof):
            joints[k] = min(max(joints[k], chain.low[k]), chain.high[k])
    shift, turn = _length(error, 0, 3), _length(error, 3, 6)
    return shift < 0.2 * POSITION_TOLERANCE and turn < 0.2 * ROTATION_TOLERANCE, joints


@compiled
def settle(chain: Chain, start: FloatArray, target: FloatArray) -> tuple[bool, FloatArray, float, float]:
    """:func:`descend` with more steps; then, for a redundant arm, the same tool pose farther from the limits.

    Returns whether it was reached, and joints (dof,) with their distance to the nearest limit and Yoshikawa's
    manipulability sqrt(det(J J^T)).
    """
    pose, jacobian = np.empty((4, 4)), np.empty((6, len(start)))
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
        _tool(chain, best, pose, jacobian)
        start = best.copy()
        _go_away(chain, best, jacobian, 0.5, start)
    _tool(chain, best, pose, jacobian)
    gram, volume = _gram(jacobian), 1.0
    if _solve(gram, np.zeros(6)) == 0.0:
        volume = 0.0
    for i in range(6):
        volume *= gram[i, i]  # the factor's diagonal
    return reached, best, margin, volume
