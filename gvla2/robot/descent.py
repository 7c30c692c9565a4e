"""Inverse kinematics' compiled inner loop: the chain of joints that carries the tool, and descents along it.

A plan needs hundreds of tool poses, each with dozens of steps of a few small matrices: in Python the calls cost thirty
times the arithmetic.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar, cast

import numba
import numpy as np
from numpy.typing import NDArray

from gvla2.geometry.transform import FloatArray

F = TypeVar("F", bound=Callable[..., Any])

POSITION_TOLERANCE, ROTATION_TOLERANCE = 5e-4, 5e-3
"""A pose counts as reached within this many metres and radians; steps continue well below."""

COMFORT = 0.15
"""Distance to a joint limit, radians, under which a solution is pushed away from it if the arm has spare joints."""


def _compiled(function: F) -> F:
    """Compiled on the first call, kept on disk. Sums keep their order, so results are reproducible."""
    return cast(F, numba.njit(cache=True, nogil=True)(function))


class Chain(NamedTuple):
    """The N joints from the world to the tool, first the one at the base, and the limits of all of the arm's.

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


@_compiled
def _times(one: FloatArray, other: FloatArray) -> FloatArray:
    """Product of two (3, 3): a call of BLAS costs more than this."""
    product = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            product[i, j] = one[i, 0] * other[0, j] + one[i, 1] * other[1, j] + one[i, 2] * other[2, j]
    return product


@_compiled
def _apply(turn: FloatArray, vector: FloatArray) -> FloatArray:
    """(3, 3) times (3,)."""
    product = np.empty(3)
    for i in range(3):
        product[i] = turn[i, 0] * vector[0] + turn[i, 1] * vector[1] + turn[i, 2] * vector[2]
    return product


@_compiled
def _dot(one: FloatArray, other: FloatArray) -> float:
    """Sum of the products of two (n,)."""
    total = 0.0
    for k in range(len(one)):
        total += one[k] * other[k]
    return total


@_compiled
def _put(values: FloatArray, into: FloatArray) -> None:
    """Copies (n,) into (n,): assigning a slice brings in error texts, which take seconds to compile."""
    for k in range(len(values)):
        into[k] = values[k]


@_compiled
def _across(a: FloatArray, b: FloatArray) -> FloatArray:
    """Cross product of two (3,)."""
    product = np.empty(3)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        product[i] = a[j] * b[k] - a[k] * b[j]
    return product


@_compiled
def _about(spin: FloatArray, value: float) -> FloatArray:
    """(3, 3) the turn by ``value`` radians about a unit axis (3,); an axis of length 0 turns nothing."""
    c, s = np.cos(value), np.sin(value)
    if _dot(spin, spin) < 0.5:
        c, s = 1.0, 0.0
    turn = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            turn[i, j] = (1.0 - c) * spin[i] * spin[j]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        turn[i, i] += c
        turn[k, j] += s * spin[i]
        turn[j, k] -= s * spin[i]
    return turn


@_compiled
def _tool(chain: Chain, joints: FloatArray, pose: FloatArray, jacobian: FloatArray) -> None:
    """Writes world_from_tool (4, 4) and its Jacobian (6, dof) in the tool frame, metres before radians."""
    count = len(chain.column)
    turn, place = np.zeros((3, 3)), np.zeros(3)
    for i in range(3):
        turn[i, i] = 1.0
    spins, slides, hinges = np.empty((count, 3)), np.empty((count, 3)), np.empty((count, 3))
    for k in range(count):
        value = joints[chain.column[k]]
        place = place + _apply(turn, chain.places[k])
        turn = _times(turn, chain.turns[k])
        _put(_apply(turn, chain.spin[k]), spins[k])
        _put(_apply(turn, chain.slide[k]), slides[k])
        place = place + value * slides[k]
        _put(place, hinges[k])
        turn = _times(turn, _about(chain.spin[k], value))
    place = place + _apply(turn, chain.tool_place)
    turn = _times(turn, chain.tool_turn)
    for i in range(3):
        _put(turn[i], pose[i, :3])
        pose[i, 3], pose[3, i] = place[i], 0.0
    pose[3, 3] = 1.0
    jacobian.fill(0.0)
    for k in range(count):
        moves = slides[k] + _across(spins[k], place - hinges[k])
        column = chain.column[k]
        for i in range(3):
            for j in range(3):
                jacobian[i, column] += turn[j, i] * moves[j]
                jacobian[3 + i, column] += turn[j, i] * spins[k, j]


