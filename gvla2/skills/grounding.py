"""Grounding of calls in a scene: which are refused, which objects a skill applies to, which skill a call means.

"Open" names the result, not the motion: a hinged lid is swung, a drawer is pulled, a cap is turned. An object held
between others cannot be lifted, only drawn out. And placing a lid on its own box closes it. All this is inferred from
geometry. The rules for which objects a skill applies to are generous: an impossible call is refused with its reason by
:func:`gvla2.skills.carry_out.carry_out`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches

import numpy as np

from gvla2.errors import did_you_mean
from gvla2.planning.arm import Hand
from gvla2.planning.calls import SkillCall
from gvla2.planning.contracts import Abstention
from gvla2.planning.part_hierarchy import (
    assembled,
    button_of,
    called,
    cap_of,
    closed_by,
    holders,
    inside,
    is_ajar,
    is_button,
    is_lid,
    knob_of,
    root_of,
)
from gvla2.planning.scene import Scene, SceneObject
from gvla2.planning.skill import Skill
from gvla2.skills.grasps import has_hold
from gvla2.skills.mechanisms import door_for, hinge_for, slide_for, stuck
from gvla2.skills.schemas.pick_place import fits_over

OVER = ("on", "in", "to", "")
"""Relations by which a ring can be put over a post."""


@dataclass(frozen=True)
class Meant:
    """The name of the skill, its theme, and its goal if it has one."""

    skill: str
    theme: SceneObject
    goal: SceneObject | None = None


def meant(call: SkillCall, scene: Scene) -> Meant | Abstention:
    """The meaning of a standard call; an abstention if the skill does not apply to the object."""
    theme = scene[call.theme]
    goal = scene[call.goal] if call.goal else None
    knob = knob_of(theme, scene) if call.skill in ("press", "twist") else None
    if knob is not None and (call.skill == "twist" or button_of(theme, scene) is None):
        return Meant("twist", knob)
    if call.skill == "press":
        button = button_of(theme, scene)
        if button is None:
            return Abstention(
                "nothing_matches",
                f"The {theme.label} cannot be pressed and does not have exactly one button.",
            )
        return Meant("press", button)
    if call.skill in ("open", "close", "pull"):
        moving = [p for p in scene.parts_of(theme.id) if is_ajar(p) is not None]
        fit = [p for p in moving if is_ajar(p) == (call.skill == "close")] if len(moving) > 1 else moving
        if moving and len(fit) != 1:
            names = ", ".join(p.label for p in moving)
            return Abstention("ambiguous", f"The {theme.label} has {names}; say which to {call.skill}.")
        theme = fit[0] if fit else theme
    skill = suited(call.skill, theme, scene, aimed=goal is not None or call.xy is not None)
    if skill in ("open", "twist") and (cap := cap_of(theme, scene)) is not None:
        skill, theme = "twist", cap
    elif skill in ("pick", "place", "pull", "draw") and closed_by(theme, scene) is not None:
        skill = "twist"
    if skill == "twist" and closed_by(theme, scene) is None and not is_lid(theme, scene):
        return Abstention("nothing_matches", f"The {theme.label} is not a cap, and no cap is visible on it.")
    if goal is not None:
        skill = fitted(skill, theme, goal, call.relation, scene)
        if skill == "close":
            return Meant(skill, theme)
    return Meant(skill, theme, goal)


def turned(call: SkillCall, knob: SceneObject, on: bool | None = None) -> SkillCall:
    """The call that turns a knob ``on``, as far as it goes, or off, back to where it began; to the other if None.

    The call's own ``turn``, if it has one, stays.
    """
    joint = knob.joint
    if joint is None:
        return call
    on = joint.position < 0.5 * joint.reach if on is None else on
    turn = (joint.reach if on else 0.0) - joint.position
    return replace(call, skill="twist", theme=knob.id, theta={"turn": turn, **call.theta})


def suited(skill: str, theme: SceneObject, scene: Scene, *, aimed: bool = False) -> str:
    """The skill that does to ``theme`` what ``skill`` asks for; ``skill`` itself if the scene suggests no other.

    ``aimed``: the object is to end elsewhere, so it is not a part that stays in place.
    """
    if aimed and skill == "pull" and stuck(theme, scene) is not None:
        return "draw"
    if skill == "pull" and any(inside(theme, holder) for holder in holders(theme, scene)):
        return "pick"  # up, out of what it stands in, even if it has a handle
    if skill in ("open", "pull"):
        if door_for(theme, scene) is not None:
            return "open"
        if (hinge := hinge_for(theme, scene)) is not None and (skill == "open" or theme.id == hinge.lid.id):
            return "open"
        if slide_for(theme, scene) is not None:
            return "pull"
        if skill == "open":
            caps = [o for o in scene.objects if o.shape in ("cylinder", "disc") and is_lid(o, scene)]
            return "twist" if any(theme.id in (cap.id, cap.parent) for cap in caps) else "open"
    if skill in ("pick", "place", "pull") and stuck(theme, scene) is not None:
        return "draw"
    if skill == "pick":
        if (hinge := hinge_for(theme, scene)) is not None and theme.id == hinge.lid.id:
            return "open"
        if (slide := slide_for(theme, scene)) is not None and slide.body is not None and theme.parent:
            return "pull"  # a drawer stays in its cabinet
    return skill


def fitted(skill: str, theme: SceneObject, goal: SceneObject, relation: str, scene: Scene) -> str:
    """Inserting, if the theme has a hole that fits over the goal; closing, if a hinged lid is put on its box; else the
    skill itself.
    """
    if skill not in ("place", "push"):
        return skill
    hinge = hinge_for(theme, scene)
    if hinge is not None and theme.id == hinge.lid.id and goal.id in hinge.parts:
        return "close"
    return "insert" if relation in OVER and fits_over(theme, goal) else skill


def whole_meant(theme: SceneObject, scene: Scene) -> SceneObject:
    """The whole that moves if a part is named; the part itself if it only stands in the whole."""
    above = scene.whole_of(theme)
    if above is None or (inside(theme, above) and above in holders(theme, scene)):
        return theme
    return root_of(theme, scene)


RESTING = 0.02
"""Greatest height above the table of the bottom of an object that can be pushed, metres."""
BUTTON = 0.06
"""Greatest width of a button that is no part, metres."""


def themes(skill: Skill, scene: Scene, hand: Hand) -> tuple[SceneObject, ...]:
    """The objects to which the skill applies, in the scene's order; never painted patches."""
    solid = (o for o in scene.objects if o.shape != "region")
    return tuple(o for o in solid if skill.fits is None or skill.fits(o, scene, hand))


