"""From phrases to scene objects: which one is meant, or a typed reason why none is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from gvla2.planning.colours import COLOURS, colour_distance, nearest_colours
from gvla2.planning.contracts import Abstention
from gvla2.planning.scene import Scene, SceneObject
from gvla2.planning.selecting import extreme, located
from gvla2.skills.parts import is_button
from gvla2_plugins.skill import lexicon
from gvla2_plugins.skill.phrases import Phrase
from gvla2_plugins.skill.words import noun_class, tokenise, verbs_of

TIE = 0.9
"""Objects that fit this share of the best fit are as good as the best: only a selector parts them."""
NEAR_COLOUR = 0.7
PART = 0.6
"""What is left of a fit where a part of a thing is to be any thing."""
BETWEEN, LEEWAY = 25.0, 2.2
"""A colour that is further from every word is between them: a word up to so many times as far may be meant."""


@dataclass(frozen=True)
class Grounded:
    """The object meant, how well it fits in [0, 1], and what had to be assumed."""

    object: SceneObject
    score: float
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Fit:
    object: SceneObject
    score: float
    near_colour: bool = False


def ground(
    phrase: Phrase, scene: Scene, *, movable: bool = False, exclude: frozenset[str] = frozenset()
) -> Grounded | Abstention:
    """The one object of the scene that a phrase means.

    ``movable`` leaves painted regions out; ``exclude`` are ids it cannot be. Abstains with ``nothing_matches`` or
    ``ambiguous``.
    """
    pool = [o for o in scene.objects if o.id not in exclude and not (movable and o.shape == "region")]
    noun = "block" if movable and phrase.noun == "target" else phrase.noun  # "lift the red square"
    fits = [_Fit(o, score) for o in pool if (score := _noun_score(phrase, noun, o)) > 0]
    kinds = {*phrase.unknown, *phrase.kinds}
    fits = [f for f in fits if kinds and not _strange(phrase, f.object)] or fits
    if phrase.owner is not None and fits:
        return _single(phrase, _owned(phrase, phrase.owner, fits, scene), scene)
    return _single(phrase, _of_owners(phrase, fits, scene) or _colour_filter(phrase.colour, fits), scene)


def ground_all(phrase: Phrase, scene: Scene) -> tuple[SceneObject, ...]:
    """All things of a scene that a phrase means, parts too: "the red ones", "the lids". Empty where nothing fits."""
    fits = [_Fit(o, score) for o in scene.objects if (score := _noun_score(phrase, phrase.noun, o)) > 0]
    fits = _colour_filter(phrase.colour, fits)
    best = max((f.score for f in fits), default=0.0)
    return tuple(f.object for f in fits if f.score >= TIE * best)


def part_named(scene: Scene, thing: SceneObject, noun: str) -> SceneObject | None:
    """The part of a thing that is called by a noun class ("handle", "lid"), the highest of several, or None."""
    named = [part for part in scene.parts_of(thing.id) if noun in _label_classes(part)]
    return max(named, key=lambda part: part.top, default=None)


def _of_owners(phrase: Phrase, fits: Sequence[_Fit], scene: Scene) -> list[_Fit]:
    """Where no part has the colour that is named, those whose owner has it: "the red lid" is that of the red jar."""
    if not phrase.colour or phrase.noun not in lexicon.PARTS:
        return []
    if any(f.object.colour == phrase.colour for f in fits):
        return []
    owners = {o.id for o in scene.objects if o.colour == phrase.colour}
    return [f for f in fits if f.object.parent in owners]


def _owned(phrase: Phrase, owner: Phrase, fits: Sequence[_Fit], scene: Scene) -> list[_Fit]:
    """The fits that belong to the owner; a colour may be the owner's where no part has it ("the red jar lid")."""
    coloured = _colour_filter(phrase.colour, fits)
    at = ground(owner, scene)
    if isinstance(at, Abstention) and phrase.colour and not owner.colour:
        at = ground(replace(owner, colour=phrase.colour), scene)
        coloured = list(fits)
    if isinstance(at, Abstention):
        return coloured
    own = {part.id for part in scene.parts_of(at.object.id)}
    return [f for f in coloured if f.object.id in own] or [f for f in fits if f.object.id in own] or coloured


def ground_button(phrase: Phrase | None, scene: Scene) -> Grounded | Abstention:
    """The button that a phrase means, also where the phrase names the lamp that the button works."""
    phrase = phrase or Phrase("")
    other = [o for o in scene.objects if set(phrase.unknown) & set(tokenise(o.label))]
    if other and not any(_button_score(o, scene) for o in other):
        return Abstention("nothing_matches", f"'{other[0].label}' is nothing to press; {_inventory(scene)}.")
    buttons = [_Fit(o, s) for o in scene.objects if (s := _button_score(o, scene)) > 0]
    if phrase.noun not in ("button", "lamp", "object", "") or (phrase.unknown and not phrase.noun):
        found = ground(phrase, scene, movable=True)
        if isinstance(found, Grounded) and not any(b.object.id == found.object.id for b in buttons):
            return Abstention(
                "nothing_matches", f"'{found.object.label}' is nothing to press; {_inventory(scene)}."
            )
        return found
    owners = [o for o in scene.objects if "lamp" in _label_classes(o)]
    of_lamp = [b for b in buttons if b.object.parent in {o.id for o in owners}]
    if (phrase.noun == "lamp" or (phrase.owner and phrase.owner.noun == "lamp")) and of_lamp:
        buttons = of_lamp
    coloured = _colour_filter(phrase.colour, buttons)
    if phrase.noun == "lamp" and not coloured and phrase.colour:
        # "the red lamp": the colour may be the lamp's instead of its button's.
        red = {f.object.id for f in _colour_filter(phrase.colour, [_Fit(o, 1.0) for o in owners])}
        coloured = [b for b in buttons if b.object.parent in red]
    return _single(phrase if phrase.text else Phrase("a button"), coloured, scene)


