"""Did the skill do what it is for? One rule a skill, from perceived scenes and the hand's own measurements.

Each rule answers with a score in [0, 1], or None where the evidence does not tell, and a sentence.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from gvla2.correspondence import Correspondence, correspond
from gvla2.evidence import RobotEvidence
from gvla2.geometry.transform import FloatArray, invert_rigid, transform_points
from gvla2.planning.scene import Scene, SceneObject

if TYPE_CHECKING:
    from gvla2_plugins.geometric import GeometricConfig


@dataclass(frozen=True)
class Finding:
    """A score in [0, 1], None when unknown, and why."""

    score: float | None
    reason: str


class Case:
    """One episode's evidence with its objects looked up; lookups give None where there is nothing."""

    def __init__(self, evidence: RobotEvidence, config: GeometricConfig) -> None:
        self.evidence, self.config = evidence, config
        self.before = evidence.before
        self.matched: Correspondence | None = (
            correspond(evidence.before, evidence.after) if evidence.after is not None else None
        )

    def role(self, *names: str) -> SceneObject | None:
        """The object before, by the first of these roles that the plan gives."""
        ids = {o.id: o for o in self.before.objects}
        return next((ids[i] for name in names if (i := self.evidence.plan.roles.get(name, "")) in ids), None)

    def later(self, thing: SceneObject) -> SceneObject | None:
        """The same object after, None when it was not seen again."""
        return self.matched.of(thing.id) if self.matched is not None else None

    @property
    def holding(self) -> bool:
        """The fingers are stopped by something at the end."""
        return self.evidence.gripper_width > self.config.empty_width

    @property
    def last_held(self) -> bool | None:
        """What the robot felt at the last waypoint."""
        reports = self.evidence.report.waypoints
        return reports[-1].held if reports else None


def completion(case: Case) -> Finding:
    """The finding of the plan's skill; unknown for a skill without a rule."""
    rule = _RULES.get(case.evidence.plan.skill)
    if rule is None:
        return Finding(None, f"There is no rule for the skill '{case.evidence.plan.skill}'.")
    return rule(case)


def _pick(case: Case) -> Finding:
    """The theme is up and in the hand; or it is out of sight, gone from its place, and the hand holds something."""
    theme = case.role("theme", "part")
    if theme is None:
        return Finding(None, "The plan does not say what was to be picked.")
    if not case.holding:
        return Finding(0.0, "The hand is empty at the end.")
    if case.evidence.after is None:
        return Finding(None, "The hand holds something, but nothing was perceived at the end.")
    later = case.later(theme)
    if later is None:
        if _something_at(theme, case.evidence.after, case.config.same_place):
            return Finding(0.2, f"Something still stands where {theme.label} stood.")
        if case.last_held is False:
            return Finding(0.2, f"{theme.label} is gone from its place, but the hand felt nothing.")
        return Finding(
            0.85, f"{theme.label} is gone from its place and the hand is held open by what it holds."
        )
    risen = later.bottom - theme.bottom
    # A sentence may ask for less than a clear lift.
    enough = min(case.config.risen, 0.5 * case.evidence.plan.parameters.get("lift_height", np.inf))
    if risen >= enough:
        return Finding(1.0, f"{theme.label} rose by {100 * risen:.1f} cm and the hand holds something.")
    if _in_hand(case, later):
        return Finding(0.45, f"{theme.label} is in the hand, but rose by {100 * risen:.1f} cm only.")
    moved = float(np.linalg.norm(later.centre - theme.centre))
    return Finding(
        max(0.0, 0.3 * risen / enough),
        f"{theme.label} was found {100 * moved:.1f} cm from its old place, raised by {100 * risen:.1f} cm only.",
    )


