"""One episode's evidence for the rules of the skills, with shared queries on two scenes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gvla2.episode.evidence import Correspondence, RobotEvidence, correspond
from gvla2.geometry.transform import FloatArray, invert_rigid, transform_points
from gvla2.planning.scene import Scene, SceneObject
from gvla2.planning.trajectory import Waypoint

if TYPE_CHECKING:
    from gvla2_plugins.geometric import GeometricConfig

GROWN = 0.02
"""Metres by which a side of an object's footprint is at most seen longer when nothing was added to it."""


@dataclass(frozen=True)
class Score:
    """A score in [0, 1], None when unknown, and why."""

    score: float | None
    reason: str


class InconclusiveError(Exception):
    """The evidence does not decide whether the skill reached its goal; the message says what is missing."""


class Case:
    """One episode's evidence with its objects looked up."""

    def __init__(self, evidence: RobotEvidence, config: GeometricConfig) -> None:
        self.evidence, self.config = evidence, config
        self.before = evidence.before
        self.after = evidence.after
        self.matched: Correspondence | None = (
            correspond(evidence.before, evidence.after) if evidence.after is not None else None
        )

    def handled(self, *names: str) -> SceneObject:
        """The object of :meth:`role`; raises :class:`InconclusiveError` if the plan names none."""
        roles = names or ("theme", "part")
        found = self.role(*roles)
        if found is None:
            raise InconclusiveError(f"The plan names no object as {' or '.join(roles)}.")
        return found

    def perceived(self) -> Scene:
        """The scene afterwards; raises :class:`InconclusiveError` if there is none."""
        if self.after is None:
            raise InconclusiveError("Nothing was perceived at the end.")
        return self.after

    def again(self, obj: SceneObject) -> SceneObject:
        """The same object afterwards; raises :class:`InconclusiveError` if it was not seen again."""
        later = self.later(obj)
        if later is None:
            raise InconclusiveError(f"{obj.label} was not seen again.")
        return later

    def role(self, *names: str) -> SceneObject | None:
        """The object before, by the first of these roles that the plan gives; None if it gives none."""
        ids = {o.id: o for o in self.before.objects}
        return next((ids[i] for name in names if (i := self.evidence.plan.roles.get(name, "")) in ids), None)

    def seen(self, object_id: str) -> SceneObject | None:
        """The object of that id before the episode."""
        return next((o for o in self.before.objects if o.id == object_id), None)

    def later(self, obj: SceneObject) -> SceneObject | None:
        """The same object afterwards, None if it was not seen again."""
        return self.matched.of(obj.id) if self.matched is not None else None

    @property
    def planned(self) -> tuple[Waypoint, ...]:
        """The plan's waypoints."""
        trajectory = self.evidence.plan.trajectory
        return trajectory.waypoints if trajectory is not None else ()

    def way(self, object_id: str) -> FloatArray:
        """(3,) from where the hand grasped an object to where it last held it, as planned; 0 if it never did."""
        with_it = [i for i, w in enumerate(self.planned) if w.carries == object_id and i > 0]
        if not with_it:
            return np.zeros(3)
        return np.subtract(self.planned[with_it[-1]].xyz, self.planned[with_it[0] - 1].xyz)

    @property
    def holding(self) -> bool:
        """The fingers are stopped by something at the end."""
        return self.evidence.gripper_width > self.config.empty_width

    @property
    def last_held(self) -> bool | None:
        """What the robot felt at the last waypoint."""
        reports = self.evidence.report.waypoints
        return reports[-1].held if reports else None

    def in_hand(self, obj: SceneObject) -> bool:
        """Whether the tool ended within an object's box, within perception's error."""
        reports = self.evidence.report.waypoints
        if not reports:
            return False
        inside = transform_points(invert_rigid(obj.world_from_object), np.asarray(reports[-1].reached))
        return bool((np.abs(inside) <= 0.5 * obj.extents + self.config.same_place).all())


def outside_footprint(point: FloatArray, goal: SceneObject) -> float:
    """How far a world point (3,) lies outside the goal's footprint, horizontally, metres; 0 inside."""
    local = transform_points(invert_rigid(goal.world_from_object), np.asarray(point, dtype=np.float64))
    if goal.shape in ("disc", "cylinder", "sphere"):
        return max(0.0, float(np.linalg.norm(local[:2])) - 0.5 * float(goal.extents[:2].max()))
    beyond = np.maximum(np.abs(local[:2]) - 0.5 * goal.extents[:2], 0.0)
    return float(np.linalg.norm(beyond))


def goal_now(case: Case, goal: SceneObject) -> SceneObject:
    """The goal's place at the end: paint stays where it was seen unhidden, objects may have moved.

    Objects do not grow: one that is seen larger about its old place is seen as one with something beside it.
    """
    later = None if goal.shape == "region" else case.later(goal)
    if later is None:
        return goal
    grown = float((np.sort(later.extents[:2]) - np.sort(goal.extents[:2])).max())
    return goal if grown > GROWN and outside_footprint(goal.centre, later) == 0.0 else later


def something_at(old: SceneObject, scene: Scene, reach: float) -> bool:
    """Whether anything solid stands at an object's old place."""
    return any(
        float(np.linalg.norm((o.centre - old.centre)[:2])) < reach and o.bottom < old.top
        for o in scene.obstacles()
    )
