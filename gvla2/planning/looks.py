"""Whose lessons they are: things that look alike are taken to behave alike, until they show otherwise.

How far a cap must be turned, or how deep a button goes, cannot be seen. What can be seen is that this lid is the gray
one of the red jars; what was learnt on those holds for it before what was learnt on others.
"""

from __future__ import annotations

from collections.abc import Iterable

from gvla2.planning.effects import Effect
from gvla2.planning.scene import Scene, SceneObject

ON = " on "
"""Between the colour of a part and that of its whole, as a look has them."""


def look_of(thing: SceneObject | None, scene: Scene) -> str:
    """What a thing looks like, in colour words: "red", or "gray on red" for a part of something red.

    "" for no thing, or where its colour is not known. Colours, not labels: the noun depends on the view.
    """
    if thing is None or not thing.colour:
        return ""
    known = {other.id: other for other in scene.objects}
    whole, seen = thing, {thing.id}
    while whole.parent in known and whole.parent not in seen:
        whole = known[whole.parent]
        seen.add(whole.id)
    return thing.colour if whole is thing or not whole.colour else f"{thing.colour}{ON}{whole.colour}"


def own_first(effects: Iterable[Effect], look: str) -> tuple[Effect, ...]:
    """The effects that count for a thing of this look.

    What was learnt on things that look like it replaces what was learnt on others, parameter by parameter and skill by
    skill; where there is nothing of its own, the others' is the best guess. Effects of no particular thing stay.
    """
    given = tuple(effects)
    own = [(one.parameter, one.skill) for one in given if look and one.object == look]

    def replaced(effect: Effect) -> bool:
        return any(
            effect.parameter == name and ("" in (effect.skill, skill) or effect.skill == skill)
            for name, skill in own
        )

    return tuple(one for one in given if one.object in ("", look) or not replaced(one))
