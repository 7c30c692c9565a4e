"""Sorting: sentences that send several things to containers, read as one pair of thing and container each."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

from gvla2.planning.colours import FAMILIES, colour_distance
from gvla2.planning.contracts import Abstention
from gvla2.planning.scene import Scene, SceneObject
from gvla2.skills.multi_step import is_container
from gvla2_plugins.skill import lexicon
from gvla2_plugins.skill.clauses import phrase_at
from gvla2_plugins.skill.grammar import heard
from gvla2_plugins.skill.grounding import ground, ground_all
from gvla2_plugins.skill.phrases import read_phrase
from gvla2_plugins.skill.words import noun_class, tokenise, verbs_of

EACH = lexicon.EACH - {"any", "anything"}
INTO = (*lexicon.RELATIONS["in"], "onto", "on to", "on", "to", "by")
GOING = frozenset((*lexicon.VERBS["place"], *lexicon.SORTING, "take", "get", "goes", "go", "belongs"))
ALIKE = re.compile(
    r"\b(same|own|match\w*|correspond\w*|respective|its|their|with the|according to(?: the)?) (?:own )?colou?rs?\b"
    r"|\bcolou?rs? (?:match\w*|agrees?)\b|\bsort\w*\b.*\bby colou?r\b"
)
"""Wordings that send each thing to the container of its colour."""

Pair = tuple[SceneObject, SceneObject]


def sorting(sentence: str, scene: Scene) -> list[Pair] | Abstention | None:
    """The pairs of a sentence about several things, None for any other sentence."""
    tokens = heard(sentence, [o.label for o in scene.objects])
    if not _several(tokens) or not any(verbs_of(t) & GOING or t in GOING for t in tokens):
        return None
    if any(phrase_at(tokens, i, (*lexicon.NEGATIONS, "but")) for i in range(len(tokens))):
        return Abstention("other", "Which of several things are left out cannot be told; name each.")
    named = [o for o in scene.objects if {"container", "tray"} & {*map(noun_class, tokenise(o.label))}]
    whole = [o for o in scene.objects if o.shape != "region" and not o.parent]
    containers = [o for o in whole if o in named or is_container(o)]
    things = replace(scene, objects=tuple(o for o in whole if o not in containers))
    if not containers or not things.objects:
        return None
    alike = ALIKE.search(" ".join(tokens))
    found: list[Pair] = []
    for segment in [tokens] if alike else _segments(tokens):
        at, goal = _into(segment), None
        if not alike and (at == len(segment) or not _several(segment[:at])):
            return None
        if not alike:
            where = read_phrase(segment[at + len(phrase_at(segment, at, INTO).split()) :])
            goal = ground(where, replace(scene, objects=tuple(containers)))
            if isinstance(goal, Abstention) and where.noun in ("container", "tray"):  # a flat bin is a tray
                goal = ground(replace(where, noun="object"), replace(scene, objects=tuple(containers)))
        if isinstance(goal, Abstention):
            return goal if ground(where, scene) == goal else None
        chosen = _chosen(segment[:at], things)
        if isinstance(chosen, Abstention):
            return chosen
        found += [(t, goal.object if goal else _nearest(t, containers)) for t in chosen]
    return found or None


def _nearest(thing: SceneObject, containers: Sequence[SceneObject]) -> SceneObject:
    """The container that looks most like a thing."""
    return min(containers, key=lambda c: (c.colour != thing.colour, colour_distance(thing.rgb, c.rgb)))


def _into(tokens: Sequence[str]) -> int:
    return next((i for i in range(len(tokens)) if phrase_at(tokens, i, INTO)), len(tokens))


def _segments(tokens: Sequence[str]) -> list[list[str]]:
    """The sentence cut where a new "these things there" begins: at "and", "then" and stops after a place was named."""
    segments: list[list[str]] = [[]]
    for token in tokens:
        if token not in ("and", "then", ",", ";", ".", "while"):
            segments[-1].append(token)
        elif _into(segments[-1]) < len(segments[-1]):
            segments.append([])
    return [s for s in segments if s]


def _several(tokens: Sequence[str]) -> bool:
    """Whether it names more than one thing: "every cube", "the cubes"."""
    return any(t in EACH or (t.endswith("s") and noun_class(t) and noun_class(t[:-1])) for t in tokens)


def _chosen(tokens: Sequence[str], things: Scene) -> list[SceneObject] | Abstention:
    """The things that the words before the place mean, by colour and kind; declined where they say more."""
    kept = [t for t in tokens if t not in EACH | GOING and (not verbs_of(t) or noun_class(t))]
    colours = [t for t in kept if t in FAMILIES] or [""]
    what = read_phrase([t for t in kept if t not in FAMILIES])
    chosen = [o for colour in colours for o in ground_all(replace(what, colour=colour), things)]
    if chosen and not what.unknown and not what.kinds:
        return chosen
    return Abstention("nothing_matches", f"Nothing here is surely one of '{what.text}'.")