def _noun_score(phrase: Phrase, noun: str, thing: SceneObject) -> float:
    """How well the phrase's noun fits an object, in [0, 1]: by its label first, then by its shape."""
    sure = 0.9 + 0.1 * thing.confidence
    if not noun:
        if phrase.unknown and phrase.unknown[-1] in tokenise(thing.label):
            return sure
        anything = not phrase.unknown and not phrase.everywhere
        return 0.8 * sure * (PART if thing.parent else 1.0) if anything else 0.0
    classes = _label_classes(thing)
    if noun in classes:
        own = [w for w in tokenise(thing.label)[:-1] if w not in lexicon.COLOUR_WORDS and not verbs_of(w)]
        other_kind = _strange(phrase, thing) and bool(own)  # a knife block is no jenga block
        return 0.0 if other_kind else sure
    if noun == "block" and thing.opening and "box" in phrase.text.split():
        return sure  # "the box": a hollow one, whatever it is called
    if noun == "object" and thing.parent:
        sure *= PART
    if classes - lexicon.SHAPE_NOUNS and noun != "object":
        return 0.0  # a lamp is no cup, whatever its shape
    return lexicon.SHAPES.get(noun, {}).get(thing.shape, 0.0) * sure


def _strange(phrase: Phrase, thing: SceneObject) -> set[str]:
    """Words of a phrase that say which kind of its noun is meant, and that the thing's label has not."""
    return {*phrase.unknown, *phrase.kinds} - set(tokenise(thing.label))


def _label_classes(thing: SceneObject) -> set[str]:
    """The class of the label's last noun: a knife block is a block, a box lid a lid. Empty where it has none."""
    known = [c for word in tokenise(thing.label) if (c := noun_class(word))]
    return set(known[-1:])


def _button_score(thing: SceneObject, scene: Scene) -> float:
    classes = _label_classes(thing)
    if "button" in classes:
        return 1.0
    return (
        0.6 + 0.1 * bool(thing.parent)
        if not classes - lexicon.SHAPE_NOUNS and is_button(thing, scene)
        else 0.0
    )


def _colour_filter(colour: str, fits: Sequence[_Fit]) -> list[_Fit]:
    """Objects of the colour; where none is called so, those whose colour lies between that word and another."""
    exact = [f for f in fits if not colour or f.object.colour == colour]
    if exact or not colour:
        return exact
    return [_Fit(f.object, NEAR_COLOUR * f.score, True) for f in fits if _between(colour, f.object)]


def _between(colour: str, thing: SceneObject) -> bool:
    """Whether a thing's colour is so far from every word that people differ about which it is, this one among them."""
    seen = tuple(float(v) for v in thing.rgb)
    ((_, off),) = nearest_colours(seen, 1)
    return off >= BETWEEN and float(colour_distance(COLOURS[colour], seen)) < LEEWAY * off


def _single(phrase: Phrase, fits: Sequence[_Fit], scene: Scene) -> Grounded | Abstention:
    """The best fit, when nothing else fits as well."""
    if phrase.landmark is not None and fits:
        relation, where = phrase.landmark
        if relation == "beside" and where.noun in lexicon.PARTS:  # "by its handle"
            fits = [f for f in fits if part_named(scene, f.object, where.noun)] or list(fits)
        else:
            at = ground(where, scene)
            if isinstance(at, Grounded):
                there = located([f.object for f in fits], relation, at.object)
                fits = [f for f in fits if f.object in there]
            elif relation != "from" and not where.pronoun:
                return at
            # Where it is taken from need not be seen: "out of its holder".
    if not fits:
        return Abstention("nothing_matches", f"Nothing here is '{phrase.text}'; {_inventory(scene)}.")
    if len(fits) > 1 and phrase.noun and all(_strange(phrase, f.object) for f in fits):
        strange = " ".join(sorted(_strange(phrase, fits[0].object)))
        return Abstention(
            "nothing_matches",
            f"Which of {len(fits)} is '{strange}' cannot be told; {_inventory(scene)}.",
        )
    best = max(f.score for f in fits)
    tied = [f for f in fits if f.score >= TIE * best]
    for selector in phrase.selectors:
        if selector == "any":
            tied = [max(tied, key=lambda f: f.score)]
        else:
            kept = extreme([f.object for f in tied], selector, scene)
            tied = [f for f in tied if f.object in kept]
    if len(tied) > 1:
        names = ", ".join(_name(f.object) for f in tied)
        return Abstention(
            "ambiguous",
            f"'{phrase.text}' fits {len(tied)} things equally ({names}); say which, for example by side.",
        )
    chosen = tied[0]
    notes: tuple[str, ...] = ()
    if chosen.near_colour:
        notes = (f"Nothing is plainly {phrase.colour}; the {chosen.object.label} was taken for it.",)
    return Grounded(chosen.object, chosen.score, notes)


def _name(thing: SceneObject) -> str:
    x, y = thing.centre[:2]
    return f"{thing.label} at ({x:.2f}, {y:.2f})"


def _inventory(scene: Scene) -> str:
    labels = ", ".join(sorted(o.label for o in scene.objects))
    return f"the scene has: {labels}" if labels else "the scene is empty"