@_compiled
def _solved(matrix: FloatArray, vector: FloatArray) -> tuple[FloatArray, float]:
    """X (n,) of A x = b for a symmetric positive (n, n), which is overwritten, and the least pivot over the largest
    diagonal entry: 0 if there is no such x.
    """
    size, largest, least = len(vector), 0.0, np.inf
    for k in range(size):
        largest = max(largest, matrix[k, k])
    found = vector.copy()
    for j in range(size):
        pivot = matrix[j, j]
        for k in range(j):
            pivot -= matrix[j, k] * matrix[j, k]
        least = min(least, pivot)
        if not pivot > 0.0:
            return found, 0.0
        root = np.sqrt(pivot)
        matrix[j, j] = root
        for i in range(j + 1, size):
            value = matrix[i, j]
            for k in range(j):
                value -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = value / root
        for k in range(j):
            found[j] -= matrix[j, k] * found[k]
        found[j] /= root
    for j in range(size - 1, -1, -1):
        for k in range(j + 1, size):
            found[j] -= matrix[k, j] * found[k]
        found[j] /= matrix[j, j]
    return found, least / largest


@_compiled
def _error(pose: FloatArray, target: FloatArray) -> FloatArray:
    """(6,) the motion from a pose (4, 4) to the target (4, 4) as a twist in the pose's frame: log of their quotient."""
    back = pose[:3, :3].T
    turn = _times(back, target[:3, :3])
    shift = _apply(back, target[:3, 3] - pose[:3, 3])
    # By the quaternion, which tells small turns and half turns alike; its largest part comes first.
    diagonal = np.empty(3)
    for n in range(3):
        diagonal[n] = turn[n, n]
    trace = diagonal[0] + diagonal[1] + diagonal[2]
    vector, real = np.empty(3), 0.0
    if trace > max(diagonal[0], diagonal[1], diagonal[2]):
        real = 0.5 * np.sqrt(1.0 + trace)
        vector[0] = (turn[2, 1] - turn[1, 2]) / (4.0 * real)
        vector[1] = (turn[0, 2] - turn[2, 0]) / (4.0 * real)
        vector[2] = (turn[1, 0] - turn[0, 1]) / (4.0 * real)
    else:
        i = int(np.argmax(diagonal))
        j, k = (i + 1) % 3, (i + 2) % 3
        vector[i] = 0.5 * np.sqrt(max(0.0, 1.0 + diagonal[i] - diagonal[j] - diagonal[k]))
        vector[j] = (turn[j, i] + turn[i, j]) / (4.0 * vector[i])
        vector[k] = (turn[k, i] + turn[i, k]) / (4.0 * vector[i])
        real = (turn[k, j] - turn[j, k]) / (4.0 * vector[i])
    if real < 0.0:
        vector, real = -vector, -real
    sine = np.sqrt(_dot(vector, vector))
    angle = 2.0 * np.arctan2(sine, real)
    rotation = vector * (2.0 if sine < 1e-12 else angle / sine)
    if angle < 1e-4:
        share = 1.0 / 12.0 + angle * angle / 720.0
    else:
        share = (1.0 - 0.5 * angle * real / sine) / (angle * angle)
    across = _across(rotation, shift)
    twist = np.empty(6)
    _put(shift - 0.5 * across + share * _across(rotation, across), twist[:3])
    _put(rotation, twist[3:])
    return twist


@_compiled
def _margin(chain: Chain, joints: FloatArray) -> float:
    """Smallest distance to a joint limit; negative outside."""
    least = np.inf
    for k in range(len(joints)):
        least = min(least, joints[k] - chain.low[k], chain.high[k] - joints[k])
    return least


