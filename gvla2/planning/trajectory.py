"""The trajectory tau = {(x, y, z, g)} and its full waypoints."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import takewhile
from typing import Any, Literal

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import FloatArray, rigid

MIN_WAYPOINTS, MAX_WAYPOINTS = 2, 20
WaypointFault = Literal[
    "bad_motion", "not_finite", "not_positive", "negative", "bad_guard", "bad_orientation"
]
"""What may be wrong with a waypoint by itself, a stable word."""


@dataclass(frozen=True)
class Orientation:
    """How the hand is turned at a waypoint, as a policy that the previous waypoint resolves.

    * ``hold``: as before.
    * ``grasp``: approach along ``vector`` (3,), fingers closing along ``closing`` (3,); world frame.
    * ``axis``: approach along ``vector``, with the least turn from before.
    """

    policy: Literal["hold", "grasp", "axis"] = "hold"
    vector: tuple[float, float, float] = (0.0, 0.0, -1.0)
    closing: tuple[float, float, float] = (0.0, 1.0, 0.0)

    @property
    def fault(self) -> str:
        """Why it is not a rotation, a sentence; "" if it is."""
        if self.policy not in ("hold", "grasp", "axis"):
            return f"orientation policy '{self.policy}' is unknown; use hold, grasp or axis."
        vector, closing = np.asarray(self.vector, np.float64), np.asarray(self.closing, np.float64)
        if self.policy == "hold":
            return ""
        if vector.shape != (3,) or closing.shape != (3,) or not np.isfinite([vector, closing]).all():
            return "the orientation's vector and closing direction must be three finite numbers each."
        length = float(np.linalg.norm(vector))
        if length < 1e-6:
            return "the orientation's vector has no length."
        if self.policy == "grasp" and np.linalg.norm(np.cross(vector, closing)) < 1e-3 * length:
            return "the orientation's closing direction must not be parallel to its approach."
        return ""

    def resolve(self, before: FloatArray) -> FloatArray:
        """World rotation (3, 3) of the tool frame, given the rotation (3, 3) before."""
        vector = np.asarray(self.vector, dtype=np.float64)
        match self.policy:
            case "hold":
                return before
            case "grasp":
                return grasp_rotation(vector, np.asarray(self.closing, dtype=np.float64))
            case "axis":
                turn, _ = Rotation.align_vectors([vector / np.linalg.norm(vector)], [before[:, 2]])
                return np.asarray(turn.as_matrix() @ before)


def grasp_rotation(approach: FloatArray, closing: FloatArray) -> FloatArray:
    """World rotation (3, 3) of a hand: columns x, y (fingers close along it), z (points out of the hand).

    ``closing`` (3,) is made orthogonal to ``approach`` (3,); both in the world frame.
    """
    z = approach / np.linalg.norm(approach)
    y = closing - z * (closing @ z)
    length = float(np.linalg.norm(y))
    if length < 1e-6:
        raise ValueError("The closing direction is parallel to the approach direction.")
    y = y / length
    x = [y[1] * z[2] - y[2] * z[1], y[2] * z[0] - y[0] * z[2], y[0] * z[1] - y[1] * z[0]]  # y cross z
    return np.array([x, y, z]).T


@dataclass(frozen=True)
class Guard:
    """Ends a motion early with success: it reached the expected contact, a stop, a plate, a bottom.

    ``force`` newtons on the hand and its load, their weight included, as a wrist sensor measures them (the magnitude of
    the sum: the fingers' squeeze cancels out); ``stall`` metres that the tool lags behind its command. 0 disables
    either; one of them must be above 0. A guard never allows a motion more: a robot without sensing completes the
    motion.
    """

    force: float = 0.0
    stall: float = 0.0

    @property
    def sound(self) -> bool:
        """Whether it is valid: finite, none below zero, at least one above."""
        numbers = (self.force, self.stall)
        return bool(np.isfinite(numbers).all()) and min(numbers) >= 0.0 and max(numbers) > 0.0


@dataclass(frozen=True)
class Waypoint:
    """One stop of the tool centre point.

    ``xyz`` in metres, world frame; ``gripper`` opening in [0, 1], reached after arriving; ``speed`` of the tool in
    m/s; ``stage`` names the phase ("approach", "grasp", "lift"); ``motion`` is ``free`` (planned around obstacles) or
    ``linear`` (a straight line of the tool); ``allowed_contacts`` are ids of scene objects, or "table", that the hand
    may touch on the way; ``tolerance`` of position in metres. ``carries`` is the id of the object in the hand on the
    way here, or "". With a ``guard`` the motion also ends, successfully, where the guard stops it; the next move starts
    from there. On arrival the arm waits ``dwell`` seconds.
    """

    xyz: tuple[float, float, float]
    gripper: float
    stage: str
    orientation: Orientation = Orientation()
    motion: Literal["free", "linear"] = "free"
    speed: float = 0.25
    allowed_contacts: frozenset[str] = frozenset()
    carries: str = ""
    tolerance: float = 0.01
    guard: Guard | None = None
    dwell: float = 0.0

    def faults(self) -> Iterator[tuple[WaypointFault, str]]:
        """What is malformed, whatever the scene and the arm: a stable word and a sentence each."""
        if self.motion not in ("free", "linear"):
            yield "bad_motion", f"motion '{self.motion}' is unknown; use 'free' or 'linear'."
        numbers = [*self.xyz, self.gripper, self.speed, self.tolerance, self.dwell]
        if len(self.xyz) != 3 or not np.isfinite(numbers).all():
            yield (
                "not_finite",
                "xyz, gripper, speed, tolerance or dwell is not finite, or xyz are not three numbers.",
            )
        elif self.speed <= 0 or self.tolerance <= 0:
            yield "not_positive", f"speed {self.speed:g} and tolerance {self.tolerance:g} must be above 0."
        elif self.dwell < 0:
            yield "negative", f"a dwell of {self.dwell:g} s; give 0 s or more."
        if self.guard is not None and not self.guard.sound:
            yield (
                "bad_guard",
                f"the guard is {self.guard}: finite numbers, none below and one above zero, are needed.",
            )
        if fault := self.orientation.fault:
            yield "bad_orientation", fault


@dataclass(frozen=True)
class Trajectory:
    """An ordered path of waypoints, starting from the hand's present pose."""

    waypoints: tuple[Waypoint, ...]

    def __iter__(self) -> Iterator[Waypoint]:
        return iter(self.waypoints)

    def __len__(self) -> int:
        return len(self.waypoints)

    def poses(self, start: FloatArray) -> list[FloatArray]:
        """World tool poses (4, 4) of all waypoints, orientations resolved from the pose ``start`` (4, 4)."""
        return list(self.each_pose(start))

    def each_pose(self, start: FloatArray) -> Iterator[FloatArray]:
        """:meth:`poses`, lazily, one at a time."""
        rotation = start[:3, :3]
        for waypoint in self.waypoints:
            rotation = waypoint.orientation.resolve(rotation)
            yield rigid(rotation, waypoint.xyz)

    def poses_if_valid(self, start: FloatArray) -> list[FloatArray] | None:
        """:meth:`poses`, or None when an orientation or position is malformed."""
        if any(w.orientation.fault or len(w.xyz) != 3 for w in self.waypoints):
            return None
        return self.poses(start)

    def straight_after(self, index: int, poses: Sequence[FloatArray]) -> Sequence[FloatArray]:
        """Those of all waypoints' ``poses`` (4, 4) that belong to the straight moves right after waypoint ``index``."""
        following = self.waypoints[index + 1 :]
        straight = takewhile(lambda waypoint: waypoint.motion == "linear", following)
        return poses[index + 1 : index + 1 + len(list(straight))]

    def grips(self) -> tuple[int | None, int | None]:
        """Indices of the waypoints where the hand closes on the first object that it carries, and where it lets go of
        it; None where it does not.
        """
        carried = [k for k, waypoint in enumerate(self.waypoints) if waypoint.carries]
        if not carried or carried[0] == 0:
            return None, None
        first = self.waypoints[carried[0]].carries
        last = max(k for k in carried if self.waypoints[k].carries == first)
        return carried[0] - 1, last if self.waypoints[last].gripper > self.waypoints[
            last - 1
        ].gripper else None

    def seconds(self, start: FloatArray) -> FloatArray:
        """(N,) time at each waypoint's speed along straight lines from the tool's position ``start`` (3,)."""
        points = np.array([start, *(w.xyz for w in self.waypoints)], dtype=np.float64)
        speeds = np.array([w.speed for w in self.waypoints])
        return np.asarray(np.linalg.norm(np.diff(points, axis=0), axis=1) / speeds)

    def xyzg(self) -> FloatArray:
        """(N, 4) the paper's view: x, y, z in metres and the gripper state."""
        return np.array([[*w.xyz, w.gripper] for w in self.waypoints], dtype=np.float64)

    def to_json(self) -> list[dict[str, Any]]:
        """Waypoints as JSON objects, every field, sets sorted."""
        return [json.loads(json.dumps(asdict(w), default=_plain)) for w in self.waypoints]


def _plain(value: Any) -> Any:
    """JSON for what has none: sets, and numpy's numbers."""
    return sorted(value) if isinstance(value, frozenset) else float(value)
