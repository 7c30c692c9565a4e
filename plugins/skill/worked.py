"""Worked: which thing a phrase means among those that have a lid, a handle or a cap."""

from __future__ import annotations

from dataclasses import replace

from gvla2.planning.contracts import Abstention
from gvla2.planning.scene import Scene, SceneObject
from gvla2.skills.meaning import workable
from gvla2_plugins.skill.grounding import Grounded, ground
from gvla2_plugins.skill.phrases import Phrase


def ground_worked(phrase: Phrase, scene: Scene) -> Grounded | Abstention:
    """The thing that a phrase means, looked for first among the things with a lid, a handle or a cap.

    "The box" then is the box and not its lid, which is called a box lid; where a part is named with its owner
    ("the lid of the red box") the owner's colour counts.
    """
    wholes, parts = workable(scene)
    if phrase.owner is not None and not isinstance(
        owner := ground(phrase.owner, _only(scene, wholes) if wholes else scene), Abstention
    ):
        kin = [owner.object, *scene.parts_of(owner.object.id)]
        part = ground(replace(phrase, owner=None), _only(scene, kin), movable=True)
        return part if isinstance(part, Grounded) else owner
    for pool in (wholes, parts):
        found = ground(phrase, _only(scene, pool), movable=True)
        if isinstance(found, Grounded):
            return found
        if found.kind == "ambiguous":
            return found
    return ground(phrase, scene, movable=True)


def _only(scene: Scene, things: list[SceneObject]) -> Scene:
    return replace(scene, objects=tuple(things))
