"""What a call means for a given object: the skill that does it, and the part or whole that it acts on.

"Open" names the result, not the motion: a hinged lid is swung, a drawer is pulled, a cap is turned. An object held
between others cannot be lifted, only drawn out. And placing a lid on its own box closes it. All this is inferred from
the scene's geometry.
"""

from __future__ import annotations

from dataclasses import dataclass

from gvla2.planning.calls import SkillCall
from gvla2.planning.contracts import Abstention
from gvla2.planning.scene import Scene, SceneObject
from gvla2.skills.mechanisms import hinge_for, slide_for
from gvla2.skills.parts import button_of, cap_of, closed_by, is_lid, root_of
from gvla2.skills.schemas.insert import fits_over
from gvla2.skills.stuck import stuck
from gvla2.skills.wholes import holders, inside

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
    if call.skill == "press":
        button = button_of(theme, scene)
        if button is None:
            return Abstention(
                "nothing_matches",
                f"The {theme.label} cannot be pressed and does not have exactly one button.",
            )
        return Meant("press", button)
    skill = suited(call.skill, theme, scene, aimed=goal is not None or call.xy is not None)
    skill, theme = unscrewed(skill, theme, scene)
    if skill == "twist" and closed_by(theme, scene) is None and not is_lid(theme, scene):
        return Abstention("nothing_matches", f"The {theme.label} is not a cap, and no cap is visible on it.")
    if goal is not None:
        skill = fitted(skill, theme, goal, call.relation, scene)
        if skill == "close":
            return Meant(skill, theme)
    return Meant(skill, theme, goal)


def suited(skill: str, theme: SceneObject, scene: Scene, *, aimed: bool = False) -> str:
    """The skill that does to ``theme`` what ``skill`` asks for; ``skill`` itself if the scene suggests no other.

    ``aimed``: the object is to end elsewhere, so it is not a part that stays in place.
    """
    if aimed and skill == "pull" and stuck(theme, scene) is not None:
        return "draw"
    if skill == "pull" and any(inside(theme, holder) for holder in holders(theme, scene)):
        return "pick"  # up, out of what it stands in, even if it has a handle
    if skill in ("open", "pull"):
        if (hinge := hinge_for(theme, scene)) is not None and (skill == "open" or theme.id == hinge.lid.id):
            return "open"
        if slide_for(theme, scene) is not None:
            return "pull"
        if skill == "open":
            return "twist" if threaded(theme, scene) else "open"
    if skill in ("pick", "place", "pull") and stuck(theme, scene) is not None:
        return "draw"
    if skill == "pick":
        if (hinge := hinge_for(theme, scene)) is not None and theme.id == hinge.lid.id:
            return "open"
        if (slide := slide_for(theme, scene)) is not None and slide.body is not None and theme.parent:
            return "pull"  # a drawer stays in its cabinet
    return skill


def unscrewed(skill: str, theme: SceneObject, scene: Scene) -> tuple[str, SceneObject]:
    """Twisting and the cap, if something closed by a cap is opened, or if a cap is taken away; else the arguments."""
    if skill in ("open", "twist") and (cap := cap_of(theme, scene)) is not None:
        return "twist", cap
    if skill in ("pick", "place", "pull", "draw") and closed_by(theme, scene) is not None:
        return "twist", theme
    return skill, theme


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


def threaded(theme: SceneObject, scene: Scene) -> bool:
    """Whether it is a round lid or cap, or has one."""
    caps = [o for o in scene.objects if o.shape in ("cylinder", "disc") and is_lid(o, scene)]
    return any(theme.id in (cap.id, cap.parent) for cap in caps)


def whole_meant(theme: SceneObject, scene: Scene) -> SceneObject:
    """The whole that moves if a part is named; the part itself if it only stands in the whole."""
    above = scene.whole_of(theme)
    if above is None or (inside(theme, above) and above in holders(theme, scene)):
        return theme
    return root_of(theme, scene)