def _in_hand(case: Case, thing: SceneObject) -> bool:
    """Whether the tool ended within the thing's box, give or take what perception misses."""
    reports = case.evidence.report.waypoints
    if not reports:
        return False
    inside = transform_points(invert_rigid(thing.world_from_object), np.asarray(reports[-1].reached))
    return bool((np.abs(inside) <= 0.5 * thing.extents + case.config.same_place).all())


def _push(case: Case) -> Finding:
    """The theme's centre ended inside the goal's footprint; against a solid goal it came to touch it."""
    theme, goal = case.role("theme", "part"), case.role("goal")
    if theme is None:
        return Finding(None, "The plan does not say what was to be pushed.")
    if case.evidence.after is None:
        return Finding(None, "Nothing was perceived at the end.")
    later = case.later(theme)
    if later is None:
        return Finding(None, f"{theme.label} was not seen again.")
    if goal is None:
        return _shifted(case, theme, later)
    reach = float(later.extents[:2].max())
    if goal.shape == "region":
        return _inside(case, later, goal, reach)
    gap = outside_footprint(later.centre, _goal_now(case, goal)) - 0.5 * reach
    if gap <= 0.015:
        return Finding(1.0, f"{theme.label} lies against {goal.label}.")
    return Finding(
        max(0.0, 0.45 * (1 - gap / reach)), f"{theme.label} stopped {100 * gap:.1f} cm from {goal.label}."
    )


def _shifted(case: Case, theme: SceneObject, later: SceneObject) -> Finding:
    """A push without a goal: the theme went along with the hand's strokes, half of their way at least."""
    plan = case.evidence.plan
    waypoints = plan.trajectory.waypoints if plan.trajectory else ()
    stroke = np.zeros(3)
    for before, after in pairwise(waypoints):
        if theme.id in after.allowed_contacts and after.stage.startswith("push"):
            stroke += np.subtract(after.xyz, before.xyz)
    length = float(np.linalg.norm(stroke))
    planned = length - plan.parameters.get("standoff", 0.0)
    if length < 1e-6 or planned <= case.config.same_place:
        return Finding(None, "The plan does not say how far to push.")
    along = float((later.centre - theme.centre) @ stroke) / length
    said = f"{theme.label} went {100 * along:.1f} of {100 * planned:.1f} cm"
    if 0.5 * planned <= along <= 1.5 * planned:
        return Finding(1.0, f"{said}.")
    return Finding(max(0.0, 0.4 * min(along / planned, 1.0)), f"{said}: not as planned.")


def _place(case: Case) -> Finding:
    """The theme rests on the goal, in it, or beside it where the plan meant that, and the hand let go."""
    theme, goal = case.role("theme", "part"), case.role("goal")
    if theme is None or goal is None:
        return Finding(None, "The plan does not say what was to be put where.")
    if case.last_held:
        return Finding(0.1, "The hand still holds something at the end.")
    if case.evidence.after is None:
        return Finding(None, "Nothing was perceived at the end.")
    later = case.later(theme)
    if later is None:
        return Finding(None, f"{theme.label} was not seen again.")
    reach, slack = float(later.extents[:2].max()), max(0.015, 0.2 * float(later.extents[2]))
    beside = _meant_beside(case, goal, reach)
    if beside is not None:
        off = float(np.linalg.norm((later.centre - beside)[:2]))
        if off > max(0.03, 0.5 * reach):
            return Finding(0.1, f"{theme.label} lies {100 * off:.1f} cm from where it was to be put.")
        if later.bottom > case.before.table_height + slack:
            return Finding(0.2, f"{theme.label} does not rest on the table.")
        return Finding(1.0, f"{theme.label} rests beside {goal.label}, where it was to be put.")
    found = _inside(case, later, goal, reach)
    goal_now = _goal_now(case, goal)
    if found.score == 1.0 and not goal_now.bottom - slack <= later.bottom <= goal_now.top + slack:
        return Finding(0.2, f"{theme.label} is over {goal.label}, but does not rest there.")
    return found


