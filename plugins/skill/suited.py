"""Suited: which skill a verb means for this very thing, and which thing a phrase means among those that can be worked.

"Open" says what is to come of it, not how: a lid on a hinge is swung, a drawer is pulled, a cap is turned. And what is
held between other things cannot be lifted, whatever the verb: it is drawn out.
"""

from __future__ import annotations

from dataclasses import replace

from gvla2.planning.contracts import Abstention
from gvla2.planning.scene import Scene, SceneObject
from gvla2_plugins.skill.grounding import Grounded, ground
from gvla2_plugins.skill.mechanisms import classes, hinge_for, hinges, slide_for, slides
from gvla2_plugins.skill.phrases import Phrase
from gvla2_plugins.skill.stuck import stuck
from gvla2_plugins.skill.wholes import holders, inside

WORKED = ("open", "close", "pull", "twist")
"""Verbs that ask for something to be worked; :func:`suited` tells how."""


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
            return "twist" if _threaded(theme, scene) else "open"
    if skill == "close" and hinge_for(theme, scene) is None and slide_for(theme, scene) is not None:
        return "shut"
    if skill in ("pick", "place", "pull") and stuck(theme, scene) is not None:
        return "draw"
    if skill == "pick" and (hinge := hinge_for(theme, scene)) is not None and theme.id == hinge.lid.id:
        return "open"
    return skill


def ground_worked(phrase: Phrase, scene: Scene) -> Grounded | Abstention:
    """The thing that a phrase means, looked for first among the things with a lid, a handle or a cap.

    "The box" then is the box and not its lid, which is called a box lid; where a part is named with its owner
    ("the lid of the red box") the owner's colour counts.
    """
    wholes, parts = workable(scene)
    if phrase.owner is not None and not isinstance(
        owner := ground(phrase.owner, _only(scene, wholes) if wholes else scene), Abstention
    ):
        kin = [o for o in scene.objects if o.id == owner.object.id or _above(o, owner.object.id, scene)]
        part = ground(replace(phrase, owner=None), _only(scene, kin), movable=True)
        return part if isinstance(part, Grounded) else owner
    for pool in (wholes, parts):
        found = ground(phrase, _only(scene, pool), movable=True)
        if isinstance(found, Grounded):
            return found
        if found.kind == "ambiguous":
            return found
    return ground(phrase, scene, movable=True)


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
        if _threaded(thing, scene):
            (parts if thing.parent else wholes)[thing.id] = thing
    return list(wholes.values()), [p for p in parts.values() if p.id not in wholes]


def _threaded(theme: SceneObject, scene: Scene) -> bool:
    """A round lid or cap, or what one is on."""
    caps = [o for o in scene.objects if "lid" in classes(o) and o.shape in ("cylinder", "disc")]
    return any(theme.id in (cap.id, cap.parent) for cap in caps)


def _above(thing: SceneObject, ancestor: str, scene: Scene) -> bool:
    parents = {o.id: o.parent for o in scene.objects}
    at, seen = thing.parent, set[str]()
    while at and at not in seen:
        if at == ancestor:
            return True
        seen.add(at)
        at = parents.get(at, "")
    return False


def _only(scene: Scene, things: list[SceneObject]) -> Scene:
    return replace(scene, objects=tuple(things))
