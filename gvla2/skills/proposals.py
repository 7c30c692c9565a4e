"""Grasps, and paths, which write trajectories stage by stage."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2.planning.trajectory import Guard, Orientation, Trajectory, Waypoint, grasp_rotation

STEEP = 0.7
"""A hand whose unit approach has a smaller downward component comes from the side."""
LONGEST_LINE = 0.5
"""Longer straight motions are split, metres."""


@dataclass(frozen=True)
class Grasp:
    """One way to grasp: fingers closing along ``closing`` (3,), the hand opened to ``opening`` in [0, 1] before.

    ``approach`` (3,) is the direction of the hand, ``centre`` (3,) the position of the tool centre point. ``back`` is
    how far along the approach the fingertips reach over the object, metres; None for its height above the tool.
    ``width`` is between the closed fingers, metres.
    """

    description: str
    family: str
    closing: FloatArray
    approach: FloatArray
    centre: FloatArray
    opening: float
    preference: float
    back: float | None = None
    width: float = 0.0

    @property
    def rotation(self) -> FloatArray:
        """(3, 3) of the hand in the world: columns along its breadth, its closing direction and its approach."""
        return grasp_rotation(self.approach, self.closing)

    @property
    def approaches(self) -> tuple[str, ...]:
        """The names by which memory may forbid it."""
        whence = "top" if -self.approach[2] > STEEP else "side"
        return tuple(dict.fromkeys((f"approach:{whence}", f"approach:{self.family}")))

    @property
    def orientation(self) -> Orientation:
        """The hand's orientation."""
        return pointing(self.closing, self.approach)


@dataclass
class Path:
    """Writes waypoints one by one; the attributes apply to the next ones until they are changed."""

    speed: float
    contact_speed: float
    orientation: Orientation = field(default_factory=Orientation)
    gripper: float = 1.0
    carries: str = ""
    tolerance: float = 0.01
    waypoints: list[Waypoint] = field(default_factory=list)

    def go(
        self,
        stage: str,
        xyz: FloatArray,
        *,
        gripper: float | None = None,
        allowed: frozenset[str] = frozenset(),
        **how: Any,
    ) -> Path:
        """A planned motion around obstacles; ``how`` are other fields of the waypoint."""
        self.gripper = self.gripper if gripper is None else gripper
        x, y, z = (float(v) for v in xyz)
        held = {"orientation": self.orientation, "carries": self.carries, "tolerance": self.tolerance}
        fields = {"speed": self.speed, **held, **how}
        self.waypoints.append(Waypoint((x, y, z), self.gripper, stage, allowed_contacts=allowed, **fields))
        return self

    def line(
        self,
        stage: str,
        xyz: FloatArray,
        *,
        gripper: float | None = None,
        allowed: frozenset[str] = frozenset(),
        slow: bool = False,
        guard: Guard | None = None,
        dwell: float = 0.0,
    ) -> Path:
        """A straight motion, split if it is long, then ``dwell`` seconds of rest; a ``guard`` may end it early."""
        how: dict[str, Any] = {
            "motion": "linear",
            "speed": self.contact_speed if slow else self.speed,
            "guard": guard,
        }
        if self.waypoints:
            begin = self.end
            parts = math.ceil(math.dist(xyz, begin) / LONGEST_LINE - 1e-9)
            for k in range(1, parts):
                self.go(stage, begin + (xyz - begin) * (k / parts), allowed=allowed, **how)
        return self.go(stage, xyz, gripper=gripper, allowed=allowed, dwell=dwell, **how)

    @property
    def end(self) -> FloatArray:
        """(3,) position of the tool at the last waypoint."""
        return np.asarray(self.waypoints[-1].xyz)

    def trajectory(self) -> Trajectory:
        """The trajectory of all waypoints so far."""
        return Trajectory(tuple(self.waypoints))


def pointing(closing: FloatArray, approach: FloatArray | None = None) -> Orientation:
    """The hand's orientation with fingers closing along ``closing`` (3,), pointing along ``approach`` (3,) or down."""
    down = np.array([0.0, 0.0, -1.0]) if approach is None else approach
    vector, along = (tuple(float(v) for v in a) for a in (down, closing))
    return Orientation("grasp", vector, along)  # type: ignore[arg-type]


def horizontal(angle: float) -> FloatArray:
    """(3,) unit vector in the table's plane, ``angle`` radians from x."""
    return np.array([np.cos(angle), np.sin(angle), 0.0])
