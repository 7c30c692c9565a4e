"""Validation of calls before planning: unknown names, goals that make no sense, numbers out of range, no room."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from difflib import get_close_matches

import numpy as np

from gvla2.planning.calls import SkillCall
from gvla2.planning.contracts import Abstention
from gvla2.planning.part_hierarchy import closed_by, holders, inside
from gvla2.planning.scene import Scene, SceneObject
from gvla2.planning.skill import Skill
from gvla2.skills.mechanisms import stuck


def unknown(calls: Sequence[SkillCall], scene: Scene, skills: Mapping[str, Skill]) -> Abstention | None:
    """The refusal of an unknown skill or object, with those that exist; None if all exist."""
    if not calls:
        return Abstention("other", "The program has no calls, so there is nothing to do.")
    ids = {o.id for o in scene.objects}
    for call in calls:
        if call.skill not in skills:
            close = get_close_matches(call.skill, skills, n=1)
            hint = f" Did you mean '{close[0]}'?" if close else ""
            return Abstention(
                "unknown_skill", f"There is no skill '{call.skill}'.{hint} Skills: {', '.join(skills)}."
            )
        for name in (call.theme, *([call.goal] if call.goal else [])):
            if name not in ids:
                known = ", ".join(f"{o.id} ({o.label})" for o in scene.objects) or "nothing"
                return Abstention(
                    "nothing_matches", f"There is no object '{name}' to {call.skill}; the scene has: {known}."
                )
    return None


def nonsense(call: SkillCall, scene: Scene, skills: Mapping[str, Skill]) -> Abstention | None:
    """The refusal of a call that is meaningless for any object; its skill must be in ``skills``."""
    theme, goal, message = scene[call.theme], scene[call.goal] if call.goal else None, ""
    if theme.shape == "region":
        message = f"The {theme.label} is painted on the table; '{call.skill}' does not apply to it."
    elif goal is theme:
        message = f"The {theme.label} cannot be its own goal. Name another object."
    elif goal in scene.parts_of(theme.id):
        message = f"The {call.goal} is a part of the {theme.label}, so not a goal for it."
    elif call.amount is not None and call.amount <= 0.0:
        message = f"An amount must be positive; {call.amount:g} m was asked for."
    elif call.direction is not None and np.linalg.norm(call.direction) < 1e-6:
        message = "A direction must not be (0, 0)."
    return Abstention("other", message) if message else wrong_parameters(call.theta, skills, call.skill)


def unaimed(call: SkillCall, skill: Skill, scene: Scene) -> Abstention | None:
    """The refusal of a missing, superfluous or wrong goal or amount; ``skill`` is what the call means for its theme."""
    role, message = skill.role("goal"), ""
    spot_in_goal = bool(call.goal) and call.xy is not None and call.relation in ("on", "in")
    given = [bool(call.goal), call.xy is not None and not spot_in_goal, call.direction is not None]
    if any(given) and (role is None or (not skill.free and any(given[1:]))):
        aimed = "a goal" if call.goal else "a place" if call.xy is not None else "a direction"
        message = f"'{skill.name}' does not take {aimed}; its signature is {skill.signature()}."
    elif call.amount is not None and not skill.amount and call.direction is None:
        what = "an amount only with a direction ('10 cm to the right')" if skill.free else "no amount"
        message = f"'{skill.name}' takes {what}; {call.amount:g} m was asked for."
    elif sum(given) > 1:
        message = "Only one of goal, place and direction can say where an object goes."
    elif role and call.relation and not call.goal:
        message = f"The relation '{call.relation}' needs a goal."
    elif call.relation and role and role.relations and call.relation not in role.relations:
        there = ", ".join(role.relations)
        message = f"'{skill.name}' does not have the relation '{call.relation}'; it has {there}."
    if not message and role is not None and role.required and not any(given):
        example = "name a goal or a direction, such as 'onto the red square' or '10 cm to the left'"
        where = f"Where to {skill.name} the {scene[call.theme].label} is not said; {example}."
        return Abstention("no_goal", where)
    return Abstention("other", message) if message else None


def wrong_parameters(
    values: Mapping[str, float], skills: Mapping[str, Skill], skill: str = ""
) -> Abstention | None:
    """The refusal of a parameter that no skill has or that is out of its range; None if all are right.

    They may be another skill's than ``skill``: opening a drawer means pulling it.
    """
    own = {p.name: p for p in skills[skill].parameters} if skill else {}
    ranges = {p.name: p for each in skills.values() for p in each.parameters} | own
    for name, value in values.items():
        if name not in ranges:
            there = ", ".join(own or ranges)
            return Abstention("other", f"There is no parameter '{name}'; there are {there}.")
        least, most = ranges[name].least, ranges[name].most
        if not least <= value <= most:
            unit = f" {ranges[name].unit}" if ranges[name].unit else ""
            return Abstention(
                "other", f"{name} is {value:g}{unit}; it may be from {least:g} to {most:g}{unit}."
            )
    return None


SLACK = 0.002
"""Error of perceived sizes that is allowed when an object is to go through an opening, metres."""


def no_room(theme: SceneObject, goal: SceneObject, relation: str, scene: Scene) -> Abstention | None:
    """The refusal of a goal that the object is in already, or that it cannot go into; None if it can."""
    if relation in ("in", "on", "to", "") and goal.id in _rests_in(theme, scene):
        return Abstention("no_goal", f"The {theme.label} is in the {goal.label} already.")
    why = _kept_out(theme, goal) if relation == "in" else ""
    return Abstention("no_goal", why) if why else None


def _rests_in(obj: SceneObject, scene: Scene) -> set[str]:
    """The ids of what it stands in, sticks in or closes."""
    held = stuck(obj, scene)
    on = {obj.parent} if closed_by(obj, scene) is not None else set()
    return on | {h.id for h in holders(obj, scene) if inside(obj, h)} | set(held.holders if held else ())


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
