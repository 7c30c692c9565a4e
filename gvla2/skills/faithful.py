"""Faithfulness: where a program and the words of its wish go apart. Doubts are reasons to ask the model again."""

# ruff: noqa: SIM905 - word lists read best as words

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from gvla2.planning.calls import SkillCall
from gvla2.planning.colours import FAMILIES, colour_words, meant_by
from gvla2.planning.contracts import Abstention
from gvla2.planning.scene import Scene, SceneObject
from gvla2.skills.parts import root_of

SELECTING = frozenset(
    "left right leftmost rightmost middle centre center near nearest far farthest furthest close closest front back "
    "behind beside between other another not except but only first second third last big bigger biggest small smaller "
    "smallest tall taller tallest short shorter shortest high higher highest low lower lowest any either both all each "
    "every one top bottom outer inner".split()
)
"""Words that may tell things of one kind apart, or say that it does not matter."""
EXCLUDING = frozenset(
    "except excluding not dont don doesn didn shouldn mustn without neither nor unless never only but leave keep "
    "instead rather if".split()
)
"""Words by which a wish rules something out or makes it depend, which small models read past."""
ACTS = {
    "push": ("push", "press"),
    "slide": ("push", "insert", "pull"),
    "shove": ("push",),
    "press": ("press",),
    "unscrew": ("twist", "open"),
    "twist": ("twist",),
    "close": ("close",),
    "shut": ("close",),
    "open": ("open", "twist", "pull"),
}
"""Verbs that say by which skill, where a program might do the like by another."""
NEAR = 0.015
"""Things whose boxes are no farther apart touch, metres."""


@dataclass(frozen=True)
class Named:
    """Something that a wish names.

    The ``reason`` why a program without it is doubtful, and the names of the scene that would be ``about`` it.
    ``handled``: one of them is what is to be moved. ``skills``: an act was named, by any of these.
    """

    reason: str
    about: frozenset[str]
    handled: bool = False
    skills: frozenset[str] = frozenset()

    def met(self, calls: Sequence[SkillCall], names: Mapping[str, str]) -> bool:
        """Whether one of the calls is about it."""
        if self.skills:
            return any(c.skill in self.skills for c in calls)
        return any(
            names[i] in self.about for c in calls for i in (c.theme, "" if self.handled else c.goal) if i
        )


def named_things(instruction: str, scene: Scene, names: Mapping[str, str]) -> list[Named]:
    """The colours, parts and things that the words of a wish name; a thing stands for its parts and its whole."""
    words = set(re.findall(r"[a-z]+", instruction.casefold()))
    found = [
        Named(f"The task says to {verb}.", frozenset(), skills=frozenset(acts))
        for verb, acts in ACTS.items()
        if verb in words
    ]
    for colour in _meant(instruction, scene):
        if bearers := [o for o in scene.objects if o.colour == colour]:
            listed = " or ".join(names[o.id] for o in bearers)
            found.append(Named(f"The task names something {colour}: {listed}.", _kin(bearers, scene, names)))
    for noun in sorted({_noun(o) for o in scene.objects} & words):
        alike = [o for o in scene.objects if _noun(o) == noun]
        if all(o.parent for o in alike):
            listed = " or ".join(names[o.id] for o in alike)
            found.append(Named(f"The task names {listed}.", frozenset(names[o.id] for o in alike)))
        elif len(alike) == 1:
            found.append(Named(f"The task names {names[alike[0].id]}.", _kin(alike, scene, names)))
    return found


def doubts(
    calls: Sequence[SkillCall], instruction: str, scene: Scene, names: Mapping[str, str]
) -> list[Named]:
    """What the wish names and no call is about, but for where the thing is taken from; and, last, a goal that is
    named before what goes there.
    """
    about = {names[i] for call in calls for i in _beside(call.theme, scene)}
    found = [
        n for n in named_things(instruction, scene, names) if not n.met(calls, names) and not n.about & about
    ]
    if len(calls) == 1 and calls[0].goal:
        theme, goal = scene[calls[0].theme], scene[calls[0].goal]
        first, second = _named_at(theme, scene, instruction), _named_at(goal, scene, instruction)
        if 0 <= second < first and goal.shape != "region":
            name = names[goal.id]
            found.append(
                Named(f"{name} is named first: it goes to {names[theme.id]}.", frozenset({name}), True)
            )
    return found


def colour_absent(instruction: str, scene: Scene) -> str:
    """A colour that the wish names and nothing in the scene can mean; "" where there is none, or a thing's colour is
    not known. What a label says ("orange juice") is there.
    """
    if not all(o.colour for o in scene.objects):
        return ""
    labels = " ".join(o.label.casefold() for o in scene.objects)
    present = {o.colour for o in scene.objects}
    for word in colour_words(instruction):
        shades = present & {word, *FAMILIES.get(word, ())}
        if not shades and not re.search(rf"\b{re.escape(word)}\b", labels):
            return word
    return ""


def ruled_out(instruction: str) -> str:
    """The first word of a wish that rules something out, "" where there is none."""
    words = re.findall(r"[a-z]+", instruction.casefold())
    return next((w for w in words if w in EXCLUDING), "")


def beyond(instruction: str, scene: Scene) -> Abstention | None:
    """Why a small model had better not be asked: words that it reads past, or a colour that is not there."""
    if word := ruled_out(instruction):
        message = (
            f"'{word}' may rule something out, which small models read past (planner.cautious=false tries)."
        )
        return Abstention("other", message)
    if colour := colour_absent(instruction, scene):
        return Abstention("nothing_matches", f"Nothing is {colour} (planner.cautious=false asks anyway).")
    return None


def unclear(calls: Sequence[SkillCall], instruction: str, scene: Scene) -> str:
    """Why it is not clear which of several things a wish means: it names their kind and nothing that tells them apart;
    "" where it is clear, or names no kind.
    """
    words = set(re.findall(r"[a-z]+", instruction.casefold()))
    if words & SELECTING or len(calls) != 1:
        return ""
    said = _meant(instruction, scene)
    for thing in (scene[i] for i in (calls[0].theme, calls[0].goal) if i):
        if _noun(thing) not in words:
            continue
        alike = [o for o in scene.objects if _noun(o) == _noun(thing) and o.shape == thing.shape]
        own = said.keys() & _colours(thing, scene)  # told apart by its colour, or by having none that is said
        told = [
            o for o in alike if (own & _colours(o, scene) if own else not said.keys() & _colours(o, scene))
        ]
        if len(told) > 1:
            return f"There are {len(told)} things called {_noun(thing)}: {', '.join(o.label for o in told)}."
    return ""


def _meant(instruction: str, scene: Scene) -> dict[str, None]:
    """The colours of the scene that the wish means, in its order: "blue" is the azure thing where none is blue."""
    present = [o.colour for o in scene.objects if o.colour]
    return dict.fromkeys(c for word in colour_words(instruction) if (c := meant_by(word, present)))


def _colours(thing: SceneObject, scene: Scene) -> set[str]:
    """Its colour and that of its whole."""
    return {thing.colour, root_of(thing, scene).colour}


def _beside(object_id: str, scene: Scene) -> list[str]:
    """Other whole things that touch it: it may be taken from there."""
    own = root_of(scene[object_id], scene).id
    return [
        o.id for o in scene.obstacles(frozenset({own})) if not o.parent and _touching(o, scene[object_id])
    ]


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
