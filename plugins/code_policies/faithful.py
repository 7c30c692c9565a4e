"""Faithfulness: where a program and the words of its wish go apart. Doubts are reasons to ask the model again."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from gvla2.planning.calls import SkillCall
from gvla2.planning.colours import colours_in
from gvla2.planning.scene import Scene, SceneObject
from gvla2.skills.parts import root_of

NEAR = 0.015
"""Things whose boxes are no farther apart touch, metres."""
MOVING = ("pick", "place", "push", "insert")
"""Skills that move a whole thing, where a part is named that comes off."""


@dataclass(frozen=True)
class Doubt:
    """One reason, for the program's author, and the names that another program should be ``about``: its first call
    handles one of them, or (``handled`` False) is about one of them in any role.
    """

    reason: str
    about: frozenset[str]
    handled: bool = False


def overlooked(
    calls: Sequence[SkillCall], instruction: str, scene: Scene, names: Mapping[str, str]
) -> list[Doubt]:
    """What the wish names and no call is about; a thing stands for its parts and for its whole.

    A colour whose bearers are all left out; a part that is named where its whole is moved; nothing that is named
    handled; and a goal that is named before what goes there.
    """
    return list(_doubts(calls, instruction, scene, names))


def _doubts(
    calls: Sequence[SkillCall], instruction: str, scene: Scene, names: Mapping[str, str]
) -> Iterator[Doubt]:
    used = {root_of(scene[i], scene).id for call in calls for i in (call.theme, call.goal) if i}
    words = re.findall(r"[a-z]+", instruction.casefold())
    for colour in dict.fromkeys(colours_in(instruction)):
        bearers = [o for o in scene.objects if o.colour == colour]
        if bearers and not any(root_of(o, scene).id in used for o in bearers):
            listed = [names[o.id] for o in bearers]
            yield Doubt(
                f"The task names something {colour}; use {' or '.join(listed)}.", _kin(bearers, scene, names)
            )
    for call in calls:
        parts = [p for p in scene.parts_of(call.theme) if _noun(p) in words and call.skill in MOVING]
        if parts and _noun(scene[call.theme]) != _noun(parts[0]):
            listed = [names[p.id] for p in parts]
            reason = f"The task names {' or '.join(listed)}, not all of {names[call.theme]}."
            yield Doubt(reason, frozenset(listed), handled=True)
    for thing in scene.objects:
        alike = [o for o in scene.objects if _noun(o) == _noun(thing)]
        if len(alike) > 1 or _noun(thing) not in words or root_of(thing, scene).id in used:
            continue
        if any(_touching(thing, scene[call.theme]) for call in calls):
            continue  # where it is taken from
        yield Doubt(f"The task names {names[thing.id]}; use it.", _kin([thing], scene, names))
    if len(calls) == 1 and calls[0].goal:
        theme, goal = scene[calls[0].theme], scene[calls[0].goal]
        first, second = _named_at(theme, scene, instruction), _named_at(goal, scene, instruction)
        if 0 <= second < first and goal.shape != "region":
            name = names[goal.id]
            yield Doubt(
                f"{name} is named first: it goes to {names[theme.id]}.", frozenset({name}), handled=True
            )


def _kin(things: Sequence[SceneObject], scene: Scene, names: Mapping[str, str]) -> frozenset[str]:
    """Their names, with those of their parts and wholes."""
    roots = {root_of(o, scene).id for o in things}
    return frozenset(names[o.id] for o in scene.objects if root_of(o, scene).id in roots)


def _touching(thing: SceneObject, other: SceneObject) -> bool:
    """Whether their upright boxes come closer than :data:`NEAR`."""
    (a, b), (c, d) = ((o.corners().min(axis=0), o.corners().max(axis=0)) for o in (thing, other))
    return bool((a - NEAR < d).all() and (c - NEAR < b).all())


def _noun(thing: SceneObject) -> str:
    """The last word of its label."""
    return (thing.label.casefold().split() or [""])[-1]


def _named_at(thing: SceneObject, scene: Scene, instruction: str) -> int:
    """Where the instruction names it, by a colour or noun that is its alone; -1 where it does not."""
    said = instruction.casefold()
    for word, alike in (
        (thing.colour, [o for o in scene.objects if o.colour == thing.colour]),
        (_noun(thing), [o for o in scene.objects if _noun(o) == _noun(thing)]),
    ):
        found = re.search(rf"\b{re.escape(word)}\b", said) if word else None
        if found and len(alike) == 1:
            return found.start()
    return -1
