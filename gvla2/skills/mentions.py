"""Mentions: where a wish speaks of things of the scene, and what the words before them say of their part in it.

"Put the knife on the block" speaks of the knife first and without a preposition: the knife is what is moved. What is
only spoken of as "into the block" or "out of the stand" is not.
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
"""Prepositions: what follows one is not what is acted on, or need not be."""
GOALS = frozenset("on onto in into inside to towards toward over around".split())
"""Those after which a thing may be where something goes."""
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
"""Verbs that say by which skill, where a program might do the like by another."""
WITHOUT = re.compile(r"\bwithout \w+ing\b[^,.;]*?(?=[,.;]|\band\b|$)")


@dataclass(frozen=True)
class Mention:
    """Some words of a wish: the whole things that they may mean, and the preposition before them, "" for none."""

    roots: frozenset[str]
    after: str = ""


def mentions(wish: str, scene: Scene) -> list[Mention]:
    """The things of the scene that a wish speaks of, in its order; by their nouns, by their colours or by both."""
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
    """The ids of the things, with their parts, that a wish speaks of as ``theme`` and as ``goal``; roles that it names
    nothing for are left out.
    """
    said = mentions(wish, scene)
    theme = acted_on(said, scene)
    goal = next((m for m in said if m.after in GOALS and m is not theme), None)
    return {
        role: frozenset(o.id for o in scene.objects if root_of(o, scene).id in m.roots)
        for role, m in (("theme", theme), ("goal", goal))
        if m is not None
    }


def acted_on(said: Sequence[Mention], scene: Scene) -> Mention | None:
    """The first that no preposition stands before and that may be moved: a painted patch is not."""
    moved = (m for m in said if not m.after and any(scene[root].shape != "region" for root in m.roots))
    return next(moved, None)


def asked(wish: str) -> str:
    """The wish in small letters without how it is not to be done: "without toppling the tower"."""
    return WITHOUT.sub(" ", wish.casefold())


def may_mean(skill: str, instruction: str) -> bool:
    """Whether the verbs of a wish leave room for a skill; they do where none of them says by which."""
    said = [acts for verb, acts in ACTS.items() if verb in asked(instruction).split()]
    return all(skill in acts for acts in said)


def _phrase(
    words: Sequence[str], begin: int, colours: dict[str, str], scene: Scene
) -> tuple[int, list[SceneObject]]:
    """Where the words about one thing that begin at ``begin`` end, and the things that fit them; none where none do."""
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
    """The preposition that stands before a phrase; "" where another word does."""
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
