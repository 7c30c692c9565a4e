"""The trajectory tau = {(x, y, z, g)} and its full waypoints."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import FloatArray, rigid

MIN_WAYPOINTS, MAX_WAYPOINTS = 2, 20


@dataclass(frozen=True)
class Orientation:
    """How the hand is turned at a waypoint, as a policy that the previous waypoint resolves.

    * ``hold``: as before.
    * ``grasp``: approach along ``vector`` (3,), fingers closing along ``closing`` (3,); world frame.
    * ``axis``: approach along ``vector``, with the least turn from before.
    * ``twist``: turn by ``angle`` (radians, right hand) about the world axis ``vector``.
    * ``slerp``: the share ``angle`` in [0, 1] of the way to the grasp given by ``vector`` and ``closing``.
    """

    policy: Literal["hold", "grasp", "axis", "twist", "slerp"] = "hold"
    vector: tuple[float, float, float] = (0.0, 0.0, -1.0)
    closing: tuple[float, float, float] = (0.0, 1.0, 0.0)
    angle: float = 0.0

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
            case "twist":
                step = Rotation.from_rotvec(vector / np.linalg.norm(vector) * self.angle)
                return np.asarray(step.as_matrix() @ before)
            case "slerp":
                goal = grasp_rotation(vector, np.asarray(self.closing, dtype=np.float64))
                rotvec = Rotation.from_matrix(goal @ before.T).as_rotvec() * self.angle
                return np.asarray(Rotation.from_rotvec(rotvec).as_matrix() @ before)


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
    return np.stack([np.cross(y, z), y, z], axis=1)


@dataclass(frozen=True)
class Waypoint:
    """One stop of the tool centre point.

    ``xyz`` in metres, world ``frame``; ``gripper`` opening in [0, 1], reached after arriving; ``speed`` of the
    tool in m/s; ``stage`` names the phase ("approach", "grasp", "lift"); ``motion`` is ``free`` (planned around
    obstacles) or ``linear`` (a straight line of the tool); ``allowed_contacts`` are ids of scene objects, or
    "table", that the hand may touch on the way; ``tolerance`` of position in metres.
    ``carries`` is the id of the object in the hand on the way here, or "".
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
    frame: str = "world"


@dataclass(frozen=True)
class Trajectory:
    """An ordered path of waypoints, from the hand's present pose on."""

    waypoints: tuple[Waypoint, ...]

    def __iter__(self) -> Iterator[Waypoint]:
        return iter(self.waypoints)

    def __len__(self) -> int:
        return len(self.waypoints)

    def poses(self, start: FloatArray) -> list[FloatArray]:
        """World tool poses (4, 4) of all waypoints, orientations resolved from the pose ``start`` (4, 4)."""
        rotation, poses = start[:3, :3], []
        for waypoint in self.waypoints:
            rotation = waypoint.orientation.resolve(rotation)
            poses.append(rigid(rotation, waypoint.xyz))
        return poses

    def xyzg(self) -> FloatArray:
        """(N, 4) the paper's view: x, y, z in metres and the gripper state."""
        return np.array([[*w.xyz, w.gripper] for w in self.waypoints], dtype=np.float64)

    def to_json(self) -> list[dict[str, Any]]:
        """Waypoints as JSON objects, every field, sets sorted."""
        return [
            {
                "xyz": [float(v) for v in w.xyz],
                "gripper": w.gripper,
                "stage": w.stage,
                "orientation": {
                    "policy": w.orientation.policy,
                    "vector": [float(v) for v in w.orientation.vector],
                    "closing": [float(v) for v in w.orientation.closing],
                    "angle": w.orientation.angle,
                },
                "motion": w.motion,
                "speed": w.speed,
                "allowed_contacts": sorted(w.allowed_contacts),
                "carries": w.carries,
                "tolerance": w.tolerance,
                "frame": w.frame,
            }
            for w in self.waypoints
        ]
