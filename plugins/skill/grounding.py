"""From phrases to scene objects: which one is meant, or a typed reason why none is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gvla2.planning.colours import COLOURS, TOLD_APART, colour_distance, nearest_colours
from gvla2.planning.contracts import Abstention
from gvla2.planning.scene import Scene, SceneObject
from gvla2.skills.parts import is_button
from gvla2_plugins.skill import lexicon
from gvla2_plugins.skill.phrases import Phrase
from gvla2_plugins.skill.words import noun_class, tokenise

TIE = 0.9
"""Objects that fit this share of the best fit are as good as the best: only a selector parts them."""
NEAR_COLOUR = 0.7
OTHER_KIND, PART = 0.7, 0.6
"""What is left of a fit where the words before the noun are not the thing's, and where a part of a thing is to be
any thing."""
DOUBTFUL = 0.25
"""How well a thing of another shape fits, where its colour is the one that was named."""
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
    if phrase.owner is not None and fits:
        return _single(phrase, _owned(phrase, phrase.owner, fits, scene), scene)
    return _single(phrase, _of_owners(phrase, fits, scene) or _colour_filter(phrase.colour, fits), scene)


def ground_all(
    phrase: Phrase, scene: Scene, *, exclude: frozenset[str] = frozenset()
) -> tuple[SceneObject, ...]:
    """All movable things of a scene that a phrase in the plural means: "the red things", "every object".

    Parts, painted regions and ``exclude`` are none of them; nor are hollow things where any object is meant, since
    these are what others are put into. Empty where nothing fits.
    """
    pool = [o for o in scene.objects if o.id not in exclude and o.shape != "region" and not o.parent]
    if phrase.noun in ("", "object"):
        pool = [o for o in pool if not o.opening and not _label_classes(o) & lexicon.HOLLOW]
    fits = [_Fit(o, score) for o in pool if (score := _noun_score(phrase, phrase.noun, o)) > 0]
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
    if set(phrase.unknown) & set(tokenise(thing.label)):
        return sure
    if not noun:
        anything = not phrase.unknown and not phrase.everywhere
        return 0.8 * sure * (PART if thing.parent else 1.0) if anything else 0.0
    words = tokenise(thing.label)
    classes = _label_classes(thing)
    if noun in classes:
        other_kind = bool(phrase.kinds) and not set(phrase.kinds) & set(words)
        return OTHER_KIND * sure if other_kind else sure
    if noun == "block" and thing.opening and "box" in phrase.text.split():
        return sure  # "the box": a hollow one, whatever it is called
    alike = max((lexicon.ALIKE.get(noun, {}).get(c, 0.0) for c in classes), default=0.0)
    if alike:
        return alike * sure
    if noun == "object" and thing.parent:
        sure *= PART
    speaking = classes - lexicon.SHAPE_NOUNS
    if speaking and noun not in lexicon.SHAPE_NOUNS:
        return 0.0  # a lamp is no cup, whatever its shape
    fit = lexicon.SHAPE_FIT.get(noun, {}).get(thing.shape, 0.0)
    if not fit and phrase.colour == thing.colour != "" and thing.shape in lexicon.CONFUSED.get(noun, ()):
        fit = DOUBTFUL
    return fit * sure


def _label_classes(thing: SceneObject) -> set[str]:
    """The class of the label's last noun: a knife block is a block, a box lid a lid. Empty where it has none."""
    known = [c for word in tokenise(thing.label) if (c := noun_class(word))]
    return set(known[-1:])


def _button_score(thing: SceneObject, scene: Scene) -> float:
    if "button" in _label_classes(thing):
        return 1.0
    if not is_button(thing, scene):
        return 0.0
    return 0.6 + 0.1 * bool(thing.parent)


def _colour_filter(colour: str, fits: Sequence[_Fit]) -> list[_Fit]:
    """Objects of the colour; where none has it, those of a shade that one can take for it."""
    if not colour:
        return list(fits)
    exact = [f for f in fits if f.object.colour == colour]
    if exact:
        return exact
    gaps = {f.object.id: _gap(colour, f.object) for f in fits}
    nearest = min(gaps.values(), default=np.inf)
    # A second shade nearly as near leaves it open which one is meant: both stay, and tie.
    close = [f for f in fits if gaps[f.object.id] < TOLD_APART and gaps[f.object.id] < nearest + 8.0]
    return [_Fit(f.object, NEAR_COLOUR * f.score, True) for f in close]


def _gap(colour: str, thing: SceneObject) -> float:
    seen = tuple(float(v) for v in thing.rgb)
    shown = COLOURS.get(thing.colour, seen)
    by_word = float(colour_distance(COLOURS[colour], shown))
    ((_, off),) = nearest_colours(seen, 1)
    if off < BETWEEN:
        return by_word
    # A colour between the words: people differ about what it is called.
    by_sight = float(colour_distance(COLOURS[colour], seen))
    return min(by_word, TOLD_APART * by_sight / (LEEWAY * off))


