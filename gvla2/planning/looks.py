"""Lessons by look: things that look alike are assumed to behave alike, until proven otherwise.

How far a cap must be turned, or how deep a button goes, cannot be seen; that it is the gray lid of a red jar can. For
such a lid, lessons from gray lids of red jars take precedence over all others.
"""

from __future__ import annotations

from collections.abc import Iterable

from gvla2.planning.effects import Effect
from gvla2.planning.scene import Scene, SceneObject

ON = " on "
"""Separates the colours of a part and its whole in a look."""


def look_of(thing: SceneObject | None, scene: Scene) -> str:
    """A thing's look in colour words: "red", or "gray on red" for a part of something red.

    "" for no thing, or if its colour is unknown. Colours, not labels: the noun depends on the view.
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
    """The effects that apply to a thing of this look.

    Lessons from things that look like it replace lessons from others, per parameter and skill; without any, the others'
    are the best guess. Effects without a look stay.
    """
    given = tuple(effects)
    own = [(one.parameter, one.skill) for one in given if look and one.object == look]

    def replaced(effect: Effect) -> bool:
        return any(
            effect.parameter == name and ("" in (effect.skill, skill) or effect.skill == skill)
            for name, skill in own
        )

    return tuple(one for one in given if one.object in ("", look) or not replaced(one))
