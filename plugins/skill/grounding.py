"""From phrases to scene objects: which one is meant, or a typed reason why none is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from gvla2.planning.colours import FAMILIES, between, meant_by
from gvla2.planning.contracts import Abstention
from gvla2.planning.scene import Scene, SceneObject
from gvla2.planning.selecting import extreme, located
from gvla2.skills.part_hierarchy import is_button
from gvla2_plugins.skill import lexicon
from gvla2_plugins.skill.phrases import Phrase
from gvla2_plugins.skill.words import noun_class, tokenise, verbs_of

TIE = 0.9
"""Objects that fit this share of the best fit are as good as the best: only a selector parts them."""
NEAR_COLOUR, SAME_KIND = 0.7, 0.85
"""What is left of a fit by a colour between two, and by another word: "the box" is the box before the cube."""
PART = 0.6
"""What is left of a fit where a part of a thing is to be any thing."""
HOLDING = (*sorted(lexicon.SHAPE_NOUNS), "stand", "tower")
"""What people call what something is taken out of, whatever it looks like."""


@dataclass(frozen=True)
class Grounded:
    """The object meant, and what had to be assumed."""

    object: SceneObject
    notes: tuple[str, ...] = ()


Fits = list[tuple[SceneObject, float]]
"""Objects that a phrase may mean, and how well each fits it."""


def ground(
    phrase: Phrase, scene: Scene, *, movable: bool = False, exclude: frozenset[str] = frozenset()
) -> Grounded | Abstention:
    """The one object that a phrase means; ``movable`` leaves painted regions out, ``exclude`` are ids it cannot be."""
    pool = [o for o in scene.objects if o.id not in exclude and not (movable and o.shape == "region")]
    return _single(phrase, _of_colour(phrase, _fits(phrase, pool), scene), scene)


def ground_all(phrase: Phrase, scene: Scene) -> tuple[SceneObject, ...]:
    """All things of a scene that a phrase means, parts too: "the red ones", "the lids". Empty where nothing fits."""
    fits = _coloured(phrase.colour, _fits(phrase, scene.objects))
    best = max((s for _, s in fits), default=0.0)
    return tuple(o for o, s in fits if s >= TIE * best)


def ground_button(phrase: Phrase | None, scene: Scene) -> Grounded | Abstention:
    """The button that a phrase means, also where the phrase names the lamp that the button works."""
    phrase = phrase or Phrase("a button")
    buttons = [(o, s) for o in scene.objects if (s := _button_score(o, scene)) > 0]
    named = {o.id for o in scene.objects if set(phrase.unknown) & set(tokenise(o.label))}
    other = phrase.noun not in ("button", "lamp", "object", "") or (phrase.unknown and not phrase.noun)
    if other or (named and not named & {o.id for o, _ in buttons}):
        found = ground(phrase, scene, movable=True)
        if isinstance(found, Grounded) and not any(o is found.object for o, _ in buttons):
            return Abstention("nothing_matches", f"'{found.object.label}' is nothing to press.")
        return found
    lamps = [(o, 1.0) for o in scene.objects if _kind(o) == "lamp"]
    coloured = _coloured(phrase.colour, buttons)
    if phrase.noun == "lamp" and not coloured:  # "the red lamp": the colour may be the lamp's
        coloured = _parts_of(_coloured(phrase.colour, lamps), buttons)
    return _single(phrase, coloured, scene)


def strange(phrase: Phrase, thing: SceneObject) -> set[str]:
    """Words of a phrase that say which kind of its noun is meant, and that the thing's label has not."""
    return {*phrase.unknown, *phrase.kinds} - set(tokenise(thing.label))


def _fits(phrase: Phrase, things: Sequence[SceneObject]) -> Fits:
    return [(o, score) for o in things if (score := _noun_score(phrase, o)) > 0]


def _noun_score(phrase: Phrase, thing: SceneObject) -> float:
    """How well the phrase's noun fits an object, in [0, 1]: by its label first, then by its shape."""
    noun, kind, sure = phrase.noun, _kind(thing), 0.9 + 0.1 * thing.confidence
    contents = [w for w in phrase.unknown if w in lexicon.CONTENTS and w not in tokenise(thing.label)]
    usual = [colour for word in contents for colour in lexicon.CONTENTS[word]] if kind == "bottle" else []
    if usual and not any(meant_by(colour, [thing.colour]) for colour in usual):
        return 0.0  # mustard is no milk
    if not noun:
        if phrase.unknown[-1:] and phrase.unknown[-1] in tokenise(thing.label):
            return sure
        anything = not phrase.unknown and not phrase.everywhere
        known = sure if usual and len(phrase.unknown) == 1 else 0.0
        return 0.8 * sure * (PART if thing.parent else 1.0) if anything else known
    if noun == kind:
        own = [w for w in tokenise(thing.label)[:-1] if w not in FAMILIES and not verbs_of(w)]
        called = tokenise(thing.label)[-1] in phrase.text.split()  # "the box" is the box before the cube
        if own and strange(phrase, thing):
            return 0.0  # a knife block is no jenga block
        return sure * (1.0 if called else SAME_KIND)
    if noun == "object" and thing.parent:
        sure *= PART
    if kind and kind not in lexicon.SHAPE_NOUNS and noun != "object":
        return 0.0  # a lamp is no cup, whatever its shape
    return lexicon.SHAPES.get(noun, {}).get(thing.shape, 0.0) * sure


