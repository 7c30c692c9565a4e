"""Wishes as a whole: whether some skill can fulfil them, and how many calls they need at most."""

# ruff: noqa: SIM905 - word lists read best as words

from __future__ import annotations

import re

from gvla2.planning.scene import Scene
from gvla2.skills.mentions import asked, noun_of

OPENERS = frozenset(
    "please now just then so and first next can could would will you i we want need like d ll to kindly robot hey ok "
    "let s go ahead".split()
)
"""Words before the verb of a wish."""
UNDOABLE = frozenset(
    "pour fill unfold wipe clean wash rinse dry cut slice chop saw halve peel break smash crush tear eat drink "
    "taste cook bake heat boil fry stir mix shake paint measure weigh count tie untie plug unplug squeeze bend "
    "throw toss hurl kick juggle read sing dance sew iron sharpen repair fix lock unlock change charge scrub wrap "
    "crumple sell buy".split()
)
"""Verbs without a skill: a model that can only call skills would do something else instead."""
ACTING = frozenset(
    "pick lift raise hoist snatch hold heave scoop gather bring move grab grasp seize grip clutch get take fetch "
    "collect retrieve obtain give pass hand reach put set lay place drop deposit stack rest position deliver "
    "transfer carry relocate leave stow store park load pile arrange sort insert slip thread fit hang mount stick "
    "lower settle tuck pop push slide shove nudge sweep scoot shift drag propel steer guide drive poke press hit "
    "tap click switch turn light activate toggle flick open prise pry flip swing fold pull draw tug yank extract "
    "remove ease wiggle unscrew twist untwist uncap unseal rotate uncork loosen undo unfasten spin close shut "
    "seal cover belong go want need build tidy clear sit look off onto into up out down".split()
)
"""Words for what some skill may do; a wish without any of them is for another kind of robot."""
TOGETHER = re.compile(
    r"\b(?:both|two|all|every|each)\b.*\b(?:at the same time|simultaneously|together in the air)\b"
)
"""Wishes that need two hands."""
NO_SKILL = re.compile(
    r"\b(?:turn|switch|power|put)\b(?=[^.,;]*\boff\b)[^.,;]*\b(?:light|lamp)s?\b"
    r"|\bin(?:to)? (?:two |equal |small )*(?:half|halves|pieces|slices)\b"
)
"""Further wishes without a skill: switching a lamp off, and dividing an object."""
JOINTS = re.compile(r"[,;.:](?=\s*\w)|\b(?:and|then|after|afterwards|before|first|once|while)\b")
MANY = re.compile(
    r"\b(?:all|both|each|every|everything|them|others|rest|things|items|objects|pieces|toys|ones)\b"
)
MOST = 6
"""Most calls in a small model's program, whatever the wish."""


def undoable(wish: str) -> str:
    """The verb of a clause without a skill, or words that ask for two hands; "" if there are none."""
    if together := TOGETHER.search(wish.casefold()):
        return together.group()
    for clause in re.split(r"[,;.:!?]|\b(?:and|then)\b", wish.casefold()):
        words: list[str] = [w for w in re.findall(r"[a-z]+", clause) if w not in OPENERS]
        if words and words[0] in UNDOABLE:
            return words[0]
    nothing = NO_SKILL.search(wish.casefold())
    return nothing.group() if nothing else ""


def acting(wish: str) -> bool:
    """Whether a word of a wish, in any inflection, is an act that some skill may do."""
    endings = ("", "s", "es", "d", "ed", "ing")
    for word in re.findall(r"[a-z]+", wish.casefold()):
        stems = {word.removesuffix(end) for end in endings}
        stems |= {stem + "e" for stem in stems} | {stem[:-1] for stem in stems if stem[-2:-1] == stem[-1:]}
        if stems & ACTING:
            return True
    return False


def most_calls(wish: str, scene: Scene) -> int:
    """The most calls that a wish can need: one more than it has joints, unless it is about many objects."""
    said = asked(wish)
    nouns = {noun_of(o) for o in scene.objects}
    if MANY.search(said) or any(w.endswith("s") and w[:-1] in nouns for w in re.findall(r"[a-z]+", said)):
        return MOST
    return min(MOST, 1 + len(JOINTS.findall(said)))
