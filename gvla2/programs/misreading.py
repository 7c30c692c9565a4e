"""Misreading: calls that act on other objects than the wish says."""

# ruff: noqa: SIM905 - word lists read best as words

from __future__ import annotations

import re
from collections.abc import Sequence

from gvla2.planning.calls import SkillCall
from gvla2.planning.scene import Scene
from gvla2.skills.mentions import acted_on, mentions, roles_said
from gvla2.skills.parts import root_of

ELSEWHERE = frozenset("into onto inside to towards toward beside behind under from".split())
"""Prepositions after which a thing is where something goes or comes from, whatever the verb."""
MOVING = ("pick", "place", "push", "insert", "draw")
IT = re.compile(r"\b(?:it|its)\b")


def onto_itself(wish: str, scene: Scene) -> str:
    """The label of an object that is the wish's theme and its goal, because a second one is missing; "" if none is."""
    roles = roles_said(wish, scene)
    if len(roles) == 2 and roles["theme"] == roles["goal"] and len(roles["theme"]) == 1:
        return scene[next(iter(roles["theme"]))].label
    return ""


def misread(calls: Sequence[SkillCall], wish: str, scene: Scene) -> tuple[str, frozenset[str]]:
    """Why calls act on a wrong object, "" if they do not; and the ids of the whole objects that they should act on."""
    said = mentions(wish, scene)
    acted = acted_on(said, scene)
    themes = {root_of(scene[c.theme], scene).id for c in calls}
    if acted is not None and not themes & acted.roots:
        return "The task first names what is to be moved, and it is something else.", acted.roots
    spoken = frozenset[str]().union(*(m.roots for m in said))
    if acted is not None and IT.search(wish.casefold()):
        for call in calls:
            if call.skill in MOVING and root_of(scene[call.theme], scene).id not in spoken:
                return f"The task does not speak of the {scene[call.theme].label}.", acted.roots
    plain = frozenset[str]().union(*(m.roots for m in said if m.after not in ELSEWHERE))
    for call in calls:
        theme = scene[call.theme]
        aside = not theme.parent and theme.id not in plain and any(m.roots == {theme.id} for m in said)
        if aside and call.skill in MOVING:
            others = frozenset(o.id for o in scene.objects if not o.parent and o is not theme)
            return f"The {theme.label} is only where something goes or comes from.", others
    return "", frozenset()
