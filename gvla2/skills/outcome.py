"""The outcome of an executed skill, and the signal that the skill's diagnosis finds in it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from gvla2.planning.contracts import Plan
from gvla2.planning.effects import Effect
from gvla2.planning.scene import Scene, SceneObject
from gvla2.planning.trajectory import Waypoint

EMPTY = 0.001
"""Fingers this close hold nothing, metres."""


@dataclass(frozen=True)
class Signal:
    """One diagnosed cause: a stable ``kind``, ``words`` that are true of any such episode, and its effect, if any."""

    kind: str
    words: str
    effect: Effect | None = None


@dataclass(frozen=True)
class Reached:
    """One executed waypoint: its ``stage``, the fingers' gap at its end in metres, whether a guard ended it, and the
    tool's distance from its target, metres.
    """

    index: int
    stage: str
    gripper_width: float
    guarded: bool = False
    error: float = 0.0


@dataclass(frozen=True)
class Outcome:
    """A plan that was executed to its end, or until the object ``slipped`` or resisted.

    ``theme`` is the handled object as perceived ``before``; ``later(id)`` is an object as perceived afterwards, None if
    it was not found; ``after`` is the whole scene perceived then.
    """

    plan: Plan
    before: Scene
    theme: SceneObject
    later: Callable[[str], SceneObject | None]
    reached: tuple[Reached, ...] = ()
    slipped: bool = False
    after: Scene | None = None

    @property
    def goal(self) -> SceneObject | None:
        """The plan's goal, as perceived before; None if it has none."""
        return next((o for o in self.before.objects if o.id == self.plan.roles.get("goal")), None)

    @property
    def waypoints(self) -> tuple[Waypoint, ...]:
        """The plan's waypoints; () if it has no trajectory."""
        return self.plan.trajectory.waypoints if self.plan.trajectory else ()

    def gripped(self) -> bool:
        """Whether the fingers held something wherever the plan carries it."""
        carrying = [r.gripper_width for r, w in self._followed() if w.carries and w.gripper < 0.1]
        return bool(carrying) and min(carrying) > EMPTY

    def held_back(self) -> bool:
        """Whether the hand closed on something and began to carry it, so that the object must have resisted."""
        closed = any(r.stage == "close" and r.gripper_width > EMPTY for r in self.reached)
        return closed and any(w.carries for _, w in self._followed())

    def _followed(self) -> list[tuple[Reached, Waypoint]]:
        return [(r, self.waypoints[r.index]) for r in self.reached if r.index < len(self.waypoints)]

    def stopped(self, stage: str, short: float) -> bool:
        """Whether a guard ended a motion of this stage, or it ended more than ``short`` metres off its target."""
        return any(r.guarded or r.error > short for r in self.reached if r.stage == stage)

    def went(self, stage: str, name: str) -> float:
        """The value of a parameter that the motions of this stage reached, metres."""
        missed = max((r.error for r in self.reached if r.stage == stage), default=0.0)
        return self.plan.parameters.get(name, 0.0) - missed

    def changed(self, name: str, by: float, op: str = ">=") -> Effect | None:
        """The bound at ``by`` more (or less) than the used value of a parameter; None if the parameter was not used."""
        used = self.plan.parameters.get(name)
        if used is None:
            return None
        return Effect("bound", name, used + by, "<=" if op == "<=" else ">=", skill=self.plan.skill)