def _single(phrase: Phrase, fits: Sequence[_Fit], scene: Scene) -> Grounded | Abstention:
    """The best fit, when nothing else fits as well."""
    if phrase.landmark is not None and fits:
        relation, where = phrase.landmark
        if relation == "beside" and where.noun in lexicon.PARTS:  # "by its handle"
            fits = [f for f in fits if part_named(scene, f.object, where.noun)] or list(fits)
        else:
            at = ground(where, scene)
            if isinstance(at, Grounded):
                others = [f for f in fits if f.object.id != at.object.id]
                fits = _located(others, relation, at.object)
            elif relation != "from" and not where.pronoun:
                return at
            # Where it is taken from need not be seen: "out of its holder".
    if not fits:
        return Abstention("nothing_matches", f"Nothing here is '{phrase.text}'; {_inventory(scene)}.")
    best = max(f.score for f in fits)
    tied = [f for f in fits if f.score >= TIE * best]
    for selector in phrase.selectors:
        tied = _selected(tied, selector, scene)
    if len(tied) > 1:
        names = ", ".join(_name(f.object) for f in tied)
        return Abstention(
            "ambiguous",
            f"'{phrase.text}' fits {len(tied)} things equally ({names}); say which, for example by side.",
        )
    chosen = tied[0]
    notes: tuple[str, ...] = ()
    if chosen.near_colour:
        seen = chosen.object.colour or "nearest"
        notes = (f"Nothing is {phrase.colour}; the {seen} {_noun(chosen.object)} was taken for it.",)
    elif phrase.noun and chosen.score <= DOUBTFUL:
        notes = (f"The {chosen.object.label} was taken for '{phrase.text}', by its colour alone.",)
    return Grounded(chosen.object, chosen.score, notes)


def _selected(fits: Sequence[_Fit], selector: str, scene: Scene) -> list[_Fit]:
    """The fits that a selector leaves: the extreme one, or all of equal rank."""
    if selector == "any":
        return [max(fits, key=lambda f: f.score)]
    base = np.array([scene.workspace.low[0], 0.5 * (scene.workspace.low[1] + scene.workspace.high[1])])
    middle = np.mean([f.object.centre[:2] for f in fits], axis=0)

    def rank(f: _Fit) -> float:
        o = f.object
        match selector:
            case "left":
                return -float(o.centre[1])
            case "right":
                return float(o.centre[1])
            case "near":
                return float(np.linalg.norm(o.centre[:2] - base))
            case "far":
                return -float(np.linalg.norm(o.centre[:2] - base))
            case "middle":
                return float(np.linalg.norm(o.centre[:2] - middle))
            case "big":
                return -float(np.prod(o.extents))
            case "small":
                return float(np.prod(o.extents))
            case "tall":
                return -float(o.extents[2])
            case _:
                return float(o.extents[2])

    ranks = [rank(f) for f in fits]
    # Sizes and places that perception cannot tell apart do not decide: 5 % of a size, 5 mm of a place.
    sizes = selector in ("big", "small", "tall", "short")
    slack = 0.05 * abs(min(ranks)) if sizes else 0.005
    return [f for f, r in zip(fits, ranks, strict=True) if r <= min(ranks) + slack]


def _located(fits: Sequence[_Fit], relation: str, at: SceneObject) -> list[_Fit]:
    """The fits that are where the relation to the landmark says; of several, the nearest to it."""

    def holds(o: SceneObject) -> bool:
        dx, dy = (o.centre - at.centre)[:2]
        reach = 0.5 * float(np.linalg.norm(at.extents[:2]))
        match relation:
            case "on" | "in" | "to" | "from":
                return bool(np.hypot(dx, dy) < reach + 0.01) or o.parent == at.id
            case "left_of":
                return bool(dy > 0.01)
            case "right_of":
                return bool(dy < -0.01)
            case "behind":
                return bool(dx > 0.01)
            case "front_of":
                return bool(dx < -0.01)
        return True

    there = [f for f in fits if holds(f.object)]
    if not there:
        return []
    gaps = [float(np.linalg.norm((f.object.centre - at.centre)[:2])) for f in there]
    return [f for f, g in zip(there, gaps, strict=True) if g <= min(gaps) + 0.005]


def _name(thing: SceneObject) -> str:
    x, y = thing.centre[:2]
    return f"{thing.label} at ({x:.2f}, {y:.2f})"


def _noun(thing: SceneObject) -> str:
    return thing.label.removeprefix(thing.colour).strip() or "one"


def _inventory(scene: Scene) -> str:
    labels = ", ".join(sorted(o.label for o in scene.objects))
    return f"the scene has: {labels}" if labels else "the scene is empty"
