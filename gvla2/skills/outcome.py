"""What came of carrying out a skill, as plain data: what a skill's own diagnosis is told, and what it answers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from gvla2.planning.contracts import Plan
from gvla2.planning.effects import Effect
from gvla2.planning.scene import Scene, SceneObject
from gvla2.planning.trajectory import Waypoint

EMPTY = 0.001
"""Fingers that are no further apart hold nothing, metres."""


@dataclass(frozen=True)
class Signal:
    """One diagnosed cause: a stable ``kind``, words that hold for any such episode, and an effect where one follows."""

    kind: str
    words: str
    effect: Effect | None = None


@dataclass(frozen=True)
class Reached:
    """One executed waypoint: its ``stage``, the fingers' gap in metres at its end, whether a guard
    ended it, and by how much the tool missed its target, metres.
    """

    index: int
    stage: str
    gripper_width: float
    guarded: bool = False
    error: float = 0.0


@dataclass(frozen=True)
class Outcome:
    """A plan that was executed: to its end, or until the object ``slipped`` or held the hand back.

    ``theme`` is what was handled, as perceived ``before``; ``later(id)`` is the same object as perceived afterwards,
    None where it was not found. ``after`` is all that was perceived then.
    """

    plan: Plan
    before: Scene
    theme: SceneObject
    later: Callable[[str], SceneObject | None]
    reached: tuple[Reached, ...] = ()
    slipped: bool = False
    after: Scene | None = None

    @property
    def waypoints(self) -> tuple[Waypoint, ...]:
        """The plan's waypoints; () if it has no trajectory."""
        return self.plan.trajectory.waypoints if self.plan.trajectory else ()

    def gripped(self) -> bool:
        """Whether the fingers had something between them on all the way that the plan has them carry it."""
        carrying = [r.gripper_width for r, w in self._followed() if w.carries and w.gripper < 0.1]
        return bool(carrying) and min(carrying) > EMPTY

    def held_back(self) -> bool:
        """Whether the thing did not come along: the hand was stopped on the way, or what it held was drawn from it."""
        closed = any(r.stage == "close" and r.gripper_width > EMPTY for r in self.reached)
        return closed and any(w.carries for _, w in self._followed())

    def _followed(self) -> list[tuple[Reached, Waypoint]]:
        return [(r, self.waypoints[r.index]) for r in self.reached if r.index < len(self.waypoints)]

    def stopped(self, stage: str, short: float) -> bool:
        """Whether the hand met a stop in a motion of this stage: a guard ended it, or it ended ``short`` metres off."""
        return any(r.guarded or r.error > short for r in self.reached if r.stage == stage)

    def went(self, stage: str, name: str) -> float:
        """How far of the depth that the parameter asks for the hand got in the motion of this stage, metres."""
        missed = max((r.error for r in self.reached if r.stage == stage), default=0.0)
        return self.plan.parameters.get(name, 0.0) - missed

    def changed(self, name: str, by: float, op: str = ">=") -> Effect | None:
        """The bound that asks for ``by`` more (or less) of a parameter than was used; None where it was not used."""
        used = self.plan.parameters.get(name)
        if used is None:
            return None
        return Effect("bound", name, used + by, "<=" if op == "<=" else ">=", skill=self.plan.skill)
