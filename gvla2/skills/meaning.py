"""What a call means for this very thing: the skill that does it, the part or the whole that it is done to.

"Open" says what is to come of it, not how: a lid on a hinge is swung, a drawer is pulled, a cap is turned. What is held
between other things cannot be lifted, whatever was called: it is drawn out. And a lid put on its own box is closed.
All is told from the scene's geometry.
"""

from __future__ import annotations

from dataclasses import dataclass

from gvla2.planning.calls import SkillCall
from gvla2.planning.contracts import Abstention
from gvla2.planning.scene import Scene, SceneObject
from gvla2.skills.mechanisms import hinge_for, hinges, slide_for, slides
from gvla2.skills.parts import button_of, cap_of, closed_by, is_lid, root_of
from gvla2.skills.schemas.insert import fits_over
from gvla2.skills.stuck import stuck
from gvla2.skills.wholes import holders, inside

OVER = ("on", "in", "to", "")
"""Relations in which a ring goes over a post."""


@dataclass(frozen=True)
class Meant:
    """The skill by name, and what it is done to and leads to; ``goal`` None where there is none."""

    skill: str
    theme: SceneObject
    goal: SceneObject | None = None


def meant(call: SkillCall, scene: Scene) -> Meant | Abstention:
    """The meaning of a standard call on a thing of the scene; a refusal where the thing is not for that."""
    theme = scene[call.theme]
    goal = scene[call.goal] if call.goal else None
    if call.skill == "press":
        button = button_of(theme, scene)
        if button is None:
            return Abstention(
                "nothing_matches", f"The {theme.label} is nothing to press, and has no one button."
            )
        return Meant("press", button)
    skill = suited(call.skill, theme, scene, aimed=goal is not None or call.xy is not None)
    skill, theme = unscrewed(skill, theme, scene)
    if skill == "twist" and closed_by(theme, scene) is None and not is_lid(theme, scene):
        return Abstention(
            "nothing_matches", f"The {theme.label} is no cap, and none is seen on it to unscrew."
        )
    if goal is not None:
        skill = fitted(skill, theme, goal, call.relation, scene)
        if skill == "close":
            return Meant(skill, theme)
    return Meant(skill, theme, goal)


def suited(skill: str, theme: SceneObject, scene: Scene, *, aimed: bool = False) -> str:
    """The skill that does to ``theme`` what ``skill`` asks for; the same one where the scene does not tell.

    ``aimed``: it is to end somewhere else, so it is no part that stays where it is, whatever it looks like.
    """
    if aimed and skill == "pull" and stuck(theme, scene) is not None:
        return "draw"
    if skill == "pull" and any(inside(theme, holder) for holder in holders(theme, scene)):
        return "pick"  # up, out of what it stands in, also where it has a handle
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
    """Twisting, and the cap, where something is opened that has one, or where a cap is to be taken away."""
    if skill in ("open", "twist") and (cap := cap_of(theme, scene)) is not None:
        return "twist", cap
    if skill in ("pick", "place", "pull", "draw") and closed_by(theme, scene) is not None:
        return "twist", theme
    return skill, theme


def fitted(skill: str, theme: SceneObject, goal: SceneObject, relation: str, scene: Scene) -> str:
    """Inserting, where something with a hole goes to what fits through it; closing, where a hinged lid goes to its
    box; else the skill itself.
    """
    if skill not in ("place", "push"):
        return skill
    hinge = hinge_for(theme, scene)
    if hinge is not None and theme.id == hinge.lid.id and goal.id in hinge.parts:
        return "close"
    return "insert" if relation in OVER and fits_over(theme, goal) else skill


def threaded(theme: SceneObject, scene: Scene) -> bool:
    """A round lid or cap, or what one is on."""
    caps = [o for o in scene.objects if o.shape in ("cylinder", "disc") and is_lid(o, scene)]
    return any(theme.id in (cap.id, cap.parent) for cap in caps)


def workable(scene: Scene) -> tuple[list[SceneObject], list[SceneObject]]:
    """The whole things of the scene that have something to be worked, and their parts that are worked."""
    wholes: dict[str, SceneObject] = {}
    parts: dict[str, SceneObject] = {}
    for hinge in hinges(scene):
        parts[hinge.lid.id] = hinge.lid
        if hinge.body is not None:
            wholes[hinge.body.id] = hinge.body
    for slide in slides(scene):
        wholes[slide.front.id] = slide.front
        for thing in (slide.handle, slide.body):
            if thing is not None:
                parts[thing.id] = thing
    for thing in scene.objects:
        if threaded(thing, scene):
            (parts if thing.parent else wholes)[thing.id] = thing
    return list(wholes.values()), [p for p in parts.values() if p.id not in wholes]


def whole_meant(theme: SceneObject, scene: Scene) -> SceneObject:
    """The whole that is moved when a part is named that cannot be moved by itself; what only stands in it can."""
    above = scene.whole_of(theme)
    if above is None or (inside(theme, above) and above in holders(theme, scene)):
        return theme
    return root_of(theme, scene)
