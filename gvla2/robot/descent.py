"""Inverse kinematics' inner loop, compiled: the chain of joints that carries the tool, and descents along it.

A plan asks for hundreds of tool poses, each of which takes dozens of steps of a few small matrices: in Python the
calls cost thirty times what the arithmetic does.
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
"""A pose counts as reached within this many metres and radians; steps go on well below."""

COMFORT = 0.15
"""Distance to a joint limit, radians, under which a solution is pushed away from it where the arm has spare joints."""


def _compiled(function: F) -> F:
    """Compiled on the first call, kept on disk. Sums keep their order: the same question gets the same answer."""
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
def _tool(chain: Chain, joints: FloatArray, pose: FloatArray, jacobian: FloatArray) -> None:
    """Writes world_from_tool (4, 4) and its Jacobian (6, dof) in the tool frame, metres before radians."""
    count = len(chain.column)
    turn, place = np.eye(3), np.zeros(3)
    spins, slides, hinges = np.empty((count, 3)), np.empty((count, 3)), np.empty((count, 3))
    for k in range(count):
        value = joints[chain.column[k]]
        for i in range(3):
            place[i] += turn[i] @ chain.places[k]
        turn = turn @ chain.turns[k]
        spin, slide = chain.spin[k], chain.slide[k]
        for i in range(3):
            spins[k, i], slides[k, i] = turn[i] @ spin, turn[i] @ slide
        place += value * slides[k]
        hinges[k] = place
        # Rodrigues' formula; an axis of length 0 turns nothing.
        own = np.empty((3, 3))
        c, s = np.cos(value), np.sin(value)
        squared = spin @ spin
        for i in range(3):
            for j in range(3):
                own[i, j] = (1.0 - c) * spin[i] * spin[j] + ((c if squared > 0.5 else 1.0) if i == j else 0.0)
        own[0, 1] -= s * spin[2]
        own[1, 0] += s * spin[2]
        own[0, 2] += s * spin[1]
        own[2, 0] -= s * spin[1]
        own[1, 2] -= s * spin[0]
        own[2, 1] += s * spin[0]
        turn = turn @ own
    for i in range(3):
        place[i] += turn[i] @ chain.tool_place
    turn = turn @ chain.tool_turn
    pose[:3, :3], pose[:3, 3], pose[3] = turn, place, np.array([0.0, 0.0, 0.0, 1.0])
    jacobian[:] = 0.0
    back = np.ascontiguousarray(turn.T)
    for k in range(count):
        column = chain.column[k]
        jacobian[:3, column] = back @ (slides[k] + np.cross(spins[k], place - hinges[k]))
        jacobian[3:, column] = back @ spins[k]


@_compiled
def _error(pose: FloatArray, target: FloatArray) -> FloatArray:
    """(6,) the motion from a pose (4, 4) to the target (4, 4) as a twist in the pose's frame: log of their quotient."""
    back = np.ascontiguousarray(pose[:3, :3].T)
    turn = back @ np.ascontiguousarray(target[:3, :3])
    shift = back @ (target[:3, 3] - pose[:3, 3])
    # By the quaternion, which tells small turns and half turns alike; its largest part comes first.
    diagonal = np.array([turn[0, 0], turn[1, 1], turn[2, 2]])
    trace = diagonal.sum()
    vector, real = np.empty(3), 0.0
    if trace > diagonal.max():
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
    sine = np.sqrt(vector @ vector)
    angle = 2.0 * np.arctan2(sine, real)
    rotation = vector * (2.0 if sine < 1e-12 else angle / sine)
    if angle < 1e-4:
        share = 1.0 / 12.0 + angle * angle / 720.0
    else:
        share = (1.0 - 0.5 * angle * real / sine) / (angle * angle)
    across = np.cross(rotation, shift)
    twist = np.empty(6)
    twist[:3] = shift - 0.5 * across + share * np.cross(rotation, across)
    twist[3:] = rotation
    return twist


@_compiled
def _margin(chain: Chain, joints: FloatArray) -> float:
    """Smallest distance to a joint limit; negative outside."""
    return float(np.minimum(joints - chain.low, chain.high - joints).min())


@_compiled
def _away(chain: Chain, joints: FloatArray, jacobian: FloatArray, gain: float) -> FloatArray:
    """A small motion (dof,) away from near limits that leaves the tool where it is: spare joints only."""
    if len(joints) <= 6 or _margin(chain, joints) > 2 * COMFORT:
        return np.zeros(len(joints))
    push = np.maximum(0.0, 2 * COMFORT - (joints - chain.low))
    push -= np.maximum(0.0, 2 * COMFORT - (chain.high - joints))
    toward = np.linalg.lstsq(jacobian, jacobian @ push, 1e-4)[0]
    return gain * (push - toward)


@_compiled
def descend(
    chain: Chain, start: FloatArray, target: FloatArray, iterations: int, spare: bool
) -> tuple[bool, FloatArray]:
    """Whether the tool gets from joints ``start`` (dof,) to the pose ``target`` (4, 4), and the joints (dof,) where.

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
        squared = error @ error
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
        step = np.linalg.solve(normal, across @ error)
        if spare:
            step += _away(chain, joints, jacobian, 0.2)
        largest = np.abs(step).max()
        joints = joints + step * min(1.0, 0.6 / max(largest, 1e-12))
        joints = np.minimum(np.maximum(joints, chain.low), chain.high)
    _tool(chain, joints, pose, jacobian)
    error = _error(pose, target)
    reached = np.sqrt(error[:3] @ error[:3]) < 0.2 * POSITION_TOLERANCE
    return reached and np.sqrt(error[3:] @ error[3:]) < 0.2 * ROTATION_TOLERANCE, joints


@_compiled
def settle(
    chain: Chain, start: FloatArray, target: FloatArray
) -> tuple[bool, FloatArray, float, float, float, float]:
    """:func:`descend` with patience; then, where joints are to spare, the same tool pose farther from the limits.

    Whether it was reached, and joints (dof,); of those the distance to the nearest limit, Yoshikawa's manipulability
    sqrt(det(J J^T)), and what they miss the pose by, metres and radians.
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
    volume = np.linalg.det(jacobian @ np.ascontiguousarray(jacobian.T))
    misses = np.sqrt(error[:3] @ error[:3]), np.sqrt(error[3:] @ error[3:])
    return reached, best, margin, np.sqrt(max(0.0, volume)), misses[0], misses[1]
