"""One episode's evidence for the rules of the skills, with shared queries on two scenes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from gvla2.episode.evidence import RobotEvidence, correspond
from gvla2.geometry.transform import FloatArray, invert_rigid, transform_points
from gvla2.planning.scene import Scene, SceneObject

if TYPE_CHECKING:
    from gvla2_plugins.geometric import GeometricConfig

GROWN = 0.02  # metres by which a side of an unchanged footprint is at most seen longer


@dataclass(frozen=True)
class Score:
    """A score in [0, 1], None when unknown, and why."""

    score: float | None
    reason: str


class InconclusiveError(Exception):
    """The evidence does not decide whether the skill reached its goal; the message says what is missing."""


class Case:
    """One episode's evidence with its objects looked up.

    ``holding``: the fingers are stopped by something at the end; ``last_held``: what the robot felt then.
    """

    def __init__(self, evidence: RobotEvidence, config: GeometricConfig) -> None:
        self.evidence, self.config, self.before = evidence, config, evidence.before
        trajectory, reports = evidence.plan.trajectory, evidence.report.waypoints
        self.planned = trajectory.waypoints if trajectory is not None else ()
        self.holding = evidence.gripper_width > config.empty_width
        self.last_held = reports[-1].held if reports else None

    @property
    def after(self) -> Scene:
        """The scene afterwards; raises :class:`InconclusiveError` if there is none."""
        if self.evidence.after is None:
            raise InconclusiveError("Nothing was perceived at the end.")
        return self.evidence.after

    @cached_property
    def _matched(self) -> dict[str, SceneObject]:
        return correspond(self.before, self.after)

    def role(self, *names: str) -> SceneObject | None:
        """The object before, by the first of these roles that the plan gives; None if it gives none."""
        return next((o for n in names if (o := self.seen(self.evidence.plan.roles.get(n, "")))), None)

    def handled(self, *names: str) -> SceneObject:
        """The object of :meth:`role`, by default theme or part; raises :class:`InconclusiveError` for none."""
        roles = names or ("theme", "part")
        if (found := self.role(*roles)) is None:
            raise InconclusiveError(f"The plan names no object as {' or '.join(roles)}.")
        return found

    def seen(self, object_id: str) -> SceneObject | None:
        """The object of that id before the episode."""
        return next((o for o in self.before.objects if o.id == object_id), None)

    def later(self, obj: SceneObject) -> SceneObject | None:
        """The same object afterwards, None if it was not seen again; errors as :attr:`after`."""
        return self._matched.get(obj.id)

    def again(self, obj: SceneObject) -> SceneObject:
        """The same object afterwards; raises :class:`InconclusiveError` if it was not seen again."""
        if (later := self.later(obj)) is None:
            raise InconclusiveError(f"{obj.label} was not seen again.")
        return later

    def carried(self, object_id: str) -> FloatArray:
        """(3,) the hand's planned way while it held an object; 0 if it never did."""
        return self._way([after.carries == object_id for after in self.planned[1:]])

    def pushed(self, touching: str = "") -> FloatArray:
        """(3,) the hand's planned way while it pushed anything, or the object of an id."""
        pushes = [
            w.stage.startswith("push") and (not touching or touching in w.allowed_contacts)
            for w in self.planned[1:]
        ]
        return self._way(pushes)

    def _way(self, counts: list[bool]) -> FloatArray:
        steps = [np.subtract(after.xyz, before.xyz) for before, after in pairwise(self.planned)]
        return np.asarray(sum((s for s, c in zip(steps, counts, strict=True) if c), np.zeros(3)))

    def goal_now(self, goal: SceneObject) -> SceneObject:
        """The goal's place at the end: paint stays where it was seen unhidden, objects may have moved.

        Objects do not grow: one that is seen larger about its old place is seen as one with something beside it.
        """
        later = None if goal.shape == "region" else self.later(goal)
        if later is None:
            return goal
        grown = float((np.sort(later.extents[:2]) - np.sort(goal.extents[:2])).max())
        return goal if grown > GROWN and outside_footprint(goal.centre, later) == 0.0 else later

    def still_there(self, old: SceneObject) -> bool:
        """Whether anything solid takes an object's old place; what it stood on does not reach up to its middle."""
        near = (o for o in self.after.obstacles() if level_gap(o.centre, old.centre) < self.config.same_place)
        return any(o.bottom < old.top and o.top > old.centre[2] for o in near)


def level_gap(a: FloatArray, b: FloatArray) -> float:
    """Horizontal distance of two points (3,), metres."""
    return float(np.linalg.norm((a - b)[:2]))


def outside_footprint(point: ArrayLike, goal: SceneObject) -> float:
    """How far a world point (3,) lies outside the goal's footprint, horizontally, metres; 0 inside."""
    local = transform_points(invert_rigid(goal.world_from_object), point)
    if goal.shape in ("disc", "cylinder", "sphere"):
        return max(0.0, float(np.linalg.norm(local[:2])) - 0.5 * float(goal.extents[:2].max()))
    return float(np.linalg.norm(np.maximum(np.abs(local[:2]) - 0.5 * goal.extents[:2], 0.0)))