@_compiled
def _away(chain: Chain, joints: FloatArray, jacobian: FloatArray, gain: float) -> FloatArray:
    """A small motion (dof,) away from near limits that leaves the tool where it is: spare joints only."""
    if len(joints) <= 6 or _margin(chain, joints) > 2 * COMFORT:
        return np.zeros(len(joints))
    push = np.maximum(0.0, 2 * COMFORT - (joints - chain.low))
    push -= np.maximum(0.0, 2 * COMFORT - (chain.high - joints))
    # The part of the push that moves the tool: its share in the Jacobian's rows. If those are nearly dependent it is
    # inexact.
    across = np.ascontiguousarray(jacobian.T)
    rates, sound = _solved(jacobian @ across, jacobian @ push)
    return gain * (push - across @ rates) if sound > 1e-6 else np.zeros(len(joints))


@_compiled
def descend(
    chain: Chain, start: FloatArray, target: FloatArray, iterations: int, spare: bool
) -> tuple[bool, FloatArray]:
    """Whether the tool gets from joints ``start`` (dof,) to the pose ``target`` (4, 4), and the final joints (dof,).

    Damped least squares, damping falling with the squared error (Sugihara 2011), clipped to the limits. With ``spare``
    each step also goes away from near limits.
    """
    dof = len(start)
    joints = np.minimum(np.maximum(start, chain.low), chain.high)
    pose, jacobian = np.empty((4, 4)), np.empty((6, dof))
    best, stalled = np.inf, 0
    for _ in range(iterations):
        _tool(chain, joints, pose, jacobian)
        error = _error(pose, target)
        squared = _dot(error, error)
        if squared < 1e-11:
            return True, joints
        stalled = 0 if squared < 0.9 * best else stalled + 1
        best = min(best, squared)
        if stalled > 6:
            break
        across = np.ascontiguousarray(jacobian.T)
        normal = across @ jacobian
        for k in range(dof):
            normal[k, k] += 1e-2 * squared + 1e-9
        step, _ = _solved(normal, across @ error)
        if spare:
            step += _away(chain, joints, jacobian, 0.2)
        largest = np.abs(step).max()
        joints = joints + step * min(1.0, 0.6 / max(largest, 1e-12))
        joints = np.minimum(np.maximum(joints, chain.low), chain.high)
    _tool(chain, joints, pose, jacobian)
    error = _error(pose, target)
    shift, turn = np.sqrt(_dot(error[:3], error[:3])), np.sqrt(_dot(error[3:], error[3:]))
    return shift < 0.2 * POSITION_TOLERANCE and turn < 0.2 * ROTATION_TOLERANCE, joints


@_compiled
def settle(
    chain: Chain, start: FloatArray, target: FloatArray
) -> tuple[bool, FloatArray, float, float, float, float]:
    """:func:`descend` with more steps; then, with spare joints, the same tool pose farther from the limits.

    Returns whether it was reached, and joints (dof,) with their distance to the nearest limit, Yoshikawa's
    manipulability sqrt(det(J J^T)), and their pose error, metres and radians.
    """
    reached, joints = descend(chain, start, target, 40, False)
    margin = _margin(chain, joints)
    best = joints
    pose, jacobian = np.empty((4, 4)), np.empty((6, len(joints)))
    if reached and margin < COMFORT and len(joints) > 6:
        for _ in range(10):
            _tool(chain, best, pose, jacobian)
            settled, joints = descend(chain, best + _away(chain, best, jacobian, 0.5), target, 6, False)
            if not settled or _margin(chain, joints) < margin + 1e-3:
                break
            best, margin = joints, _margin(chain, joints)
    _tool(chain, best, pose, jacobian)
    error = _error(pose, target)
    volume = float(np.linalg.det(jacobian @ np.ascontiguousarray(jacobian.T)))
    shift, turn = np.sqrt(_dot(error[:3], error[:3])), np.sqrt(_dot(error[3:], error[3:]))
    return reached, best, margin, float(np.sqrt(max(0.0, volume))), shift, turn