def goals(skill: Skill, theme: SceneObject, scene: Scene) -> tuple[SceneObject, ...]:
    """The objects that can be the skill's goal with this theme; () for a skill without a goal.

    Not the theme itself, its parts or its whole, nor what it stands in.
    """
    if skill.role("goal") is None:
        return ()
    kin = scene.family(root_of(theme, scene).id)
    if skill.name == "insert":
        return tuple(o for o in scene.objects if o.id not in kin and fits_over(theme, o))
    about = {h.id for h in holders(theme, scene) if inside(theme, h)}
    return tuple(o for o in scene.objects if o.id not in kin | about)


def fits_pick(obj: SceneObject, scene: Scene, hand: Hand) -> bool:
    """A whole object, or a cap, that can be moved and that fits between the fingers."""
    if obj.parent and closed_by(obj, scene) is None:
        return False
    if fits_close(obj, scene, hand) or (is_button(obj, scene) and obj.parent):
        return False
    return stuck(obj, scene) is not None or has_hold(assembled(obj, scene), hand)


def fits_press(obj: SceneObject, scene: Scene, hand: Hand) -> bool:
    """A button or knob, or something with one; if a part is labelled a button, no other part."""
    if knob_of(obj, scene) is not None:
        return True
    kin = scene.parts_of(root_of(obj, scene).id)
    if is_button(obj, scene) and not called(obj, "button") and any(called(p, "button") for p in kin):
        return False
    return button_of(obj, scene) is not None and (
        bool(scene.parts_of(obj.id)) or float(max(obj.extents[:2])) < BUTTON
    )


def fits_close(obj: SceneObject, scene: Scene, hand: Hand) -> bool:
    """Something with a hinge or a slide."""
    return (
        door_for(obj, scene) is not None
        or hinge_for(obj, scene) is not None
        or slide_for(obj, scene) is not None
    )


FITS: Mapping[str, Callable[[SceneObject, Scene, Hand], bool]] = {
    "pick": fits_pick,
    "place": fits_pick,
    "push": lambda obj, scene, hand: not obj.parent and obj.bottom - scene.table_height < RESTING,
    "press": fits_press,
    "twist": lambda obj, scene, hand: bool(cap_of(obj, scene) or knob_of(obj, scene)),
    "insert": lambda obj, scene, hand: any(
        fits_over(obj, post) for post in scene.objects if post.id != obj.id
    ),
    "open": lambda obj, scene, hand: fits_close(obj, scene, hand) or cap_of(obj, scene) is not None,
    "close": fits_close,
    "pull": lambda obj, scene, hand: slide_for(obj, scene) is not None,
    "draw": lambda obj, scene, hand: stuck(obj, scene) is not None,
}
"""Whether a standard skill applies to an object, by the skill's name; see :attr:`gvla2.planning.skill.Skill.fits`."""


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


def still_held(call: SkillCall, following: SkillCall, scene: Scene) -> Abstention | None:
    """The refusal of a call that would begin with another object in the hand: the one of the call before it."""
    what, theme = meant(call, scene), scene[call.theme]
    taken = isinstance(what, Meant) and what.skill in ("pick", "twist", "draw") and theme.joint is None
    put = call.goal or call.xy is not None or call.direction is not None
    if not taken or put or root_of(scene[following.theme], scene) is root_of(theme, scene):
        return None
    message = f"The {theme.label} would still be in the hand; ask for one at a time."
    return Abstention("other", message)


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
            hint = did_you_mean(name, own or ranges)
            return Abstention("other", f"There is no parameter '{name}'.{hint} There are {there}.")
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
