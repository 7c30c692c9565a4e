"""Mentions: where a wish speaks of things of the scene, and what the words before them say of their part in it.

"Put the knife on the block" speaks of the knife first and without a preposition: the knife is what is moved. What is
only spoken of as "into the block" or "out of the stand" is not. A language model that reads the words otherwise is
asked again.
"""

# ruff: noqa: SIM905 - word lists read best as words

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from gvla2.planning.calls import SkillCall
from gvla2.planning.colours import colour_words, meant_by
from gvla2.planning.scene import Scene, SceneObject
from gvla2.skills.parts import root_of

DETERMINERS = frozenset("the a an my your our his her its that this these those".split())
OPENERS = frozenset(
    "please now just then so and first next can could would will you i we want need like d ll to kindly robot hey ok "
    "let s go ahead".split()
)
"""Words before the verb of a wish."""
PLACES = frozenset(
    "on onto in into inside to towards toward over around beside behind under near at by with from off".split()
)
"""Prepositions: what follows one is not what is acted on, or need not be."""
ELSEWHERE = frozenset("into onto inside to towards toward beside behind under from".split())
"""Those after which a thing is where something goes or comes from, whatever the verb."""
GOALS = frozenset("on onto in into inside to towards toward over around".split())
"""Those after which a thing may be where something goes."""
MOVING = ("pick", "place", "push", "insert", "draw")
UNDOABLE = frozenset(
    "pour fill unfold wipe clean wash rinse dry cut slice chop saw halve peel break smash crush tear eat drink "
    "taste cook bake heat boil fry stir mix shake paint measure weigh count tie untie plug unplug squeeze bend "
    "throw toss hurl kick juggle read sing dance sew iron sharpen repair fix lock unlock change charge scrub wrap "
    "crumple sell buy".split()
)
"""What no hand does here by any skill; a model that may only call skills would do another thing instead."""
ACTING = frozenset(
    "pick lift raise hoist snatch hold heave scoop gather bring move grab grasp seize grip clutch get take fetch "
    "collect retrieve obtain give pass hand reach put set lay place drop deposit stack rest position deliver "
    "transfer carry relocate leave stow store park load pile arrange sort insert slip thread fit hang mount stick "
    "lower settle tuck pop push slide shove nudge sweep scoot shift drag propel steer guide drive poke press hit "
    "tap click switch turn light activate toggle flick open prise pry flip swing fold pull draw tug yank extract "
    "remove ease wiggle unscrew twist untwist uncap unseal rotate uncork loosen undo unfasten spin close shut "
    "seal cover belong go want need build tidy clear sit look off onto into up out down".split()
)
"""Words of acts that some skill may do; a wish without any of them is for another kind of robot."""
TOGETHER = re.compile(
    r"\b(?:both|two|all|every|each)\b.*\b(?:at the same time|simultaneously|together in the air)\b"
)
"""What one hand cannot do."""
NO_SKILL = re.compile(
    r"\b(?:turn|switch|power|put)\b(?=[^.,;]*\boff\b)[^.,;]*\b(?:light|lamp)s?\b"
    r"|\bin(?:to)? (?:two |equal |small )*(?:half|halves|pieces|slices)\b"
)
"""What no skill is for: switching off, and making several things of one."""
JOINTS = re.compile(r"[,;.:](?=\s*\w)|\b(?:and|then|after|afterwards|before|first|once|while)\b")
MANY = re.compile(
    r"\b(?:all|both|each|every|everything|them|others|rest|things|items|objects|pieces|toys|ones)\b"
)
IT = re.compile(r"\b(?:it|its)\b")
WITHOUT = re.compile(r"\bwithout \w+ing\b[^,.;]*?(?=[,.;]|\band\b|$)")
MOST = 6
"""Calls of a program that a small model may write, however much is wished for."""


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
    theme = _acted_on(said, scene)
    goal = next((m for m in said if m.after in GOALS and m is not theme), None)
    return {
        role: frozenset(o.id for o in scene.objects if root_of(o, scene).id in m.roots)
        for role, m in (("theme", theme), ("goal", goal))
        if m is not None
    }


def onto_itself(wish: str, scene: Scene) -> str:
    """The label of a whole thing that a wish speaks of as moved and as where it goes, so that another like it is
    missing here; "" where there is none.
    """
    roles = roles_said(wish, scene)
    if len(roles) == 2 and roles["theme"] == roles["goal"] and len(roles["theme"]) == 1:
        return scene[next(iter(roles["theme"]))].label
    return ""


def misread(calls: Sequence[SkillCall], wish: str, scene: Scene) -> tuple[str, frozenset[str]]:
    """Why calls do not act on what the wish speaks of as acted on, "" where they do; and the ids of whole things that
    they are to act on.
    """
    said = mentions(wish, scene)
    acted = _acted_on(said, scene)
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


def _acted_on(said: Sequence[Mention], scene: Scene) -> Mention | None:
    """The first that no preposition stands before and that may be moved: a painted patch is not."""
    moved = (m for m in said if not m.after and any(scene[root].shape != "region" for root in m.roots))
    return next(moved, None)


def asked(wish: str) -> str:
    """The wish in small letters without how it is not to be done: "without toppling the tower"."""
    return WITHOUT.sub(" ", wish.casefold())


def undoable(wish: str) -> str:
    """The verb of a clause that no skill does, or words that ask for two hands; "" where there is neither."""
    if together := TOGETHER.search(wish.casefold()):
        return together.group()
    for clause in re.split(r"[,;.:!?]|\b(?:and|then)\b", wish.casefold()):
        words: list[str] = [w for w in re.findall(r"[a-z]+", clause) if w not in OPENERS]
        if words and words[0] in UNDOABLE:
            return words[0]
    nothing = NO_SKILL.search(wish.casefold())
    return nothing.group() if nothing else ""


def acting(wish: str) -> bool:
    """Whether some word of a wish says an act that a skill may do, in any form of it."""
    endings = ("", "s", "es", "d", "ed", "ing")
    for word in re.findall(r"[a-z]+", wish.casefold()):
        stems = {word.removesuffix(end) for end in endings}
        stems |= {stem + "e" for stem in stems} | {stem[:-1] for stem in stems if stem[-2:-1] == stem[-1:]}
        if stems & ACTING:
            return True
    return False


def most_calls(wish: str, scene: Scene) -> int:
    """So many calls at most are what a wish can ask for: one more than it has joints, unless it is about many."""
    said = asked(wish)
    nouns = {noun_of(o) for o in scene.objects}
    if MANY.search(said) or any(w.endswith("s") and w[:-1] in nouns for w in re.findall(r"[a-z]+", said)):
        return MOST
    return min(MOST, 1 + len(JOINTS.findall(said)))


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
