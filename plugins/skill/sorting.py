"""Sorting: sentences that send several things to containers, read as one pair of thing and container each."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

from gvla2.planning.colours import FAMILIES, colour_distance
from gvla2.planning.contracts import Abstention
from gvla2.planning.scene import Scene, SceneObject
from gvla2.skills.chaining import is_container
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


def sorting(sentence: str, scene: Scene, spelling: float = 0.85) -> list[Pair] | Abstention | None:
    """The pairs of a sentence about several things, None for any other sentence."""
    tokens, _ = heard(sentence, [o.label for o in scene.objects], spelling)
    if not any(verbs_of(t) & GOING or t in GOING for t in tokens):
        return None
    many = bool(EACH & set(tokens)) or any(_plural(t) for t in tokens)
    if many and any(phrase_at(tokens, i, (*lexicon.NEGATIONS, "but")) for i in range(len(tokens))):
        return Abstention("other", "Which of several things are left out cannot be told; name each.")
    containers = [o for o in scene.objects if _holds_things(o)]
    things = [o for o in scene.objects if o.shape != "region" and not o.parent and o not in containers]
    if not containers or not things:
        return None
    if many and ALIKE.search(" ".join(tokens)):
        chosen = _chosen(tokens[: _into(tokens)], replace(scene, objects=tuple(things)))
        if isinstance(chosen, Abstention):
            return chosen
        return [
            (t, min(containers, key=lambda c: (c.colour != t.colour, colour_distance(t.rgb, c.rgb))))
            for t in chosen
        ]
    found: list[Pair] = []
    for segment in _segments(tokens):
        at = _into(segment)
        if at == len(segment) or not (EACH & set(segment[:at]) or any(_plural(t) for t in segment[:at])):
            return None
        where = read_phrase(segment[at + len(phrase_at(segment, at, INTO).split()) :])
        goal = ground(where, replace(scene, objects=tuple(containers)))
        if isinstance(goal, Abstention):
            return goal if ground(where, scene) == goal else None
        chosen = _chosen(segment[:at], replace(scene, objects=tuple(things)))
        if isinstance(chosen, Abstention):
            return chosen
        found += [(t, goal.object) for t in chosen]
    return found or None


def _holds_things(thing: SceneObject) -> bool:
    """Whether other things are put into it, by its shape or by what it is called."""
    named = {"container", "tray"} & {noun_class(word) for word in tokenise(thing.label)}
    return is_container(thing) or bool(named and thing.shape != "region" and not thing.parent)


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


def _plural(token: str) -> bool:
    return bool(noun_class(token) and token.endswith("s") and noun_class(token[:-1]))


def _chosen(tokens: Sequence[str], things: Scene) -> list[SceneObject] | Abstention:
    """The things that the words before the place mean, by colour and kind; declined where they say more."""
    kept = [t for t in tokens if t not in EACH | GOING and (not verbs_of(t) or noun_class(t))]
    colours = [t for t in kept if t in FAMILIES] or [""]
    what = read_phrase([t for t in kept if t not in FAMILIES])
    chosen = [o for colour in colours for o in ground_all(replace(what, colour=colour), things)]
    if chosen and not what.unknown and not what.kinds:
        return chosen
    return Abstention("nothing_matches", f"Nothing here is surely one of '{what.text}'.")
