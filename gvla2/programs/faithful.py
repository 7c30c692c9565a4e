"""Faithfulness: differences between a program and the words of its wish, as reasons to ask the model again."""

# ruff: noqa: SIM905 - word lists read best as words

from __future__ import annotations

import re
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass

from gvla2.planning.calls import SkillCall
from gvla2.planning.colours import FAMILIES, colour_words, meant_by
from gvla2.planning.contracts import Abstention
from gvla2.planning.scene import Scene, SceneObject
from gvla2.programs.misreading import misread, onto_itself
from gvla2.programs.wishes import acting, undoable
from gvla2.skills.mentions import ACTS, PUT, asked, mentions, noun_of
from gvla2.skills.parts import root_of
from gvla2.skills.wording import may_name

SELECTING = frozenset(
    "left right leftmost rightmost middle centre center near nearest far farthest furthest close closest front back "
    "behind beside between other another not except but only first second third last big bigger biggest small smaller "
    "smallest tall taller tallest short shorter shortest high higher highest low lower lowest any either both all each "
    "every one top bottom outer inner".split()
)
"""Words that may distinguish objects of one kind, or say that any will do."""
OTHER = re.compile(r"\b(?:the other|another|that|this) one\b")
EXCLUDING = frozenset(
    "except excluding not dont don doesn didn shouldn mustn without neither nor unless never only but leave keep "
    "instead rather if".split()
)
"""Words of exclusions and conditions, which small models overlook."""
HARMLESS = re.compile(
    r"\bif (?:you (?:can|could|would|don't mind|please|like|want)|possible|needed)\b|\bwithout \w+ing\b"
    r"|\b(?:leave|keep) (?:it|them) (?:on|in|at|up|there|beside|next|onto|into|inside|behind)\b|\bif i may\b"
)
"""Phrases with such words that exclude nothing, or something that the checks prevent anyway."""
UNLIFTED = re.compile(r"\bwithout (?:lifting|picking|raising|grasping|grabbing|carrying|taking)\b")
LIFTED = frozenset(("pick", "draw", "pull", "open", "twist"))
SPEAKERS = re.compile(r"\bmy (?:\w+ )?(?:left|right|side|end)\b")
"""Places relative to the speaker, whose position is unknown."""
RAISED = re.compile(
    r"^(?!.*\b(?:on|onto|on to|in|into|over|beside|next to)\b).*\b(?:lift|raise|hoist|heave)\b"
)
"""A wish to lift without a place to put the object."""
TAKEN_THERE = re.compile(r"\b(?:move|bring|carry|transfer|take|get)\b[^.;]*\b(?:onto|into)\b")
NEAR = 0.015
"""Objects whose boxes are closer touch, metres."""


@dataclass(frozen=True)
class Named:
    """Something that a wish names.

    ``reason`` is why a program without it is doubtful, ``about`` are the scene's names of the objects that it may mean.
    ``handled``: one of them must be moved. ``skills``: any of these fulfils a named act.
    """

    reason: str
    about: frozenset[str]
    handled: bool = False
    skills: frozenset[str] = frozenset()

    def met(self, calls: Sequence[SkillCall], names: Mapping[str, str]) -> bool:
        """Whether one of the calls has it."""
        if self.skills:
            return any(c.skill in self.skills for c in calls)
        return any(
            names[i] in self.about for c in calls for i in (c.theme, "" if self.handled else c.goal) if i
        )


def named_things(instruction: str, scene: Scene, names: Mapping[str, str]) -> list[Named]:
    """The acts, colours, parts and objects that a wish names; an object stands for its parts and its whole."""
    words = set(re.findall(r"[a-z]+", asked(instruction)))
    found = [
        Named(f"The task says to {verb}.", frozenset(), skills=frozenset(acts))
        for verb, acts in ACTS.items()
        if verb in words
    ]
    if UNLIFTED.search(instruction.casefold()):
        found.append(Named("The task says not to lift it.", frozenset(), skills=frozenset(("push", "pull"))))
    if RAISED.search(asked(instruction)):
        found.append(Named("The task says to lift it, not where to put it.", frozenset(), skills=LIFTED))
    if TAKEN_THERE.search(asked(instruction)):
        found.append(Named("The task says where it goes.", frozenset(), skills=frozenset(PUT)))
    for colour in _meant(instruction, scene):
        if bearers := [o for o in scene.objects if o.colour == colour]:
            listed = " or ".join(names[o.id] for o in bearers)
            found.append(Named(f"The task names something {colour}: {listed}.", _kin(bearers, scene, names)))
    for noun in sorted({noun_of(o) for o in scene.objects} & words):
        alike = [o for o in scene.objects if noun_of(o) == noun]
        if all(o.parent for o in alike):
            listed = " or ".join(names[o.id] for o in alike)
            found.append(Named(f"The task names {listed}.", frozenset(names[o.id] for o in alike)))
        elif len(alike) == 1:
            found.append(Named(f"The task names {names[alike[0].id]}.", _kin(alike, scene, names)))
    return found