def _kind(thing: SceneObject) -> str:
    """The class of the label's last noun: a knife block is a block, a box lid a lid. "" where it has none."""
    return ([c for word in tokenise(thing.label) if (c := noun_class(word))] or [""])[-1]


def _button_score(thing: SceneObject, scene: Scene) -> float:
    if (kind := _kind(thing)) == "button":
        return 1.0
    return 0.6 if kind in ("", *lexicon.SHAPE_NOUNS) and is_button(thing, scene) else 0.0


def _parts_of(owners: Fits, fits: Fits) -> Fits:
    ids = {o.id for o, _ in owners}
    return [(o, s) for o, s in fits if o.parent in ids]


def _of_colour(phrase: Phrase, fits: Fits, scene: Scene) -> Fits:
    """The fits of the phrase's colour and owner; the colour may be a part's or its whole's: "the red jar lid"."""
    coloured = _coloured(phrase.colour, fits)
    if phrase.owner is None:
        wholes = _coloured(phrase.colour, [(o, 1.0) for o in scene.objects if not o.parent])
        plainly = any(s > NEAR_COLOUR for _, s in coloured)
        part = phrase.colour and phrase.noun in lexicon.PARTS and not plainly
        return (_parts_of(wholes, fits) if part else []) or coloured
    owner = ground(phrase.owner, scene)
    if isinstance(owner, Abstention) and phrase.colour and not phrase.owner.colour:
        owner, coloured = ground(replace(phrase.owner, colour=phrase.colour), scene), fits
    if isinstance(owner, Abstention):
        return coloured
    whole = [(owner.object, 1.0)]
    return _parts_of(whole, coloured) or _parts_of(whole, fits) or coloured


def _coloured(colour: str, fits: Fits) -> Fits:
    """Objects of the colour that is meant; where none is called so, those whose colour lies between two words."""
    name = meant_by(colour, (o.colour for o, _ in fits))
    exact = [(o, s) for o, s in fits if not colour or (name and o.colour == name)]
    return exact or [(o, NEAR_COLOUR * s) for o, s in fits if between(colour, o.rgb)]


def _single(phrase: Phrase, fits: Fits, scene: Scene) -> Grounded | Abstention:
    """The best fit, when nothing else fits as well."""
    inventory = f"the scene has: {', '.join(sorted(o.label for o in scene.objects)) or 'nothing'}"
    if phrase.landmark is not None and fits:
        relation, where = phrase.landmark
        if relation == "beside" and where.noun in lexicon.PARTS:  # "by its handle"
            fits = [f for f in fits if where.noun in map(_kind, scene.parts_of(f[0].id))] or fits
        else:
            near = ground(where, scene)
            if isinstance(near, Grounded):
                there = located([o for o, _ in fits], relation, near.object)
                fits = [f for f in fits if f[0] in there]
            elif not (where.pronoun or (relation == "from" and (where.noun in HOLDING or where.empty))):
                return near
            # Where it is taken from need not be seen: "out of its holder".
    if not fits:
        at = f" {phrase.landmark[0].replace('_', ' ')} '{phrase.landmark[1].text}'" if phrase.landmark else ""
        return Abstention("nothing_matches", f"Nothing here is '{phrase.text}'{at}; {inventory}.")
    best = max(fits, key=lambda f: f[1])
    tied = [o for o, s in fits if s >= TIE * best[1]]
    singled = [s for s in phrase.selectors if s != "any"]  # "the left one of the posts"
    for selector in singled or phrase.selectors:
        tied = [best[0]] if selector == "any" else extreme(tied, selector, scene)
    if len(tied) > 1:
        names = ", ".join(f"{o.label} at ({o.centre[0]:.2f}, {o.centre[1]:.2f})" for o in tied)
        return Abstention("ambiguous", f"'{phrase.text}' fits {names} equally; say which, by side perhaps.")
    plain = not phrase.colour or not tied[0].colour or meant_by(phrase.colour, [tied[0].colour])
    notes = () if plain else (f"Nothing is plainly {phrase.colour}; the {tied[0].label} was taken for it.",)
    return Grounded(tied[0], notes)
