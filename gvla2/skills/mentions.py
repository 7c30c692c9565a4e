"""Mentions: the objects of the scene that a wish names, and the prepositions before them.

"Put the knife on the block" names the knife first and without a preposition: the knife is moved. Objects that are named
only as "into the block" or "out of the stand" are not.
"""

# ruff: noqa: SIM905 - word lists read best as words

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from gvla2.planning.colours import colour_words, meant_by
from gvla2.planning.scene import Scene, SceneObject
from gvla2.skills.parts import root_of

DETERMINERS = frozenset("the a an my your our his her its that this these those".split())
PLACES = frozenset(
    "on onto in into inside to towards toward over around beside behind under near at by with from off".split()
)
"""Prepositions: what follows one is not acted on, or need not be."""
GOALS = frozenset("on onto in into inside to towards toward over around".split())
"""Prepositions that may be followed by where something goes."""
PUT = ("place", "insert", "push", "twist", "close", "draw")
ACTS = {
    "push": ("push", "press"),
    "slide": ("push", "insert", "pull", "draw"),
    "shove": ("push",),
    "press": ("press",),
    "unscrew": ("twist", "open"),
    "twist": ("twist",),
    "close": ("close",),
    "shut": ("close",),
    "open": ("open", "twist", "pull"),
    **dict.fromkeys(("put", "place", "lay", "set", "stack", "belongs"), PUT),
}
"""Verbs that imply certain skills, although others might do something similar."""
WITHOUT = re.compile(r"\bwithout \w+ing\b[^,.;]*?(?=[,.;]|\band\b|$)")


@dataclass(frozen=True)
class Mention:
    """Some words of a wish: the ids of whole objects that they may mean, and the preposition before them, if any."""

    roots: frozenset[str]
    after: str = ""


def mentions(wish: str, scene: Scene) -> list[Mention]:
    """The objects that a wish names, in its order; by their nouns, their colours or both."""
    wish = asked(wish)
    words = re.findall(r"[a-z]+", wish)
    colours = {c: m for c in colour_words(wish) if (m := meant_by(c, (o.colour for o in scene.objects)))}
    found: list[Mention] = []
    begin = 0
    while begin < len(words):
        end, told = _phrase(words, begin, colours, scene)
        if told:
            roots = frozenset(root_of(o, scene).id for o in told)
            found.append(Mention(roots, _preposition(words[:begin])))
        begin = end
    return found


def roles_said(wish: str, scene: Scene) -> dict[str, frozenset[str]]:
    """The ids of the objects, with their parts, that a wish names as ``theme`` and as ``goal``, if it names any."""
    said = mentions(wish, scene)
    theme = acted_on(said, scene)
    goal = next((m for m in said if m.after in GOALS and m is not theme), None)
    return {
        role: frozenset(o.id for o in scene.objects if root_of(o, scene).id in m.roots)
        for role, m in (("theme", theme), ("goal", goal))
        if m is not None
    }


def acted_on(said: Sequence[Mention], scene: Scene) -> Mention | None:
    """The first mention without a preposition of something that can be moved, so not of a painted patch."""
    moved = (m for m in said if not m.after and any(scene[root].shape != "region" for root in m.roots))
    return next(moved, None)


def asked(wish: str) -> str:
    """The wish in lower case, without phrases such as "without toppling the tower"."""
    return WITHOUT.sub(" ", wish.casefold())


def may_mean(skill: str, instruction: str) -> bool:
    """Whether the verbs of a wish admit a skill; those that imply none admit any."""
    said = [acts for verb, acts in ACTS.items() if verb in asked(instruction).split()]
    return all(skill in acts for acts in said)


def _phrase(
    words: Sequence[str], begin: int, colours: dict[str, str], scene: Scene
) -> tuple[int, list[SceneObject]]:
    """The end of the noun phrase at ``begin``, and the objects that it fits, if any."""
    at, colour = begin, ""
    for width in (2, 1):
        if not colour and " ".join(words[begin : begin + width]) in colours:
            colour, at = colours[" ".join(words[begin : begin + width])], begin + width
    labelled = {word for o in scene.objects for word in o.label.casefold().split()} - {
        o.colour for o in scene.objects
    }
    last = at
    while last < len(words) and words[last] in labelled:
        last += 1
    nouns = set(words[at:last])
    if not nouns and not colour:
        return begin + 1, []
    fits = [o for o in scene.objects if not nouns or nouns <= set(o.label.casefold().split())]
    fits = [o for o in fits if not nouns or noun_of(o) == words[last - 1]] or fits
    fits = [o for o in fits if not colour or colour in (o.colour, root_of(o, scene).colour)] or fits
    return max(last, begin + 1), fits


def _preposition(before: Sequence[str]) -> str:
    """The preposition at the end of the words before a phrase; "" if there is none."""
    left = list(before)
    if left[-2:-1] and left[-2] in DETERMINERS and left[-1] not in PLACES:
        left.pop()  # "the jenga tower"
    while left and left[-1] in DETERMINERS:
        left.pop()
    if not left:
        return ""
    if left[-1] == "of":
        return "from" if left[-2:-1] in (["out"], ["off"]) else "onto" if left[-2:-1] == ["top"] else "of"
    return left[-1] if left[-1] in PLACES else ""


def noun_of(thing: SceneObject) -> str:
    """The last word of its label."""
    return (thing.label.casefold().split() or [""])[-1]
