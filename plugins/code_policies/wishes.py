"""Wishes as a whole: whether some skill may do what is asked for, and by how many calls at most."""

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
MOST = 6
"""Calls of a program that a small model may write, however much is wished for."""


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
