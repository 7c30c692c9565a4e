"""Room: whether an object can be put where a call says: not where it is already, nor where it does not fit."""

from __future__ import annotations

import numpy as np

from gvla2.planning.contracts import Abstention
from gvla2.planning.scene import Scene, SceneObject
from gvla2.skills.parts import closed_by
from gvla2.skills.stuck import stuck
from gvla2.skills.wholes import holders, inside

SLACK = 0.002
"""Error of perceived sizes that is allowed when an object is to go through an opening, metres."""


def no_room(theme: SceneObject, goal: SceneObject, relation: str, scene: Scene) -> Abstention | None:
    """The refusal of a goal that the object is in already, or that it cannot go into; None if it can."""
    if relation in ("in", "on", "to", "") and goal.id in _rests_in(theme, scene):
        return Abstention("no_goal", f"The {theme.label} is in the {goal.label} already.")
    why = _kept_out(theme, goal) if relation == "in" else ""
    return Abstention("no_goal", why) if why else None


def _rests_in(thing: SceneObject, scene: Scene) -> set[str]:
    """The ids of what it stands in, sticks in or closes."""
    held = stuck(thing, scene)
    on = {thing.parent} if closed_by(thing, scene) is not None else set()
    return on | {h.id for h in holders(thing, scene) if inside(thing, h)} | set(held.holders if held else ())


def _kept_out(theme: SceneObject, goal: SceneObject) -> str:
    """Why it cannot go into the goal, by their shapes and sizes; "" if it can."""
    if goal.shape == "region" or goal.parent or theme.shape == "ring":
        return ""
    if goal.opening and theme.label.split()[-1] == goal.label.split()[-1]:
        return ""  # cups and bowls stack
    solid = goal.shape in ("box", "cylinder", "sphere") and not goal.opening
    if solid and goal.label.split()[-1] in ("cube", "box", "cylinder", "ball", "brick", "can"):
        return f"The {goal.label} does not seem to be open, so nothing can go into it."
    room = goal.opening or float(np.max(goal.extents[:2]))
    if goal.shape != "ring" and float(np.sort(theme.extents)[1]) > room + SLACK:  # in any orientation
        return f"The {theme.label} is too large to go into the {goal.label}."
    return ""
