"""What a verb means for the things it is said of: a lid on a jar is unscrewed, a ring goes over a post, and a hinged
lid that is put on its box is closed.
"""

from __future__ import annotations

from gvla2.planning.scene import Scene, SceneObject
from gvla2_plugins.skill.caps import cap_of, closed_by
from gvla2_plugins.skill.intents import Intent
from gvla2_plugins.skill.mechanisms import hinge_for
from gvla2_plugins.skill.schemas.insert import fits_over

OVER = ("on", "in", "to", "")
"""Relations in which a ring goes over a post."""


def unscrewed(skill: str, theme: SceneObject, scene: Scene) -> tuple[str, SceneObject]:
    """Twisting, and the cap, where something is opened that has one, or where a cap is to be taken away."""
    if skill in ("open", "twist") and (cap := cap_of(theme, scene)) is not None:
        return "twist", cap
    if skill in ("pick", "place", "pull", "draw") and closed_by(theme, scene) is not None:
        return "twist", theme
    return skill, theme


def fitted(intent: Intent, theme: SceneObject, goal: SceneObject, scene: Scene) -> str:
    """Inserting, where something with a hole goes to what fits through it; closing, where a hinged lid goes to its
    box; else the intent's own skill.
    """
    hinge = hinge_for(theme, scene) if intent.skill in ("place", "push") else None
    if hinge is not None and theme.id == hinge.lid.id and goal.id in hinge.parts:
        return "close"
    fits = intent.skill in ("place", "push") and intent.relation in OVER and fits_over(theme, goal)
    return "insert" if fits else intent.skill