def _inside(case: Case, thing: SceneObject, goal: SceneObject, reach: float) -> Finding:
    """The thing's centre in the goal's footprint; half a body's width off, the goal is touched, not reached."""
    outside = outside_footprint(thing.centre, _goal_now(case, goal))
    if outside <= case.config.margin:
        return Finding(1.0, f"{thing.label} lies within {goal.label}.")
    score = max(0.0, 0.45 * (1 - outside / reach))
    return Finding(score, f"{thing.label} lies {100 * outside:.1f} cm outside {goal.label}.")


def _meant_beside(case: Case, goal: SceneObject, reach: float) -> FloatArray | None:
    """(3,) where the hand was to let go, when that is clearly beside the goal; None when it is on or in it."""
    plan = case.evidence.plan
    carried = [w.xyz for w in (plan.trajectory.waypoints if plan.trajectory else ()) if w.carries]
    if not carried:
        return None
    spot = np.asarray(carried[-1], dtype=np.float64)
    return spot if outside_footprint(spot, goal) > 0.5 * reach else None


def _press(case: Case) -> Finding:
    """The tool went at least half of the planned press below the button's top, and felt it."""
    button = case.role("part", "theme", "goal")
    plan, reports = case.evidence.plan, case.evidence.report.waypoints
    if button is None or plan.trajectory is None:
        return Finding(None, "The plan does not say what was to be pressed.")
    near = [r for r in reports if outside_footprint(np.asarray(r.target), button) <= 0.02]
    if not near:
        return Finding(0.0, f"The tool never came over {button.label}.")
    lowest = min(near, key=lambda r: r.target[2])
    planned = plan.parameters.get("press_depth", button.top - lowest.target[2])
    if planned <= 0:
        return Finding(0.0, f"The plan does not go below the top of {button.label}.")
    # How far short of its target the tool stayed is what is missing of the planned depth.
    depth = planned - max(lowest.reached[2] - lowest.target[2], 0.0)
    aside = float(np.linalg.norm(np.subtract(lowest.reached[:2], lowest.target[:2])))
    said = f"The tool went {1e3 * depth:.1f} of {1e3 * planned:.1f} mm into {button.label}"
    if aside > max(0.02, 0.5 * float(button.extents[:2].max())):
        return Finding(0.0, f"The tool missed {button.label} by {100 * aside:.1f} cm.")
    if depth < 0.5 * planned:
        return Finding(max(0.0, 0.6 * depth / planned), f"{said}: not far enough.")
    if not lowest.contacts:
        return Finding(0.4, f"{said}, but felt no contact.")
    return Finding(1.0, f"{said} and felt it.")


_RULES: dict[str, Callable[[Case], Finding]] = {
    "pick": _pick,
    "push": _push,
    "place": _place,
    "press": _press,
}


def outside_footprint(point: FloatArray, goal: SceneObject) -> float:
    """How far a world point (3,) lies outside the goal's footprint, horizontally, metres; 0 inside."""
    local = transform_points(invert_rigid(goal.world_from_object), np.asarray(point, dtype=np.float64))
    if goal.shape in ("disc", "cylinder", "sphere"):
        return max(0.0, float(np.linalg.norm(local[:2])) - 0.5 * float(goal.extents[:2].max()))
    beyond = np.maximum(np.abs(local[:2]) - 0.5 * goal.extents[:2], 0.0)
    return float(np.linalg.norm(beyond))


def _goal_now(case: Case, goal: SceneObject) -> SceneObject:
    """Where the goal is at the end: paint stays where it was seen unhidden, things may have been shifted."""
    if goal.shape == "region":
        return goal
    return case.later(goal) or goal


def _something_at(old: SceneObject, scene: Scene, reach: float) -> bool:
    """Whether anything solid stands at an object's old place."""
    return any(
        float(np.linalg.norm((o.centre - old.centre)[:2])) < reach and o.bottom < old.top
        for o in scene.obstacles()
    )
