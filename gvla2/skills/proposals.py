"""Jobs, the trajectories proposed for them, and paths, which write trajectories stage by stage."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2.planning.arm import Hand
from gvla2.planning.calls import GraspOptions
from gvla2.planning.scene import Box, Scene, SceneObject
from gvla2.planning.trajectory import Guard, Orientation, Trajectory, Waypoint
from gvla2.skills.parameters import TABLE_GAP
from gvla2.skills.part_hierarchy import holders, rise, way_out

LONGEST_LINE = 0.5
"""Longer straight motions are split, metres."""


@dataclass(frozen=True)
class Job:
    """One grounded request. ``goal`` is the object that the theme goes to, or None, and ``relation`` how it should lie
    there; ``target`` (2,) is the intended position of the theme's centre, world metres, if there is no goal. ``share``:
    the theme is the k-th (from 0) of n objects that go there. ``done`` is the amount by parameter that earlier attempts
    did to the theme. ``grasp`` is how grasps are chosen.
    """

    skill: str
    scene: Scene
    hand: Hand
    workspace: Box
    theta: Mapping[str, float]
    theme: SceneObject
    goal: SceneObject | None = None
    relation: str = ""
    target: FloatArray | None = None
    share: tuple[int, int] = (0, 1)
    done: Mapping[str, float] = field(default_factory=dict)
    grasp: GraspOptions = field(default_factory=GraspOptions)

    def own(self) -> frozenset[str]:
        """Ids of the theme and its parts, which a hand that grasps it may touch."""
        return self._own

    def resting(self) -> frozenset[str]:
        """Ids of what the theme stands in or on, with their parts, and the table: it touches them before the lift."""
        return self._resting

    @cached_property
    def rise(self) -> float:
        """Height by which the theme must be lifted to leave what it stands in, metres."""
        return rise(self.theme, self.scene)

    @cached_property
    def way_out(self) -> FloatArray:
        """(3,) unit: the direction in which the theme leaves what it stands in."""
        return way_out(self.theme, self.scene)

    @cached_property
    def highest(self) -> float:
        """Height of the highest object except the theme and its parts, or of the table, metres."""
        return max((o.top for o in self.scene.obstacles(self._own)), default=self.scene.table_height)

    # Cached: dozens of proposals ask for the same.
    @cached_property
    def _own(self) -> frozenset[str]:
        return self.scene.family(self.theme.id)

    @cached_property
    def _resting(self) -> frozenset[str]:
        held = [self.scene.family(holder.id) for holder in holders(self.theme, self.scene)]
        return frozenset({"table"}).union(*held)

    def lowest_tcp(self) -> float:
        """The lowest height of the tool, pointing down, with the fingertips above the table, metres."""
        return self.scene.table_height + TABLE_GAP + self.hand.tip_beyond_tcp

    def outward(self) -> FloatArray:
        """(3,) level vector from the arm's foot, at the middle of the workspace's near side, to the theme."""
        stands = np.array([self.workspace.low[0], 0.5 * (self.workspace.low[1] + self.workspace.high[1])])
        return np.array([*(self.theme.centre[:2] - stands), 0.0])

    def ceiling(self) -> float:
        """The greatest height of the tool, metres."""
        return float(min(self.workspace.high[2], self.scene.workspace.high[2]))


@dataclass(frozen=True)
class Proposal:
    """One way to do a job. ``approaches`` are the names by which memory may forbid it ("approach:top");
    ``preference`` in [0, 1] rates its geometry, without regard to the arm. Proposals in ``reserve`` are considered only
    if all others failed. ``way`` is the trajectory, or a function that writes it: only a few of dozens are needed.
    """

    description: str
    approaches: tuple[str, ...]
    preference: float
    way: Trajectory | Callable[[], Trajectory]
    notes: tuple[str, ...] = ()
    reserve: bool = False

    @cached_property
    def trajectory(self) -> Trajectory:
        """The trajectory, written on first use."""
        return self.way if isinstance(self.way, Trajectory) else self.way()


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
    ) -> Path:
        """A planned motion around obstacles."""
        return self._add(stage, xyz, "free", self.speed, gripper, allowed)

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
        speed = self.contact_speed if slow else self.speed
        if self.waypoints:
            begin = np.asarray(self.waypoints[-1].xyz)
            parts = math.ceil(math.dist(xyz, begin) / LONGEST_LINE - 1e-9)
            for k in range(1, parts):
                self._add(stage, begin + (xyz - begin) * (k / parts), "linear", speed, None, allowed, guard)
        return self._add(stage, xyz, "linear", speed, gripper, allowed, guard, dwell)

    def trajectory(self) -> Trajectory:
        """The trajectory of all waypoints so far."""
        return Trajectory(tuple(self.waypoints))

    def _add(
        self,
        stage: str,
        xyz: FloatArray,
        motion: Literal["free", "linear"],
        speed: float,
        gripper: float | None,
        allowed: frozenset[str],
        guard: Guard | None = None,
        dwell: float = 0.0,
    ) -> Path:
        self.gripper = self.gripper if gripper is None else gripper
        x, y, z = (float(v) for v in xyz)
        how = (self.gripper, stage, self.orientation, motion, speed, allowed, self.carries, self.tolerance)
        self.waypoints.append(Waypoint((x, y, z), *how, guard=guard, dwell=dwell))
        return self


def pointing(closing: FloatArray, approach: FloatArray | None = None) -> Orientation:
    """The hand's orientation with fingers closing along ``closing`` (3,), pointing along ``approach`` (3,) or down."""
    down = np.array([0.0, 0.0, -1.0]) if approach is None else approach
    vector, along = (tuple(float(v) for v in a) for a in (down, closing))
    return Orientation("grasp", vector, along)  # type: ignore[arg-type]


def horizontal(angle: float) -> FloatArray:
    """(3,) unit vector in the table's plane, ``angle`` radians from x."""
    return np.array([np.cos(angle), np.sin(angle), 0.0])
