"""Sorting: sentences that send several things to containers, read as one pair of thing and container each."""

# ruff: noqa: SIM905 - word lists read best as words

from __future__ import annotations

import re
from collections.abc import Sequence

from gvla2.planning.colours import colour_distance
from gvla2.planning.contracts import Abstention
from gvla2.planning.scene import Scene, SceneObject
from gvla2.skills.chaining import is_container
from gvla2_plugins.skill import lexicon
from gvla2_plugins.skill.clauses import phrase_at
from gvla2_plugins.skill.grounding import ground
from gvla2_plugins.skill.phrases import Phrase, read_phrase
from gvla2_plugins.skill.words import noun_class, spell, tokenise, verbs_of

MATCHING = frozenset(
    "same own matching match matches matched corresponding corresponds respective equal".split()
)
TINTS = frozenset("color colour colors colours coloured colored tint hue shade".split())
EACH = frozenset("all every each everything both".split())
INTO: tuple[str, ...] = ("into", "in to", "inside of", "inside", "in", "onto", "on to", "on", "to")
GOING = frozenset(lexicon.VERBS["place"]) | {
    "sort",
    "group",
    "separate",
    "distribute",
    "divide",
    "take",
    "get",
    "goes",
    "go",
    "belongs",
}
Pair = tuple[SceneObject, SceneObject]
"""A thing and the container that it goes into."""


def sorting(sentence: str, scene: Scene, spelling: float = 0.85) -> list[Pair] | Abstention | None:
    """The pairs of a sentence about several things, None for any other sentence."""
    known = frozenset(word for o in scene.objects for word in tokenise(o.label)) | MATCHING | EACH | GOING
    tokens, _ = spell(tokenise(sentence), spelling, known)
    if not any(verbs_of(t) & GOING or t in GOING for t in tokens):
        return None
    many = bool(EACH & set(tokens)) or any(_plural(t) for t in tokens)
    if many and any(phrase_at(tokens, i, (*lexicon.NEGATIONS, "but")) for i in range(len(tokens))):
        return Abstention(
            "other", "Which of several things are left out cannot be told with certainty; name each."
        )
    containers = [o for o in scene.objects if _holds_things(o)]
    things = [o for o in scene.objects if _loose(o, containers)]
    if not containers or not things:
        return None
    if (by_colour := _by_colour(tokens, things, containers)) is not None:
        return by_colour
    found: list[tuple[SceneObject, SceneObject]] = []
    for segment in _segments(tokens):
        pairs = _segment(segment, things, containers, scene)
        if pairs is None:
            return None
        if isinstance(pairs, Abstention):
            return pairs
        found += pairs
    return found or None


def _holds_things(thing: SceneObject) -> bool:
    """Whether other things are put into it, by its shape or by what it is called."""
    names = {noun_class(word) for word in tokenise(thing.label)}
    named = thing.shape != "region" and not thing.parent and bool(names & {"container", "tray"})
    return named or is_container(thing)


def _loose(thing: SceneObject, containers: Sequence[SceneObject]) -> bool:
    held = {c.id for c in containers}
    return thing.shape != "region" and not thing.parent and thing.id not in held


def _by_colour(
    tokens: Sequence[str], things: Sequence[SceneObject], containers: Sequence[SceneObject]
) -> list[tuple[SceneObject, SceneObject]] | None:
    """Each thing with the container that is most like it, where the sentence says that colours are to agree."""
    said = set(tokens)
    text = " ".join(tokens)
    owned = re.search(
        r"\b(?:its|their|by|with the|according to(?: the| their)?) (?:own )?(?:colou?rs?)\b", text
    )
    if not (said & TINTS and (said & MATCHING or owned)) and not (
        "sort" in text and re.search(r"by colou?r", text)
    ):
        return None
    into = min((i for i in range(len(tokens)) if phrase_at(tokens, i, INTO)), default=len(tokens))
    named = {lexicon.COLOUR_WORDS[t] for t in tokens[:into] if t in lexicon.COLOUR_WORDS}
    chosen = [t for t in things if not named or t.colour in named] or list(things)
    return [(t, min(containers, key=lambda c: _unlike(t, c))) for t in chosen]


def _unlike(thing: SceneObject, container: SceneObject) -> float:
    if thing.colour and thing.colour == container.colour:
        return 0.0
    return 1.0 + float(colour_distance(tuple(thing.rgb), tuple(container.rgb)))


def _segments(tokens: Sequence[str]) -> list[list[str]]:
    """The sentence cut where a new "these things there" begins: at "and", "then" and stops after a place was named."""
    segments: list[list[str]] = [[]]
    placed = False
    for i, token in enumerate(tokens):
        if token in ("and", "then", ",", ";", ".", "while"):
            if placed:
                segments.append([])
                placed = False
            continue
        placed = placed or bool(phrase_at(tokens, i, INTO))
        segments[-1].append(token)
    return [s for s in segments if s]


def _segment(
    tokens: Sequence[str], things: Sequence[SceneObject], containers: Sequence[SceneObject], scene: Scene
) -> list[tuple[SceneObject, SceneObject]] | Abstention | None:
    """The pairs of one segment; None when it is not about several things, or goes to no container."""
    at = next((i for i in range(len(tokens)) if phrase_at(tokens, i, INTO)), 0)
    if not at:
        return None
    before = [t for t in tokens[:at] if not verbs_of(t) or noun_class(t)]
    after = list(tokens[at + len(phrase_at(tokens, at, INTO).split()) :])
    plural = any(_plural(t) for t in before)
    if not plural and not EACH & set(before):
        return None
    what = read_phrase([t for t in before if t not in EACH])
    goal = ground(read_phrase(after), Scene(tuple(containers), scene.table_height, scene.workspace))
    if isinstance(goal, Abstention):
        return goal if ground(read_phrase(after), scene) == goal else None
    chosen = [t for t in things if _means(what, t)]
    if not chosen:
        return Abstention("nothing_matches", f"Nothing here is one of '{what.text}'.")
    return [(t, goal.object) for t in chosen]


def _plural(token: str) -> bool:
    return bool(noun_class(token) and token.endswith("s") and noun_class(token[:-1]))


def _means(what: Phrase, thing: SceneObject) -> bool:
    if what.colour and thing.colour != what.colour:
        return False
    if not what.noun or what.noun == "object":
        return True
    return what.noun in {noun_class(word) for word in tokenise(thing.label)} or bool(
        lexicon.SHAPES.get(what.noun, {}).get(thing.shape, 0.0) > 0.7
    )