def doubts(
    calls: Sequence[SkillCall], instruction: str, scene: Scene, names: Mapping[str, str]
) -> list[Named]:
    """What the wish names and no call has, except where the object is taken from; last, if a wrong object is moved."""
    about = {names[i] for call in calls for i in _beside(call.theme, scene)}
    if RAISED.search(asked(instruction)):  # objects after a preposition only say where the thing is
        told = [m for m in mentions(instruction, scene) if m.after]
        about |= {names[o.id] for m in told for o in scene.objects if root_of(o, scene).id in m.roots}
    found = [
        n for n in named_things(instruction, scene, names) if not n.met(calls, names) and not n.about & about
    ]
    why, wanted = misread(calls, instruction, scene)
    if why:
        moved = frozenset(names[o.id] for o in scene.objects if root_of(o, scene).id in wanted)
        found.append(Named(why, moved, True))
    return found


def theme_held(call: SkillCall, scene: Scene, names: Mapping[str, str]) -> Named:
    """The object that a call moves, its parts and its whole, to be kept if only the rest of a program is doubtful."""
    return Named("", _kin([scene[call.theme]], scene, names), handled=True)


def colour_absent(instruction: str, scene: Scene) -> str:
    """A colour in the wish that no object has; "" if there is none, or if some object's colour is unknown. Colours in
    labels ("orange juice") count.
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
    """The first word of a wish that excludes something; "" if there is none."""
    words = re.findall(r"[a-z]+", HARMLESS.sub(" ", instruction.casefold()))
    return next((w for w in words if w in EXCLUDING), "")


def beyond(instruction: str, scene: Scene) -> Abstention | None:
    """Why a small model should not be asked: words that it overlooks, a colour that no object has, a verb without a
    skill, or nothing that is there; None if it may be asked.
    """
    if SPEAKERS.search(instruction.casefold()):
        return Abstention("ambiguous", "Where the speaker stands is not known.")
    if verb := undoable(instruction):
        return Abstention("unknown_skill", f"No skill does '{verb}' (planner.cautious=false asks anyway).")
    if not acting(instruction):
        return Abstention("unknown_skill", "No act is asked for (planner.cautious=false asks anyway).")
    if word := ruled_out(instruction):
        message = (
            f"'{word}' may rule something out, which small models read past (planner.cautious=false tries)."
        )
        return Abstention("other", message)
    if colour := colour_absent(instruction, scene):
        return Abstention("nothing_matches", f"Nothing is {colour} (planner.cautious=false asks anyway).")
    if alone := onto_itself(instruction, scene):
        return Abstention("nothing_matches", f"There is only one {alone} here.")
    if not may_name(instruction, scene):
        return Abstention(
            "nothing_matches", "It names nothing that is here (planner.cautious=false asks anyway)."
        )
    return None


def unclear(
    calls: Sequence[SkillCall], instruction: str, scene: Scene, able: Container[str] | None = None
) -> str:
    """Why it is unclear which of several objects a wish means: it names their kind but nothing that distinguishes them.

    "" if it is clear, or if the wish names no kind. ``able`` are the ids of the objects that the skill applies to, if
    known.
    """
    words = set(re.findall(r"[a-z]+", instruction.casefold()))
    if len(calls) != 1:
        return ""
    if OTHER.search(instruction.casefold()) and not words & SELECTING - {"other", "one", "another"}:
        alike = [o for o in scene.objects if not o.parent and o.shape == scene[calls[0].theme].shape]
        if len(alike) > 1 and not mentions(instruction, scene):
            return f"Which one is meant of {', '.join(o.label for o in alike)} is not said."
    if words & SELECTING:
        return ""
    said = _meant(instruction, scene)
    for thing in (scene[i] for i in (calls[0].theme, calls[0].goal) if i):
        if noun_of(thing) not in words:
            continue
        alike = [o for o in scene.objects if noun_of(o) == noun_of(thing) and o.shape == thing.shape]
        own = said.keys() & _colours(thing, scene)  # distinguished by its colour, or by lacking those named
        told = [
            o for o in alike if (own & _colours(o, scene) if own else not said.keys() & _colours(o, scene))
        ]
        if able is not None and thing.id == calls[0].theme:
            told = [o for o in told if o.id in able]
        if len(told) > 1:
            listed = ", ".join(o.label for o in told)
            return f"There are {len(told)} things called {noun_of(thing)}: {listed}."
    return ""


def _meant(instruction: str, scene: Scene) -> dict[str, None]:
    """The colours of the scene that the wish means, in its order: "blue" is an azure object if none is blue."""
    present = [o.colour for o in scene.objects if o.colour]
    return dict.fromkeys(c for word in colour_words(asked(instruction)) if (c := meant_by(word, present)))


def _colours(thing: SceneObject, scene: Scene) -> set[str]:
    """Its colour and that of its whole."""
    return {thing.colour, root_of(thing, scene).colour}


def _beside(object_id: str, scene: Scene) -> list[str]:
    """Other whole objects that touch it: it may be taken from there."""
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
